"""A scenario file is read completely or refused with the file, the line and what was expected."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from agents.scenario.format.coloring import color_clash
from agents.scenario.format.geometry import penetration
from agents.scenario.format.layout import object_box
from agents.scenario.format.model import Scenario
from agents.scenario.format.scenario import (
    CameraCover,
    CameraSpec,
    PlaceEvent,
    load_scenario,
    parse_scenario,
    scenario_files,
    start_poses,
)
from dsr.errors import ConfigError

BASE = """\
name = "small"
title = "Two cubes"
duration = 10.0

[[object]]
name = "a"
marker_id = 1
position = [0.3, 0.0, 0.02]

[[object]]
name = "b"
marker_id = 2
position = [
    0.4,
    0.0,  # y
    0.02,
]
"""


def refusal(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_scenario(text, "x.toml")
    return str(caught.value)


def with_line(line: str, where: str = "duration = 10.0") -> str:
    return BASE.replace(where, f"{where}\n{line}")


def test_a_small_file_gets_documented_defaults():
    scenario = parse_scenario(BASE)
    assert scenario.camera == "overhead"
    assert scenario.object("b").position == (0.4, 0.0, 0.02)
    assert scenario.object("a").size == (0.04, 0.04, 0.04)
    assert scenario.robot.model == "gen3" and len(scenario.robot.start) == 7
    assert scenario.sensor.depth_bias == (0.0, 0.0)
    assert scenario.events == scenario.expectations == []


def test_objects_may_be_seen_too_low():
    scenario = parse_scenario(with_line("[sensor]\ndepth_bias = [-0.015, 0.005]"))
    assert scenario.sensor.depth_bias == (-0.015, 0.005)


STAND = """
[camera]
position = [-0.9, 0.0, 1.5]
look_at = [0.0, 0.0, 0.72]
"""
NO_ROBOT = "[robot]\nmodel = 'none'\n"


def test_without_a_robot_nothing_can_wait_for_it():
    event = "[[event]]\nwhen = 'resting(a) and held(a)'\ndo = 'remove'\nobject = 'a'\n"
    assert "event.1.when: held(a): there is no robot" in refusal(on_a_stand() + event)


def on_a_stand(more: str = "", camera: str = STAND) -> str:
    return with_line(f'system = "reasoner"\n{NO_ROBOT}{camera}{more}')


def test_a_camera_on_a_stand_looks_where_it_should_and_is_level():
    scenario = parse_scenario(on_a_stand())
    assert isinstance(scenario.camera, CameraSpec) and scenario.camera_name == "fixed"
    pose = scenario.camera.pose
    assert pose.t == (-0.9, 0.0, 1.5)
    centre = pose.inverse().apply([0.0, 0.0, 0.72])
    assert centre == pytest.approx([0.0, 0.0, np.hypot(0.9, 0.78)])
    left, above = pose.inverse().apply([0.0, 0.1, 0.72]), pose.inverse().apply([0.0, 0.0, 0.82])
    assert left[0] == pytest.approx(-0.1) and left[1] == pytest.approx(0.0)
    assert above[0] == pytest.approx(0.0) and above[1] < -0.05


@pytest.mark.parametrize("height", [1.0, -1.0])
def test_a_camera_may_look_straight_down_or_up(height: float):
    camera = CameraSpec(position=(0.2, 0.1, height), look_at=(0.2, 0.1, 0.0))
    matrix = camera.pose.rotation_matrix
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    assert camera.pose.inverse().apply([0.2, 0.1, 0.0])[2] == pytest.approx(1.0)
    assert camera.pose.inverse().apply([0.3, 0.1, 0.0])[:2] == pytest.approx([0.0, -0.1])


NOTHING = [
    ("'slide'\nobject = 'a'\nby = [0, 0]", "slide: expected a motion that is not zero"),
    ("'tilt'\nobject = 'a'\nangle = 0", "tilt: expected an `angle` that is not zero"),
    ("'hand_move'\nby = [0, 0, 0]", "hand_move: expected a motion that is not zero"),
    ("'false_percept'\nobject = 'a'", "false_percept: expected an error that is not zero"),
    ("'camera_bump'", "camera_bump: expected a motion that is not zero"),
    ("'camera_cover'\nduration = 0", "camera_cover: expected a `duration` that is not zero"),
    ("'arm_error'\ntranslation = [0, 0, 0]\nduration = 1", "arm_error: expected an error that is not zero"),
    ("'arm_error'\ntranslation = [0, 0, 0.01]\nduration = 0", "arm_error: expected a `duration` that is not zero"),
]
"""Events that change nothing, and what is told of them."""


@pytest.mark.parametrize("section", [field.encode_name for field in msgspec.structs.fields(Scenario)])
def test_unknown_fields_of_all_sections_are_told(section: str) -> None:
    """Those of a list of tables in their first element; a section that is no table is told likewise."""
    for header in (f"[{section}]", f"[[{section}]]"):
        with pytest.raises(ConfigError):
            parse_scenario(f"{header}\nfieldd = 1\n", "x.toml")
    with pytest.raises(ConfigError, match=r"x\.toml:1: "):
        parse_scenario(f"[[{section}s]]\n", "x.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (on_a_stand(camera=STAND.replace("[0.0, 0.0, 0.72]", "[-0.9, 0.0, 1.5]")), "camera.look_at: expected another"),
        (on_a_stand(camera=STAND.replace("look_at", "lok_at")), "camera.lok_at: unknown field; did you mean 'look_at'"),
        (on_a_stand(camera="[camera]\nposition = [0.0, 0.0, 1.0]"), "missing required field `look_at`"),
        (with_line(STAND), "camera: the system 'tabletop' has no agent 'fixed_camera'"),
        (with_line(NO_ROBOT), "robot.model: the system 'tabletop' has an arm"),
        (with_line(f'system = "reasoner"\ncamera = "wrist"\n{NO_ROBOT}'), "camera: there is no robot to carry"),
        (on_a_stand("[mission]\ngoal = 'on(a, b)'"), "mission: there is no robot to do it"),
        (
            on_a_stand('[[event]]\nat = 1\ndo = "camera_cover"\nduration = 1.0\ncamera = "wrist"'),
            "event.1.camera: there is no camera 'wrist'",
        ),
        (
            on_a_stand('[[event]]\nat = 1\ndo = "arm_error"\nduration = 1.0\ntranslation = [0.1, 0.0, 0.0]'),
            "event.1: there is no robot",
        ),
        (with_line('camera = "overhed"'), "unknown value 'overhed'"),
    ],
)
def test_what_is_used_of_arm_and_cameras_must_be_there(text: str, message: str):
    assert message in refusal(text)


def test_events_and_conditions_are_read():
    text = (
        BASE
        + """
[[event]]
when = "built(a, b) and resting(b)"
delay = 1.0
do = "place"
object = "a"
position = [0.3, 0.1, 0.02]

[[event]]
at = 3
do = "camera_cover"
duration = 2.0
"""
    )
    place, cover = parse_scenario(text).events
    assert isinstance(place, PlaceEvent) and isinstance(cover, CameraCover)
    assert place.condition is not None and cover.condition is None
    assert place.condition.holds(lambda term: term.predicate in ("built", "resting"))
    assert not place.condition.holds(lambda term: term.objects == ("b",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (with_line("durration = 3"), "x.toml:4: durration: unknown field; did you mean 'duration'?"),
        (
            with_line("[sensor]\ndepth_jiter = 0.1"),
            "x.toml:5: sensor.depth_jiter: unknown field; did you mean",
        ),
        (with_line("siz = [1, 1, 1]", "marker_id = 2"), "x.toml:13: object.2.siz: unknown field"),
        (with_line("camera = 'front'"), "x.toml:4: camera: unknown value 'front'; valid: overhead, wrist"),
        (
            with_line("type = 'cub'", "marker_id = 1"),
            "x.toml:8: object.1.type: unknown value 'cub'; did you mean",
        ),
        (BASE.replace("duration = 10.0\n", ""), "x.toml: missing required field `duration`"),
        (
            BASE.replace("duration = 10.0", "duration = 'long'"),
            "x.toml:3: duration: expected `float` (s), got 'long'",
        ),
        (
            BASE.replace("duration = 10.0", "duration = -1"),
            "x.toml:3: duration: expected `float` > 0.0 (s), got -1",
        ),
        (BASE.replace("duration = 10.0", "duration = nan"), "x.toml:3: duration: expected a finite number"),
        (BASE.replace("0.4,", "inf,"), "x.toml:13: object.2.position.1: expected a finite number"),
        (BASE.replace("0.4,", "'left',"), "x.toml:13: object.2.position.1: expected `float` (m), got 'left'"),
        (
            BASE.replace("    0.4,\n", ""),
            "x.toml:13: object.2.position: expected `array` of length 3 (m), got [0.0, 0.02]",
        ),
        (
            with_line("size = [40, 40, 40]", "marker_id = 1"),
            "x.toml:8: object.1.size.1: expected `float` <= 5.0 (m)",
        ),
        (with_line("mass = 1e-300", "marker_id = 1"), "x.toml:8: object.1.mass: expected `float` >= 0.0001 (kg)"),
        (
            with_line("yaw = 90", "marker_id = 1"),
            "x.toml:8: object.1.yaw: expected `float` <= 6.2832 (rad), got 90",
        ),
        (
            with_line("marker = 4", "marker_id = 1"),
            "object.1.marker: unknown field; did you mean 'marker_id'?",
        ),
        (BASE.replace("marker_id = 2", "marker_id = 587"), "12: object.2.marker_id: expected `int` <= 586, got 587"),
        (
            BASE.replace("marker_id = 2", "marker_id = 1"),
            "x.toml:12: object.2.marker_id: 'b' has the marker 1 of 'a'",
        ),
        (BASE.replace('"b"', '"a"'), "x.toml:11: object.2.name: the name 'a' is taken"),
        (BASE.replace('"b"', '"table"'), "x.toml:11: object.2.name: the name 'table' is taken"),
        (BASE.replace('"b"', '"b c"'), "x.toml:11: object.2.name: name 'b c': expected 1 to 64 letters"),
        (BASE.replace("0.4,", "0.33,"), "x.toml:13: object.2.position: 'b' and 'a' overlap by 10.0 mm"),
        (
            BASE.replace("[0.3, 0.0, 0.02]", "[0.3, 0.0, 0.01]"),
            "x.toml:8: object.1.position: 'a' is 10.0 mm inside",
        ),
        (with_line("settle = 20"), "x.toml:4: settle: settle = 20.0 s; expected less than the duration"),
        (
            with_line("[sensor]\ndepth_bias = [0.02, 0.01]"),
            "x.toml:5: sensor.depth_bias: [0.02, 0.01] m: expected",
        ),
        (
            with_line("system = 'tabeltop'"),
            "x.toml:4: system: unknown system 'tabeltop'; did you mean 'tabletop'?",
        ),
        (
            with_line("[robot]\nmodel = 'gen4'"),
            "x.toml:5: robot.model: unknown model 'gen4'; valid: gen3",
        ),
        (with_line("[robot]\nstart = [0, 0]"), "x.toml:5: robot.start: expected 7 joint positions (rad), got 2"),
        (with_line("sensor = 3"), "x.toml:4: sensor: expected `table`, got 3"),
        (
            with_line("system = 'people'\n[robot]\nmodel = 'none'"),
            "camera: the system 'people' has a camera on a stand; expected [camera], with its place",
        ),
        (
            with_line("system='people'\n[camera]\nposition=[0,0,1]\nlook_at=[1,0,0]\n[mission]\ngoal='clear(a)'"),
            "x.toml:8: mission: the system 'people' has no agent 'mission'; expected another",
        ),
        *((f"{BASE}[[event]]\nat = 1\ndo = {event}\n", f"x.toml:18: event.1: {message}") for event, message in NOTHING),
        ("name = 'x\n", "x.toml:1: not valid TOML: Expected"),
        ("a = 1\na = 2\n", "x.toml:2: not valid TOML: Cannot overwrite a value"),
    ],
)
def test_wrong_values_are_refused_with_line_and_expectation(text: str, message: str):
    assert message in refusal(text)


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ("do = 'plce'", "x.toml:20: event.1.do: unknown value 'plce'; did you mean 'place'?"),
        ("at = 1", "x.toml:19: event.1: missing required field `do`; valid: arm_error, camera_bump"),
        ("do = 'drop'\nobject = 'a'", "x.toml:19: event.1: expected either `at` (s) or `when`"),
        (
            "do = 'drop'\nobject = 'a'\nat = 1\nwhen = 'resting(a)'",
            "event.1: expected either `at` (s) or `when`",
        ),
        ("do = 'drop'\nobject = 'c'\nat = 1", "x.toml:21: event.1.object: unknown object 'c'; valid: a, b"),
        ("do = 'drop'\nobject = 'a'\nat = 11", "x.toml:22: event.1.at: 11.0 s is after the end"),
        (
            "do = 'drop'\nobject = 'a'\nwhen = 'reste(a)'",
            "x.toml:22: event.1.when: unknown predicate 'reste'; did you",
        ),
        ("do = 'drop'\nobject = 'a'\nwhen = 'built(a)'", "event.1.when: 'built(a)': expected 2 object(s)"),
        ("do = 'drop'\nobject = 'a'\nwhen = 'resting(c)'", "event.1.when: unknown object 'c'"),
        (
            "do = 'drop'\nobject = 'a'\nwhen = 'resting'",
            "event.1.when: condition 'resting': expected 'predicate(",
        ),
        ("do = 'place'\nobject = 'a'\nat = 1", "event.1: place: expected either `position` (m) or `onto`"),
        (
            "do = 'place'\nobject = 'a'\nat = 1\nonto = 'a'",
            "x.toml:23: event.1.onto: an object cannot be placed onto",
        ),
        ("do = 'place'\nobject = 'a'\nat = 1\nonto = 'z'", "x.toml:23: event.1.onto: unknown object 'z'"),
        (
            "do = 'place'\nobject = 'a'\nat = 1\nposition = [0.3, 0, 0]",
            "x.toml:23: event.1.position: 'a' would be",
        ),
        ("do = 'carry'\nobject = 'a'\nat = 1\nto = [0.3, 0, -0.01]", "x.toml:23: event.1.to: 'a' would be"),
        (
            "do = 'slide'\nobject = 'a'\nat = 1\nto = [0.3, 0, 0]",
            "event.1.to: expected `array` of length 2 (m), got [0.3, 0, 0]",
        ),
        (
            "do = 'slide'\nobject = 'a'\nat = 1\nto = [0.3, 0]\nspeeed = 1",
            "event.1.speeed: unknown field; did you",
        ),
        ("do = 'kill'\nagent = 'plant'\nwhen = 'resting(c)'", "x.toml:22: event.1.when: unknown object 'c'"),
        ("do = 'remove'\nobject = 'a'\nwhen = 'built(a, a)'", "when: built(a, a): expected two different objects"),
        ("do = 'push'\nobject = 'a'\nat = 1", "x.toml:19: event.1: push: expected either `velocity` (m/s) or"),
        (
            "do = 'push'\nobject = 'a'\nat = 1\nvelocity = [1, 0, 0]\nimpulse = [1, 0, 0]",
            "push: expected either `velocity` (m/s) or `impulse` (N s)",
        ),
        ("do = 'push'\nobject = 'a'\nat = 1\nvelocity = [0, 0, 0]", "push: expected a motion that is not zero"),
        (
            "do = 'push'\nobject = 'a'\nat = 1\nvelocity = [0, 0, 1]\nhand = 0",
            "event.1.hand: push: a hand pushes sideways; expected a motion along x or y",
        ),
        (
            "do = 'push'\nobject = 'a'\nat = 1\nimpulse = [0, 3, 4]",
            "23: event.1.impulse: would change the velocity of 'a' by 100.0 m/s; expected at most 0.25 N s",
        ),
        (
            "do = 'push'\nobject = 'a'\nat = 1\nvelocity = [9, 0, 0]",
            "event.1.velocity.1: expected `float` <= 5.0 (m/s), got 9",
        ),
        (
            "do = 'roll'\nobject = 'a'\nat = 1\nvelocity = [1, 0]",
            "21: event.1.object: 'a' is no ball and cannot roll; expected an object whose only part is a sphere",
        ),
        ("do = 'roll'\nobject = 'a'\nat = 1\nvelocity = [1, 0, 0]", "expected `array` of length 2 (m/s), got [1, 0"),
        ("do = 'kill'\nagent = 'plnt'\nat = 1", "21: event.1.agent: unknown agent 'plnt'; did you mean 'plant'?"),
    ],
)
def test_wrong_events_are_refused(event: str, message: str):
    assert message in refusal(f"{BASE}\n[[event]]\n{event}\n")


@pytest.mark.parametrize(
    ("check", "message"),
    [
        ("check = 'restin'", "x.toml:20: expect.1.check: unknown value 'restin'; did you mean 'resting'?"),
        ("tolerance = 1", "x.toml:19: expect.1: missing required field `check`; valid: actions"),
        (
            "check = 'resting'\nobjects = ['c']",
            "x.toml:21: expect.1.objects: unknown object 'c'; valid: a, b",
        ),
        (
            "check = 'resting'\nat = 12",
            "x.toml:21: expect.1.at: 12.0 s is after the end; expected at most 10.0 s",
        ),
        (
            "check = 'resting'\ntolerance = 1",
            "x.toml:21: expect.1.tolerance: expected `float` <= 0.5 (m), got 1",
        ),
        ("check = 'no_drift'\nafter = 10", "x.toml:21: expect.1.after: the window begins at 10.0 s"),
        (
            "check = 'no_drift'\nat = 3",
            "x.toml:21: expect.1.at: the window begins at 4.0 s; expected before 3.0 s",
        ),
        ("check = 'edges'", "x.toml:19: expect.1: edges: expected `present` or `absent`"),
        (
            "check = 'edges'\nabsent = [['gripper', 'a']]\ntype = 'graspin'",
            "x.toml:22: expect.1.type: unknown edge type 'graspin'; did you mean 'grasping'?",
        ),
        ("check = 'recovered'\nagent = 'x'", "x.toml:21: expect.1.agent: no event kills 'x'; none is known"),
    ],
)
def test_wrong_expectations_are_refused(check: str, message: str):
    assert message in refusal(f"{BASE}\n[[expect]]\n{check}\n")


@pytest.mark.parametrize(
    "name", ["human_hand_1", "human_hand_0_finger_4", "arm_link_7", "timeline", "unknown", "plant", "scene_estimator"]
)
def test_what_agents_call_their_nodes_and_themselves_is_no_name_of_another_thing(name: str):
    taken = f"name: the name '{name}' is taken; expected a name used once"
    assert f"x.toml:11: object.2.{taken}" in refusal(BASE.replace('"b"', f'"{name}"'))
    person = f'[[person]]\nname = "{name}"\nposition = [1, 0, 1]\nlook_at = [0, 0, 0]\n'
    assert f"person.1.{taken}" in refusal(BASE + person)


def test_a_thing_may_be_called_like_an_agent_of_another_system():
    assert parse_scenario(BASE.replace('"b"', '"fixed_camera"')).object("fixed_camera").marker_id == 2


def test_a_name_that_is_no_scenario_lists_the_valid_ones():
    with pytest.raises(ConfigError, match="unknown scenario 'howering'; did you mean 'hovering'"):
        load_scenario("howering")


def test_a_file_of_another_ending_is_told_apart_from_an_unknown_name(tmp_path: Path):
    file = tmp_path / "episode.txt"
    file.write_text(BASE, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"episode\.txt: no scenario file; expected .* ends in \.toml"):
        load_scenario(file)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"gone\.toml: cannot be read"):
        load_scenario(tmp_path / "gone.toml")


def test_a_file_that_is_no_text_is_refused(tmp_path: Path):
    (tmp_path / "x.toml").write_bytes(b"name = '\xff\xfe'")
    with pytest.raises(ConfigError, match=r"x\.toml: is no UTF-8 text"):
        load_scenario(tmp_path / "x.toml")


def test_built_in_scenarios_are_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert load_scenario("hovering").name == "hovering"


def test_scenarios_of_the_current_folder_are_found_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    Path("etc/scenarios").mkdir(parents=True)
    Path("etc/scenarios/mine.toml").write_text(BASE)
    assert load_scenario("mine").name == "small"


@pytest.mark.parametrize("name", sorted(scenario_files()))
def test_built_in_scenarios_are_valid_and_called_like_their_files(name: str):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.expectations


@pytest.mark.parametrize("name", sorted(scenario_files()))
def test_objects_start_apart_for_every_seed(name: str):
    scenario = load_scenario(name)
    for seed in range(10):
        boxes = [object_box(spec) for spec in start_poses(scenario, np.random.default_rng(seed))]
        assert all(penetration(a, b) < 0.001 for i, a in enumerate(boxes) for b in boxes[:i])


def test_start_poses_repeat_with_the_seed_and_differ_between_seeds():
    scenario = parse_scenario(with_line("[random]\nposition = 0.01\nyaw = 3.0"))
    first, again, other = (start_poses(scenario, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again != other
    for drawn, spec in zip(first, scenario.objects, strict=True):
        assert np.all(np.abs(np.subtract(drawn.position, spec.position)) <= (0.01, 0.01, 0))


def test_without_random_the_objects_start_as_written():
    scenario = parse_scenario(BASE)
    assert start_poses(scenario, np.random.default_rng(0)) == scenario.objects


def test_a_tower_is_moved_as_one():
    text = with_line("[random]\nposition = 0.02").replace("0.4,\n", "0.3,\n").replace("    0.02,", "    0.06,")
    a, b = start_poses(parse_scenario(text), np.random.default_rng(3))
    assert a.position[:2] == b.position[:2] != (0.3, 0.0)


def test_objects_without_room_for_their_variation_are_refused():
    text = BASE.replace("0.4,", "0.34,").replace("duration", "random = {yaw = 3.0}\nduration")
    crowded = text + "".join(
        f'\n[[object]]\nname = "c{i}"\nposition = [{0.3 + 0.04 * (i % 6)}, {0.04 + 0.04 * (i // 6)}, 0.02]'
        for i in range(24)
    )
    with pytest.raises(ConfigError, match=r"26 objects overlap in each of 200 draws; expected a smaller \[random\]"):
        start_poses(parse_scenario(crowded), np.random.default_rng(0))


CUP = '\n[[object]]\nname = "cup"\nmodel = "cup"\nknown = true\nposition = [0.3, 0.2, 0.045]\n'
BALL = CUP.replace('model = "cup"', 'model = "ball"')
UNDER_A_COVER = """
[[object]]
name = "cover"
model = "cover_large"
marker_id = 9
position = [0.3, 0.0, 0.075]
"""


def test_a_model_gives_what_the_file_leaves_out():
    cup = parse_scenario(BASE + CUP).object("cup")
    assert (cup.type, cup.mass, len(cup.shape)) == ("cup", 0.1, 13)
    assert cup.by_color
    cup = parse_scenario(BASE + CUP + "mass = 0.3\nfriction = 0.2\ncolor = [0.0, 1.0, 0.0]\n").object("cup")
    assert (cup.mass, cup.friction, cup.color, len(cup.shape)) == (0.3, 0.2, (0.0, 1.0, 0.0), 13)


HAND = '[[event]]\nat = 1.0\ndo = "hand_enter"\nposition = [0.3, 0.0, 0.2]\n'


@pytest.mark.parametrize(
    ("color", "message"),
    [
        (
            "[0.7, 0.58, 0.45]",
            "that of the table is too much like it: 0 degrees between (0.7, 0.58, 0.45) and (0.62, 0.52, 0.4)",
        ),
        ("[0.3, 0.3, 0.31]", "that of the floor is too much like it"),
        ("[0.5, 0.6, 0.5]", "that of tags and all that is grey is too much like it"),  # the arm's shell is grey, too
        ("[0.5, 0.52, 0.56]", "that of the arm is too much like it"),
        ("[0.4, 0.17, 0.15]", "that of 'a' is too much like it"),  # which has the first of the plant's colours
        ("[0.0, 0.0, 0.2]", "(0.0, 0.0, 0.2) is too dark to be told from black"),
    ],
)
def test_colors_must_differ_from_all_else_that_is_drawn(color: str, message: str):
    assert f"x.toml:19: object.3: 'cup' is recognised by its colour, but {message}" in refusal(
        BASE + CUP + f"color = {color}\n"
    )


def test_skin_is_a_color_where_there_are_hands():
    text = BASE + CUP + "color = [0.8, 0.4, 0.55]\n"
    assert parse_scenario(text).object("cup").by_color
    assert "object.3: 'cup' is recognised by its colour, but that of hands is too much" in refusal(text + HAND)
    parse_scenario(text.replace("known = true", "marker_id = 9").replace('model = "cup"', 'model = "box"') + HAND)


def test_the_arm_has_the_colors_of_its_description(tmp_path: Path):
    (tmp_path / "gen3.urdf").write_text(
        '<robot name="r"><material name="m"><color rgba="0 0.9 0.9 1"/></material><link name="l"/></robot>'
    )
    scenario = parse_scenario(BASE + CUP + "color = [0.0, 0.6, 0.6]\n")
    assert color_clash(scenario, None) is None
    clash = color_clash(scenario, tmp_path)
    assert clash is not None and clash[0] == 2 and "that of the arm is too much like it" in clash[1]


def test_a_model_beside_the_file(tmp_path: Path):
    own = Path(__file__).parents[3] / "etc" / "objects" / "box.urdf"
    (tmp_path / "mine.urdf").write_text(own.read_text().replace("0.08 0.06 0.05", "0.1 0.06 0.05"))
    file = tmp_path / "x.toml"
    file.write_text(BASE + CUP.replace('"cup"', '"mine.urdf"').replace('"mine.urdf"', '"pot"', 1))
    assert load_scenario(file).object("pot").size == (0.1, 0.06, 0.05)
    (tmp_path / "mine.urdf").write_text("<robot/>")
    with pytest.raises(ConfigError, match=r"x\.toml:21: object\.3\.model: .*mine\.urdf: 0 <link> elements"):
        load_scenario(file)


def test_a_solid_model_may_have_another_size():
    text = BASE + CUP.replace('model = "cup"', 'model = "box"') + "size = [0.02, 0.03, 0.04]\n"
    assert parse_scenario(text).object("cup").size == (0.02, 0.03, 0.04)


def test_what_stands_under_a_cover_does_not_overlap_it_and_moves_with_it():
    text = BASE.replace("0.4,", "0.5,") + UNDER_A_COVER + "[random]\nposition = 0.2\n"
    for seed in range(20):
        objects = {spec.name: spec for spec in start_poses(parse_scenario(text), np.random.default_rng(seed))}
        assert objects["a"].position[:2] == objects["cover"].position[:2]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CUP.replace('model = "cup"', 'model = "cpu"'), "object.3.model: unknown model 'cpu'; did you mean 'cup'"),
        (CUP.replace('model = "cup"', 'type = "cup"'), "object.3.type: a cup needs a `model`"),
        (CUP.replace('model = "cup"', "model = 3"), "object.3.model: expected `str | null`, got 3"),
        (CUP.replace("known = true\n", ""), "object.3: 'cup' is recognised by its colour: expected `known = true`"),
        (CUP + "marker_id = 9\n", "object.3.marker_id: 'cup' has no closed upper face for a tag"),
        (CUP + "size = [0.1, 0.1, 0.1]\n", "object.3.size: only a model of one upright box can have another size"),
        (BALL + "size = [0.1, 0.1, 0.1]\n", "object.3.size: only a model of one upright box can have another size"),
        (CUP + "shape = [1.0]\n", "object.3.shape"),
        (
            CUP + CUP.replace('"cup"', '"mug"', 1).replace("0.2,", "0.3,"),
            "object.3: 'cup' is recognised by its colour, but that of 'mug' is too much like it: 0 degrees between",
        ),
        (UNDER_A_COVER.replace("0.3, 0.0", "0.37, 0.0"), "'cover' and 'a' overlap by"),
    ],
)
def test_what_is_wrong_with_a_model_is_named(text: str, message: str):
    assert message in refusal(BASE + text)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ('name = "a"\nposition = [1, 0, 1]\nlook_at = [0, 0, 0]', "the name 'a' is taken"),
        ('name = "p"\nposition = [1, 0, 1]\nlook_at = [1, 0, 1]', "expected another place than its `position`"),
        ('name = "p"\nposition = [1, 0, 1]\nlook_at = [0, 0, 0]\nfov = [4.0, 1.0]', "fov"),
    ],
)
def test_wrong_persons_are_refused(lines: str, expected: str):
    assert expected in refusal(f"{BASE}\n[[person]]\n{lines}\n")


def test_an_event_of_somebody_unknown_is_refused_with_the_names_that_are_known():
    person = '[[person]]\nname = "anne"\nposition = [1, 0, 1]\nlook_at = [0, 0, 0]\n'
    leaving = '[[event]]\nat = 1.0\ndo = "person_leave"\nperson = "{}"\n'
    assert "unknown person 'ann'; did you mean 'anne'" in refusal(BASE + person + leaving.format("ann"))
    assert parse_scenario(BASE + person + leaving.format("anne")).persons[0].present


SHAPED = """
name = "shaped"
title = "x"
duration = 5.0
[[object]]
name = "thing"
marker_id = 1
"""


def test_an_object_is_made_of_parts_that_the_file_gives():
    parts = 'shape = [["cylinder", [0.04, 0.04, 0.1]], ["box", [0.1, 0.02, 0.02], [0.03, 0, 0.06], [0, 0, 0, 1.0001]]]'
    colored = SHAPED.replace("marker_id = 1", "known = true\ncolor = [0.1, 0.2, 0.9]")
    (spec,) = parse_scenario(colored + f'type = "box"\nposition = [0.3, 0.0, 0.06]\n{parts}').objects
    assert spec.size == pytest.approx((0.1, 0.04, 0.12))
    assert [part.position for part in spec.shape] == [
        pytest.approx((-0.03, 0.0, -0.01)), pytest.approx((0.0, 0.0, 0.05))
    ]  # fmt: skip
    assert spec.shape[1].rotation == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-9)


def test_a_leaning_object_lies_before_it_is_turned():
    text = SHAPED + "size = [0.04, 0.06, 0.1]\nposition = [0.3, 0.0, 0.03]\nlean = [1.5708, 0.0, 0.0]\nyaw = 1.5708"
    (spec,) = parse_scenario(text).objects
    assert spec.pose.rotation_matrix[:, 2] == pytest.approx((1.0, 0.0, 0.0), abs=1e-4), "its z axis is along world x"
    box = object_box(spec)
    assert (box.bottom, box.top) == (pytest.approx(0.0, abs=1e-5), pytest.approx(0.06, abs=1e-5))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ('shape = [["box", [0.1, 0.1, 0.0001]]]', "part 1 (box): expected lengths of at least 0.001 m"),
        ('shape = [["box", [0.1, 0.1, 0.1], [0, 0, 0], [0, 0, 0, 2]]]', "norm 2, expected 1"),
        ('shape = [["box", [0.1, 0.1, 0.1]]]\nsize = [0.1, 0.1, 0.1]', "expected no `shape` where there is a `size`"),
        ('shape = [["box", [0.1, 0.1, 0.1]]]\nmodel = "cup"', "expected no `shape` where there is a `model`"),
        ('type = "ball"\nshape = [["box", [0.1, 0.1, 0.1]]]', "a ball is one sphere"),
        ("shape = []", "0 parts; expected 1 to 16"),
        ('shape = [["box", [0.1, 0.1, 0.1], [0, 0, 0], [0, 0, 0, 1], [[0, 0, 0]]]]', "a part with corners"),
        ('shape = [["cylinder", [0.03, 0.1]]]', "kind, three lengths in m (of round parts, too), position, rotation"),
        ('shape = [["cylinder", [0.06, 0.05, 0.1]]]', "part 1 (cylinder): expected equal diameters, got 0.06 x 0.05 m"),
        ('shape = [["sphere", [0.06, 0.06, 0.1]]]', "expected equal diameters, got 0.06 x 0.06 x 0.1 m"),
        ("lean = [90.0, 0.0, 0.0]", "lean"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(fields: str, message: str):
    with pytest.raises(ConfigError) as caught:
        parse_scenario(SHAPED + f"position = [0.3, 0.0, 0.06]\n{fields}")
    assert message in str(caught.value)
