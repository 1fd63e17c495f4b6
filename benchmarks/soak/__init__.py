"""Faults on purpose: real processes write while links are cut and processes die, and a judge counts what was lost."""
