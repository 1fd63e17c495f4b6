"""Cameras that may have moved: what is seen of them view by view, doubt, and calibrations that begin by themselves."""
