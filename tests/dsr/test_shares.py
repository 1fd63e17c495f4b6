"""Of too many elements each agent has its share, however many one of them makes."""

from __future__ import annotations

from dsr.graph.shares import makers, shared_out
from tests.dsr.conftest import Net


def test_who_makes_many_leaves_room_for_others(net: Net) -> None:
    busy, quiet = net.join("busy"), net.join("quiet")
    for number in range(20):
        busy.add_node(f"a_{number:02}", "cube")
    for number in range(3):
        quiet.add_node(f"z_{number}", "cube")
    net.pump(2.0)
    for memory in (busy, quiet):
        nodes = sorted(memory.nodes("cube"), key=lambda node: node.name)
        found = [node.name for node in shared_out(nodes, 8)]
        assert found == ["a_00", "a_01", "a_02", "a_03", "a_04", "z_0", "z_1", "z_2"]
        assert shared_out(nodes, 23) == nodes and shared_out(nodes, 0) == []


def test_what_several_made_at_once_counts_for_who_has_least(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(1.0)
    for number in range(5):
        a.add_node(f"a_{number}", "cube")
    a.add_node("shared", "cube")
    b.add_node("shared", "cube")
    net.pump(2.0)
    assert makers(a.node("shared")) == {"a", "b"}
    nodes = sorted(a.nodes("cube"), key=lambda node: node.name)
    assert "shared" in [node.name for node in shared_out(nodes, 2)]
