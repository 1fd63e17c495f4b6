"""Where things may be: distributions of the belief, and their leading alternatives as worlds."""
