"""Measurements on recordings of others: real images, beside others' programs on the same files."""
