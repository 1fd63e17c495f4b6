"""The worlds of the system as a graph: which agents provide and which read them, and whether anything flows."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping

import msgspec
import rerun as rr

from agents.inbox import Message
from agents.viewer import palette
from agents.viewer.palette import Color
from agents.viewer.texts import drawable
from dsr import Memory, WireError
from dsr.runtime.status import Status, decode_status, keep_newest
from dsr.runtime.topology import Topology, topology

ENTITY = "worlds"
_COLUMN, _ROW = 220.0, 70.0
"""px"""
_GOLDEN = (5.0**0.5 - 1.0) / 2.0
_FASTEST_TOLD = 0.5
"""Changes a second from which on a world counts as active."""


class PlacedBoxes(msgspec.Struct, frozen=True):
    """A box of the drawing."""

    id: str
    label: str
    color: Color
    x: float
    y: float


class TopologyView:
    """Logs worlds and agents as boxes, and as arrows who writes and who reads; only when something has changed."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._statuses: dict[str, Status] = {}
        self._shown: object = None

    def note_status(self, message: Message) -> None:
        """Take down what an agent tells of its worlds; malformed statuses, and those on others' keys, are left out."""
        with contextlib.suppress(WireError):
            status = decode_status(message.payload)
            if status.agent == message.key.rpartition("/")[2]:
                keep_newest(self._statuses, status.agent, status)

    def draw(self, memory: Memory) -> None:
        """Log the graph if it has changed."""
        boxes, arrows = arrange(topology(memory.worlds(), self._statuses.values()))
        if (boxes, arrows) == self._shown:
            return
        self._shown = (boxes, arrows)
        self._recording.log(
            ENTITY,
            rr.GraphNodes(
                [box.id for box in boxes],
                labels=[drawable(box.label) for box in boxes],
                colors=[box.color for box in boxes],
                positions=[(box.x, box.y) for box in boxes],
                show_labels=True,
            ),
            rr.GraphEdges(arrows, graph_type="directed"),
        )


def arrange(found: Topology) -> tuple[list[PlacedBoxes], list[tuple[str, str]]]:
    """Boxes and arrows, from the left to the right in the direction in which content flows."""
    arrows = [
        arrow
        for client in found.clients
        for use in client.uses
        for arrow in (
            *(((_world(use.world), _agent(client.agent)),) if use.reads else ()),
            *(((_agent(client.agent), _world(use.world)),) if use.writes else ()),
        )
    ]
    names = [*(_world(entry.info.name) for entry in found.worlds), *(_agent(client.agent) for client in found.clients)]
    columns = _columns(names, arrows)
    labels, colors = _looks(found)
    rows: dict[int, int] = {}
    boxes = []
    for name in names:
        column = columns[name]
        row = rows[column] = rows.get(column, -1) + 1
        lift = column * _GOLDEN % 1.0  # so that arrows over several columns do not run through the boxes between
        boxes.append(PlacedBoxes(name, labels[name], colors[name], column * _COLUMN, (row + lift) * _ROW))
    return boxes, arrows


def _looks(found: Topology) -> tuple[Mapping[str, str], Mapping[str, Color]]:
    """What is written into each box, and its colour: worlds by whether they change, agents by how they are."""
    labels, colors = {}, {}
    for entry in found.worlds:
        name = _world(entry.info.name)
        active = entry.write_hz >= _FASTEST_TOLD
        labels[name] = f"world {entry.info.name}" if entry.there else f"world {entry.info.name} (waited for)"
        colors[name] = palette.SURPRISE if not entry.there else palette.BELIEF if active else palette.GREY
    for client in found.clients:
        name = _agent(client.agent)
        labels[name] = client.agent
        colors[name] = palette.ROBOT if client.state in ("ready", "starting") else palette.PERCEPT
    return labels, colors


def _columns(names: list[str], arrows: list[tuple[str, str]]) -> dict[str, int]:
    """The longest way to each box along arrows, each arrow into a box that is on the way already left out."""
    following: dict[str, list[str]] = {name: [] for name in names}
    for source, destination in arrows:
        following[source].append(destination)
    columns = dict.fromkeys(names, 0)
    order = _sorted(names, following)
    place = {name: index for index, name in enumerate(order)}
    for name in order:
        for other in following[name]:
            if place[other] > place[name]:
                columns[other] = max(columns[other], columns[name] + 1)
    return columns


def _sorted(names: list[str], following: Mapping[str, list[str]]) -> list[str]:
    """What comes before what follows, circles cut where they are closed: depth first, backwards."""
    done: list[str] = []
    seen: set[str] = set()

    def visit(name: str) -> None:
        stack = [(name, iter(following[name]))]
        seen.add(name)
        while stack:
            here, others = stack[-1]
            step = next((other for other in others if other not in seen), None)
            if step is None:
                done.append(here)
                stack.pop()
            else:
                seen.add(step)
                stack.append((step, iter(following[step])))

    for name in names:
        if name not in seen:
            visit(name)
    return done[::-1]


def _world(name: str) -> str:
    return f"world:{name}"


def _agent(name: str) -> str:
    return f"agent:{name}"
