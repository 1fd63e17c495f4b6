"""Restores the beliefs and explanations of an earlier run from the graph."""

from __future__ import annotations

import logging
import math

from dsr.errors import SchemaError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Edge, Node
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.reach import near
from dsr.timeline import EXPLAINED, query
from dsr.vocabulary.explained import changes_of
from dsr.vocabulary.handling import Handling
from dsr.vocabulary.observed_actions import deeds_of
from dsr.vocabulary.relations import is_present
from simulation_handler.contact.relations import BOUNDS, CONTACT
from simulation_handler.explaining.explainer import EXPLANATION
from simulation_handler.hands.state import HandGrasp
from simulation_handler.reasoner import Reasoner

log = logging.getLogger("simulation_handler.recalling")

SOURCES = (CONTACT, EXPLANATION, BOUNDS)
"""Sources of the relations that the belief writes."""


class Recalling:
    """The beliefs that an earlier run left in the graph; make this before the present run writes anything.

    What no belief can be is not recalled: a pose that is too far away, or of a time to come.

    Args:
        memory: what the earlier run wrote.
        belief: what recalls it.
        now: s, beyond which no earlier run has lived.
    """

    def __init__(self, memory: Memory, belief: Reasoner, now: float) -> None:
        self._memory = memory
        self._belief = belief
        poses = [edge.get("pose") for edge in memory.edges("Virtual_RT", src=WORLD)]
        stamps = (pose.stamp for pose in poses if pose is not None and pose.stamp <= now)
        self._lived_until = max(stamps, default=-math.inf)

    def recall_explanations(self, now: float) -> None:
        """Take over the explanations of an earlier run at time `now` (s), so that a lasting one is not told again."""
        for entry in query(self._memory, kind=EXPLAINED):
            self._belief.recall_explanation(changes_of(entry.details, entry.text), entry.begin, now)

    def recall(self, node: Node, now: float) -> float:
        """Restore the earlier belief about an object.

        Returns:
            Until when (s) its percepts have been taken in, for the belief is what became of them; minus infinity if
            nothing was believed of it.

        Raises:
            SchemaError: if what was believed cannot be.
        """
        edge = self._memory.get_edge(WORLD, node.name, "Virtual_RT")
        pose: Pose | None = None if edge is None else edge.get("pose")
        if pose is not None:
            if pose.stamp > now:
                raise SchemaError(f"{node}: believed at {pose.stamp:.1f} s, and now it is {now:.1f} s")
            self._belief.recall(node.name, near(node, pose), held=node.get("plausible") is False)
            self._recall_relations(node, now)
            self._recall_deeds(node, now)
            return max(self._lived_until, pose.stamp)
        if not is_present(node):
            self._belief.recall_gone(node.name)
            self._recall_deeds(node, now)
            return self._lived_until
        return -math.inf

    def _recall_deeds(self, node: Node, now: float) -> None:
        try:
            deeds = deeds_of(node)
        except SchemaError as error:  # the rest is recalled all the same
            log.warning("the deeds are not recalled: %s", error)
            return
        self._belief.recall_deeds(node.name, [deed for deed in deeds if deed.time <= now])

    def _recall_relations(self, node: Node, now: float) -> None:
        for edge in self._memory.edges("on", src=node.name):
            source = edge.get("source")
            if source in SOURCES:
                self._belief.recall_support((edge.src, edge.dst), _since(edge, now), now, source)
        for edge in self._memory.edges("grasping", dst=node.name):
            held_at, source = edge.get("held_at"), edge.get("source")
            if source in (CONTACT, EXPLANATION) and held_at is not None:
                try:
                    place = near(node, held_at)
                except SchemaError as error:  # the other relations are recalled all the same
                    log.warning("%s is not recalled: %s", edge, error)
                    continue
                grasp = HandGrasp(_since(edge, now), place, _handling(edge))
                self._belief.recall_grasp((edge.src, edge.dst), grasp, now)
        for edge in self._memory.edges("in", src=node.name):
            self._belief.recall_contents((edge.src, edge.dst), _since(edge, now), now)


def _since(edge: Edge, now: float) -> float:
    """When (s) a relation began; now if that is not told, or yet to come."""
    since: float = edge.get("since", now)
    return min(since, now)


def _handling(edge: Edge) -> Handling:
    """What a hand had to do with an object; that it touched it, if the edge does not say what is known here."""
    told = edge.get("handling", Handling.TOUCHING)
    return Handling(told) if told in set(Handling) else Handling.TOUCHING
