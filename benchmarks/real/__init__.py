"""Measures on recordings of others, which are not part of this project: `python -m benchmarks.real NAME --data DIR`."""
