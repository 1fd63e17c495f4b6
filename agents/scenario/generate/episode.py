"""Generates the episode of a family and a seed: drawn until the plant alone says that it is valid."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
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
    kind = find_family(family)
    if seed < 0:
        raise ConfigError(f"seed {seed}: expected 0 or more")
    refused: list[str] = []
    for attempt in range(MOST_DRAWS):
        try:
            return Episode(family=family, seed=seed, text=_drawn(kind, seed, attempt), refused=refused)
        except ConfigError as error:
            refused.append(str(error))
    raise ConfigError(f"family {family!r}, seed {seed}: none of {MOST_DRAWS} draws is valid; the last: {refused[-1]}")


def _drawn(family: Family, seed: int, attempt: int) -> str:
    """One draw as the text of a file. Raises `ConfigError` if it is not valid."""
    draft = EpisodeDraft(Draw(family.name, seed, attempt), family.system)
    family.draw(draft)
    name = f"{family.name}-{seed}"
    heading = f"Drawn by `dsr scenario generate {family.name} --seed {seed}`."
    scenario = draft.scenario(name, family.title)
    text = to_toml(scenario, heading)
    parse_scenario(text, name)
    history = _course(text)
    if why := why_invalid(history, family):
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
