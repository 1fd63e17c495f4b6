"""Plays random episodes in lockstep and scores all that is told in them."""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from agents.scenario.generate.episode import generate
from agents.scenario.run.runner import play
from agents.scenario.run.staging import Sensor, make_run, staged_system, without
from benchmarks.honesty.moments import RunScores, scores_of
from benchmarks.honesty.watching import WorldsWatcher, watched


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
    with tempfile.TemporaryDirectory(prefix="dsr-honesty-") as folder:
        file = Path(folder) / "episode.toml"
        file.write_text(generate(job.family, job.seed).text, encoding="utf-8")
        run = make_run(file, seed=job.seed, sensor=job.sensor)
        system, running = watched(without(staged_system(run), "viewer"))
        watcher = WorldsWatcher(running)
        judge = play(run, system, onlooker=watcher)
        return scores_of(job.family, job.seed, judge.history, watcher.told)
