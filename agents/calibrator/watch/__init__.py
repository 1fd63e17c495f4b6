"""Watches cameras that may have moved: their views, doubts, and calibrations that begin by themselves."""
