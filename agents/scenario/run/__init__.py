"""Runs of scenarios: one or many, in lockstep or live, and their display in the terminal."""
