"""The history of a run: truth, percepts and beliefs at each moment."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, Literal

import msgspec

from agents.scenario.format.model import Scenario
from agents.scenario.format.units import Size
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import Action

Source = Literal["percept", "belief"]

_SLACK = 1e-6
"""s, so that rounding does not move a sample out of a window"""


class Error(msgspec.Struct, frozen=True):
    """The distance of a pose from the true one."""

    position: float
    """m, distance"""
    rotation: float
    """rad, angle"""


class WorldSample(msgspec.Struct, frozen=True):
    """One moment of a world other than the base, as far as expectations are about it."""

    places: dict[str, Pose]
    """world_from_object of each object that has a place there."""
    perceived: frozenset[str]
    """Names of the objects that are perceived there."""
    edges: frozenset[tuple[str, str, str]]
    """Type, source, destination."""


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """One moment; all poses are world_from_object, by name of the object."""

    time: float
    """s after the start"""
    truth: dict[str, Pose]
    percepts: dict[str, Pose] = {}
    """The newest of each object, however old."""
    beliefs: dict[str, Pose] = {}
    sizes: dict[str, Size] = {}
    """m, extents along the axes of `beliefs`, of objects whose extents nobody told the working memory: as believed"""
    perceived: dict[str, bool] = {}
    """Whether each object is perceived, for those that have a node."""
    edges: frozenset[tuple[str, str, str]] = frozenset()
    """Type, source, destination."""
    attributes: dict[tuple[str, str], Any] = {}
    """The attributes that the scenario asks for, by node and name."""
    held: str | None = None
    """True: the object in the first arm's gripper."""
    grasped: dict[str, str] = {}
    """True: objects that are held, and by what: the node of a gripper or a hand, or `unknown`."""
    apart: float | None = None
    """m, true: the least distance between two arms since the sample before; None if they were far apart."""
    touched: dict[str, str] = {}
    """True: objects on which fingertips just lie, and the node of the hand."""
    pinched: dict[str, str] = {}
    """True: what each human hand grasps, by its node; two hands may grasp one object, of which `grasped` names one."""
    hands: dict[str, tuple[Vector3, ...]] = {}
    """True: 21 landmarks (m, world) of each human hand in the scene, by its node."""
    moving: frozenset[str] = frozenset()
    """True: objects that do not lie still."""
    in_view: frozenset[str] = frozenset()
    """Names of the objects whose tag the camera could truly see."""
    surprising: frozenset[str] = frozenset()
    camera_error: Error | None = None
    """How far the scenario's camera is believed to be from where it is; None if one of both is not known."""
    absent: frozenset[str] = frozenset()
    """Objects believed to have left the scene."""
    worlds: dict[str, WorldSample | None] = {}
    """The listed worlds by name, without the base; None for those that no expectation looks into."""

    @property
    def gripped(self) -> frozenset[str]:
        """True: the objects in grippers."""
        others = (name for name, holder in self.grasped.items() if holder.endswith("gripper"))
        return frozenset((*others, *([] if self.held is None else [self.held])))

    def poses(self, source: Source) -> dict[str, Pose]:
        """The percepts or the beliefs."""
        return self.percepts if source == "percept" else self.beliefs


class MissionState(msgspec.Struct, frozen=True):
    """The state of an intention's node from some time on."""

    time: float
    """s after the start"""
    node: str
    status: str
    explanation: str
    replans: int


class Explained(msgspec.Struct, frozen=True):
    """An explanation that was adopted."""

    time: float
    """s after the start, when it was in the memory"""
    node: str
    explanation: str


class Inferred(msgspec.Struct, frozen=True):
    """An action that was written into the memory."""

    action: Action
    noticed: float
    """s after the start, when it was in the memory"""
    confidence: float = 1.0


class LateTicks(msgspec.Struct, frozen=True):
    """An agent said that it had left out ticks because it waited for a processor."""

    time: float
    """s after the start; it is about the second before"""
    agent: str
    waiting: float
    """Share of that second in which the agent waited."""


class History:
    """The samples of one run, in order of time."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.samples: list[Sample] = []
        self.agent_starts: list[tuple[float, str]] = []
        """When an agent was first ready after each of its starts: s after the start, name."""
        self.spans: dict[int, tuple[float, float | None]] = {}
        """By the number of an event (from 1): when its move began and ended, s after the start."""
        self.given_up: dict[int, str] = {}
        """By the number of an event that could not be carried out: why."""
        self.kills: dict[int, float] = {}
        """By the number of a `kill`: when it was done, s after the start."""
        self.missions: list[MissionState] = []
        """All changes of all intentions."""
        self.explanations: list[Explained] = []
        self.calibrations: list[tuple[float, str]] = []
        """When (s after the start) a pose of a camera was adopted or taken back, and what was told of that."""
        self.actions: list[Inferred] = []
        """In the order in which they were written."""
        self.frames: list[float] = []
        """When (s after the start) the newest frame of a camera had been looked at; of live runs only."""
        self.loads: list[LateTicks] = []
        """What agents told of an overloaded machine; in lockstep there is none."""
        self.end = scenario.duration
        """s after the start: when the run ended"""

    def add(self, sample: Sample) -> None:
        """Append a sample; one that is not newer than the last is ignored."""
        if not self.samples or sample.time > self.samples[-1].time:
            self.samples.append(sample)

    def at(self, time: float) -> Sample | None:
        """The last sample until `time` (s), or None."""
        index = self._index_after(time)
        return self.samples[index - 1] if index else None

    def before(self, time: float) -> Sample | None:
        """The last sample before `time` (s), or None."""
        index = bisect_right(self.samples, time - _SLACK, key=lambda sample: sample.time)
        return self.samples[index - 1] if index else None

    def window(self, begin: float, end: float) -> Sequence[Sample]:
        """The samples between two times (s), both included."""
        first = bisect_right(self.samples, begin - _SLACK, key=lambda sample: sample.time)
        return self.samples[first : self._index_after(end)]

    def after(self, time: float) -> Sequence[Sample]:
        """The samples after `time` (s)."""
        return self.samples[self._index_after(time) :]

    def mission(self, time: float) -> MissionState | None:
        """The last state of any intention until `time` (s)."""
        return next((state for state in reversed(self.missions) if state.time <= time + _SLACK), None)

    def replans(self, time: float) -> int:
        """New plans made until `time` (s), of all intentions."""
        most: dict[str, int] = {}
        for state in self.missions:
            if state.time <= time + _SLACK:
                most[state.node] = max(state.replans, most.get(state.node, 0))
        return sum(most.values())

    def was_perceived(self, name: str) -> bool:
        """Whether the object was ever perceived."""
        return any(sample.perceived.get(name) and name in sample.percepts for sample in self.samples)

    def _index_after(self, time: float) -> int:
        return bisect_right(self.samples, time + _SLACK, key=lambda sample: sample.time)
