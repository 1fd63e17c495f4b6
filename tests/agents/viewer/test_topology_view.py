"""Worlds and agents as boxes and arrows."""

from __future__ import annotations

from agents.viewer.topology_view import arrange
from dsr import WorldInfo
from dsr.runtime.activity import WorldUse
from dsr.runtime.status import State, Status
from dsr.runtime.topology import topology


def status(agent: str, reads: str = "", writes: str = "", hz: float = 5.0) -> Status:
    uses = [WorldUse(world=reads, reads=True, read_hz=hz)] if reads else []
    uses += [WorldUse(world=writes, writes=True, write_hz=hz)] if writes else []
    return Status(agent=agent, rid=f"{agent}-1", pid=1, state=State.READY, worlds=uses)


def test_content_flows_from_the_left_to_the_right() -> None:
    found = topology(
        [WorldInfo("base"), WorldInfo("stable")],
        [status("camera", writes="base"), status("physics", "base", "stable"), status("viewer", "stable")],
    )
    boxes, arrows = arrange(found)
    x = {box.id: box.x for box in boxes}
    assert x["agent:camera"] < x["world:base"] < x["agent:physics"] < x["world:stable"] < x["agent:viewer"]
    assert ("agent:physics", "world:stable") in arrows and ("world:base", "agent:physics") in arrows
    assert len({(box.x, box.y) for box in boxes}) == len(boxes)


def test_circles_and_missing_worlds_are_drawn_too() -> None:
    found = topology([WorldInfo("a"), WorldInfo("b")], [status("f", "a", "b"), status("g", "b", "a"), status("h", "c")])
    boxes, arrows = arrange(found)
    assert len(boxes) == 6 and len(arrows) == 5
    assert "world c (waited for)" in [box.label for box in boxes]
    assert arrange(topology([], [])) == ([], [])
