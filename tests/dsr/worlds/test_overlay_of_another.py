"""An overlay of a world that is dropped for another one of its name goes on over that one, with what it held."""

from __future__ import annotations

import pytest

import dsr
from tests.dsr.conftest import Net


@pytest.mark.parametrize("later", ["a", "b"])
def test_an_overlay_goes_on_over_the_world_that_is_there_now(net: Net, later: str) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    a.add_node("base_cube", "cube")
    net.pump(1.0)
    net.network.partition(["a"], ["b"])
    net.pump(1.0)
    for memory in (a, b) if later == "b" else (b, a):  # an empty world, and one that shows the base
        if memory is a:
            memory.create_world("shown").add_node("only_there", "cube")
        else:
            memory.fork("shown", follow=True)
        net.pump(1.0)
    mine = [memory.fork(f"over_{memory.agent}", of="shown", follow=True) for memory in (a, b)]
    for overlay in mine:
        overlay.add_node(f"of_{overlay.agent}", "cube", seen=1)
    net.network.heal()
    net.pump(10.0)
    for name in ("over_a", "over_b"):
        opened = [memory.world(name) for memory in (a, b)]
        net.pump(3.0)
        views = [{node.name for node in world.nodes()} for world in opened]
        assert views[0] == views[1] >= {f"of_{name[-1]}"}
    assert sum(overlay.closed for overlay in mine) == 1, "only one of them showed what was dropped"


def test_overlays_that_come_to_show_one_another_are_dropped_and_can_be_deleted(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    b.create_world("w")
    a.create_world("v")
    mine = [a.fork("w", of="v", follow=True), b.fork("v", of="w", follow=True)]  # neither knows of the other's yet
    net.pump(5.0)
    assert {info.name: info.parent for info in a.worlds()} == {"base": None, "v": "w", "w": "v"}
    assert all(overlay.closed for overlay in mine)
    with pytest.raises(dsr.WorldNotFoundError, match="show one another"):
        a.world("w")
    a.delete_world("w")
    net.pump(2.0)
    assert [info.name for info in b.worlds()] == ["base", "v"]


def test_an_overlay_of_an_overlay_shows_what_others_add_under_a_name_that_it_hides(net: Net) -> None:
    a, b = net.join("a"), net.join("b")
    net.pump(2.0)
    a.add_node("thing", "cube", seen=1)
    net.network.partition(["a"], ["b"])
    b.add_node("thing", "cube", seen=2)  # another one of the same name
    a.fork("lower", follow=True)
    upper = a.fork("upper", of="lower", follow=True)
    upper.remove_node("thing")
    net.network.heal()
    net.pump(5.0)
    assert a.node("thing")["seen"] in (1, 2)
    assert upper.node("thing")["seen"] == 2, "only the one that was there then was removed"


@pytest.mark.parametrize("other", ["base", "shown"])
def test_of_copies_of_an_overlay_that_are_made_at_the_same_time_one_stays(net: Net, other: str) -> None:
    a, b, c = (net.join(name) for name in "abc")
    net.pump(2.0)
    a.add_node("thing", "cube", seen=1)
    a.fork("shown", follow=True).update_node("thing", seen=2)
    net.pump(2.0)
    b.world("shown")
    net.pump(2.0)
    a.update_node("thing", seen=3)
    net.pump(2.0)
    mine = [a.fork("copy", of="shown"), b.fork("copy", of=other)]  # neither knows of the other's yet
    net.pump(5.0)
    assert sum(copy.closed for copy in mine) == 1
    opened = [memory.world("copy") for memory in (a, b, c)]
    net.pump(3.0)
    values = {copy.node("thing")["seen"] for copy in opened}
    assert values == ({2} if mine[1].closed or other == "shown" else {3})
