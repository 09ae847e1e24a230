"""The loop: one episode of controllers in a world."""
