"""What the belief keeps of each object, and the bodies of all."""
