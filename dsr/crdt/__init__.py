"""The replicated data types under the graph: pure state, no I/O and no clock reads."""
