"""Surprise in nats: low while all is as believed, high for what is improbable, less where the belief allowed for it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.surprise_scene import CAMERA, SIX, SurpriseScene, moved
from dsr import Alternative, Pose, Whereabouts
from dsr.believing.absence import learned_recognition
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.believing.distribution import encoded
from dsr.vocabulary.nats import FALSE_FRAME, MOST_MISFIT, MOST_MISSED, SURPRISING
from surprise.config import SurpriseConfig
from surprise.evidence import KEPT
from surprise.improbability import ATTRIBUTE, HandMotion, LatelySeen, at_most, improbability, jump, silence


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
    scene.run(0.9)
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
    scene.run(0.75)
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


def test_a_silent_camera_is_the_more_surprising_the_longer_it_is_silent() -> None:
    assert silence(0.0, 0.2) == 0.0
    assert silence(1.0, 0.2) == pytest.approx(5.0)
    assert silence(90.0, 0.2) == MOST_MISFIT
    scene = SurpriseScene(SIX, seed=5)
    scene.run(2.0)
    scene.hidden |= set(SIX)
    scene.run(1.0)
    assert 3.0 < nats(scene, CAMERA) < SURPRISING
    scene.run(1.0)
    assert nats(scene, CAMERA) >= SURPRISING
    assert scene.is_surprising(CAMERA)


def test_a_hand_is_surprising_that_moves_faster_than_hands_do() -> None:
    begin = Pose((0.0, 0.0, 0.0), stamp=1.0)
    assert jump(begin, Pose((0.07, 0.0, 0.0), stamp=1.1), 0.7, 0.015) < 1.0
    assert jump(begin, Pose((0.9, 0.0, 0.0), stamp=1.1), 0.7, 0.015) > 10.0


@pytest.mark.parametrize(("away", "surprising"), [(1, False), (2, False), (5, True)])
def test_a_hand_jumps_when_several_percepts_have_it_away(away: int, surprising: bool) -> None:
    scene = SurpriseScene(SIX, seed=1)
    scene.memory.add_node("human_hand", "hand")
    places = [0.0] * 10 + [1.5] * away + [0.0] * (0 if surprising else 10)
    highest = 0.0
    for x in places:
        scene.tick()
        scene.memory.add_edge("world", "human_hand", "RT", pose=Pose((x, 0.5, 0.2), stamp=scene.clock.now()))
        scene.tick()
        highest = max(highest, nats(scene, "human_hand"))
    assert (highest >= SURPRISING) is surprising
    assert any(node == "human_hand" for _, node, _, _ in scene.events) is surprising
    scene.run(2.0)
    assert not scene.is_surprising("human_hand")


def test_a_hand_that_comes_back_after_a_while_may_be_anywhere() -> None:
    track = HandMotion(SurpriseConfig())
    for place in range(5):
        track.add(Pose((0.0, 0.0, 0.0), stamp=1.0 + 0.1 * place))
    for place in range(5):
        track.add(Pose((1.0, 0.0, 0.0), stamp=3.0 + 0.1 * place))
    assert track.improbability(3.5) < 1.0
    assert track.improbability(9.0) == 0.0
    track.add(Pose((5.0, 0.0, 0.0), stamp=0.5))
    assert track.improbability(0.5) == 0.0, "the clock was set back"


@pytest.mark.parametrize("tagged", [True, False])
def test_absence_tells_as_much_as_it_is_likely_to_be_recognised(tagged: bool) -> None:
    found = []
    recognition = learned_recognition()
    half = recognition.tag if tagged else recognition.color
    for share in (1.0, half, 0.0):
        scene = SurpriseScene(SIX, seed=4)
        if not tagged:
            scene.memory.remove_attribute("cube_0", "marker_id")
        scene.memory.add_edge(CAMERA, "cube_0", "sees", detectable=share, covered_by="")
        scene.run(2.0)
        scene.hidden.add("cube_0")
        scene.run(1.5)
        found.append(nats(scene, "cube_0"))
        assert scene.is_surprising("cube_0") is (share == 1.0)
    assert found[0] == pytest.approx(MOST_MISSED, abs=1.0)
    assert found[1] == pytest.approx(0.5 * MOST_MISSED, abs=0.6)
    assert found[2] < 0.6


@pytest.mark.parametrize("share", [0.5, 0.75])
def test_a_colour_is_missed_of_which_half_should_be_seen_and_a_tag_is_not(share: float) -> None:
    assert learned_recognition().probability(share, tagged=False) > 0.9
    assert learned_recognition().probability(share, tagged=True) < 0.1


def test_a_thing_that_is_seen_though_gone_is_as_surprising_as_can_be() -> None:
    where = Whereabouts("cube", (Alternative(weight=1.0, pose=None),))
    scene = SurpriseScene(SIX)
    scene.run(1.0)
    tracks = [track for (_, name), track in scene.detector._tracks.items() if name == "cube_0"]
    assert at_most(where, LatelySeen(tracks), scene.detector.config) >= MOST_MISFIT
    highest = improbability(where, LatelySeen(tracks), scene.detector.config)
    assert highest == pytest.approx(-math.log(math.exp(-FALSE_FRAME * KEPT) + math.exp(-MOST_MISFIT)))
    assert improbability(where, LatelySeen(), scene.detector.config) == 0.0
    assert np.isfinite(improbability(where, LatelySeen(missed=10_000), scene.detector.config))


@pytest.mark.parametrize("tagged", [True, False])
def test_no_share_that_somebody_writes_is_beyond_all_and_nothing(tagged: bool) -> None:
    """Before, one such number ended the agents that read it."""
    probability = learned_recognition().probability
    assert probability(-1e12, tagged=tagged) == probability(0.0, tagged=tagged)
    assert probability(1e12, tagged=tagged) == probability(1.0, tagged=tagged)
