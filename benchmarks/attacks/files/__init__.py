"""Hostile files: small ones that cost far more to read than they are large."""
