"""Looks into the belief while an episode is played: what its weighted worlds say of places and relations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from agents.scenario.truth.history import History
from benchmarks.honesty.statement import Likely, Statement, stated
from dsr.math3d.quaternions import Vector3
from dsr.memory import Memory
from dsr.runtime.system import System
from simulation_handler.agent import SimulationHandler
from simulation_handler.belief import Belief
from simulation_handler.contact.relations import Relation
from simulation_handler.worlds.model import GRASPING, INSIDE, ON, Island, ObjectState, holds

HANDLER = "simulation_handler"
"""Name of the agent that keeps the belief"""


class ToldWorlds(NamedTuple):
    """What a belief says at one moment."""

    places: dict[str, Statement]
    """Of each object, by all weighted worlds"""
    simulated: dict[str, Statement]
    """Of each object, by the simulated world alone"""
    relations: dict[str, dict[Relation, float]]
    """By kind and pair, as in edges: the probability of it"""
    palms: dict[str, Vector3]
    """(3,) m, world, of each hand that is in sight, by its node"""


def watched(system: System) -> tuple[System, list[SimulationHandler]]:
    """The system with a simulation handler that can be looked into; the list holds it once it runs."""
    running: list[SimulationHandler] = []

    class Watched(SimulationHandler):
        """The simulation handler, which tells that it runs."""

        def setup(self) -> None:
            super().setup()
            running.append(self)

    agents = [replace(spec, kind=Watched) if spec.name == HANDLER else spec for spec in system.agents]
    return replace(system, agents=tuple(agents)), running


class WorldsWatcher:
    """Keeps what a running belief says at the time of each sample of the history; an onlooker of a lockstep run."""

    def __init__(self, running: Sequence[SimulationHandler]) -> None:
        self._running = running
        self.told: dict[float, ToldWorlds] = {}
        """By the time of the sample, s after the start"""

    def __call__(self, elapsed: float, memory: Memory, history: History) -> None:
        """Take in what is said now."""
        belief = self._running[-1].belief if self._running else None
        if isinstance(belief, Belief) and history.samples and history.samples[-1].time not in self.told:
            self.told[history.samples[-1].time] = told_by(belief)


def told_by(belief: Belief) -> ToldWorlds:
    """What a belief says now."""
    islands = belief.islands()
    places = {name: statement_of(island, name) for island in islands for name in island.names}
    evidence = belief.evidence()
    simulated = {name: stated(thing.believed, gone=thing.gone) for name, thing in evidence.objects.items()}
    relations = {kind: told_relations(islands, kind) for kind in (GRASPING, INSIDE, ON)}
    palms = {name: hand.pose.t for name, hand in evidence.hands.items() if hand.is_seen}
    return ToldWorlds(places, simulated, relations, palms)


def statement_of(island: Island, name: str) -> Statement:
    """The distribution of one object's pose; worlds in which it is at the same place count as one."""
    weights: dict[object, Likely] = {}
    gone = 0.0
    for world in island.worlds:
        pose = world.objects[name].pose
        if pose is None:
            gone += world.weight
        else:
            key = (pose.t, pose.q, pose.cov)
            before = weights[key].weight if key in weights else 0.0
            weights[key] = Likely(before + world.weight, pose)
    return Statement(tuple(weights.values()), gone)


def told_relations(islands: Sequence[Island], kind: str) -> dict[Relation, float]:
    """All pairs that hold in some world, with their probability."""
    found: dict[Relation, float] = {}
    for island in islands:
        for world in island.worlds:
            for pair in _pairs(world.objects, kind):
                if holds(world, kind, pair):
                    found[pair] = found.get(pair, 0.0) + world.weight
    return found


def _pairs(states: Mapping[str, ObjectState], kind: str) -> set[Relation]:
    """Pairs of a kind that may hold in a world."""
    if kind == GRASPING:
        return {(state.hand, name) for name, state in states.items() if state.hand}
    if kind == ON:
        return {(name, support) for name, state in states.items() for support in state.supports}
    containers = {container for state in states.values() for container in state.containers}
    return {(name, container) for name, state in states.items() if state.containers for container in containers}
