"""Weighted worlds: what is hidden stays, what should be seen loses weight, what a hand may have goes along with it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from dsr.errors import ConfigError
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose
from simulation_handler.contact.relations import SupportedPose
from simulation_handler.perception.visibility import ExpectedVisibility, RayVisibility
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.circumstances import (
    CIRCUMSTANCES,
    HELD_ALOFT,
    HELD_LYING,
    HELD_OPENING,
    RESTLESS,
    TOUCHED,
    WITHIN_REACH,
)
from simulation_handler.worlds.evidence import Evidence, HandEvidence, ObjectEvidence, seen_shares
from simulation_handler.worlds.model import WeightedWorld
from simulation_handler.worlds.parameters import WorldParameters, learned_parameters
from simulation_handler.worlds.weighted import ON_COURSE, WeightedWorlds
from tests.simulation_handler.worlds import VIEW, container

COVARIANCE = np.diag([0.001**2] * 3 + [0.01**2] * 3)
CUP: Shape = container((0.1, 0.1, 0.1))
STEP = 0.1
AWAY = HandEvidence(Pose((-0.6, 0.0, 0.2)), True, ())
"""A hand far from all things"""


def thing(pose: Pose, seen_at: float, size: float = 0.04, shape: Shape = (), name: str = "box") -> ObjectEvidence:
    """An object that is believed where it was seen."""
    return ObjectEvidence(
        solid=Solid(name, (size, size, size), pose.t, pose.q, shape=shape),
        believed=pose.with_covariance(COVARIANCE),
        velocity=(0.0, 0.0, 0.0),
        percept=pose.with_stamp(seen_at),
        is_recognised=True,
        agreeing=10,
        is_moving=False,
    )


class Course:
    """A box that is seen until 1 s, and other things: cameras see a `share` of it, and `about` it another one."""

    def __init__(self, share: float = 0.0, about: float = 0.0) -> None:
        self.asked: list[set[str]] = []

        def shares(evidence: Evidence, places: Mapping[str, Sequence[Solid]]) -> dict[str, list[float]]:
            self.asked.append(set(places))
            return {
                name: [share if math.dist(one.position, there[0].position) < 0.03 else about for one in there]
                for name, there in places.items()
            }

        self.worlds = WeightedWorlds(learned_parameters(), shares)
        self.now = 0.0
        self.box = thing(Pose((0.3, 0.0, 0.02)), 0.0)
        self.others: dict[str, ObjectEvidence] = {"other": thing(Pose((0.0, 0.5, 0.02)), 0.0, name="other")}
        self.hands: dict[str, HandEvidence] = {}
        self.fixtures: tuple[Solid, ...] = ()
        self.watching = True

    def run(self, seconds: float, change: Callable[[ObjectEvidence], ObjectEvidence] = lambda box: box) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            box = change(self.box)
            if self.now <= 1.0:
                box = _seen(box, self.now)
            self.box = box
            others = {name: _seen(one, self.now) if self.watching else one for name, one in self.others.items()}
            contents = frozenset(("box", container) for container in box.containers)
            self.worlds.update(Evidence(self.now, {"box": box, **others}, self.hands, None, contents, self.fixtures))

    def weight(self, reason: str) -> float:
        return sum(world.weight for world in self.worlds.worlds("box") if world.reason.startswith(reason))


def _seen(one: ObjectEvidence, now: float) -> ObjectEvidence:
    assert one.percept is not None
    return replace(one, percept=one.percept.with_stamp(now))


def test_what_is_seen_has_one_world_and_its_doubt() -> None:
    course = Course()
    course.run(1.0)
    worlds = course.worlds.worlds("box")
    assert [world.reason for world in worlds] == ["rests in view", *["something unknown is wrong"] * 2]
    spreads = [np.diag(np.array(world.objects["box"].pose.cov).reshape(6, 6)) for world in worlds]  # type: ignore[union-attr]
    assert all((wider >= 4.0 * spread).all() for spread, wider in pairwise(spreads))
    assert sum(world.weight for world in worlds) == pytest.approx(1.0)


def test_what_percepts_contradict_may_be_where_they_have_it() -> None:
    course, seen = Course(), Pose((0.35, 0.0, 0.02)).with_covariance(COVARIANCE)
    course.run(1.0, lambda box: replace(box, seen=seen))
    contradicted = course.weight("as perceived")
    place = next(world.objects["box"].pose for world in course.worlds.worlds("box") if world.reason == "as perceived")
    assert place is not None and place.t == pytest.approx(seen.t)
    agreeing = Course()
    agreeing.run(1.0, lambda box: replace(box, seen=box.believed))
    assert contradicted > agreeing.weight("as perceived") > 0.0


@pytest.mark.parametrize("off", [0.002, 0.2])
def test_what_a_percept_contradicts_is_as_unsure_as_the_percept_is_off_at_most(off: float) -> None:
    course = Course()
    aside = Pose((0.3 + off, 0.0, 0.02))
    course.run(1.0)
    course.worlds.update(
        Evidence(
            1.0,
            {"box": replace(thing(aside, 1.0), believed=course.box.believed, is_moving=True)},
            {},
            None,
            frozenset(),
        )
    )
    pose = course.worlds.pose("box")
    assert pose is not None and pose.cov is not None
    deviation = np.sqrt(np.diag(np.array(pose.cov).reshape(6, 6))[:3])
    learned = learned_parameters().noise[RESTLESS]
    levels = np.minimum((learned.level, learned.level, learned.height), off)
    assert deviation == pytest.approx(levels, abs=0.001)


def test_what_was_taken_away_is_gone_the_more_surely_the_longer_its_place_is_seen_empty() -> None:
    weights = {}
    for share in (0.0, 1.0):
        course = Course(share=share)
        course.run(1.5)
        course.run(0.1, lambda box: replace(box, gone=True, believed=None, solid=None))
        before = course.weight("gone")
        course.run(10.0)
        weights[share] = before, course.weight("gone")
    assert weights[1.0][1] > weights[1.0][0] and weights[1.0][1] > weights[0.0][1] + 0.1


def test_cameras_that_were_in_doubt_are_remembered() -> None:
    course = Course()
    course.run(0.5, lambda box: replace(box, is_doubted=True))
    course.run(0.5, lambda box: replace(box, is_doubted=False))
    assert course.worlds.worlds("box")[0].reason == "rests in view after cameras were in doubt"


def test_what_only_doubted_cameras_see_is_known_by_its_own_circumstance() -> None:
    course = Course()
    course.run(1.0, lambda box: replace(box, is_doubted=True, is_moving=True))
    assert course.worlds.worlds("box")[0].reason == "seen by doubted cameras"


def test_what_is_hidden_stays_believed_and_becomes_less_sure() -> None:
    course = Course(share=0.0)
    course.run(2.0)
    before = course.weight("rests unseen")
    course.run(10.0)
    assert 0.5 < course.weight("rests unseen") < before


def test_what_should_be_seen_in_part_loses_weight_gradually() -> None:
    course, hidden = Course(share=0.75), Course(share=0.0)
    weights = []
    for _ in range(8):
        course.run(10.0)
        hidden.run(10.0)
        weights.append(course.weight("rests unseen"))
        assert hidden.weight("rests unseen") > weights[-1], "absence of what is hidden says nothing"
    assert all(after < before for before, after in pairwise(weights))
    assert weights[0] > 0.5 and weights[-1] < 0.75 * weights[0]
    assert course.weight("gone") + course.weight("elsewhere") > 0.25


def explained(box: ObjectEvidence) -> ObjectEvidence:
    """The box, of which an explanation says that it is gone."""
    return replace(box, gone=True, believed=None, solid=None)


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_what_is_explained_as_gone_while_no_hand_is_about_is_so_more_probably(share: float) -> None:
    alone, beside_a_hand = Course(share), Course(share)
    beside_a_hand.hands["hand"] = AWAY
    for course in (alone, beside_a_hand):
        course.run(1.5)
        course.run(0.1, explained)
    rates = learned_parameters().rates
    more = (1.0 - rates.missed) * (1.0 - rates.slipped) * rates.vanished * share
    assert alone.weight("gone") > beside_a_hand.weight("gone") + 0.5 * more


def test_what_vanishes_where_much_is_hidden_may_be_there() -> None:
    """Behind a screen, beside which it stood."""
    in_sight, beside_a_screen = Course(share=1.0, about=1.0), Course(share=1.0, about=0.0)
    for course in (in_sight, beside_a_screen):
        course.run(1.5)
        course.run(0.1, explained)
        course.run(2.0)
    assert beside_a_screen.weight("elsewhere") > 10.0 * in_sight.weight("elsewhere")
    assert in_sight.weight("gone") > beside_a_screen.weight("gone") > 0.3


def test_what_vanishes_on_its_way_may_be_hidden_nearby_once_its_courses_are_seen_to_be_empty() -> None:
    weights = {}
    for about in (0.0, 1.0):
        course = Course(share=1.0, about=about)
        course.box = replace(course.box, driven=True)
        course.run(1.5)
        course.run(3.0, lambda box: replace(box, courses=(SupportedPose(Pose((0.31, 0.0, 0.02))),)))
        weights[about] = course.weight("astray")
    assert weights[0.0] > 0.8
    assert weights[1.0] < 0.3, "if it would be seen there as well, all places are as improbable"


def test_it_is_so_no_more_probably_while_another_thing_is_seen_elsewhere() -> None:
    course = Course(share=1.0, about=1.0)
    course.run(1.5)
    course.others["other"] = replace(course.others["other"], is_moving=True)
    course.run(0.1, explained)
    before = course.weight("gone")
    course.others["other"] = replace(course.others["other"], is_moving=False)
    course.run(0.1, explained)
    assert before < 0.6 and course.weight("gone") > 0.8


def test_it_is_so_no_more_probably_again_and_again() -> None:
    """An explanation is evidence once: then its place is seen empty, and that has a limit."""
    course = Course(share=1.0)
    course.run(1.5)
    course.run(0.1, explained)
    before = course.weight("rests unseen")
    course.run(0.3, explained)
    assert course.weight("rests unseen") > 0.2 * before


@pytest.mark.parametrize("moves", [False, True])
def test_it_is_so_only_of_what_rested(moves: bool) -> None:
    """What was on its way may have gone behind something."""
    course, rates = Course(share=1.0), learned_parameters().rates
    course.run(1.5, lambda box: replace(box, driven=moves))
    course.run(0.1, explained)
    assert (course.weight("gone") > rates.missed + 0.5 * (1.0 - rates.missed) * rates.vanished) == (not moves)


def test_it_is_so_no_more_once_cameras_saw_nothing_at_all() -> None:
    """It may have been moved then: nobody has seen it vanish alone."""
    told = []
    for watching in (True, False):
        course = Course(share=1.0, about=1.0)
        course.run(1.0)
        course.watching = watching
        course.run(0.5)
        course.watching = True
        course.run(0.3)
        before = course.weight("gone")
        course.run(0.1, explained)
        told.append((course.weight("gone") - before) / (1.0 - before))
    assert told[0] > told[1] + 0.2


def test_what_vanishes_at_the_time_of_all_else_has_not_vanished_alone() -> None:
    box, other = thing(Pose((0.3, 0.0, 0.02)), 1.0), thing(Pose((0.0, 0.5, 0.02)), 1.1, name="other")
    later = replace(other, percept=Pose((0.0, 0.5, 0.02)).with_stamp(1.4))
    told = [Evidence(1.5, {"box": box, "other": one}, {}, None, frozenset()) for one in (other, later)]
    assert [evidence.has_vanished_alone("box") for evidence in told] == [False, True]


def test_cameras_are_asked_once_about_all_unseen_objects() -> None:
    course = Course(1.0)
    course.others["third"] = thing(Pose((0.0, 0.3, 0.02)), 0.0, name="third")
    course.run(1.0)
    course.watching = False
    course.run(2.0)
    course.asked.clear()
    course.run(2.0)
    assert len(course.asked) == 20 and set().union(*course.asked[-2:]) == {"box", "other", "third"}
    assert {len(names) for names in course.asked} == {2}, "all of three within two images"


def test_the_shares_of_many_objects_are_those_of_each() -> None:
    places = {"cup": (0.3, 0.0, 0.05), "box": (0.3, 0.0, 0.03), "low": (0.5, 0.0, 0.02), "high": (0.51, 0.0, 0.06)}
    things = {
        name: thing(Pose(place), 0.0, 0.1 if name == "cup" else 0.04, CUP if name == "cup" else (), name)
        for name, place in places.items()
    }
    calls: list[int] = []
    rays = RayVisibility([VIEW])

    def look(solids: Sequence[Solid], among: Sequence[Solid]) -> list[dict[str, ExpectedVisibility]]:
        calls.append(len(solids))
        return rays.look_for(solids, among)

    evidence = Evidence(1.0, things, {}, look, frozenset({("box", "cup")}))
    solids = [known.solid for known in things.values() if known.solid is not None]
    asked = {solid.name: [solid, solid.moved((0.45, 0.05, 0.02))] for solid in solids}
    together = seen_shares(evidence, asked)
    assert len(calls) <= 4, "about the cup apart from all others"
    assert together == {name: seen_shares(evidence, {name: there})[name] for name, there in asked.items()}
    assert together["low"][0] < together["low"][1] and together["cup"][0] > 0.5
    assert seen_shares(replace(evidence, visibility=None), asked) == {name: [0.0, 0.0] for name in asked}


def test_what_is_seen_over_another_thing_hides_it_before_its_move_is_explained() -> None:
    rays, above = RayVisibility([VIEW]), Pose((0.5, 0.0, 0.06)).with_covariance(COVARIANCE)
    low, other = thing(Pose((0.5, 0.0, 0.02)), 0.0, name="low"), thing(Pose((0.3, 0.1, 0.02)), 0.0, name="other")
    shares = {}
    for is_moving in (False, True):
        moved = replace(other, seen=above, is_moving=is_moving)
        evidence = Evidence(1.0, {"low": low, "other": moved}, {}, rays.look_for, frozenset())
        assert low.solid is not None
        (shares[is_moving],) = seen_shares(evidence, {"low": [low.solid]})["low"]
    assert shares[True] < 0.01
    assert shares[False] > 0.9


def test_blind_cameras_tell_nothing() -> None:
    course = Course(share=1.0)
    course.run(1.2)
    course.watching = False
    course.run(5.0)
    assert course.weight("rests unseen") > 0.8


def test_what_is_seen_again_has_no_alternatives() -> None:
    course = Course(share=0.9)
    course.run(5.0)
    course.run(0.1, lambda box: _seen(box, course.now))
    worlds = course.worlds.worlds("box")
    assert {world.reason for world in worlds} == {"rests in view", "something unknown is wrong"}
    assert worlds[0].reason == "rests in view" and course.weight("gone") == 0.0


def test_what_lies_in_a_vessel_stays_there_whatever_the_simulation_says() -> None:
    cup = thing(Pose((0.3, 0.0, 0.05)), 0.0, 0.1, CUP, "cup")
    course = Course(share=0.0)
    course.others["cup"] = cup
    course.box = replace(course.box, containers=("cup",))
    course.run(2.0)
    course.run(2.0, lambda box: replace(box, gone=True, believed=None, solid=None, containers=()))
    worlds = course.worlds.worlds("box")
    placed = sum(world.weight for world in worlds if world.objects["box"].pose is not None)
    learned = learned_parameters().rates.missed
    assert placed > 0.9 * (1.0 - learned), "only the explanation speaks for its absence"


def test_a_hand_that_was_near_may_have_it() -> None:
    course = Course(share=0.9)
    course.hands["hand"] = HandEvidence(Pose((0.3, 0.0, 0.1)), True, ())
    course.run(2.0)
    course.hands["hand"] = HandEvidence(Pose((0.7, 0.0, 0.2)), True, ())
    course.run(1.0)
    held = [world for world in course.worlds.worlds("box") if world.objects["box"].hand == "hand"]
    assert len(held) == 1 and held[0].weight > 0.0
    assert held[0].objects["box"].pose is not None
    assert held[0].objects["box"].pose.t == pytest.approx((0.7, 0.0, 0.12))


def test_what_may_have_stayed_is_missed_where_it_would_be_however_late_it_did() -> None:
    def shares(evidence: Evidence, places: Mapping[str, Sequence[Solid]]) -> dict[str, list[float]]:
        """Cameras see the place where it was, and not the hand."""
        return {name: [float(solid.position[0] < 0.35) for solid in there] for name, there in places.items()}

    course = Course()
    course.worlds = WeightedWorlds(learned_parameters(), shares)
    course.hands["hand"] = HandEvidence(Pose((0.3, 0.0, 0.1)), True, ())
    course.run(1.0, lambda box: replace(box, hand="hand"))
    for step in range(1, 61):
        away = Pose((0.3 + 0.02 * step, 0.0, 0.1)).with_covariance(COVARIANCE)
        course.run(0.1, lambda box, away=away: replace(box, believed=away))
    course.run(1.5)
    assert course.weight("left") < 0.05


def test_while_cameras_see_nothing_no_place_is_missed() -> None:
    """Nor all at once when they see again."""
    course = Course(share=0.0, about=1.0)
    course.run(1.5)
    course.watching = False
    course.run(5.0)
    before = course.weight("elsewhere")
    course.watching = True
    course.run(0.4)
    assert before > course.weight("elsewhere") > 0.1 * before


def test_what_was_moved_from_a_table_or_beside_it_is_on_it_or_on_the_floor() -> None:
    """A height between the two is true of neither."""
    course, table = Course(), Solid("table", (0.8, 0.8, 0.04), (0.0, 0.0, 0.7), fixed=True)
    course.fixtures = (table, Solid("_floor", (20.0, 20.0, 0.2), (0.0, 0.0, -0.1), fixed=True))
    course.box = thing(Pose((0.38, 0.0, 0.74)), 0.0)
    course.run(20.0)
    fallen = Pose((0.45, 0.0, 0.02)).with_covariance(COVARIANCE)
    course.run(40.0, lambda box: replace(box, believed=fallen))
    told = {
        (world.objects["box"].support, round(height, 2))
        for world in course.worlds.worlds("box") if world.reason == "elsewhere" for height in _heights(world)
    }  # fmt: skip
    assert told == {("table", 0.74), ("", 0.02)}


@pytest.mark.parametrize("place", [0.5, 0.7])
def test_what_a_hand_let_go_in_the_air_is_not_in_the_air_any_more(place: float) -> None:
    """Nor is what the hand put down somewhere near: beyond the edge of the table it is on the floor."""
    course, aloft = Course(), Pose((place, 0.0, 0.4))
    table = Solid("table", (1.2, 1.2, 0.04), (0.0, 0.0, -0.02), fixed=True)
    course.fixtures = (table, Solid("_floor", (20.0, 20.0, 0.2), (0.0, 0.0, -0.8), fixed=True))
    course.hands["hand"] = HandEvidence(aloft, True, ())
    course.box = replace(thing(aloft, 0.0), hand="hand", aloft=True)
    course.run(1.0)
    course.hands["hand"] = HandEvidence(aloft, False, ())
    course.run(3.0)
    let_go = Pose((place, 0.0, 0.02 if place < 0.6 else -0.68)).with_covariance(COVARIANCE)
    course.run(1.0, lambda box: replace(box, hand="", believed=let_go, aloft=False))
    told = {(world.reason, round(height, 2)) for world in course.worlds.worlds("box") for height in _heights(world)}
    assert {height for _, height in told} <= {0.02, 0.06, -0.68}, "on the table, the other thing or the floor"
    assert {("left", round(let_go.t[2], 2)), ("elsewhere", 0.02), ("elsewhere", -0.68)} <= told


def _heights(world: WeightedWorld) -> list[float]:
    pose = world.objects["box"].pose
    return [] if pose is None else [pose.t[2]]


def test_what_is_in_a_hand_out_of_sight_is_not_missing_where_that_was_seen_last() -> None:
    weights = {}
    for is_seen in (True, False):
        course = Course(share=1.0)
        course.hands["hand"] = HandEvidence(Pose((0.3, 0.0, 0.1)), True, ())
        course.run(1.0, lambda box: replace(box, hand="hand"))
        course.hands["hand"] = HandEvidence(Pose((0.3, 0.0, 0.1)), is_seen, ())
        course.run(3.0)
        weights[is_seen] = course.weight("elsewhere")
    assert weights[False] < 0.5 * weights[True]


def test_a_hand_has_what_it_took_as_it_was_while_it_stayed_there() -> None:
    course = Course(share=0.0)
    course.hands["hand"] = HandEvidence(Pose((0.3, 0.0, 0.1)), True, ())
    course.run(2.0)
    for height in (0.13, 0.16, 0.6):  # it goes away, still in reach of the place at first
        course.hands["hand"] = HandEvidence(Pose((0.3, 0.0, height)), True, ())
        course.run(0.1)
    held = next(world for world in course.worlds.worlds("box") if world.objects["box"].hand == "hand")
    assert held.objects["box"].pose is not None
    assert held.objects["box"].pose.t == pytest.approx((0.3, 0.0, 0.6 - 0.08), abs=0.02)


def test_what_may_have_gone_on_or_stayed_rests_there_on_what_carries_it() -> None:
    course = Course(share=0.0)
    course.box = replace(course.box, driven=True, supports=("table",))
    course.run(1.0)
    there, fallen = SupportedPose(Pose((0.5, 0.0, 0.02)), ("table",)), SupportedPose(Pose((0.9, 0.0, -0.4)))
    away = Pose((0.4, 0.0, 0.02)).with_covariance(COVARIANCE)
    course.run(0.5)
    course.run(0.3, lambda box: replace(box, believed=away, courses=(there, there, there, fallen)))
    told = {world.reason: world.objects["box"].supports for world in course.worlds.worlds("box")}
    assert told["left"] == ("table",), "where it was seen last, the table carries it"
    on_table = sum(world.weight for world in course.worlds.worlds("box") if world.objects["box"].supports == ("table",))
    assert course.weight(ON_COURSE) > 0.1 and course.weight("elsewhere") < 0.02
    assert on_table == pytest.approx(1.0 - course.weight("astray") - course.weight(ON_COURSE) / 4, abs=0.02)


def test_what_went_on_into_a_container_is_in_it() -> None:
    course = Course(share=0.0)
    course.box = replace(course.box, driven=True)
    course.run(1.5)
    course.others = {"cup": thing(Pose((0.5, 0.0, 0.05)), 0.0, 0.1, CUP, "cup")}
    inside, beside = SupportedPose(Pose((0.5, 0.0, 0.03)), ("cup",)), SupportedPose(Pose((0.7, 0.0, 0.02)), ("table",))
    course.run(0.3, lambda box: replace(box, courses=(inside, beside)))
    on_course = [world for world in course.worlds.worlds("box") if world.reason == ON_COURSE]
    assert {world.objects["box"].supports: world.objects["box"].containers for world in on_course} == {
        ("cup",): ("cup",),
        ("table",): (),
    }


@pytest.mark.parametrize(("height", "may_be_in"), [(0.05, True), (0.09, True), (0.25, False)])
def test_what_vanishes_on_its_way_enters_nothing_that_is_all_above_it(height: float, may_be_in: bool) -> None:
    course = Course(share=0.0)
    course.others["cup"] = thing(Pose((0.32, 0.0, height)), 0.0, 0.1, CUP, "cup")
    course.run(1.5, lambda box: replace(box, driven=True))
    assert (course.weight("inside cup") > 0.0) == may_be_in


def test_a_hand_that_holds_something_takes_nothing_else() -> None:
    weights = {}
    for held in ("", "hand"):
        course = Course()
        course.hands = {"hand": HandEvidence(Pose((0.3, 0.0, 0.1)), True, ())}
        course.others["other"] = replace(course.others["other"], hand=held)
        course.run(1.0)
        course.run(5.0)
        weights[held] = course.weight("in hand"), course.weight("elsewhere")
    assert weights[""][0] > 0.05 and weights["hand"][0] == 0.0
    assert weights["hand"][1] < weights[""][1]


def test_what_the_simulation_has_taken_away_may_still_rest_where_it_was() -> None:
    course = Course(share=0.0)
    course.box = replace(course.box, supports=("table",))
    course.run(1.5)
    course.run(0.5, lambda box: replace(box, gone=True, believed=None, solid=None, supports=()))
    worlds = course.worlds.worlds("box")
    on_table = sum(world.weight for world in worlds if world.objects["box"].supports == ("table",))
    assert course.weight("gone") > 0.0 and on_table == pytest.approx(course.weight("rests unseen"), abs=0.02)
    assert on_table > 0.1


def test_a_hand_holds_what_is_in_the_air_more_probably_than_what_lies_or_what_it_opens_about() -> None:
    shares = {HELD_ALOFT: 0.97, HELD_LYING: 0.7, HELD_OPENING: 0.1}
    for aloft, opens, share in ((True, False, 0.97), (False, False, 0.7), (False, True, 0.1), (True, True, 0.97)):
        course = Course()
        course.worlds = WeightedWorlds(msgspec.structs.replace(learned_parameters(), holding=shares))
        course.run(1.0, lambda box, aloft=aloft, opens=opens: replace(box, hand="hand", aloft=aloft, opens=opens))
        held = sum(world.weight for world in course.worlds.worlds("box") if world.objects["box"].hand)
        assert held == pytest.approx(share)


def _shares_of_hold(course: Course, **held: Any) -> dict[str, float]:
    """By the name of a hand, the probability that it holds the box, which is seen in the air."""
    course.run(1.0, lambda box: replace(box, aloft=True, **held))
    found: dict[str, float] = {}
    for world in course.worlds.worlds("box"):
        hand = world.objects["box"].hand
        found[hand] = found.get(hand, 0.0) + world.weight
    return found


def test_hands_that_hold_a_thing_together_as_it_seems_share_what_is_told_of_its_hold() -> None:
    held = learned_parameters().holding[HELD_ALOFT]
    told = _shares_of_hold(Course(), hand="second", held_by=("first", "second"))
    assert told == pytest.approx({"first": 0.5 * held, "second": 0.5 * held, "": 1.0 - held})


FINGERTIPS = ((0.3, 0.1, 0.1),) * 5


@pytest.mark.parametrize(
    ("palm", "fingertips", "is_seen", "shares"),
    [
        ((0.2, 0.0, 0.02), FINGERTIPS[:3], True, True),
        ((0.2, 0.0, 0.02), FINGERTIPS[:3], False, False),
        ((0.2, 0.0, 0.02), FINGERTIPS, True, False),
        ((0.0, 0.0, 0.02), FINGERTIPS[:3], True, False),
    ],
)
def test_a_hand_at_a_thing_in_another_one_may_have_taken_it_unless_its_fingers_tell(
    palm: Vector3, fingertips: tuple[Vector3, ...], is_seen: bool, shares: bool
) -> None:
    course = Course()
    course.hands = {
        "giver": HandEvidence(Pose((0.4, 0.0, 0.02), (0.0, 0.0, 1.0, 0.0)), True, FINGERTIPS),
        "taker": HandEvidence(Pose(palm), is_seen, fingertips),
    }
    told = _shares_of_hold(course, hand="giver", held_by=("giver",))
    held = learned_parameters().holding[HELD_ALOFT]
    assert told["giver"] == pytest.approx(0.5 * held if shares else held)
    assert told.get("taker", 0.0) == pytest.approx(0.5 * held if shares else 0.0)


def test_what_hovered_before_a_hand_came_to_it_may_still_be_in_the_hand_of_somebody_unknown() -> None:
    held = learned_parameters().holding[HELD_ALOFT]
    told = _shares_of_hold(Course(), hand="hand", held_by=("hand",), hovers=True)
    assert told == pytest.approx({"hand": 0.5 * held, "": 1.0 - 0.5 * held})


@pytest.mark.parametrize("is_seen", [False, True])
def test_a_hand_out_of_sight_may_take_what_is_in_another_one_out_of_sight(is_seen: bool) -> None:
    course, away = Course(), Pose((5.0, 0.0, 0.0))
    course.hands = {
        "giver": HandEvidence(away.with_stamp(0.2), is_seen, ()),
        "taker": HandEvidence(away.with_stamp(-5.0), False, ()),
    }
    told = _shares_of_hold(course, hand="giver", held_by=("giver",))
    held, rate = learned_parameters().holding[HELD_ALOFT], learned_parameters().rates.taken
    kept = 1.0 if is_seen else 0.5 + 0.5 * math.exp(-2.0 * 0.8 * rate)
    assert told["giver"] == pytest.approx(held * kept)
    assert told.get("taker", 0.0) == pytest.approx(held * (1.0 - kept))


def test_hands_out_of_sight_for_long_have_what_one_of_them_held_with_the_same_probability() -> None:
    course, held, names = Course(), learned_parameters().holding[HELD_ALOFT], ("giver", "second", "third")
    stamps = dict(zip(names, (-500.0, -400.0, -300.0), strict=True))
    course.hands = {name: HandEvidence(Pose((5.0, 0.0, 0.0), stamp=stamps[name]), False, ()) for name in names}
    told = _shares_of_hold(course, hand="giver", held_by=("giver",))
    assert [told[name] for name in names] == pytest.approx([held / 3.0] * 3, rel=1e-3)


def test_what_hovers_is_held_no_less_probably_once_a_hand_touches_it() -> None:
    hidden = HandEvidence(Pose((0.2, 0.0, 0.02)), True, FINGERTIPS[:3])
    told = []
    for touched in ((), ("hand",)):
        course = Course()
        course.hands = {"hand": hidden}
        told.append(_shares_of_hold(course, hovers=True, touched_by=touched)["hand"])
    assert told[0] == told[1] == pytest.approx(learned_parameters().holding[WITHIN_REACH])


def test_what_a_hand_touches_is_held_no_more_probably_while_it_is_seen_by_doubted_cameras() -> None:
    told = []
    for is_doubted in (False, True):
        course = Course()
        course.hands = {"hand": HandEvidence(Pose((0.3, 0.0, 0.06)), True, FINGERTIPS)}
        told.append(_shares_of_hold(course, touched_by=("hand",), is_doubted=is_doubted)["hand"])
    assert told == pytest.approx([learned_parameters().holding[TOUCHED]] * 2)


@pytest.mark.parametrize(("aloft", "age"), [(False, 0.0), (True, 5.0)])
def test_what_lies_or_is_out_of_sight_is_in_no_hand_that_merely_could_reach_it(aloft: bool, age: float) -> None:
    course = Course()
    course.hands = {"hand": HandEvidence(Pose((0.2, 0.0, 0.02)), True, FINGERTIPS[:3])}
    course.run(1.0 + age, lambda box: replace(box, aloft=aloft))
    assert all(world.objects["box"].hand == "" or world.reason == "in hand" for world in course.worlds.worlds("box"))


@pytest.mark.parametrize("later", [0.0, 100.0])
def test_a_hand_told_to_be_out_of_sight_this_moment_has_taken_nothing_yet(later: float) -> None:
    course, held = Course(), learned_parameters().holding[HELD_ALOFT]
    stamp = course.now + 1.0 + later
    course.hands = {name: HandEvidence(Pose((5.0, 0.0, 0.0), stamp=stamp), False, ()) for name in ("giver", "taker")}
    told = _shares_of_hold(course, hand="giver", held_by=("giver",))
    assert told == pytest.approx({"giver": held, "": 1.0 - held})


@pytest.mark.parametrize("busy", [False, True])
def test_what_hovers_may_be_in_a_hand_within_reach_whose_fingers_are_hidden(busy: bool) -> None:
    course = Course()
    course.hands = {"hand": HandEvidence(Pose((0.2, 0.0, 0.02)), True, FINGERTIPS[:4])}
    course.others["other"] = replace(course.others["other"], hand="hand" if busy else "")
    told = _shares_of_hold(course)
    expected = {} if busy else {"hand": learned_parameters().holding[WITHIN_REACH]}
    assert {hand: share for hand, share in told.items() if hand} == pytest.approx(expected)


def test_parameters_are_complete(tmp_path: Path) -> None:
    learned = learned_parameters()
    assert set(learned.noise) >= set(CIRCUMSTANCES)
    with pytest.raises(ConfigError, match="rests in view"):
        WeightedWorlds(msgspec.structs.replace(learned, noise={}))
    file = tmp_path / "worlds.toml"
    file.write_text("[parameters.rates]\nmoved = -1.0\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"worlds\.toml"):
        learned_parameters(file)
    everywhere = {name: msgspec.structs.replace(noise, perceived=1.0) for name, noise in learned.noise.items()}
    with pytest.raises(msgspec.ValidationError, match="perceived"):  # no odds tell what is certain
        msgspec.convert(msgspec.to_builtins(msgspec.structs.replace(learned, noise=everywhere)), WorldParameters)
