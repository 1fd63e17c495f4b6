"""Rows of images and transforms over our link to ROS 2, from one process to another; they need the extra `ros`."""

from __future__ import annotations

from benchmarks.group import Group, Run
from benchmarks.rows import Spec

_ABOUT = "encoded, sent, received and decoded; peer: raw Zenoh with as many bytes, until its callback has them"
IMAGE = Spec("ROS 2 image 640x480 at 30 Hz, one way, p50 over raw Zenoh", "x", 1.2, about=_ABOUT)
TF = Spec("ROS 2 tf of a frame at 100 Hz, one way, p50 over raw Zenoh", "x", 1.3, about=_ABOUT)


def measure(run: Run) -> None:
    """Measure both rows, if the messages of ROS can be encoded here."""
    if run.has("rosbags"):
        from benchmarks.ros_topics import measure as measure_topics

        measure_topics(run)


GROUP = Group("ros", [IMAGE, TF], measure)
