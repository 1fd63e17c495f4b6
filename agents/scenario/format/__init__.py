"""The scenario file format: its parts as structs, reading, and checks of consistency."""
