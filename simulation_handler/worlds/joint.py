"""Worlds of the whole scene: the most probable combinations of the worlds of all islands."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.perception.scales import SAME_OUTCOME
from simulation_handler.physics.rollouts.scene import RolloutBody, RolloutScene
from simulation_handler.scales import TURN_FLOOR
from simulation_handler.worlds.model import Island, ObjectState

ONE_OUTCOME = PoseTolerance(SAME_OUTCOME, TURN_FLOOR)
"""m, rad up to which simulations have the same outcome"""


@dataclass(frozen=True)
class JointWorld:
    """One way in which all objects may be, told by what is otherwise in it than in the simulated scene."""

    weight: float = 1.0
    """1, probability of this world"""
    otherwise: Mapping[str, ObjectState] = field(default_factory=dict)
    """State of each object that is elsewhere, or gone, or is held and is not in the scene, or the reverse"""

    def scene(self, simulated: RolloutScene) -> RolloutScene:
        """The simulated scene as it is in this world."""
        for name, state in self.otherwise.items():
            if state.pose is None:
                simulated = simulated.without([name])
            else:
                simulated = simulated.moved({name: (state.pose.t, state.pose.q)})
                simulated = simulated.held([name]) if state.hand else simulated.released([name])
        return simulated


def leading(islands: Collection[Island], simulated: RolloutScene, most: int) -> list[JointWorld]:
    """The simulated world, and then the most probable others, the best first; `most` at most.

    Islands are independent, so a world's weight is the product of the weights of its parts. What has no place in the
    simulated scene has none in any of these worlds. The order of the islands does not matter.
    """
    found = [JointWorld()]
    for island in sorted(islands, key=lambda island: island.names):
        parts = _parts(island, simulated)
        combined = [
            JointWorld(one.weight * part.weight, {**one.otherwise, **part.otherwise}) for one in found for part in parts
        ]
        combined.sort(key=lambda one: (bool(one.otherwise), -one.weight))
        found = combined[:most]
    return found


def _parts(island: Island, simulated: RolloutScene) -> list[JointWorld]:
    """The simulated world of an island, and the others; those with the same outcome are one."""
    found = [JointWorld(0.0)]
    for world in island.worlds:
        otherwise = {
            name: state
            for name, state in world.objects.items()
            if name in simulated and _is_otherwise(state, simulated[name])
        }
        index = next((index for index, one in enumerate(found) if _are_same(one.otherwise, otherwise)), len(found))
        weight = world.weight + sum(one.weight for one in found[index : index + 1])
        found[index : index + 1] = [JointWorld(weight, otherwise)]
    return found


def _is_otherwise(state: ObjectState, body: RolloutBody) -> bool:
    if state.pose is None or bool(state.hand) != body.fixed:
        return True
    return not ONE_OUTCOME.covers(Pose.unchecked(body.position, body.rotation), state.pose)


def _are_same(one: Mapping[str, ObjectState], other: Mapping[str, ObjectState]) -> bool:
    return one.keys() == other.keys() and all(_is_same(state, other[name]) for name, state in one.items())


def _is_same(one: ObjectState, other: ObjectState) -> bool:
    if one.pose is None or other.pose is None:
        return one.pose is other.pose
    return bool(one.hand) == bool(other.hand) and ONE_OUTCOME.covers(one.pose, other.pose)
