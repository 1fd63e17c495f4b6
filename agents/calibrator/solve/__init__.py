"""The pose of a camera from what it sees: methods, their problem and their outcome."""
