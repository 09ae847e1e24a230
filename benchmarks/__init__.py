"""Speed and memory, measured in one run with peers beside: ``python -m benchmarks``."""
