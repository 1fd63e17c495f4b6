"""Holds what is told of a memory: sentences, each with its basis, what it claims, and the evidence for it."""

from __future__ import annotations

from datetime import tzinfo
from enum import StrEnum
from typing import Any, NamedTuple

import msgspec

from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose, position_deviation
from dsr.memory import Memory
from dsr.narration.calendar import moment_words
from dsr.vocabulary.perceived import is_perceived
from dsr.vocabulary.relations import SURFACES

_CALENDAR = 3600.0
"""s before now from which a time of day tells more than a length of time"""
Place = tuple[float, float, float]
"""m, x y z in the world frame"""


class Moment(NamedTuple):
    """A memory at a time: all that is told of it is told as of then."""

    memory: Memory
    now: float
    """s"""
    origin: float | None = None
    """s, from which times count that are given without `ago`, as in a recording; None where nothing has begun"""
    zone: tzinfo | None = None
    """On whose calendar days are counted; None for that of this machine"""

    @staticmethod
    def of(memory: Memory) -> Moment:
        """The present moment of a memory, by its own clock."""
        return Moment(memory, memory.clock.now())

    def in_world(self, world: Memory) -> Moment:
        """The same moment in another world."""
        return self._replace(memory=world)

    def when(self, time: float) -> str:
        """A time (s) before now in words: `4.2 s ago`; from an hour on `yesterday at 14:05` and the like."""
        past = self.now - time
        return ago(past) if past < _CALENDAR else moment_words(time, self.now, self.zone)


class Basis(StrEnum):
    """What a sentence rests on."""

    PERCEIVED = "perceived"
    """Sensors of the robot show what the sentence tells."""
    BELIEVED = "believed"
    """The robot, or a person, believes so without seeing it; the sentence says so."""
    OWN = "own"
    """The sentence is about the robot's own mind: its goals, surprises and conclusions."""


class Subject(StrEnum):
    """What a sentence is about."""

    PLACE = "place"
    HOLDING = "holding"
    SIGHT = "sight"
    SURPRISE = "surprise"
    HAPPENED = "happened"
    WANTED = "wanted"
    FORBIDDEN = "forbidden"


class StatedClaim(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a sentence says of the world, for programs."""

    relation: str
    """`on`, `in`, `grasping`, `touching`, `at`, `gone`, `empty`; of events `began on`, `ended on`, ..., `Pick`, ..."""
    participants: tuple[str, ...]
    """Names of nodes, in the order of the relation."""
    place: Place | None = None
    """m, of `at`: where the first participant is, to a centimetre"""


class Statement(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """A sentence about a memory."""

    text: str
    """One plain sentence, with a full stop."""
    subject: Subject
    basis: Basis
    names: tuple[str, ...] = ()
    """Names of nodes that the sentence is about."""
    claims: tuple[StatedClaim, ...] = ()
    """What the sentence says of the world; none if it is about the robot's mind."""
    time: float | None = None
    """s, when what is told happened; None for what is so now"""
    since: float | None = None
    """s, the earliest time at which it may have happened, where nobody saw it until `time`; else None"""
    confidence: float = 1.0
    """Probability (0 to 1) that whoever inferred it gave."""
    evidence: dict[str, Any] = {}
    """What speaks for it, as plain data: percepts, relations with their sources, entries of the timeline."""


def ago(seconds: float) -> str:
    """A time before now in words: `4.2 s ago`, `3 min ago`."""
    return f"{length_of_time(seconds)} ago"


def sentence_begin(words: str) -> str:
    """Words with a capital in front, unless that is a digit."""
    return words[:1].upper() + words[1:]


def length_of_time(seconds: float) -> str:
    """A length of time in words: `4.2 s`, `3 min 5 s`, `2 h 10 min`."""
    if seconds < 60.0:
        return f"{max(0.0, seconds):.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"


def place_of(pose: Pose) -> Place:
    """Where a pose is, to a centimetre: sentences claim no more."""
    x, y, z = (round(number, 2) + 0.0 for number in pose.t)
    return x, y, z


def place_words(place: Place, *, height: bool = False) -> str:
    """A place in the world in words: `at x 0.30 m, y 0.09 m`; with z if its `height` matters."""
    words = f"at x {place[0]:.2f} m, y {place[1]:.2f} m"
    return f"{words}, z {place[2]:.2f} m" if height else words


def is_seen(node: Node, now: float) -> bool:
    """Whether somebody sees a thing at time `now` (s); tables stand still and count as seen."""
    return node.type in SURFACES or (node.get("perceived") is True and is_perceived(node, now))


def seen_since(node: Node, now: float) -> float | None:
    """Since when (s) a thing has been seen without a break; None if it is not seen now, or that cannot be told."""
    if not is_seen(node, now):
        return None
    return float("-inf") if node.type in SURFACES else node.written_at("perceived")


def percept_evidence(moment: Moment, name: str) -> dict[str, Any]:
    """What the newest percept of a node says: from which frame, when, and the deviation of the position (m)."""
    memory = moment.memory
    node = memory.get_node(name)
    found: dict[str, Any] = {}
    if node is not None and "last_seen" in node:
        found["last_seen"] = node["last_seen"]
        found["seconds_unseen"] = max(0.0, moment.now - node["last_seen"])
    edges = memory.edges("RT", dst=name)
    percepts = [(pose, edge.src) for edge in edges if (pose := edge.get("pose")) is not None]
    if percepts:
        newest, source = max(percepts, key=lambda percept: percept[0].stamp)
        found["percept"] = {"from": source, "stamp": newest.stamp}
        if newest.covariance is not None:
            found["percept"]["position_deviation_m"] = position_deviation(newest)
    return found
