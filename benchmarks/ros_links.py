"""Rows of our link to ROS 2, from one process to another, and of the bridge; they need the extra `ros`."""

from __future__ import annotations

from benchmarks.group import Group, Run
from benchmarks.rows import Spec

_ABOUT = "encoded, sent, received and decoded; peer: raw Zenoh with as many bytes, until its callback has them"
IMAGE = Spec("ROS 2 image 640x480 at 30 Hz, one way, p50 over raw Zenoh", "x", 1.2, about=_ABOUT)
TF = Spec("ROS 2 tf of a frame at 100 Hz, one way, p50 over raw Zenoh", "x", 1.3, about=_ABOUT)
_BRIDGE = "ROS 2 tf of 100 frames at 100 Hz"
TF_IN = Spec(
    f"{_BRIDGE} into the memory, the bridge's process", "cores", 0.15,
    about="with all its threads; peer: a memory that writes the edges 50 times a second, as the bridge does",
)  # fmt: skip
TF_OUT = Spec(
    f"{_BRIDGE} out of the memory, the bridge's process", "cores", 0.15,
    about="with all its threads; peer: a memory that hears the edges 100 times a second, as the bridge does",
)  # fmt: skip
EDGE = Spec(
    "ROS 2 tf to an edge in another process than the bridge's, p50 over raw Zenoh", "x", 1.3,
    about="encoded to readable; peers: as many bytes forwarded by a third process, and the memory's share without ROS",
)  # fmt: skip


def measure(run: Run) -> None:
    """Measure all rows, if the messages of ROS can be encoded here."""
    if run.has("rosbags"):
        from benchmarks.ros_bridge import measure as measure_bridge
        from benchmarks.ros_topics import measure as measure_topics

        measure_topics(run)
        measure_bridge(run)


GROUP = Group("ros", [IMAGE, TF, TF_IN, TF_OUT, EDGE], measure)
