"""Kinds of failures: when each may show, by the truth alone, and when what is believed is one."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.truth.history import History, Inferred, Sample
from benchmarks.honesty.statement import Likely, Statement, mass_near
from benchmarks.honesty.watching import ToldWorlds
from benchmarks.kinds import __main__ as command
from benchmarks.kinds.cases import (
    DRAGGED,
    EMERGING,
    FALL,
    KINDS,
    LEANING,
    LET_GO,
    LYING,
    ROLLED,
    Case,
    cases,
    moments,
    shows,
)
from benchmarks.kinds.playing import Job, episode_of
from benchmarks.kinds.scenes import SCENES
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import Action

SCENARIO = """
name = "x"
title = "x"
duration = 9.0
settle = 1.0
[[object]]
name = "can"
known = true
color = [0.1, 0.2, 0.9]
position = [0.3, 0.3, 0.05]
shape = [["cylinder", [0.06, 0.06, 0.1]]]
[[object]]
name = "ball"
type = "ball"
known = true
color = [0.9, 0.2, 0.1]
position = [0.3, 0.0, 0.02]
shape = [["sphere", [0.04, 0.04, 0.04]]]
"""
SURE = np.diag([0.01**2] * 3 + [0.02**2] * 3)
UPRIGHT, LYING_DOWN = Pose((0.3, 0.3, 0.05)), Pose.from_rotvec((0.3, 0.3, 0.03), (0.5 * math.pi, 0.0, 0.0))
HAND = "human_hand_0"


def at(x: float, z: float = 0.02) -> Pose:
    return Pose((x, 0.0, z))


def history(course: list[tuple[Pose, Pose, dict[str, object]]]) -> History:
    """Of (can, ball, what else a sample tells), ten times a second from 1 s on."""
    made = History(parse_scenario(SCENARIO))
    for number, (can, ball, more) in enumerate(course):
        sample = {"in_view": frozenset({"can", "ball"}), **more}
        made.add(Sample(time=round(1.0 + 0.1 * number, 1), truth={"can": can, "ball": ball}, **sample))  # type: ignore[arg-type]
    return made


def found(
    made: History, kind: str, told: dict[str, list[tuple[float, Pose]]], palms: dict[str, Vector3] | None = None
) -> list[Case]:
    """The cases of a kind of a belief that says the same all the time."""
    places = {
        name: Statement(tuple(Likely(weight, pose.with_covariance(SURE)) for weight, pose in ways))
        for name, ways in told.items()
    }
    said = {one.time: ToldWorlds(places, {}, {}, {}) for one in made.samples}
    return [one for one in cases(0, made, said, {one.time: palms or {} for one in made.samples}) if one.kind == kind]


def test_a_can_that_rests_on_its_side_in_view_may_be_believed_standing() -> None:
    made = history([*[(UPRIGHT, at(0.3), {})] * 15, *[(LYING_DOWN, at(0.3), {})] * 15])
    right = found(made, LYING, {"can": [(0.7, LYING_DOWN), (0.3, UPRIGHT)]})
    assert len(right) == 5 and not any(case.wrong for case in right) and right[0].time == pytest.approx(3.5)
    standing = found(made, LYING, {"can": [(1.0, UPRIGHT)]})
    assert {(case.wrong, round(case.told, 6)) for case in standing} == {(True, 1.0)}


def test_what_leans_in_view_may_be_believed_with_a_face_down() -> None:
    aslant = Pose.from_rotvec((0.3, 0.3, 0.05), (0.3, 0.0, 0.0))
    made = history([*[(UPRIGHT, at(0.3), {})] * 15, *[(aslant, at(0.3), {})] * 15])
    right = found(made, LEANING, {"can": [(0.7, aslant), (0.3, UPRIGHT)]})
    assert len(right) == 5 and not any(case.wrong for case in right)
    flat = found(made, LEANING, {"can": [(1.0, UPRIGHT)]})
    assert all(case.wrong and case.told > 0.99 for case in flat)
    nobody_knows = Statement((Likely(1.0, UPRIGHT.with_covariance(np.diag([1e-4] * 3 + [1.0] * 3))),))
    said = {one.time: ToldWorlds({"can": nobody_knows}, {}, {}, {}) for one in made.samples}
    assert not any(case.wrong for case in cases(0, made, said, {}) if case.kind == LEANING)


def test_a_ball_that_rolls_out_of_sight_may_be_believed_where_it_vanished() -> None:
    rolls: dict[str, object] = {"moving": frozenset({"ball"})}
    hidden = {**rolls, "in_view": frozenset({"can"})}
    made = history([*[(UPRIGHT, at(0.3), rolls)] * 5, *[(UPRIGHT, at(0.3 + 0.05 * k), hidden) for k in range(10)]])
    stopped = found(made, ROLLED, {"ball": [(1.0, at(0.3))]})
    assert len(stopped) == 6 and all(case.wrong and case.told > 0.99 for case in stopped)
    unsure = found(made, ROLLED, {"ball": [(0.6, at(0.3)), (0.4, at(0.7))]})
    assert unsure[0].wrong and unsure[0].told == pytest.approx(0.6, abs=0.01)


def test_what_comes_out_of_hiding_must_move_and_be_seen_for_a_moment() -> None:
    hidden: dict[str, object] = {"in_view": frozenset({"can"})}
    way = [(UPRIGHT, at(0.3 + 0.03 * k), {}) for k in range(1, 7)]
    made = history([*[(UPRIGHT, at(0.3), hidden)] * 8, *way, *[(UPRIGHT, at(0.48), {})] * 5])
    left = found(made, EMERGING, {"ball": [(1.0, at(0.3))]})
    assert [round(case.time, 1) for case in left] == [2.1, 2.2, 2.3] and all(case.wrong for case in left)
    assert not any(case.wrong for case in found(made, EMERGING, {"ball": [(1.0, at(0.45))]}))


def test_what_was_let_go_unseen_may_be_believed_elsewhere_or_with_the_empty_hand() -> None:
    hidden: dict[str, object] = {"in_view": frozenset({"can"})}
    held = {**hidden, "grasped": {"ball": HAND}}
    made = history([*[(UPRIGHT, at(0.3), held)] * 5, *[(UPRIGHT, at(0.3), hidden)] * 15])
    with_hand = {"ball": [(0.95, at(0.8)), (0.05, at(0.3))]}
    assert len(found(made, LET_GO, with_hand)) == 5 and found(made, LET_GO, with_hand)[0].told > 0.9
    assert found(made, DRAGGED, with_hand) == [], "no hand is in view"
    dragged = found(made, DRAGGED, with_hand, {HAND: (0.8, 0.0, 0.1)})
    assert len(dragged) == 5 and all(case.wrong and case.told == pytest.approx(0.95) for case in dragged)
    elsewhere = found(made, DRAGGED, {"ball": [(1.0, at(0.45))]}, {HAND: (0.8, 0.0, 0.1)})
    assert not any(case.wrong for case in elsewhere), "wrong, but not with the hand"


def test_a_fall_may_be_told_as_a_placement() -> None:
    held: dict[str, object] = {"grasped": {"ball": HAND}}
    course = [(UPRIGHT, at(0.3, height), held) for height in (0.02, 0.06, 0.1, 0.1)]
    made = history([*[(UPRIGHT, at(0.3), {})] * 2, *course, *[(UPRIGHT, at(0.3), {})] * 5])
    (silent,) = found(made, FALL, {})
    assert not silent.wrong
    made.actions.append(Inferred(Action(1.6, "Place", "ball", HAND), 1.9, 0.95))
    (placed,) = found(made, FALL, {})
    assert placed.wrong and placed.told == 0.95
    assert shows("letting_go", made) and not shows("lying", made)
    assert moments(made) == []


def test_what_is_told_near_a_place_is_the_mass_there() -> None:
    two = Statement((Likely(0.7, at(0.0).with_covariance(SURE)), Likely(0.2, at(1.0).with_covariance(SURE))), 0.1)
    assert mass_near(two, (0.0, 0.0, 0.02), 0.1) == pytest.approx(0.7)
    assert mass_near(two, (1.0, 0.0, 0.02), 0.1) == pytest.approx(0.2)
    assert mass_near(two, (0.0, 0.0, 0.02), 0.0154) == pytest.approx(0.35, abs=0.02), "the median of a Gaussian of 1 cm"


def test_a_failure_counts_for_an_episode_if_it_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lasting = [Case(LYING, 1, "can", 0.1 * k, k < 5, 0.95 if k < 5 else 0.0) for k in range(10)]
    short = [Case(LYING, 2, "can", 0.1 * k, k < 4, 0.6 if k < 4 else 0.0) for k in range(10)]
    fall = [Case(FALL, 2, "can", 1.0, True, 0.7)]
    kept = tmp_path / "kept"
    kept.write_bytes(msgspec.msgpack.encode([*lasting, *short, *fall]))
    monkeypatch.setattr("sys.argv", ["kinds", "--read", str(kept), "--failures"])
    command.main()
    told = capsys.readouterr().out
    assert f"| lying | {KINDS[LYING][1]} | 2 | 1 | 1 | 20 | 45% | 25% |" in told
    assert f"| fall | {KINDS[FALL][1]} | 1 | 1 | 0 | 1 | 100% | 0% |" in told
    assert "lying: can of seed 1, 5 moments" in told


@pytest.mark.parametrize("scene", SCENES)
def test_an_episode_shows_a_kind_of_its_scene(scene: str) -> None:
    drawn = episode_of(Job(scene, 3))
    assert "benchmarks.kinds" in drawn.text and parse_scenario(drawn.text).name == f"{scene}-3"
