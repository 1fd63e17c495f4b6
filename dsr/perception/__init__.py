"""What cameras say of things, as their RT edges: which of it is new, and how sure it is."""
