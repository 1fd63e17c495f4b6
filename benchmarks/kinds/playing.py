"""Draws the episodes in which kinds of failures may show, and plays them in lockstep."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from agents.scenario.generate.episode import Episode, generate_of
from agents.scenario.truth.history import History
from benchmarks.honesty.runs import play_text
from benchmarks.kinds.cases import KINDS, Case, cases, shows
from benchmarks.kinds.scenes import SCENES
from dsr.math3d.quaternions import Vector3
from dsr.memory import Memory
from dsr.vocabulary.perceived import is_perceived


class Job(NamedTuple):
    """One episode to play."""

    scene: str
    seed: int


def play_all(jobs: Sequence[Job], processes: int) -> Iterator[list[Case]]:
    """Play episodes, some at a time, each in a process of its own; the cases of each, as they come."""
    with multiprocessing.get_context("spawn").Pool(processes, maxtasksperchild=1) as pool:
        yield from pool.imap_unordered(play_one, jobs)


def episode_of(job: Job) -> Episode:
    """The episode of a scene and a seed in which one of its kinds may show. Raises `ConfigError`."""
    command = f"python -m benchmarks.kinds --episodes 1 --first {job.seed}"
    return generate_of(
        SCENES[job.scene], job.seed, command, lambda history: "" if shows(job.scene, history) else "shows no kind"
    )


def play_one(job: Job) -> list[Case]:
    """Draw an episode, play it, and find its cases. Raises `ConfigError`, `AgentError`."""
    palms: dict[float, dict[str, Vector3]] = {}

    def look(elapsed: float, memory: Memory, history: History) -> None:
        if history.samples and history.samples[-1].time not in palms:
            palms[history.samples[-1].time] = perceived_palms(memory)

    history, told = play_text(episode_of(job).text, job.seed, "poses", look)
    return [case for case in cases(job.seed, history, told, palms) if KINDS[case.kind][0] == job.scene]


def perceived_palms(memory: Memory) -> dict[str, Vector3]:
    """Where the palms are of the hands that are perceived now: m, world, by the hand's node."""
    hands = [node for node in memory.nodes(type="hand") if is_perceived(node, memory.clock.now())]
    found = {node.name: memory.get_transform("world", node.name) for node in hands}
    return {name: pose.t for name, pose in found.items() if pose is not None}
