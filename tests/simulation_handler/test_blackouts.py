"""Somebody may be at work while cameras see nothing: what is seen changed afterwards tells of what is not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from dsr.perception.scales import PRESENT
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence
from simulation_handler.worlds.parameters import WorldParameters, learned_parameters
from simulation_handler.worlds.weighted import WeightedWorlds

STEP = 0.1
COVARIANCE = np.diag([0.001**2] * 3 + [0.01**2] * 3)
PLACES = {"box": Pose((0.3, 0.0, 0.02)), "can": Pose((0.0, 0.4, 0.02)), "cup": Pose((-0.3, 0.0, 0.02))}
ASIDE = Pose((0.15, 0.3, 0.02))
"""Of the can, if somebody moved it"""


def parameters() -> WorldParameters:
    known = learned_parameters()
    rates = msgspec.structs.replace(known.rates, work=0.1, work_removed=0.2, work_moved=0.2, moved=0.005)
    return msgspec.structs.replace(known, rates=rates)


class Blackout:
    """Three things that are seen for a second, and none of them while the lens is covered.

    Args:
        expected: share (0 to 1) of each that should be seen while none is.
        later: share that should be seen of each that is not, by name, while others are; else 0.
    """

    def __init__(self, expected: float = 1.0, later: Mapping[str, float] | None = None) -> None:
        def shares(evidence: Evidence, places: Mapping[str, Sequence[Solid]]) -> dict[str, list[float]]:
            dark = all(evidence.now - thing.seen_at >= PRESENT for thing in evidence.objects.values())
            share = {name: expected if dark else (later or {}).get(name, 0.0) for name in places}
            return {name: [share[name]] * len(there) for name, there in places.items()}

        self.worlds = WeightedWorlds(parameters(), shares)
        self.now = 0.0
        self.places = dict(PLACES)
        self.seen_at = dict.fromkeys(PLACES, 0.0)

    def run(self, seconds: float, *seen: str) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            self.seen_at |= dict.fromkeys(seen, self.now)
            self.worlds.update(Evidence(self.now, {name: self._thing(name) for name in PLACES}, {}, None, frozenset()))

    def _thing(self, name: str) -> ObjectEvidence:
        pose = self.places[name].with_covariance(COVARIANCE)
        seen = self.now - self.seen_at[name] < 0.7
        solid = Solid(name, (0.04, 0.04, 0.04), pose.t, pose.q)
        percept = pose.with_stamp(self.seen_at[name])
        return ObjectEvidence(solid, pose, (0.0, 0.0, 0.0), percept, seen, 10, False, seen=pose if seen else None)

    def gone(self, name: str = "box") -> float:
        return self.weight(name, "gone")

    def weight(self, name: str, reason: str) -> float:
        return sum(world.weight for world in self.worlds.worlds(name) if world.reason == reason)


def after(dark: float, *seen: str, moved: bool = False, expected: float = 1.0) -> Blackout:
    """A blackout after which some things are seen, and the can perhaps elsewhere."""
    scene = Blackout(expected)
    scene.run(1.0, *PLACES)
    scene.run(dark)
    if moved:
        scene.places["can"] = ASIDE
    scene.run(0.5, *seen)
    return scene


def test_what_is_seen_changed_tells_of_what_is_not_seen() -> None:
    nothing, unmoved, moved = after(3.0), after(3.0, "can"), after(3.0, "can", moved=True)
    assert unmoved.gone() < nothing.gone() < 0.5 * moved.gone()
    assert moved.gone() == pytest.approx(0.2, abs=0.05), "somebody was at work, surely"
    assert moved.weight("box", "elsewhere") > 2.0 * unmoved.weight("box", "elsewhere")


def test_what_is_in_the_way_is_no_failure_of_cameras() -> None:
    """An arm hides all things: nobody is thought to be at work, even if one of them is elsewhere then."""
    weights = [after(3.0, expected=expected).gone() for expected in (0.0, 0.3, 1.0)]
    assert weights == sorted(weights) and weights[0] < 0.6 * weights[-1]
    seen = [after(3.0, "can", moved=True, expected=expected).gone() for expected in (0.0, 1.0)]
    assert seen[0] < seen[1], "and there is more that speaks for it if the can is elsewhere"


def _gripped(scene: Blackout, held: str) -> None:
    """A gripper holds that thing."""
    thing = Blackout._thing
    scene._thing = lambda name: replace(thing(scene, name), gripper="gripper" if name == held else "")  # type: ignore[method-assign]


def test_what_a_gripper_puts_elsewhere_afterwards_tells_nothing() -> None:
    found = []
    for carried in (False, True):
        scene = after(3.0)
        scene.seen_at["can"] = scene.now
        _gripped(scene, "can")
        scene.run(0.5, "can")
        del scene._thing
        scene.places["can"] = ASIDE if carried else PLACES["can"]
        scene.run(0.5, "can")
        found.append(scene.gone())
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def test_what_a_gripper_lets_go_of_meanwhile_tells_nothing_of_the_time_before() -> None:
    scene = Blackout()
    scene.run(1.0, *PLACES)
    _gripped(scene, "cup")
    scene.run(8.0)
    del scene._thing
    before = scene.gone()
    scene.run(STEP)
    assert scene.gone() > 0.9 * before > 0.05, "it was held, so nobody could take it"


def test_all_that_is_seen_tells() -> None:
    assert after(3.0, "can", "cup").gone() < after(3.0, "can").gone()
    assert after(3.0, "cup", "can", moved=True).gone() < after(3.0, "can", moved=True).gone()


def test_the_longer_nothing_is_seen_the_more_may_have_happened() -> None:
    weights = [after(dark).gone() for dark in (0.5, 2.0, 8.0, 32.0)]
    assert weights == sorted(weights) and weights[0] < 0.03 and 0.15 < weights[-1] < 0.3


def test_one_thing_that_vanishes_alone_is_no_gap() -> None:
    scene = Blackout()
    scene.run(1.0, *PLACES)
    scene.run(1.0, "can", "cup")
    scene.run(1.0, "can")
    before = scene.gone()
    scene.run(5.0)
    alone = scene.gone()
    assert alone - before < 0.01, "the can may be hidden, as the others are"


def test_what_should_be_seen_and_is_not_tells_of_the_others() -> None:
    """The cup is missed where all of it should be seen, the box where nothing of it should."""
    found = []
    for share in (0.0, 1.0):
        scene = Blackout(later={"cup": share})
        scene.run(1.0, *PLACES)
        scene.run(3.0)
        scene.run(10.0, "can")
        found.append(scene.gone())
    assert found[1] > found[0] + 0.01


def test_a_later_gap_asks_anew_and_keeps_what_was_known() -> None:
    scene = after(3.0, "can", moved=True)
    before = scene.gone()
    scene.run(1.0, "can", "cup")
    kept = scene.gone()
    scene.run(0.5)
    assert scene.gone() == pytest.approx(kept, abs=0.03) and kept < before
    scene.run(30.0)
    assert scene.gone() > kept + 0.05


def test_weights_sum_to_1() -> None:
    scene = after(3.0, "can", moved=True)
    for name in PLACES:
        assert sum(world.weight for world in scene.worlds.worlds(name)) == pytest.approx(1.0)


def test_what_is_held_by_a_gripper_is_not_taken() -> None:
    scene = Blackout()
    scene.run(1.0, *PLACES)
    thing = scene._thing
    scene._thing = lambda name: replace(thing(name), gripper="gripper" if name == "box" else "")  # type: ignore[method-assign]
    scene.run(5.0)
    assert scene.gone() == 0.0 and scene.gone("can") > 0.0


def test_a_night_without_light_is_no_error() -> None:
    scene = Blackout()
    scene.run(1.0, *PLACES)
    scene.run(STEP)
    scene.now += 1e5  # s, as after a machine that slept
    scene.run(1.0)
    scene.run(0.5, "can")
    assert 0.0 < scene.gone("box") <= 1.0


@pytest.mark.parametrize("dark", [300.0, 400.0, 600.0])
def test_after_a_long_time_somebody_was_surely_at_work_whatever_is_seen(dark: float) -> None:
    moved, unmoved = after(dark, "can", moved=True), after(dark, "can")
    assert moved.gone() == pytest.approx(unmoved.gone(), rel=1e-3)


def test_many_things_that_were_moved_tell_of_somebody_after_a_long_time(monkeypatch: pytest.MonkeyPatch) -> None:
    cans = [f"can {number}" for number in range(12)]
    for number, name in enumerate(cans):
        monkeypatch.setitem(PLACES, name, Pose((0.1 * number, -0.5, 0.02)))
    unmoved, moved = Blackout(), Blackout()
    for scene in (unmoved, moved):
        scene.run(1.0, *PLACES)
        scene.run(190.0)
    moved.places |= {name: Pose((x, -0.3, z)) for name in cans for x, _, z in (PLACES[name].t,)}
    for scene in (unmoved, moved):
        scene.run(0.5, *cans)
    assert moved.gone() == pytest.approx(unmoved.gone(), rel=1e-3)


def test_after_a_night_it_is_as_sure_that_somebody_was_at_work_as_after_a_minute() -> None:
    minute, night = after(60.0), after(600.0)
    assert night.gone() >= minute.gone() > 0.15
    assert after(600.0, "can").gone() > 0.15, "one thing in its place is no proof"
