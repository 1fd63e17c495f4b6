"""Plays random episodes in lockstep and scores all that is told in them."""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from agents.scenario.generate.episode import generate
from agents.scenario.run.runner import Onlooker, play
from agents.scenario.run.staging import Sensor, make_run, staged_system, without
from agents.scenario.truth.history import History
from benchmarks.honesty.moments import RunScores, scores_of
from benchmarks.honesty.watching import ToldWorlds, WorldsWatcher, watched
from dsr.memory import Memory


class Job(NamedTuple):
    """One episode to play."""

    family: str
    seed: int
    """Of the episode, and of the sensors' noise in it."""
    sensor: Sensor


def play_all(jobs: Sequence[Job], processes: int) -> Iterator[RunScores]:
    """Play episodes, some at a time, each in a process of its own; what was told in each, as they come."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(processes, maxtasksperchild=1) as pool:
        yield from pool.imap_unordered(play_episode, jobs)


def play_episode(job: Job) -> RunScores:
    """Generate an episode, play it in lockstep, and score what was told. Raises `ConfigError`, `AgentError`."""
    history, told = play_text(generate(job.family, job.seed).text, job.seed, job.sensor)
    return scores_of(job.family, job.seed, history, told)


def play_text(
    text: str, seed: int, sensor: Sensor, onlooker: Onlooker | None = None
) -> tuple[History, Mapping[float, ToldWorlds]]:
    """Play a scenario file's text in lockstep; the history, and what was told by the times (s) of its samples.

    Args:
        text: the file.
        seed: of the sensors' noise.
        sensor: what the cameras send.
        onlooker: looks at memory and truth at each step, too.

    Raises:
        ConfigError: for a text that is no scenario.
        AgentError: if an agent cannot be started.
    """
    with tempfile.TemporaryDirectory(prefix="dsr-honesty-") as folder:
        file = Path(folder) / "episode.toml"
        file.write_text(text, encoding="utf-8")
        run = make_run(file, seed=seed, sensor=sensor)
        system, running = watched(without(staged_system(run), "viewer"))
        watcher = WorldsWatcher(running)

        def look(elapsed: float, memory: Memory, history: History) -> None:
            watcher(elapsed, memory, history)
            if onlooker is not None:
                onlooker(elapsed, memory, history)

        judge = play(run, system, onlooker=look)
        return judge.history, watcher.told
