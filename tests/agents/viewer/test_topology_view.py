"""Worlds and agents as boxes and arrows."""

from __future__ import annotations

import rerun as rr

from agents.inbox import Message
from agents.viewer.topology_view import TopologyView, arrange
from dsr import WorldInfo
from dsr.runtime.activity import WorldUse
from dsr.runtime.status import MOST_AGENTS, State, Status, encode_status
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


def test_of_few_agents_something_is_kept_and_nobody_speaks_for_another() -> None:
    view = TopologyView(rr.RecordingStream("test"))
    for number in range(MOST_AGENTS + 9):
        name = f"a{number}"
        view.note_status(Message(0.0, f"dsr/v1/g/status/{name}", encode_status(status(name, "base"))))
        view.note_status(Message(0.0, "dsr/v1/g/status/liar", encode_status(status(name, "other"))))
    assert len(view._statuses) == MOST_AGENTS
    assert {use.world for one in view._statuses.values() for use in one.worlds} == {"base"}


def test_circles_and_missing_worlds_are_drawn_too() -> None:
    found = topology([WorldInfo("a"), WorldInfo("b")], [status("f", "a", "b"), status("g", "b", "a"), status("h", "c")])
    boxes, arrows = arrange(found)
    assert len(boxes) == 6 and len(arrows) == 5
    assert "world c (waited for)" in [box.label for box in boxes]
    assert arrange(topology([], [])) == ([], [])
