"""Checks a scenario file for faults and doubts, and plays its true course without any agent."""
