"""The rows that one change of the graph, or one recorded message, gives."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from agents.recorder.index import TimedRecord
from dsr.graph.elements import Edge, Node
from dsr.graph.watch import Change
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.decoding import decoded
from dsr.network.keys import agent_of
from dsr.runtime.logs import decode_log
from dsr.runtime.status import decode_status
from dsr.timeline import Event

Row = tuple[object, ...]
"""Values in the order of the table's columns; None for an empty field."""

_POSE = "pose"
_NAMES, _POSITIONS, _VELOCITIES = "joint_names", "joint_positions", "joint_velocities"
_DIAGONAL = range(0, 36, 7)
"""Indexes of the variances in a covariance, row by row."""


class _Truth(msgspec.Struct):
    """What is exported of the truth."""

    stamp: float
    objects: dict[str, tuple[float, float, float, float, float, float, float]]


_truth_decoder = msgspec.msgpack.Decoder(_Truth)


def graph_rows(time: float, change: Change, memory: Memory) -> Iterator[tuple[str, Row]]:
    """Table and row of each value that a change at `time` (s) brought to the graph `memory`."""
    element: Node | Edge | None
    if change.element == "node":
        table, element = "nodes", memory.get_node(change.name)
        about: Row = (change.name, change.type)
    else:
        table, element = "edges", memory.get_edge(change.src, change.dst, change.type)
        about = (change.type, change.src, change.dst)
    if change.kind == "removed" or element is None:
        yield table, (time, None, "removed", *about, None, None, None, None)
        return
    if change.kind == "added":
        yield table, (time, None, "added", *about, None, None, None, agent_of(max(element.created)[0]))
    for name in sorted(change.attributes):
        if name == _POSE and isinstance(element, Edge) and isinstance(pose := element.get(name), Pose):
            yield "poses", (time, pose.stamp, *about, *_numbers(pose), _writer(element, name))
        elif name in (_POSITIONS, _VELOCITIES) and (joints := _joints(element)):
            if name == _POSITIONS or _POSITIONS not in change.attributes:
                rows = (
                    (time, element.written_at(name), change.name, *joint, _writer(element, name)) for joint in joints
                )
                yield from (("joints", row) for row in rows)
        else:
            known = memory.schema.attributes.get(name)
            unit = known.unit if known else ""
            value = _text(element.get(name))
            stamp, writer = element.written_at(name), _writer(element, name)
            yield table, (time, stamp, change.kind, *about, name, unit, value, writer)


def traffic_rows(record: TimedRecord) -> Iterator[tuple[str, Iterable[str] | None, Row]]:
    """Table, nodes concerned (None: it is about agents) and row of a message beside the graph. Raises `WireError`."""
    topic, time = record.topic, record.time
    if topic.startswith("log/"):
        log = decode_log(record.payload)
        yield "logs", None, (time, log.stamp, log.agent, log.level, log.text)
    elif topic.startswith("status/"):
        it = decode_status(record.payload)
        measured = (it.rate_hz, it.tick_ms_p50, it.tick_ms_p95, it.missed, it.errors, it.last_error)
        yield "statuses", None, (time, it.stamp, it.agent, it.state.value, *measured)
    elif topic == "truth":
        truth = decoded(record.payload, "truth", _truth_decoder.decode)
        for name, pose in truth.objects.items():
            yield "truth", (name,), (time, truth.stamp, name, *pose)


def participants_of(event: Event) -> set[str]:
    """The names of all that an event is about."""
    told = event.details.get("participants", ())
    return {*told, *event.subject.replace(",", " ").split()}


def _joints(element: Node | Edge) -> list[tuple[str, float, float | None]]:
    """Name, position and velocity of each joint of a node; empty if its attributes do not go together."""
    names, positions = element.get(_NAMES), element.get(_POSITIONS)
    if not isinstance(names, str) or not isinstance(positions, tuple) or len(names.split(",")) != len(positions):
        return []
    velocities = element.get(_VELOCITIES)
    if not isinstance(velocities, tuple) or len(velocities) != len(positions):
        velocities = (None,) * len(positions)
    return list(zip(names.split(","), positions, velocities, strict=True))


def _numbers(pose: Pose) -> Row:
    variances = (None,) * len(_DIAGONAL) if pose.cov is None else tuple(pose.cov[index] for index in _DIAGONAL)
    return (*pose.t, *pose.q, *variances)


def _writer(element: Node | Edge, attribute: str) -> str:
    write = element.newest_write(attribute)
    return "" if write is None else agent_of(write.writer)


def _text(value: Any) -> object:
    """A value as one field: what has several parts as JSON."""
    if value is None or (isinstance(value, str | int | float) and not isinstance(value, bool)):
        return value
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, Pose):
        return json.dumps([*value.t, *value.q])
    return json.dumps(value)
