"""Human hands: the objects that they touch, cover, carry and leave behind."""
