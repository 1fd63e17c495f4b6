"""The attacks, one file for each kind; each file has a list `ATTACKS`."""
