"""A model of how replicas join, remove and repair, its checker, and its traces run against the real store."""
