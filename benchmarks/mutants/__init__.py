"""Changes the sources at random places, one at a time, and tells which tests notice: what the tests catch."""
