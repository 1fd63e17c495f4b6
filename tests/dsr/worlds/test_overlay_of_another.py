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
