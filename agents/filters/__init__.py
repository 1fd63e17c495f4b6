"""Standard filters: worlds derived from others by their content. Each module is one, and a program."""
