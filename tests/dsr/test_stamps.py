"""Forged stamps in whole memories: grants, worlds, filters; and what is told of them."""

from __future__ import annotations

import pytest

from dsr import AgentError, ClockDriftError, Memory, Pose
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import TOMBSTONE, Delta, Write
from dsr.crdt.hlc import MAX_LEAD, MAX_STAMP, stamp_at
from dsr.errors import WireError
from dsr.graph.access import Access, WriteGuard
from dsr.graph.elements import Edge, Node
from dsr.replication.wire import Digest, decode_delta, encode_delta, encode_digest
from tests.dsr.conftest import Net

DAY = 86_400.0


class Forger:
    """Somebody who writes raw deltas into a world of the graph."""

    def __init__(self, net: Net, agent: str = "forger") -> None:
        self._net, self._rid, self._count = net, f"{agent}-1", 0
        self._transport = net.network.connect(agent)

    def stamp(self, memory: Memory, element: Node | Edge, attribute: str, stamp: int, value: object) -> None:
        """Write a value to each incarnation that the memory shows, and let it arrive."""
        for owner in element.created:
            self._count += 1
            dot: Dot = (self._rid, self._count)
            write = Write(owner, attribute, stamp, self._rid, dot, value)
            delta = Delta(writes=[write], context=[(*dot, dot[1])])
            self._transport.publish(memory.keys.delta(self._rid), encode_delta(delta))
        self._net.pump(0.2)


@pytest.fixture
def forger(net: Net) -> Forger:
    return Forger(net)


def tower(memory: Memory) -> None:
    memory.add_node("table", "table")
    memory.add_node("cube", "cube", mass=1.0, seen=3)
    memory.add_edge("table", "cube", "RT", pose=Pose((1, 0, 0)))
    memory.add_edge("cube", "table", "on", source="contact")


def test_a_value_with_the_greatest_stamp_is_overwritten_everywhere_and_nothing_else_is_lost(
    net: Net, forger: Forger
) -> None:
    a, b = net.join("a"), net.join("b")
    tower(a)
    net.pump(1.0)
    forger.stamp(a, a.node("cube"), "seen", MAX_STAMP, -1)
    assert b.node("cube")["seen"] == -1
    b.update_node("cube", seen=4)
    net.pump(1.0)
    c = net.join("c")
    net.pump(2.0)
    for memory in (a, b, c):
        assert dict(memory.node("cube")) == {"mass": 1.0, "seen": 4}
        assert memory.edge("table", "cube", "RT").pose.t == (1, 0, 0)
        assert memory.edge("cube", "table", "on")["source"] == "contact"
    assert c.far_stamps() == []


@pytest.mark.parametrize("stamp", [stamp_at(2e9), 1 << 62, MAX_STAMP - 1, MAX_STAMP])
def test_what_was_taken_away_or_is_an_edge_or_a_stream_likewise(net: Net, forger: Forger, stamp: int) -> None:
    a, b = net.join("a"), net.join("b")
    tower(a)
    net.pump(1.0)
    forger.stamp(a, a.node("cube"), "mass", stamp, TOMBSTONE)
    forger.stamp(a, a.edge("table", "cube", "RT"), "pose", stamp, Pose((9, 9, 9)))
    assert "mass" not in b.node("cube") and b.edge("table", "cube", "RT").pose.t == (9, 9, 9)
    for step in range(3):
        for memory, other in ((a, b), (b, a)):
            memory.update_node("cube", mass=float(step))
            memory.update_edge("table", "cube", "RT", translation=(step, 0, 0))
            net.pump(1.2)  # a sample for what has just been made may need the repair
            assert other.node("cube")["mass"] == step and other.edge("table", "cube", "RT").pose.t == (step, 0, 0)
    a.remove_attribute("cube", "mass")
    a.remove_attribute(a.edge("table", "cube", "RT"), "pose")
    net.pump(0.2)
    assert "mass" not in b.node("cube") and "pose" not in b.edge("table", "cube", "RT")


def test_who_may_not_make_it_anew_is_told_what_is_missing(net: Net, forger: Forger) -> None:
    a = net.join("a")
    narrow = net.join("narrow", guard=WriteGuard("narrow", Access(("cube",), (), ("seen",))))
    tower(a)
    net.pump(1.0)
    forger.stamp(a, a.node("cube"), "seen", MAX_STAMP - 1, -1)
    narrow.update_node("cube", seen=5)
    with pytest.raises(AgentError, match=r"'seen' of 'cube' has the greatest stamp.*'mass'"):
        narrow.update_node("cube", seen=6)
    net.pump(1.0)
    assert a.node("cube")["seen"] == narrow.node("cube")["seen"] == 5
    assert len(a.node("cube").created) == 1 and a.get_edge("cube", "table", "on")


def test_a_greater_stamp_than_the_greatest_is_no_message() -> None:
    with pytest.raises(WireError):
        decode_delta(encode_delta(Delta(writes=[Write(("a", 1), "seen", MAX_STAMP + 1, "a", ("a", 2), 1)])))


def test_stamps_of_others_move_a_clock_by_a_day_at_most(net: Net, forger: Forger) -> None:
    a = net.join("a")
    tower(a)
    for ahead in (0.9 * MAX_LEAD, 1.1 * MAX_LEAD, 30 * DAY):
        forger.stamp(a, a.node("cube"), "seen", stamp_at(net.clock.now() + ahead), -1)
        a.update_node("cube", mass=2.0)
        written = a.node("cube").written_at("mass") or 0.0
        assert 0.8 * MAX_LEAD < written - net.clock.now() < MAX_LEAD


def test_the_forger_is_told_once_and_who_overwrites_is_not(
    net: Net, forger: Forger, caplog: pytest.LogCaptureFixture
) -> None:
    a, b = net.join("a"), net.join("b")
    tower(a)
    net.pump(1.0)
    for stamp in (1 << 61, 1 << 62):
        forger.stamp(a, a.node("cube"), "seen", stamp, -1)
        for value in range(20):
            b.update_node("cube", seen=value)
            net.pump(0.1)
    assert a.far_stamped == b.far_stamped == {"forger": 2}
    assert a.statistics.far_stamps == 2
    (found,) = a.far_stamps()
    assert (found.element, found.type, found.attribute, found.writer) == ("cube", "cube", "seen", b.rid)
    told = [record.getMessage() for record in caplog.records if "days ahead" in record.getMessage()]
    assert len(told) == 2 and all("forger-1" in text for text in told)  # once in each memory


def test_an_honest_clock_that_is_a_day_off_is_not_called_a_forger(net: Net, forger: Forger) -> None:
    """One follows a stamp at the bound; another one, whose own clock is behind, sees that."""
    a, b = net.join("a"), net.join("b")
    tower(a)
    net.pump(1.0)
    forger.stamp(a, a.node("cube"), "seen", stamp_at(net.clock.now() + MAX_LEAD), -1)
    a.update_node("cube", mass=2.0)
    net.pump(1.0)
    assert a.far_stamped == b.far_stamped == {}


def test_agents_that_are_made_up_take_no_memory(net: Net) -> None:
    a = net.join("a")
    tower(a)
    owner = a.node("cube").created[0]
    writes = [Write(owner, "seen", MAX_STAMP - n * stamp_at(2.0), f"x{n}-1", None, n) for n in range(1500)]
    a.restore(encode_delta(Delta(writes=writes)))
    assert len(a.far_stamped) == 1001 and a.far_stamped["others"] == 500


def test_cleaning_leaves_what_is_shown_and_honest_stamps(net: Net, forger: Forger) -> None:
    a, b = net.join("a"), net.join("b")
    tower(a)
    net.pump(1.0)
    made = a.node("cube").written_at("mass")
    forger.stamp(a, a.node("cube"), "seen", 1 << 62, 8)
    forger.stamp(a, a.edge("table", "cube", "RT"), "pose", MAX_STAMP, Pose((2, 0, 0)))
    before = {edge.key: dict(edge) for edge in a.edges()}
    assert len(b.clean_stamps().renewed) == 2
    net.pump(1.0)
    for memory in (a, b):
        assert memory.far_stamps() == [] and {edge.key: dict(edge) for edge in memory.edges()} == before
        assert dict(memory.node("cube")) == {"mass": 1.0, "seen": 8}
        assert memory.node("cube").written_at("mass") == made
        assert abs((memory.node("cube").written_at("seen") or 0.0) - net.clock.now()) < 5.0
    assert a.clean_stamps().renewed == []


def test_poses_that_cannot_be_overwritten_are_made_anew_when_many_are_written(net: Net, forger: Forger) -> None:
    a, b = net.join("a"), net.join("b")
    tower(a)
    a.add_node("ball", "ball")
    a.add_edge("table", "ball", "RT", pose=Pose((0, 0, 0)))
    net.pump(1.0)
    for name in ("cube", "ball"):
        forger.stamp(a, a.edge("table", name, "RT"), "pose", MAX_STAMP, Pose((2, 0, 0)))
    a.update_poses("RT", {("table", name): Pose((3, 0, 0)) for name in ("cube", "ball")})
    net.pump(1.0)
    for memory in (a, b):
        assert [memory.edge("table", name, "RT").pose.t[0] for name in ("cube", "ball")] == [3.0, 3.0]


def test_who_may_not_clean_an_element_is_told_and_cleans_the_others(net: Net, forger: Forger) -> None:
    a, narrow = net.join("a"), net.join("narrow", guard=WriteGuard("narrow", Access(("ball",), (), ("seen",))))
    tower(a)
    a.add_node("ball", "ball", seen=1)
    net.pump(1.0)
    for name in ("cube", "ball"):
        forger.stamp(a, a.node(name), "seen", 1 << 62, 8)
    done = narrow.clean_stamps()
    assert [stamp.element for stamp in done.renewed] == ["ball"] and "cube" in done.refused["cube"]
    net.pump(1.0)
    assert [stamp.element for stamp in a.far_stamps()] == ["cube"]


def test_a_process_whose_clock_is_behind_does_not_clean(net: Net) -> None:
    a = net.join("a")
    tower(a)
    for agent in ("x", "y"):
        digest = Digest(f"{agent}-1", net.clock.now() + DAY, CausalContext().summary(), 0, ())
        net.network.connect(agent).publish(a.keys.digest(digest.replica), encode_digest(digest))
    net.pump(0.1)
    assert a.clocks.is_behind
    with pytest.raises(ClockDriftError, match="behind most others"):
        a.clean_stamps()
    a.update_node("cube", seen=1)  # to write is no harm


def test_overlays_write_over_what_is_forged_in_them_and_below(net: Net, forger: Forger) -> None:
    a = net.join("a")
    tower(a)
    over = a.fork("over", follow=True)
    net.pump(1.0)
    forger.stamp(a, a.node("cube"), "seen", MAX_STAMP, -1)
    for value in (5, 6):
        over.update_node("cube", seen=value)
        assert over.node("cube")["seen"] == value and a.node("cube")["seen"] == -1
    assert over.node("cube").created == a.node("cube").created, "a stamp of the parent alone detaches nothing"
    forger.stamp(over, over.node("cube"), "seen", MAX_STAMP, -2)
    assert over.node("cube")["seen"] == -2
    over.update_node("cube", seen=7)
    assert dict(over.node("cube")) == {"mass": 1.0, "seen": 7} and a.node("cube")["seen"] == -1
    assert over.get_edge("cube", "table", "on") and over.edge("table", "cube", "RT").pose.t == (1, 0, 0)


def test_a_write_in_an_overlay_is_newer_than_what_it_replaces_below(net: Net) -> None:
    """The parent has the stamp of a clock that is an hour fast; the overlay's is right."""
    a = net.join("a")
    tower(a)
    over = a.fork("over", follow=True)
    fast = Forger(net, "fast")
    fast.stamp(a, a.node("cube"), "seen", stamp_at(net.clock.now() + 3600.0), 5)
    over.update_node("cube", seen=6)
    below, above = a.node("cube").newest_write("seen"), over.node("cube").newest_write("seen")
    assert below is not None and above is not None and above.stamp > below.stamp


def test_forged_stamps_are_not_copied_into_other_worlds(net: Net, forger: Forger) -> None:
    a = net.join("a")
    tower(a)
    target = a.create_world("target")
    forger.stamp(a, a.node("cube"), "seen", MAX_STAMP, -1)
    assert target.copy(a.node("cube")) and target.node("cube")["seen"] == -1
    assert target.far_stamps() == [] and not target.copy(a.node("cube")), "once repeated, nothing is to be written"
    a.update_node("cube", seen=2)
    assert target.copy(a.node("cube")) and target.node("cube")["seen"] == 2
