"""Records the evidence of episodes beside the truth, to a file for each, so that worlds are weighed again off-line."""

from __future__ import annotations

import pickle
import tempfile
from dataclasses import dataclass
from pathlib import Path

from agents.scenario.generate.episode import generate
from agents.scenario.run.runner import play
from agents.scenario.run.staging import Sensor, make_run, staged_system, without
from agents.scenario.truth.history import History
from benchmarks.honesty.watching import watched
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from simulation_handler.belief import Belief
from simulation_handler.worlds.evidence import Evidence


@dataclass(frozen=True)
class Recorded:
    """One moment of an episode: evidence and truth."""

    time: float
    """s after the start"""
    evidence: Evidence
    truth: dict[str, Pose]
    """world_from_object of what is in the scene, by name"""
    in_view: frozenset[str]
    """Names of the objects that the camera recognises by the plant's account"""
    held: dict[str, str]
    """True: objects that are held, and the name of the hand or gripper that holds each"""
    tagged: frozenset[str]
    """Names of the objects that have a tag: cameras see how they are turned"""


def record_episode(family: str, seed: int, sensor: Sensor, file: Path) -> None:
    """Play an episode in lockstep and write its moments, ten a second, to `file`."""
    with tempfile.TemporaryDirectory(prefix="dsr-learning-") as folder:
        episode = Path(folder) / "episode.toml"
        episode.write_text(generate(family, seed).text, encoding="utf-8")
        run = make_run(episode, seed=seed, sensor=sensor)
        system, running = watched(without(staged_system(run), "viewer"))
        tagged = frozenset(spec.name for spec in run.scenario.objects if spec.marker_id is not None)
        moments: list[Recorded] = []

        def look(elapsed: float, memory: Memory, history: History) -> None:
            sample = history.samples[-1] if history.samples else None
            belief = running[-1].belief if running else None
            if sample is None or not isinstance(belief, Belief) or sample.time < 0.0:
                return
            if not moments or sample.time - moments[-1].time >= PERIOD - _SLACK:
                moments.append(
                    Recorded(sample.time, belief.evidence(), sample.truth, sample.in_view, sample.grasped, tagged)
                )

        play(run, system, onlooker=look)
    file.write_bytes(pickle.dumps((run.scenario.settle, moments), protocol=pickle.HIGHEST_PROTOCOL))


PERIOD = 0.1
"""s between two recorded moments"""
_SLACK = 0.01  # s by which a sample may be early
