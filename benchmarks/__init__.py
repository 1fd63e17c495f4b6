"""Measurements, as ratios against a peer or a limit in the same run; each module is a command, but for `tag_camera`."""
