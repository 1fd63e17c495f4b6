"""The scenario file format: its parts as structs, reading, and what must be consistent."""
