"""The replicated graph of one process: nodes, edges, their schema, and what follows their changes."""
