"""What cannot be meant is found by playing the true course: things in one another, moves that overlap in time."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from agents.scenario import cli
from agents.scenario.check.faults import deepest
from agents.scenario.check.file_check import Findings, look_through
from agents.scenario.format.scenario import parse_scenario, scenario_files
from dsr.files.built_in import ETC
from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose
from tests.agents.scenario.test_format import BASE

MORE = """
[[object]]
name = "cover"
model = "cover_small"
known = true
position = [0.3, 0.25, 0.07]

[[object]]
name = "under"
marker_id = 5
position = [0.3, 0.25, 0.02]
"""
MISSION = '[mission]\ngoal = "on(a, b)"\n'


def events(*lines: str) -> str:
    return "".join("\n[[event]]\n" + line.replace("; ", "\n") + "\n" for line in lines)


def check(folder: Path, *lines: str, base: str = BASE, options: tuple[str, ...] = ()) -> tuple[int, str]:
    file = folder / "x.toml"
    file.write_text(base + events(*lines))
    outcome = CliRunner().invoke(cli.app, ["check", str(file), *options])
    return outcome.exit_code, " ".join(outcome.output.split())


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            ["do = 'place'; object = 'a'; position = [0.41, 0.01, 0.02]; at = 1"],
            "x.toml:19: event.1: place: 'a' would be 30.0 mm inside 'b' at 1.00 s; expected a free place",
        ),
        (
            ["do = 'slide'; object = 'a'; by = [0.2, 0]; at = 1"],
            "x.toml:19: event.1: slide: 'a' goes through 'b', which stands in its way at 1.65 s; expected a free way",
        ),
        (
            [
                "do = 'slide'; object = 'b'; by = [0, 0.2]; at = 1",
                "do = 'slide'; object = 'a'; by = [0.1, 0.1]; at = 4",
                "do = 'place'; object = 'a'; position = [0.4, 0.19, 0.02]; at = 7",
            ],
            "x.toml:31: event.3: place: 'a' would be 30.0 mm inside 'b' at 7.00 s",
        ),
        (
            ["do = 'carry'; object = 'a'; to = [0.39, 0.0, 0.02]; at = 1"],
            "event.1: carry: 'a' is driven",
        ),
        (
            ["do = 'hand_grasp'; object = 'a'; at = 1", "do = 'hand_move'; by = [0, 0, -0.02]; at = 4"],
            "event.2: hand_move: 'a' is driven",
        ),
        (
            [
                "do = 'slide'; object = 'a'; by = [0, 0.1]; at = 1",
                "do = 'slide'; object = 'a'; by = [0, 0.1]; at = 1.5",
            ],
            "event.2: slide: 'a' is still in event 1 (slide, 1.00 to 2.00 s) when this begins at 1.50 s; expected one",
        ),
        (
            ["do = 'slide'; object = 'a'; by = [0, 0.1]; at = 1", "do = 'lift'; object = 'a'; height = 0.1; at = 1"],
            "event.2: lift: 'a' is still in event 1 (slide, 1.00",
        ),
        (
            [
                "do = 'carry'; object = 'a'; to = [0.3, 0.2, 0.02]; at = 1; hand = 0",
                "do = 'carry'; object = 'b'; to = [0.4, 0.2, 0.02]; at = 2; hand = 0",
            ],
            "event.2: carry: hand 0 is still in event 1 (carry, 1.00 to",
        ),
        (
            ["do = 'hand_enter'; position = [0.3, 0.2, 0.2]; at = 1", "do = 'hand_move'; by = [0, 0, 0.1]; at = 1.2"],
            "event.2: hand_move: hand 0 is still in event 1 (hand_enter, 1.00 to",
        ),
        (
            ["do = 'remove'; object = 'a'; at = 1", "do = 'push'; object = 'a'; velocity = [1, 0, 0]; at = 2"],
            "event.2: push: could not be carried out: no object 'a' in the scene",
        ),
        (
            [
                "do = 'remove'; object = 'a'; at = 1",
                "do = 'false_percept'; object = 'a'; translation = [0.1, 0, 0]; at = 2",
            ],
            "event.2: false_percept: could not be carried out: no object 'a' in the scene",
        ),
        (
            ["do = 'drop'; object = 'a'; at = 1"],
            "event.1: drop: could not be carried out: nobody holds 'a'",
        ),
        (
            ["do = 'remove'; object = 'a'; at = 9; delay = 2"],
            "event.1.delay: 11.0 s is after the end; expected at most 10.0 s",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_with_names_and_times(tmp_path: Path, lines: list[str], message: str):
    code, text = check(tmp_path, *lines)
    assert code == 1
    assert message in text


@pytest.mark.parametrize(
    "lines",
    [
        ["do = 'place'; object = 'a'; onto = 'b'; at = 1"],
        ["do = 'slide'; object = 'a'; by = [0.1, 0]; pushes = ['b']; at = 1"],
        ["do = 'slide'; object = 'a'; by = [0, 0.1]; at = 1", "do = 'slide'; object = 'b'; by = [0, 0.1]; at = 1"],
        ["do = 'slide'; object = 'a'; by = [0.1, 0]; at = 1", "do = 'slide'; object = 'b'; by = [0.1, 0]; at = 1"],
        ["do = 'slide'; object = 'cover'; by = [0.1, 0]; at = 1"],
        ["do = 'place'; object = 'a'; onto = 'b'; at = 1", "do = 'slide'; object = 'b'; by = [0.0, 0.1]; at = 2"],
        ["do = 'swap'; object = 'a'; other = 'b'; at = 1"],
        ["do = 'lift'; object = 'a'; height = 0.1; at = 1", "do = 'drop'; object = 'a'; at = 3"],
        ["do = 'hand_grasp'; object = 'a'; style = 'touch'; at = 1", "do = 'drop'; object = 'a'; at = 5"],
        [
            "do = 'slide'; object = 'a'; by = [0, 0.1]; at = 1",
            "do = 'place'; object = 'a'; onto = 'b'; when = 'held(a)'",
        ],
    ],
)
def test_what_may_be_meant_is_accepted(tmp_path: Path, lines: list[str]):
    code, text = check(tmp_path, *lines, base=BASE + MORE)
    assert code == 0, text


def test_a_swap_with_something_larger_needs_room(tmp_path: Path):
    cover = MORE.partition("\n[[object]]\nname = \"under\"")[0]
    base = BASE.replace("position = [0.3, 0.0, 0.02]", "position = [0.33, 0.0, 0.02]") + cover
    code, text = check(tmp_path, "do = 'swap'; object = 'a'; other = 'cover'; at = 1", base=base)
    assert code == 1 and "event.1: swap: 'cover' would be" in text and "inside 'b' at 1.00 s" in text


def test_where_a_robot_acts_only_hands_are_looked_at(tmp_path: Path):
    into = "do = 'place'; object = 'a'; position = [0.41, 0.01, 0.02]; at = 1"
    hands = ["do = 'hand_enter'; position = [0.3, 0.2, 0.2]; at = 1", "do = 'hand_leave'; at = 1.2"]
    assert check(tmp_path, into, base=BASE + MISSION)[0] == 0
    assert "hand 0 is still in event 2" in check(tmp_path, into, *hands, base=BASE + MISSION)[1]


def test_without_playing_only_the_file_is_read(tmp_path: Path):
    into = "do = 'place'; object = 'a'; position = [0.41, 0.01, 0.02]; at = 1"
    assert check(tmp_path, into, options=("--no-play",))[0] == 0


def test_what_is_pushed_must_be_another_object_of_the_file(tmp_path: Path):
    slide = "do = 'slide'; object = 'a'; by = [0.1, 0]; at = 1; pushes = "
    assert "event.1.pushes: unknown object 'c'" in check(tmp_path, slide + "['c']")[1]
    assert "event.1.pushes: an object cannot push itself" in check(tmp_path, slide + "['a']")[1]


def test_a_cylinder_is_no_larger_than_it_is():
    scenario = parse_scenario(BASE)
    can = replace(scenario.object("a"), shape=(Part("cylinder", (0.04, 0.04, 0.04)),))
    scenario = replace(scenario, objects=[can, scenario.object("b")])
    at_corner = Pose((0.4 + 0.02 + 0.015, 0.02 + 0.015, 0.02))  # the box around it would reach 5 mm into the cube
    beside = Pose((0.4 + 0.02 + 0.015, 0.0, 0.02))
    others = {"b": Pose((0.4, 0.0, 0.02))}
    assert deepest("a", at_corner, others, scenario) == ("", 0.0)
    assert deepest("a", beside, others, scenario) == ("b", pytest.approx(0.005, abs=2e-4))


def test_what_falls_where_it_is_put_is_told_and_no_error(tmp_path: Path):
    high = "do = 'place'; object = 'a'; position = [0.2, 0.3, 0.12]; at = 1"
    code, text = check(tmp_path, high)
    assert code == 0 and "! " in text
    assert "x.toml:19: event.1: place: 'a' falls" in text and "it does not stay where it is put" in text
    over_the_edge = "do = 'carry'; object = 'a'; to = [0.96, 0.0, 0.02]; height = 0.1; at = 1"
    assert "event.1: carry: 'a' falls" in check(tmp_path, over_the_edge)[1]
    by_hand = "do = 'carry'; object = 'a'; to = [0.2, 0.3, 0.12]; hand = 0; at = 1"
    assert "event.1: carry: 'a' falls" in check(tmp_path, by_hand)[1], "before the hand has drawn back"
    beside = "do = 'place'; object = 'a'; position = [0.43, 0.0, 0.06]; at = 1"
    assert "event.1: place: 'a' falls" in check(tmp_path, beside)[1], "half beside what it stands on"
    assert "event.1" not in check(tmp_path, "do = 'place'; object = 'a'; onto = 'b'; at = 1")[1]


def test_what_waits_for_what_nobody_does_is_told(tmp_path: Path):
    kill = "do = 'kill'; agent = 'planner'; when = 'built(a, b)'"
    assert "event.1: kill: does not begin: 'built(a, b)' does not come true" in check(tmp_path, kill)[1]
    assert "does not begin" not in check(tmp_path, kill, base=BASE + MISSION)[1], "a robot may bring it about"
    place = "do = 'place'; object = 'a'; onto = 'b'; at = 1"
    assert "does not begin" not in check(tmp_path, kill, place)[1]


def test_what_nothing_is_recognised_by_is_told(tmp_path: Path):
    thing = "\n[[object]]\nname = 'c'\nposition = [0.3, 0.2, 0.02]\n"
    assert "never recognised" not in check(tmp_path, base=BASE + thing)[1], "nothing is expected of it"
    thing += "\n[[expect]]\ncheck = 'belief_error'\n"
    code, text = check(tmp_path, base=BASE + thing)
    assert code == 0 and "'c' is never recognised: it has no `marker_id`" in text
    known = thing.replace("name = 'c'", "name = 'c'\nknown = true\ncolor = [0.6, 0.1, 0.6]")
    assert "never recognised" not in check(tmp_path, base=BASE + known)[1]
    seen = BASE.replace("name =", "system = 'untagged'\nname =", 1) + thing
    assert "never recognised" not in check(tmp_path, base=seen)[1], "found by depth"


def test_what_falls_at_the_start_is_told(tmp_path: Path):
    base = BASE.replace("position = [0.3, 0.0, 0.02]", "position = [0.3, 0.0, 0.2]")
    code, text = check(tmp_path, base=base)
    assert code == 0 and "'a' falls" in text and "before the start: nothing holds it there" in text


def test_a_file_that_judges_nothing_or_has_persons_whom_nobody_minds_is_told(tmp_path: Path):
    assert "there is no [[expect]]: nothing is judged" in check(tmp_path)[1]
    person = "\n[[person]]\nname = 'anne'\nposition = [1.0, 0.0, 0.5]\nlook_at = [0.3, 0.0, 0.0]\n"
    assert "nobody keeps what persons believe" in check(tmp_path, base=BASE + person)[1]


def test_all_errors_of_a_file_are_told_at_once(tmp_path: Path):
    slide = "do = 'slide'; object = 'nobody'; by = [0.1, 0]; at = 1"
    place = "do = 'place'; object = 'a'; onto = 'a'; at = 1"
    code, text = check(tmp_path, slide, place)
    assert code == 1 and "2 errors:" in text
    assert "event.1.object: unknown object 'nobody'" in text and "event.2.onto: an object cannot" in text


@pytest.mark.parametrize("file", sorted(scenario_files().values()), ids=lambda file: file.stem)
def test_nothing_is_found_in_what_comes_along(file: Path):
    assert look_through(str(file)) == Findings()


def test_a_goal_that_holds_in_no_world_is_doubted_unless_that_is_expected(tmp_path: Path) -> None:
    mission = '[mission]\ngoal = "on(a, b) & on(b, a)"\n'
    code, output = check(tmp_path, base=BASE + mission)
    assert code == 0
    assert "the goal never holds: on(a,b) and on(b,a) exclude each other: a would rest on itself" in output
    code, output = check(tmp_path, base=BASE + mission + '[[expect]]\ncheck = "mission"\nstatus = "unsolvable"\n')
    assert code == 0 and "never holds" not in output


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("agents.arm_controller:ArmController", "agents.arm_controller:ArmControler", "'ArmControler'"),
        ("observe_joints", "observe_jionts", "observe_jionts"),
        ("agents.arm_controller:ArmController", "idle_arm:IdleArm", "has no method tick"),
    ],
)
def test_a_system_with_a_mistake_fails_the_check(tmp_path: Path, old: str, new: str, said: str) -> None:
    system = (ETC / "systems/tabletop.toml").read_text()
    assert old in system
    (tmp_path / "mine.toml").write_text(system.replace(old, new, 1))
    (tmp_path / "idle_arm.py").write_text("from dsr import Agent\n\n\nclass IdleArm(Agent):\n    pass\n")
    file = tmp_path / "s.toml"
    file.write_text('system = "mine.toml"\n' + BASE)
    outcome = CliRunner().invoke(cli.app, ["check", "--no-play", str(file)])
    assert outcome.exit_code == 1
    assert said in outcome.output and "mine.toml" in outcome.output
