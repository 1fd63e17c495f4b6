"""How agents live: as processes under a launcher, or all in one process in lockstep."""
