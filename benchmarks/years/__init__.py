"""Years of the whole memory on one seed in one process, with every fault that can be simulated."""
