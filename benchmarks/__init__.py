"""Speed beside accuracy, measured on the same work: `python -m benchmarks`, or `make bench`."""
