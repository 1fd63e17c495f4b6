"""Solves for the pose of a camera from its percepts: methods, their problem and their outcome."""
