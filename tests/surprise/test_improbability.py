"""Surprise in nats: low while all is as believed, high for what is improbable, less where the belief allowed for it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.surprise_scene import CAMERA, SIX, SurpriseScene, moved
from dsr import Alternative, Pose, Whereabouts
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.believing.distribution import encoded
from dsr.vocabulary.nats import CAMERA_MOVED, MOST_MISFIT
from surprise.improbability import ATTRIBUTE, LatelySeen, improbability, jump, silence


def nats(scene: SurpriseScene, name: str = "world") -> float:
    return float(scene.memory.node(name)[ATTRIBUTE])


def allow(scene: SurpriseScene, name: str, weight: float, pose: Pose | None) -> None:
    """Let the belief hold another place of a thing, or its absence, for possible."""
    believed = scene.memory.get_edge("world", name, "Virtual_RT")
    assert believed is not None
    best = believed["pose"]
    sure = None if pose is None else pose.with_covariance(best.covariance)
    alternatives = (
        Alternative(weight=1.0 - weight, pose=best),
        Alternative(weight=weight, pose=sure, reason="tried", worlds=(1,)),
    )
    where = Whereabouts(name, alternatives, (name,), (1.0 - weight, weight))
    scene.memory.update_node(name, **{WHEREABOUTS: encoded(where)})


def test_a_quiet_scene_is_no_surprise_and_is_written_rarely() -> None:
    scene = SurpriseScene(SIX, seed=1)
    scene.run(2.0)
    highest, writes, before = 0.0, 0, {name: nats(scene, name) for name in SIX}
    for _ in range(200):
        scene.run(0.1)
        now = {name: nats(scene, name) for name in SIX}
        writes += sum(now[name] != before[name] for name in SIX)
        highest, before = max(highest, nats(scene)), now
    assert highest < 0.25 * MOST_MISFIT
    assert writes < 60, "in 20 s, of six cubes"
    assert nats(scene) == pytest.approx(sum(nats(scene, name) for name in SIX), abs=0.5 * len(SIX) + 0.5)


def test_a_move_has_many_nats_and_they_are_those_of_the_thing() -> None:
    scene = SurpriseScene(SIX, seed=2)
    scene.run(2.0)
    scene.truths["cube_2"] = moved(scene.truths["cube_2"], 0.05, 1.0)
    scene.run(0.6)
    assert nats(scene, "cube_2") > 0.9 * MOST_MISFIT
    assert max(nats(scene, name) for name in SIX if name != "cube_2") < 0.5 * MOST_MISFIT
    assert nats(scene) > 0.9 * MOST_MISFIT


@pytest.mark.parametrize(("weight", "least", "most"), [(0.3, 0.5, 6.0), (0.02, 3.0, 9.0)])
def test_what_the_belief_allowed_for_costs_as_much_as_it_was_improbable(
    weight: float, least: float, most: float
) -> None:
    scene = SurpriseScene(SIX, seed=3)
    scene.run(2.0)
    there = moved(scene.truths["cube_1"], 0.06, 2.0)
    allow(scene, "cube_1", weight, there)
    scene.run(1.0)
    scene.truths["cube_1"] = there
    scene.run(0.6)
    assert least < nats(scene, "cube_1") < most
    assert nats(scene, "cube_1") > -math.log(weight) - 1.0


def test_worlds_that_percepts_propose_do_not_make_these_percepts_probable() -> None:
    scene = SurpriseScene(SIX, seed=3)
    scene.run(2.0)
    scene.truths["cube_1"] = moved(scene.truths["cube_1"], 0.06, 2.0)
    scene.run(0.15)
    allow(scene, "cube_1", 0.4, scene.truths["cube_1"])  # as a belief does that weighs percepts against its simulation
    scene.run(0.45)
    assert nats(scene, "cube_1") > 0.9 * MOST_MISFIT


def test_what_is_missing_is_as_surprising_as_its_absence_is_improbable() -> None:
    seen: dict[float, float] = {}
    for weight in (0.0, 0.4):
        scene = SurpriseScene(SIX, seed=4)
        scene.run(2.0)
        if weight:
            allow(scene, "cube_0", weight, None)
        scene.hidden.add("cube_0")
        scene.run(1.5)
        seen[weight] = nats(scene, "cube_0")
    assert seen[0.0] > 10.0
    assert seen[0.4] == pytest.approx(-math.log(0.4), abs=0.5)


def test_a_silent_camera_is_surprising_as_a_camera_that_moved_at_most() -> None:
    assert silence(0.1, 0.1) == 0.0
    assert 2.0 < silence(0.2, 0.1) < 3.1
    assert silence(9.0, 0.1) == pytest.approx(CAMERA_MOVED, abs=0.01)
    scene = SurpriseScene(SIX, seed=5)
    scene.run(2.0)
    scene.hidden |= set(SIX)
    scene.run(2.0)
    assert nats(scene, CAMERA) == pytest.approx(CAMERA_MOVED, abs=0.6)


def test_a_hand_is_surprising_that_moves_faster_than_hands_do() -> None:
    begin = Pose((0.0, 0.0, 0.0), stamp=1.0)
    assert jump(begin, Pose((0.07, 0.0, 0.0), stamp=1.1), 0.7, 0.015) < 1.0
    assert jump(begin, Pose((0.9, 0.0, 0.0), stamp=1.1), 0.7, 0.015) > 10.0


def test_a_thing_that_is_seen_though_gone_is_as_surprising_as_can_be() -> None:
    where = Whereabouts("cube", (Alternative(weight=1.0, pose=None),))
    scene = SurpriseScene(SIX)
    scene.run(1.0)
    tracks = [track for (_, name), track in scene.detector._tracks.items() if name == "cube_0"]
    highest = improbability(where, LatelySeen(tracks), scene.detector.config)
    assert highest == pytest.approx(MOST_MISFIT - math.log(2), abs=0.1)
    assert improbability(where, LatelySeen(), scene.detector.config) == 0.0
    assert np.isfinite(improbability(where, LatelySeen(missed=10_000), scene.detector.config))
