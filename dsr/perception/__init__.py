"""Reads percepts, the RT edges that cameras write: which are new, and how certain they are."""
