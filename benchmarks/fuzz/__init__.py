"""Mutated messages against every decoder and every key: what gets through, and what it costs."""
