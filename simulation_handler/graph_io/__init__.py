"""Connects the graph and the belief: reading, writing, and answers to questions."""
