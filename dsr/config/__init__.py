"""Configuration: plain data and TOML files checked against types."""
