"""Methods that everyone knows."""
