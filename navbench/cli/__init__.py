"""The command line and what it needs; the only package that knows Hydra."""
