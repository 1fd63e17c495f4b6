"""Hand-eye calibration of a real camera from images of a target: targets, views, the fit and what is told of it."""
