"""A command may end when all others have what it wrote, and not before."""

from __future__ import annotations

from dsr import Faults, Pose
from tests.dsr.conftest import Net


def test_it_is_delivered_when_all_told_so(net: Net) -> None:
    writer, _, _ = net.join("writer"), net.join("a"), net.join("b")
    net.pump(1.5)
    sync = writer.replica.synchroniser
    assert sync.delivered
    writer.add_node("world", "world")
    assert not sync.delivered
    net.pump(1.5, Faults(loss=1.0))
    assert not sync.delivered
    net.pump(4.0)
    assert sync.delivered


def test_a_sample_of_a_stream_is_not_delivered_before_it_is_durable(net: Net) -> None:
    writer, reader = net.join("writer"), net.join("reader")
    writer.add_node("world", "world")
    writer.add_node("cube_1", "cube")
    writer.add_edge("world", "cube_1", "RT", pose=Pose())
    net.pump(3.0)
    assert writer.replica.synchroniser.delivered
    writer.update_edge("world", "cube_1", "RT", pose=Pose((1.0, 0.0, 0.0)))
    assert not writer.replica.synchroniser.delivered
    net.pump(3.0)
    assert writer.replica.synchroniser.delivered
    assert reader.edge("world", "cube_1", "RT").pose.t == (1.0, 0.0, 0.0)
