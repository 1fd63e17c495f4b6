"""The command `dsr scenario generate`, and the episodes that a sweep generates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from agents.scenario.generate.episode import generate
from agents.scenario.generate.registry import FAMILIES, is_for_tuning
from agents.scenario.options import parse_seeds
from dsr.cli.common import check_writable, console, shown
from dsr.errors import ConfigError


def complete_family(incomplete: str) -> list[str]:
    """The names of families that the shell completes."""
    return [name for name in FAMILIES if name.startswith(incomplete)]


def generate_episode(
    family: Annotated[
        str, typer.Argument(help=f"The kind of episode: {', '.join(FAMILIES)}.", autocompletion=complete_family)
    ],
    seed: Annotated[int, typer.Option(min=0, help="Which episode of the family.")] = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write it there, not to the terminal.")
    ] = None,
) -> None:
    """Draw a random episode of a family and print its scenario file; the same seed gives the same bytes.

    It is drawn until the plant alone says that it is valid: no belief takes part.
    Nothing starts inside anything else, nothing leaves the table unless that belongs to the family, all events
    can be carried out, and something happens. That takes some seconds.

    Play it with `dsr scenario truth FILE` and `dsr scenario run FILE`; docs/reference/episodes.md tells of the
    families, and which of them are for tuning and which for judging.
    """
    check_writable(output, "--output")
    episode = generate(family, seed)
    if output is None:
        typer.echo(episode.text, nl=False)
        return
    output.write_text(episode.text, encoding="utf-8")
    purpose = "tuning" if is_for_tuning(family, seed) else "judging"
    console.print(f"{shown(str(output))}: an episode for {purpose}", soft_wrap=True)


class EpisodeFile(NamedTuple):
    """A generated episode in a file."""

    family: str
    seed: int
    file: Path


def write_episodes(wanted: Sequence[str], folder: Path) -> list[EpisodeFile]:
    """Generate the episodes of texts like `stacks:0-99` into a folder. Raises `ConfigError`."""
    files = []
    for family, seed in dict.fromkeys(pair for text in wanted for pair in _pairs(text)):
        episode = generate(family, seed)
        files.append(EpisodeFile(family, seed, folder / f"{episode.name}.toml"))
        files[-1].file.write_text(episode.text, encoding="utf-8")
    return files


def _pairs(text: str) -> list[tuple[str, int]]:
    """Families and seeds."""
    family, colon, seeds = text.partition(":")
    if not colon:
        raise ConfigError(f"--generate {text!r}: expected a family and seeds, like stacks:0-99")
    return [(family, seed) for seed in parse_seeds(seeds, "--generate")]
