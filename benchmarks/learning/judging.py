"""Judges recorded episodes again off-line: log scores and coverage of weighted worlds, beside the simulated world."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from rich.table import Table

from agents.scenario.generate.registry import find_family
from benchmarks.honesty.statement import Statement, log_score, region_of, stated
from benchmarks.honesty.summary import LEVELS
from benchmarks.honesty.watching import statement_of
from benchmarks.learning.judged import Episode
from dsr.math3d.transforms import Pose
from simulation_handler.worlds.model import Island
from simulation_handler.worlds.parameters import WorldParameters
from simulation_handler.worlds.weighted import WeightedWorlds

EVERY = 2
"""Moments of an episode of which one is judged: neighbours are much alike"""


class Judged(NamedTuple):
    """What one speaker said of one object at one moment, and what it was worth."""

    family: str
    seen: bool
    """Whether the camera recognised it by the plant's account."""
    speaker: str
    log_score: float
    """nats"""
    region: float | None
    """Mass of the smallest region that holds the truth; None if nothing was said"""


def judge_episodes(episodes: Iterable[Episode], parameters: WorldParameters) -> list[Judged]:
    """Judge all objects that were ever recognised, from the settling of each episode on."""
    return [one for episode in episodes for one in _judge(episode, parameters)]


def _judge(episode: Episode, parameters: WorldParameters) -> Iterator[Judged]:
    worlds, family = WeightedWorlds(parameters, episode.shares), episode.name.partition("-")[0]
    for number, moment in enumerate(episode.moments):
        worlds.update(moment.evidence)
        if moment.time < episode.settle or number % EVERY:
            continue
        for name, thing in moment.evidence.objects.items():
            if thing.percept is None:
                continue
            truth, seen = moment.truth.get(name), name in moment.in_view
            said = statement_of(Island((name,), tuple(worlds.worlds(name))), name)
            yield _judged(family, "worlds", said, truth, seen=seen)
            yield _judged(family, "one world", stated(thing.believed, gone=thing.gone), truth, seen=seen)


def _judged(family: str, speaker: str, said: Statement, truth: Pose | None, *, seen: bool) -> Judged:
    return Judged(family, seen, speaker, log_score(said, truth), region_of(said, truth))


def table_of(judged: Iterable[Judged]) -> Table:
    """A row for each family, and for what is seen and not."""
    groups: dict[tuple[str, bool, str], list[Judged]] = defaultdict(list)
    for one in judged:
        groups[one.family, one.seen, one.speaker].append(one)
        groups["all", one.seen, one.speaker].append(one)
    table = Table(title="One simulated world -> weighted worlds", title_justify="left")
    for heading in ("family", "for", "", "moments", "nats", *(f"{100 * level:g} %" for level in LEVELS)):
        table.add_column(heading, justify="left" if heading in ("family", "for") else "right")
    for family, seen in dict.fromkeys((family, seen) for family, seen, _ in groups):
        pairs = [groups[family, seen, speaker] for speaker in ("one world", "worlds")]
        scores = [float(np.mean([one.log_score for one in found])) for found in pairs]
        shares = [[_coverage(found, level) for found in pairs] for level in LEVELS]
        table.add_row(
            family,
            "" if family == "all" else find_family(family).purpose,
            "seen" if seen else "unseen",
            str(len(pairs[1])),
            f"{scores[0]:.2f} -> {scores[1]:.2f}",
            *(f"{before} -> {after}" for before, after in shares),
        )
    return table


def _coverage(found: Iterable[Judged], level: float) -> str:
    regions = [one.region for one in found if one.region is not None]
    return f"{100 * float(np.mean(np.array(regions) <= level)):.0f} %" if regions else "-"
