"""Files that may come from anywhere, and files that belong to one user alone."""
