"""Benchmarks against the yardsticks people would use, on the same arrays, in one run."""
