"""The true course of a scenario, without any agent: what is played, found in it and shown."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from agents.scenario import cli
from agents.scenario.check.truth_report import truth_report
from agents.scenario.format.scenario import parse_scenario
from agents.scenario.run.runner import true_course
from agents.scenario.run.staging import make_run
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.phases import phases
from dsr.math3d.transforms import Pose
from tests.agents.scenario.test_format import BASE

STAGE = """\
name = "course"
title = "What happens"
duration = 7.0
system = "reasoner"
camera = { position = [-0.9, 0.0, 1.5], look_at = [0.0, 0.0, 0.72] }
robot = { model = "none" }
[random]
position = 0.01
[[object]]
name = "ball"
model = "ball"
known = true
position = [0.3, 0.4, 0.03]
[[object]]
name = "large_cube_with_a_name_that_is_long"
marker_id = 1
position = [0.3, 0.0, 0.02]
[[object]]
name = "stays"
marker_id = 2
position = [0.5, 0.0, 0.02]
"""
EVENTS = """
[[event]]
at = 1.0
do = "roll"
object = "ball"
velocity = [0.0, 1.0]
[[event]]
at = 1.5
do = "carry"
object = "large_cube_with_a_name_that_is_long"
to = [0.3, -0.2, 0.02]
hand = 1
[[event]]
at = 5.5
do = "remove"
object = "stays"
[[event]]
when = "resting(stays)"
do = "kill"
agent = "chronicler"
"""
WRONG = """
[[event]]
at = 5.8
do = "drop"
object = "ball"
[[event]]
at = 5.9
do = "slide"
object = "stays"
by = [0.1, 0.0]
[[event]]
when = "built(ball, stays)"
do = "remove"
object = "ball"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "course.toml"
    path.write_text(STAGE + EVENTS)
    return path


def show(file: Path, *options: str) -> tuple[int, str]:
    outcome = CliRunner().invoke(cli.app, ["truth", str(file), *options], env={"COLUMNS": "80"})
    assert outcome.exception is None or isinstance(outcome.exception, SystemExit), outcome.exception
    return outcome.exit_code, outcome.output


def test_the_course_tells_who_moved_fell_and_left_when(file: Path, tmp_path: Path):
    target = tmp_path / "new" / "course.json"
    code, text = show(file, "--json-file", str(target))
    assert code == 0
    report = json.loads(target.read_text())
    begins = [event["begin"] for event in report["events"]]
    assert begins[:3] == pytest.approx([1.0, 1.5, 5.5], abs=0.01)
    assert begins[3] == pytest.approx(0.2, abs=0.1), "the condition of a kill is looked at too"
    ball, cube, stays = report["phases"]
    assert (ball["object"], ball["rests_on"], ball["held_by"]) == ("ball", ["floor"], [])
    assert ball["fell"] == pytest.approx(0.72, abs=0.02) and 1.0 < ball["fell_at"] < 2.0
    assert ball["position"] == pytest.approx(report["tracks"]["ball"][-1][1][:3], abs=1e-3)
    assert (cube["held_by"], cube["rests_on"], cube["fell"]) == (["human_hand_1"], ["table"], 0.0)
    assert cube["moved"] == pytest.approx(0.25, abs=0.02) and cube["end"] < 7.0
    assert (stays["object"], stays["gone"], stays["begin"]) == ("stays", True, pytest.approx(5.5, abs=0.1))
    assert report["gone"] == ["stays"]
    assert "is removed" in text and "on floor" in text and "0.72 m at" in text


def test_the_table_fits_into_80_columns_and_tells_what_could_not_be_done(file: Path):
    file.write_text(STAGE + EVENTS + WRONG)
    code, text = show(file)
    assert code == 1
    assert max(map(len, text.splitlines())) <= 80
    flat = " ".join(text.split())
    assert "could not be carried out: no object 'stays' in the scene" in flat
    assert "has not begun: waits for built(ball, stays)" in flat


def test_the_same_seed_gives_the_same_course_and_another_one_another(file: Path):
    first, again, other = (truth_report(true_course(make_run(file, seed=seed)), seed) for seed in (3, 3, 4))
    assert first == again
    assert [pose.pose for pose in first.final] != [pose.pose for pose in other.final]


def test_a_false_percept_ends_though_nobody_looks(tmp_path: Path):
    event = "[[event]]\nat = 1.0\ndo = 'false_percept'\nobject = 'a'\nframes = 5\ntranslation = [0.1, 0.0, 0.0]\n"
    path = tmp_path / "small.toml"
    path.write_text(BASE + event)
    begin, end = true_course(make_run(path)).spans[1]
    assert end is not None and end - begin == pytest.approx(0.5, abs=0.11)


def test_a_false_percept_ends_when_its_object_is_removed(tmp_path: Path):
    event = "[[event]]\nat = 1.0\ndo = 'false_percept'\nobject = 'a'\nframes = 50\ntranslation = [0.1, 0.0, 0.0]\n"
    path = tmp_path / "small.toml"
    path.write_text(BASE + event + "[[event]]\nat = 2.0\ndo = 'remove'\nobject = 'a'\n")
    assert true_course(make_run(path)).spans[1][1] == pytest.approx(2.0, abs=0.02)


def test_what_lies_still_has_no_phase(tmp_path: Path):
    path = tmp_path / "small.toml"
    path.write_text(BASE)
    history = true_course(make_run(path))
    assert len(history.samples) > 150 and phases(history) == []
    code, text = show(path)
    assert code == 0 and "Nothing moves." in text


def test_what_rides_on_something_does_not_fall_and_a_phase_at_the_end_is_not_over():
    scenario = parse_scenario(BASE.replace("position = [0.3, 0.0, 0.02]", "position = [0.4, 0.0, 0.06]"))
    history = History(scenario)
    for step in range(20):
        height = 0.3 - 0.01 * step
        poses = {"b": Pose((0.4, 0.0, height)), "a": Pose((0.4, 0.0, height + 0.04))}
        history.add(Sample(time=step * 0.05, truth=poses, grasped={"b": "unknown"}))
    upper, lower = phases(history)
    assert (upper.object, upper.fell, upper.end, upper.rests_on) == ("a", 0.0, None, ("b",))
    assert (lower.object, lower.held_by, lower.moved) == ("b", ("unknown",), pytest.approx(0.19))
