"""Learns the parameters of the weighted worlds from episodes of the tuning families."""
