"""One episode: the closed loop of controllers in a world."""
