"""From the belief to the graph: believed poses, relations from contact, plausibility; only changed values."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Mapping, Sequence

from dsr.errors import GraphError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import is_within_bounds
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.scales import STEADY
from dsr.vocabulary.observed_actions import DEEDS, Deed, encoded
from simulation_handler.contact.relations import CONTACT, Relation
from simulation_handler.explaining.explainer import EXPLANATION
from simulation_handler.graph_io.alternatives import LEAST, AlternativesWriter
from simulation_handler.graph_io.events import Events
from simulation_handler.graph_io.recalling import SOURCES
from simulation_handler.hands.state import HAND_REACH, HandGrasp
from simulation_handler.reasoner import Reasoner
from simulation_handler.scales import GAP
from simulation_handler.worlds.model import Island, probability
from simulation_handler.worlds.weighted import LOOK_PERIOD

_SAME = PoseTolerance(GAP, GAP / HAND_REACH)
"""m, rad that a body may move before its pose is written again: ends of what a hand takes move by as much"""


class Writing:
    """Keeps the graph in step with a belief."""

    def __init__(self, memory: Memory, belief: Reasoner, log: logging.Logger) -> None:
        self._memory = memory
        self._belief = belief
        self._written: dict[str, Pose] = {}
        self._events = Events(memory, belief.config.policy, log)
        config = belief.config
        self._near = PoseTolerance(config.surprise_distance, config.surprise_angle)  # differences by noise
        self._alternatives = AlternativesWriter(memory, config.worlds, self._near)
        self.islands: Sequence[Island] = ()
        """Of the belief when its distributions were looked at last."""
        self._due = -math.inf
        self._related: set[tuple[str, Relation]] = set()
        self._told: dict[str, tuple[Deed, ...]] = {}

    def close(self) -> None:
        """Delete the worlds of alternatives."""
        self._alternatives.close()

    def update(self, now: float) -> None:
        """Write the changes up to time `now` (s). A node that is gone meanwhile is left out."""
        if WORLD not in self._memory:
            return
        self._written = {name: pose for name, pose in self._written.items() if name in self._belief}
        self._told = {name: deeds for name, deeds in self._told.items() if name in self._belief}
        for name in self._belief.names:
            with contextlib.suppress(GraphError):
                node, pose = self._memory.node(name), self._belief.pose(name)
                self._write_pose(name, pose, now)
                self._write_plausible(node, pose)
                self._write_present(node, pose)
                self._write_deeds(name)
        self._look_at_worlds(now)
        self._write_relations("on", self._belief.supports())
        self._write_relations("in", self._belief.contents())
        self._write_grasps()
        self._write_let_go()
        for time, explanation in self._belief.explanations():
            self._events.record(time, explanation)

    def _look_at_worlds(self, now: float) -> None:
        """Take the weighted worlds of now, if the last ones are old, or relations have changed since."""
        kinds = (("on", self._belief.supports()), ("in", self._belief.contents()), ("grasping", self._belief.grasps()))
        related = {(kind, relation) for kind, relations in kinds for relation in relations}
        if self._due - LOOK_PERIOD <= now < self._due and related == self._related:
            return
        self._due, self._related, self.islands = now + LOOK_PERIOD, related, self._belief.islands()
        self._alternatives.update(self.islands)

    def _write_pose(self, name: str, pose: Pose | None, now: float) -> None:
        if pose is not None and self._is_news(name, pose, now):
            told = pose if is_within_bounds(pose) else pose.with_covariance(None)  # of a percept that told nothing
            self._memory.add_edge(WORLD, name, "Virtual_RT", pose=told)
            self._written[name] = told

    def _is_news(self, name: str, pose: Pose, now: float) -> bool:
        written = self._written.get(name)
        if written is None or now - written.stamp >= STEADY:
            return True
        return not _SAME.covers(written, pose)

    def _write_plausible(self, node: Node, pose: Pose | None) -> None:
        plausible = self._belief.plausible(node.name)
        if pose is not None and node.get("plausible") is not plausible:
            self._memory.update_node(node.name, plausible=plausible)

    def _write_present(self, node: Node, pose: Pose | None) -> None:
        """Take the pose of what is gone out of the graph, and say so."""
        name, gone, before = node.name, self._belief.is_gone(node.name), node.get("present")
        if gone and pose is None:
            self._memory.remove_edge(WORLD, name, "Virtual_RT")
            self._written.pop(name, None)
        if before is not (not gone) and (gone or before is not None):
            self._memory.update_node(name, present=not gone)

    def _write_deeds(self, name: str) -> None:
        """Tell what was done with an object."""
        deeds = self._belief.deeds(name)
        if deeds != self._told.get(name, ()):
            self._memory.update_node(name, **{DEEDS: encoded(deeds)})
            self._told[name] = deeds

    def _write_grasps(self) -> None:
        """Let the edges `grasping` of human hands be what the belief says that they hold."""
        grasps = self._belief.grasps()
        for edge in self._memory.edges("grasping"):
            if edge.get("source") in (CONTACT, EXPLANATION) and (edge.src, edge.dst) not in grasps:
                self._memory.remove_edge(edge.src, edge.dst, "grasping")
        for (hand, name), grasp in grasps.items():
            written = self._memory.get_edge(hand, name, "grasping")
            values = {"source": EXPLANATION if grasp.is_covered else CONTACT, "since": grasp.since}
            values["handling"] = grasp.state.value
            values["probability"] = self._probability("grasping", (hand, name), written)
            told = () if written is None else tuple(map(written.get, ("handling", "source", "probability")))
            now_told = (values["handling"], values["source"], values["probability"])
            if told != now_told or (written and _is_regrasped(written, grasp, self._near)):
                with contextlib.suppress(GraphError):
                    self._memory.add_edge(hand, name, "grasping", held_at=grasp.hand_from_object, **values)

    def _write_let_go(self) -> None:
        """Let the edges `let_go` of human hands tell how they came to hold nothing more of what they held."""
        ended = self._belief.let_go()
        for edge in self._memory.edges("let_go"):
            if (edge.src, edge.dst) not in ended:
                self._memory.remove_edge(edge.src, edge.dst, "let_go")
        for relation, end in ended.items():
            written = self._memory.get_edge(*relation, "let_go")
            values = {"handling": end.state.value, "since": end.since}
            if written is None or any(written.get(name) != value for name, value in values.items()):
                with contextlib.suppress(GraphError):
                    self._memory.add_edge(*relation, "let_go", **values)

    def _probability(self, kind: str, relation: Relation, written: Edge | None) -> float:
        """That a relation holds, by the weighted worlds; what is written, if that says so within the tolerance."""
        known = None if written is None else written.get("probability")
        now = probability(self.islands, kind, relation)
        if known is not None and abs(known - now) <= LEAST:
            return float(known)
        return round(now, 2)

    def _write_relations(self, kind: str, relations: Mapping[Relation, float]) -> None:
        """Let the edges of a kind that the belief wrote be those that it has."""
        for edge in self._memory.edges(kind):
            if edge.get("source") in SOURCES and (edge.src, edge.dst) not in relations:
                self._memory.remove_edge(edge.src, edge.dst, kind)
        for relation, since in relations.items():
            written = self._memory.get_edge(*relation, kind)
            values = {"source": self._belief.source(relation), "since": since}
            values["probability"] = self._probability(kind, relation, written)
            if written is None or any(written.get(name) != value for name, value in values.items()):
                with contextlib.suppress(GraphError):
                    self._memory.add_edge(*relation, kind, **values)


def _is_regrasped(written: Edge, grasp: HandGrasp, same: PoseTolerance) -> bool:
    """Whether a hand holds an object otherwise than it was written, by more than the same hold may differ."""
    before = written.get("held_at")
    if before is None:
        return True
    return not same.covers(before, grasp.hand_from_object)
