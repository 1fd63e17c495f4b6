"""What the agent does: a module for each concept and direction, with what they share in `core.py`."""
