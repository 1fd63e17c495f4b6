"""Keeping a graph: JSON files that people edit, CORTEX files, and the state of a running system."""
