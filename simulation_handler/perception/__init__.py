"""Percepts over time, and how much of each object a camera should see."""
