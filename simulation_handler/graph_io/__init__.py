"""Between the graph and the belief: what is read, what is written, and questions that are answered."""
