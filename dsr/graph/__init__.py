"""The replicated graph of one process: nodes, edges, their schema, and followers of their changes."""
