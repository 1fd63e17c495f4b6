"""From the graph to an observation: things, how they are perceived and believed, and who could hold them."""

from __future__ import annotations

import math
from collections.abc import Iterable

from agents.action_inference.observation import Holder, ObservedEnd, ObservedGrasp, ObservedThing, Snapshot
from dsr.errors import DsrError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.percepts import PerceptReader
from dsr.vocabulary.calibration import IN_DOUBT
from dsr.vocabulary.handling import Handling
from dsr.vocabulary.perceived import is_perceived
from dsr.vocabulary.relations import SURFACES, THINGS, is_present

HOLDERS = ("hand", "gripper")
"""Node types that can hold a thing."""

_BELOW_TABLES = 0.1  # m


class SnapshotReader:
    """Observes a memory. Unusable nodes and edges are left out and counted."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._seen: dict[str, Pose] = {}
        self._percepts = PerceptReader(memory)
        self._seen_in_doubt: dict[str, bool] = {}
        self.skipped = self._percepts.skipped
        """What could not be used, by reason."""

    def snapshot(self, now: float) -> Snapshot:
        """Read the snapshot of the memory at `now` (s)."""
        nodes = self._memory.nodes(THINGS)
        self._read_percepts({node.name for node in nodes}, now)
        things = {node.name: self._thing(node) for node in nodes if is_present(node)}
        holders = self._memory.nodes(HOLDERS)
        found = (self._holder(node, now) for node in holders)
        return Snapshot(now, things, {holder.name: holder for holder in found if holder}, self._floor_below())

    def _read_percepts(self, names: set[str], now: float) -> None:
        """Take in what cameras have seen since the last look."""
        self._seen = {name: pose for name, pose in self._seen.items() if name in names}
        self._seen_in_doubt = {name: doubt for name, doubt in self._seen_in_doubt.items() if name in names}
        cameras = {node.name: node.get("mount") == IN_DOUBT for node in self._memory.nodes("camera")}
        for percept in self._percepts.new(now, names, cameras):
            self._take(percept.name, percept.pose.with_stamp(percept.stamp), cameras[percept.camera])

    def _take(self, name: str, seen: Pose, in_doubt: bool) -> None:
        known = self._seen.get(name)
        if known is None or seen.stamp > known.stamp:
            self._seen[name], self._seen_in_doubt[name] = seen, in_doubt

    def _thing(self, node: Node) -> ObservedThing:
        name, memory = node.name, self._memory
        belief = memory.get_edge(WORLD, name, "Virtual_RT")
        grasps = (
            ObservedGrasp(edge.src, edge.get("since", 0.0), edge.get("probability", 1.0))
            for edge in memory.edges("grasping", dst=name)
        )
        ends = [
            ObservedEnd(edge.src, edge.get("since", 0.0), edge.get("handling", Handling.FREE))
            for edge in memory.edges("let_go", dst=name)
        ]
        beneath = [*memory.edges("on", src=name), *memory.edges("in", src=name)]
        return ObservedThing(
            name=name,
            size=node.get("size", (0.0, 0.0, 0.0)),
            perceived=node.get("perceived") is True,
            plausible=node.get("plausible") is not False,
            seen=self._seen.get(name),
            in_doubt=self._seen_in_doubt.get(name, False),
            believed=None if belief is None else belief.get("pose"),
            on=frozenset(edge.dst for edge in beneath if edge.type == "on"),
            inside=frozenset(edge.dst for edge in beneath if edge.type == "in"),
            lies=max((edge.get("probability", 1.0) for edge in beneath), default=1.0),
            lifted=node.get("lifted"),
            grasps=tuple(sorted(grasps, key=lambda grasp: (grasp.since, grasp.holder))),
            let_go=max(ends, key=lambda end: (end.time, end.holder), default=None),
        )

    def _holder(self, node: Node, now: float) -> Holder | None:
        """A hand with its fingertips, or a gripper; None if it is nowhere."""
        parts = [node.name, *sorted(edge.dst for edge in self._memory.edges("has", src=node.name))]
        points = tuple(self._points(parts))
        is_gripper = node.type == "gripper"
        fingers = [finger for name in parts[1:] if (finger := self._memory.get_node(name)) is not None]
        shows_fingers = is_gripper or any(is_perceived(finger, now) for finger in fingers)
        perceived = is_gripper or is_perceived(node, now)
        return Holder(node.name, points, perceived, shows_fingers) if points else None

    def _points(self, names: Iterable[str]) -> Iterable[Vector3]:
        for name in names:
            try:
                yield self._memory.transform(WORLD, name).t
            except DsrError:
                self.skipped["no chain to the world"] += 1

    def _floor_below(self) -> float:
        tops = []
        for node in self._memory.nodes(SURFACES):
            try:
                tops.append(self._memory.transform(WORLD, node.name).t[2])
            except DsrError:
                self.skipped["no chain to the world"] += 1
        return min(tops) - _BELOW_TABLES if tops else -math.inf
