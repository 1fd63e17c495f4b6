"""An overlay of a world that is dropped for another one of its name goes on over that one, with what it held."""

from __future__ import annotations

import pytest

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
