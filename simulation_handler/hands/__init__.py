"""Human hands: what they touch, cover, carry and leave behind."""
