"""Parts of the base graph, of which each process holds only those that it asks for."""
