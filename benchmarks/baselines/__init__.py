"""Methods as papers published them, beside which ours are measured; entry points of pyproject.toml name them."""
