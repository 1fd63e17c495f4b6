"""The state of the belief: the records of all objects, and their bodies."""
