"""Is it found out that things are gone of which cameras should see a part only? Random episodes, by the plant's truth.

    python -m benchmarks.absence --seeds 1000-1019
    python -m benchmarks.absence --seeds 0-9 --json absence.json

Plays the family `screens`: while the camera is covered, things are put before others, and some of these are taken away.
What is taken away, or hidden in part, counts by how likely a camera recognises it at its place, with all true poses.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import track
from rich.table import Table

from agents.scenario.format.scenario import Remove
from agents.scenario.generate.episode import generate
from agents.scenario.options import parse_seeds
from agents.scenario.run.runner import play
from agents.scenario.run.staging import make_run, staged_system, without
from agents.scenario.truth.history import History, Sample
from benchmarks.learning.recognition import shares_of
from dsr.believing.absence import learned_recognition

FAMILY = "screens"


class Outcome(NamedTuple):
    """What became of one thing of an episode that is gone, or of which a part is hidden."""

    episode: str
    thing: str
    is_gone: bool
    """By the plant."""
    share: float
    """1, of its tag or image, that is to be seen at its place at the end, or would be"""
    probability: float
    """1, that a camera recognises a thing of which so much is to be seen, as learned"""
    flagged_after: float | None
    """s from the first frame after the dark until it was surprising; None: never"""
    told_after: float | None
    """s from then until it was believed to be gone; None: at the end it is not"""


def outcomes_of(seed: int) -> list[Outcome]:
    """Play one episode in lockstep."""
    with tempfile.TemporaryDirectory(prefix="dsr-absence-") as folder:
        file = Path(folder) / f"{FAMILY}-{seed}.toml"
        file.write_text(generate(FAMILY, seed).text, encoding="utf-8")
        run = make_run(file, seed=seed, sensor="poses")
        return list(_outcomes(play(run, without(staged_system(run), "viewer")).history))


def _outcomes(history: History) -> Iterator[Outcome]:
    first, last = history.samples[0], history.samples[-1]
    dark = max(sample.time for sample in history.samples if not sample.in_view)
    after = [sample for sample in history.samples if sample.time > dark]
    removed = {event.object for event in history.scenario.events if isinstance(event, Remove)}
    shares = shares_of(history.scenario, {**{name: first.truth[name] for name in removed}, **last.truth})
    for spec in history.scenario.objects:
        name, share = spec.name, shares[spec.name]
        if name not in removed and share in {0.0, 1.0}:
            continue
        told = _since(after, [name in sample.absent for sample in after])
        yield Outcome(
            history.scenario.name,
            name,
            name not in last.truth,
            share,
            learned_recognition().probability(share, tagged=spec.marker_id is not None),
            next((sample.time - dark for sample in after if name in sample.surprising), None),
            None if told is None else told - dark,
        )


def _since(samples: Sequence[Sample], holds: Sequence[bool]) -> float | None:
    """The time (s) since when something holds until the end; None if it does not."""
    found = None
    for sample, is_so in zip(reversed(samples), reversed(holds), strict=True):
        if not is_so:
            break
        found = sample.time
    return found


def main() -> None:
    """Play the episodes and print how many things were told gone, by what is to be seen of them."""
    parser = argparse.ArgumentParser("python -m benchmarks.absence", description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", default="0-9", help="of the episodes (default: 0-9); from 1000 on for judging")
    parser.add_argument("--json", type=Path, help="also write all outcomes to this file")
    options = parser.parse_args()
    console, found = Console(), []
    for seed in track(parse_seeds(options.seeds), "playing", console=Console(stderr=True)):
        found += outcomes_of(seed)
    if options.json:
        options.json.write_text(json.dumps([one._asdict() for one in found], indent=1), encoding="utf-8")
    console.print(table_of(found))


def table_of(outcomes: Sequence[Outcome]) -> Table:
    """Counts by truth and by the probability that a camera recognises so much."""
    table = Table("truly", "recognised", "things", "flagged", "told gone", "median after, s")
    for is_gone in (True, False):
        for low, high in ((0.0, 0.5), (0.5, 1.0)):
            those = [one for one in outcomes if one.is_gone is is_gone and low <= one.probability < high]
            told = sorted(one.told_after for one in those if one.told_after is not None)
            flagged = sum(one.flagged_after is not None for one in those)
            middle = f"{told[len(told) // 2]:.1f}" if told else "-"
            truly = "gone" if is_gone else "hidden in part"
            table.add_row(truly, f"{low:g} to {high:g}", str(len(those)), str(flagged), str(len(told)), middle)
    return table


if __name__ == "__main__":
    main()
