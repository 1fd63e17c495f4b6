"""Standard filters: worlds made from others by what is in them. Each module is one, and a program."""
