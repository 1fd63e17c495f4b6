"""Random episodes: scenario files drawn by family and seed, valid by the plant alone."""
