"""How often each kind of failure of the belief occurs in random episodes that are drawn to show it."""
