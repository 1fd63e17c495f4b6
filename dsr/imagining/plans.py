"""Carries a plan out in a world, step by step by physics, and reports the outcome, so that plans can be compared.

Each step is tried in several worlds of the belief: what nobody sees may be elsewhere than it most probably is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

from dsr.errors import ConfigError
from dsr.graph.elements import Node
from dsr.imagining.scenes import IMPRECISE, differences, keep, place_of, surface_below
from dsr.imagining.thinking import Thought
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.spatial import Box
from dsr.timeline import Chronicle
from dsr.vocabulary.relations import SURFACES, THINGS
from dsr.vocabulary.sentences import percent
from dsr.vocabulary.what_if import USUAL_WORLDS, Answer, Question, WorldOutcome

_STEP = re.compile(r"(?P<skill>pick|place|remove)\s+(?P<target>\S+)(?:\s+(?P<how>on|at)\s+(?P<where>.+))?\s*")
_SECONDS = 1.0  # simulated after each step
_RAISED = 0.15  # m, what is picked
_ABOVE = 5e-4  # m, over what something is placed on
_DISTURBED = 0.01  # m, from which a thing counts as moved
_CERTAIN = 0.99  # 1, probability from which a plan is not told to be in doubt


class Step(NamedTuple):
    """One step of a plan."""

    skill: str
    """`pick`, `place` or `remove`; others change nothing here."""
    target: str
    """The thing."""
    destination: str = ""
    """Name of the object that the target is placed on."""
    pose: Pose | None = None
    """world_from_target, where it is placed, instead."""

    @staticmethod
    def of(action: Node) -> Step:
        """Read a step from a node of type `action`, as a planner writes it."""
        return Step(
            action.get("skill", ""), action.get("target", ""), action.get("destination", ""), action.get("target_pose")
        )

    def __str__(self) -> str:
        where = f" on {self.destination}" if self.destination else ""
        if not where and self.pose is not None:
            where = " at " + ", ".join(f"{number:.3f}" for number in self.pose.t)
        return f"{self.skill} {self.target}{where}"


class Outcome(NamedTuple):
    """The outcome of an imagined plan."""

    steps: int
    """Number of steps that were carried out."""
    failed: str
    """Why it ended before its end; empty if it did not."""
    fallen: tuple[str, ...]
    """Things that lie on the floor at the end and did not before."""
    moved: Mapping[str, float]
    """m, how far things were moved that no step is about, by more than 10 mm."""
    probability: float = 1.0
    """1, that each step does what it should: the least of all steps, by the worlds of the belief."""

    @property
    def cost(self) -> tuple[bool, int, float, float, int]:
        """Less is better: a plan that is carried out, then less fallen, more probable, less disturbed, fewer steps."""
        doubt, disturbed = round(1.0 - self.probability, 1), round(sum(self.moved.values()), 3)
        return bool(self.failed), len(self.fallen), doubt, disturbed, self.steps

    def __str__(self) -> str:
        parts = [self.failed or f"{self.steps} steps"]
        if not self.failed and self.probability < _CERTAIN:
            parts.append(f"{percent(self.probability)} probable")
        parts += [f"{name} falls" for name in self.fallen]
        parts += [f"{name} moves by {1e3 * distance:.0f} mm" for name, distance in sorted(self.moved.items())]
        return "; ".join(parts)


def parse_step(text: str) -> Step:
    """The step of a text: `pick cube_3`, `place cube_3 on cube_4`, `place cube_3 at 0.3, 0.1, 0.02`, `remove lid`.

    Raises `ConfigError`.
    """
    match = _STEP.fullmatch(text.strip())
    expected = "expected 'pick A', 'place A on B', 'place A at X, Y, Z' (m) or 'remove A'"
    if match is None or (match["skill"] == "place") != (match["how"] is not None):
        raise ConfigError(f"step {text!r}: {expected}")
    if match["how"] != "at":
        return Step(match["skill"], match["target"], (match["where"] or "").strip())
    try:
        x, y, z = (float(part) for part in match["where"].split(","))
        return Step(match["skill"], match["target"], pose=Pose((x, y, z)))
    except ValueError:
        raise ConfigError(f"step {text!r}: {expected}") from None


def carried_out(base: Memory, world: Memory, steps: Sequence[Step]) -> Thought[Outcome]:
    """Carry a plan out in `world`, whose content changes to the outcome; each step is simulated for a second.

    A step fails if its thing does not end up where it is put, in the world that the graph shows. What is put on
    something is tried a little beside its middle first, where what only balances falls, and then put in the middle.
    What happened is told in the timeline of `world`.

    Args:
        base: the world whose belief is simulated.
        world: another one, as a fork of it.
        steps: of the plan.

    Raises:
        ConfigError: for a step about something that is nowhere.
    """
    chronicle = Chronicle(world)
    start = {name: pose for name in _things(world, steps) if (pose := place_of(world, name)) is not None}
    held: set[str] = set()
    done, failed, answer, probability = 0, "", Answer(), 1.0
    for number, step in enumerate(steps):
        if step.skill == "remove":
            world.update_node(step.target, present=False)
            held.discard(step.target)
            goals: list[Pose | None] = [None]
        elif step.skill in ("pick", "place"):
            goals = [*_goals(world, step)]
            (held.add if step.skill == "pick" else held.discard)(step.target)
        else:
            continue
        for goal in goals:
            elsewhere = {} if goal is None else {step.target: goal}
            changes = differences(base, world, held=held, elsewhere=elsewhere)
            answer = yield Question(_SECONDS, changes, worlds=USUAL_WORLDS)
            failed = _failure(step, answer)
            if failed:
                break
            probability = min(probability, answer.probability(partial(_succeeds, step)))
        if not answer.refused:
            keep(world, answer)
        text = f"{step}: {failed}" if failed else str(step)
        chronicle.happened("imagined", [name for name in (step.target, step.destination) if name], text=text)
        if failed:
            break
        done = number + 1
    return Outcome(done, failed, _fallen(world, answer, start), _moved(world, steps, start), probability)


def best(outcomes: Mapping[str, Outcome]) -> str:
    """The name of the best outcome, the first one of equals. Raises `ValueError` if there is none, or all failed."""
    good = {name: outcome for name, outcome in outcomes.items() if not outcome.failed}
    if not good:
        raise ValueError("no plan can be carried out: " + "; ".join(f"{name}: {o}" for name, o in outcomes.items()))
    return min(good, key=lambda name: good[name].cost)


def _goals(world: Memory, step: Step) -> list[Pose]:
    """world_from_target at the end of a step; before the last one, where it has to stay as well."""
    here, node = place_of(world, step.target), world.node(step.target)
    if here is None:
        raise ConfigError(f"step {step}: nobody knows where {step.target!r} is")
    if step.skill == "pick":
        return [Pose((here.t[0], here.t[1], here.t[2] + _RAISED), here.q)]
    if step.pose is not None:
        return [step.pose]
    size = node.get("size")
    support, below = world.node(step.destination), place_of(world, step.destination)
    if below is None or not isinstance(size, tuple):
        raise ConfigError(f"step {step}: nobody knows where {step.destination!r} is, or how large {step.target!r} is")
    top = below.t[2] if support.type in SURFACES else Box(below, support["size"]).top
    half = Box(Pose((0.0, 0.0, 0.0), here.q), (size[0], size[1], size[2])).top
    x, y, z = below.t[0], below.t[1], top + half + _ABOVE
    return [Pose((x + IMPRECISE[0], y + IMPRECISE[1], z), here.q), Pose((x, y, z), here.q)]


def _succeeds(step: Step, outcome: WorldOutcome) -> bool:
    return not _failure(step, outcome)


def _failure(step: Step, answer: WorldOutcome) -> str:
    """Why a step has not done what it should; empty if it has."""
    if answer.refused or step.skill != "place":
        return answer.refused
    if step.target in answer.on_floor:
        return f"{step.target} would fall to the floor"
    if step.destination and step.destination not in answer.rests_on.get(step.target, ()):
        return f"{step.target} would not stay on {step.destination}"
    moved = answer.moved.get(step.target, 0.0)
    return "" if moved <= _DISTURBED else f"{step.target} would move by {1e3 * moved:.0f} mm"


def _things(world: Memory, steps: Sequence[Step]) -> list[str]:
    return sorted({node.name for node in world.nodes(THINGS)} | {step.target for step in steps})


def _fallen(world: Memory, answer: Answer, start: Mapping[str, Pose]) -> tuple[str, ...]:
    """What is on the floor at the end and was above a table before."""
    return tuple(
        name
        for name in sorted(answer.on_floor)
        if name in start and surface_below(world, *start[name].t[:2]) is not None
    )


def _moved(world: Memory, steps: Sequence[Step], start: Mapping[str, Pose]) -> dict[str, float]:
    about = {step.target for step in steps}
    ends = {name: pose for name in start if name not in about and (pose := place_of(world, name)) is not None}
    distances = {name: start[name].distance(pose)[0] for name, pose in ends.items()}
    return {name: distance for name, distance in distances.items() if distance > _DISTURBED}
