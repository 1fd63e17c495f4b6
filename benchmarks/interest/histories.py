"""Histories of memories that hold parts and change their minds: of a seed, under faults, and made shorter if they fail.

A history is some days long. Each day is work and faults in a random order, then the healing of all, after which each
part must be equal at all who hold it, and what each shows be what a plain model of all holders shows there.
"""

from __future__ import annotations

import logging
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.interest.claimant import KINDS, Kind
from benchmarks.interest.world import PARTS, PartsWorld
from benchmarks.years.running import quiet
from benchmarks.years.shrinking import shrunk
from benchmarks.years.steps import NAMES, Step
from dsr import Faults

_WORK = {
    "hold": 10, "leave": 5, "add": 20, "update": 10, "edge": 16, "stream": 6, "remove": 6, "remove edge": 3, "batch": 2,
}  # fmt: skip
_FAULTS = {"lossy": 2, "partition": 4, "mend": 3, "kill": 3}
_PASSING = {"pass": 22}
_ALL = {**_WORK, **_FAULTS, **_PASSING}
"""How often each kind of step comes, relative to the others."""
_DELAY = (0.0, 0.4)
"""s, least and most, for which a message is under way on a network that loses some"""
_TYPES = ("cube", "ball")
_EDGES = ("RT", "on")
_UNSHOWN: tuple[Kind, ...] = ("begins anew", "repeats", "trickles", "tells ranges")
_LIES: tuple[Kind | None, ...] = (None, *(kind for kind in KINDS if kind not in _UNSHOWN))
"""By seed, what an agent does that claims to hold all parts. Nonsense is left out, for none may be counted; and who
repeats or trickles, for its true elements are shown where they were taken in; and who tells ranges that nobody has."""


@dataclass(frozen=True)
class Setting:
    """What a history needs beside its steps."""

    seed: int
    places: int = 4
    days: int = 2
    steps: int = 150
    """Steps of each day."""

    def history(self) -> list[Step]:
        """The steps of all days."""
        drawn = np.random.default_rng(self.seed)
        weights = np.array(list(_ALL.values()), dtype=float)
        steps: list[Step] = []
        for _ in range(self.days):
            kinds = drawn.choice(list(_ALL), size=self.steps, p=weights / weights.sum())
            steps += [_drawn(drawn, str(kind)) for kind in kinds]
            steps.append(Step("heal"))
        return steps


@dataclass
class Outcome:
    """What a history came to."""

    met: Counter[str] = field(default_factory=Counter)
    """Faults by kind."""
    changes: int = 0
    """Times when a process began to hold a part, or held it no more."""
    waiting: int = 0
    """Edges that, when all were healed, waited for a part that their holder did not hold."""
    problem: str = ""
    """What was wrong, and where; empty if nothing was."""


def _drawn(drawn: np.random.Generator, kind: str) -> Step:
    amount = 0.0
    if kind == "pass":
        amount = drawn.choice([0.0, 0.02, 0.1, 0.3, 1.1])
    elif kind == "lossy":
        amount = drawn.choice([0.0, 0.3])
    return Step(kind, int(drawn.integers(60)), int(drawn.integers(1 << 16)), float(amount))


def run(setting: Setting, steps: Sequence[Step] | None = None) -> Outcome:
    """Run the history of a setting, or these steps in its place."""
    outcome = Outcome()
    with quiet() as complaints:
        logging.getLogger("dsr.parts").addHandler(complaints)
        world = PartsWorld(setting.places, setting.seed, lie=_LIES[setting.seed % len(_LIES)])
        try:
            for step in setting.history() if steps is None else steps:
                _take(world, step, outcome)
                world.check()
                if complaints.said:
                    outcome.problem = f"an error was logged: {complaints.said[0]}"
                    break
        except Exception as error:  # whatever comes out is a finding
            place = traceback.extract_tb(error.__traceback__)[-1]
            outcome.problem = f"{type(error).__name__}: {error} ({place.name})"
        finally:
            logging.getLogger("dsr.parts").removeHandler(complaints)
    outcome.met += world.network.met
    return outcome


def shortest(setting: Setting, problem: str) -> list[Step]:
    """Fewer steps of a history that fail with the same problem."""
    return shrunk(setting.history(), lambda fewer: run(setting, fewer).problem == problem)


def _take(world: PartsWorld, step: Step, outcome: Outcome) -> None:
    kind, place, choice, amount = step
    part, name, type = PARTS[choice % len(PARTS)], NAMES[choice % len(NAMES)], _TYPES[choice % len(_TYPES)]
    match kind:
        case "hold" | "leave":
            before = world.memory(place).interest
            (world.hold if kind == "hold" else world.leave)(place, part)
            outcome.changes += before != world.memory(place).interest
        case "add":
            world.add_in(place, ("", *PARTS)[choice % (len(PARTS) + 1)], name, type, choice)
        case "batch":
            world.batch(place, [name, NAMES[(choice + 1) % len(NAMES)]], choice)
        case "edge":
            src, dst = world.a_node(place, choice), world.a_node(place, choice // 7)
            if src and dst:
                world.add_edge(place, (src, dst, _EDGES[choice % len(_EDGES)]), choice)
        case "pass":
            world.advance(amount)
        case "heal":
            faults = world.network.faults
            world.converge()
            world.check_converged()
            outcome.waiting += world.waiting()
            world.network.faults = faults
        case "lossy":
            world.network.faults = Faults(loss=amount, duplication=amount, delay=_DELAY if amount else (0.0, 0.0))
        case "partition":
            world.partition(choice)
            outcome.met["partition"] += 1
        case "mend":
            world.heal()
        case "kill":
            world.crash(place, restore=choice % 2 == 0)
            outcome.met["kill"] += 1
        case _:
            _change(world, step)


def _change(world: PartsWorld, step: Step) -> None:
    kind, place, choice, _ = step
    if kind in ("update", "remove"):
        if name := world.a_node(place, choice):
            if kind == "update":
                world.update_node(place, name, choice)
            else:
                world.remove_node(place, name)
    elif key := world.an_edge(place, choice):
        if kind == "stream":
            world.stream(place, key, choice)
        else:
            world.remove_edge(place, key)
