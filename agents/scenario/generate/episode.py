"""Generates the episode of a family and a seed: drawn until the plant alone says that it is valid."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.generate.draft import EpisodeDraft
from agents.scenario.generate.draw import Draw
from agents.scenario.generate.registry import Family, find_family
from agents.scenario.generate.validity import why_invalid, with_expectations
from agents.scenario.generate.writing import to_toml
from agents.scenario.run.runner import true_course
from agents.scenario.run.staging import make_run
from agents.scenario.truth.history import History
from dsr.errors import ConfigError

MOST_DRAWS = 200
"""Draws of one episode, after which its family cannot be drawn"""


class Episode(msgspec.Struct, frozen=True, kw_only=True):
    """A random episode."""

    family: str
    seed: int
    text: str
    """The scenario file."""
    refused: list[str]
    """Why each of the draws before was thrown away."""

    @property
    def name(self) -> str:
        """The name of its scenario."""
        return f"{self.family}-{self.seed}"


def generate(family: str, seed: int) -> Episode:
    """The episode of a family and a seed, always the same bytes. Takes some seconds.

    Raises:
        ConfigError: for an unknown family, a negative seed, or a family of which no valid episode was drawn.
    """
    return generate_of(find_family(family), seed, f"dsr scenario generate {family} --seed {seed}")


def generate_of(family: Family, seed: int, command: str, why_not: Callable[[History], str] | None = None) -> Episode:
    """The episode of any family and a seed, as `generate` does it.

    Args:
        family: also one that is not registered.
        seed: 0 or more.
        command: draws the same episode; the file tells it.
        why_not: from the true course of a valid draw to why it is not wanted; empty if it is.

    Raises:
        ConfigError: for a negative seed, or a family of which no valid and wanted episode was drawn.
    """
    if seed < 0:
        raise ConfigError(f"seed {seed}: expected 0 or more")
    refused: list[str] = []
    for attempt in range(MOST_DRAWS):
        try:
            text = _drawn(family, seed, attempt, command, why_not)
            return Episode(family=family.name, seed=seed, text=text, refused=refused)
        except ConfigError as error:
            refused.append(str(error))
    last = refused[-1]
    raise ConfigError(f"family {family.name!r}, seed {seed}: none of {MOST_DRAWS} draws is valid; the last: {last}")


def _drawn(
    family: Family, seed: int, attempt: int, command: str, why_not: Callable[[History], str] | None
) -> str:  # fmt: skip
    """One draw as the text of a file. Raises `ConfigError` if it is not valid, or not wanted."""
    draft = EpisodeDraft(Draw(family.name, seed, attempt), family.system)
    family.draw(draft)
    name = f"{family.name}-{seed}"
    heading = f"Drawn by `{command}`."
    scenario = draft.scenario(name, family.title)
    text = to_toml(scenario, heading)
    parse_scenario(text, name)
    history = _course(text)
    if why := why_invalid(history, family) or (why_not(history) if why_not is not None else ""):
        raise ConfigError(why)
    scenario = msgspec.structs.replace(scenario, expectations=with_expectations(history).expectations)
    return to_toml(scenario, heading)


def _course(text: str) -> History:
    """The true course of a scenario, with what the camera could recognise."""
    with tempfile.TemporaryDirectory(prefix="dsr-episode-") as folder, _quiet():
        file = Path(folder) / "episode.toml"
        file.write_text(text, encoding="utf-8")
        return true_course(make_run(file, sensor="poses"), sensor="poses")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the plant from telling of events that it gives up: such a draw is thrown away."""
    log = logging.getLogger("agents.plant.experimenter")
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before
