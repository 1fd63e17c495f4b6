"""The sessions of benchmarks/calibration: what is drawn makes sense, and one of them is right."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.urdf import load_robot
from agents.scenario.format.model import RobotSpec
from benchmarks import calibration as system
from benchmarks import calibration_survey as survey
from benchmarks import calibration_tables as tables
from benchmarks.calibration_runs import EVENT_AT, bump, in_view, name_of, observing, on_table, play, put, scene, spread
from benchmarks.calibration_scene import EVALUATED_FROM
from dsr.math3d.transforms import Pose


def test_a_session_in_which_one_cube_was_moved_is_decided_rightly() -> None:
    row = system.session("mixed", "one_moved", 0, "poses")
    assert row["right"] and row["times"] == 0 and row["views"] == []
    assert system.holds([row]) and not system.holds([row | {"right": False}])


def test_scenes_name_what_moves() -> None:
    text = scene(
        [on_table(0.3, 0.0, 0.1)], [bump(Pose((0.01, 0.0, 0.0))), put(0, on_table(0.4, 0.0, 0.0))], duration=9.0
    )
    assert f'name = "{name_of(0)}"' in text and "[0.300000, 0.000000, 0.020000]" in text
    assert 'do = "camera_bump"' in text and "[0.010000, 0.000000, 0.000000]" in text and 'do = "place"' in text


def test_what_is_drawn_is_in_view_and_apart() -> None:
    rng = np.random.default_rng(0)
    for _ in range(3):
        cubes = system._scattered(rng, 6)
        assert spread(cubes, 0.05) and in_view(cubes, observing())
        assert spread([*system._moved(rng, cubes, 2), *cubes[2:]], 0.05)
    four = system._corners(rng)
    there = system._moved_alike(rng, four)
    moved = there[0] @ four[0].inverse()
    assert all((moved @ before).distance(after)[0] < 1e-9 for before, after in zip(four, there, strict=True))
    assert not in_view([on_table(2.0, 0.0, 0.0)], observing())


@pytest.mark.parametrize("part", system.PARTS)
def test_every_part_has_its_cases(part: str) -> None:
    assert len(system.cases(part)) == {"trials": 1, "cubes": 6, "layouts": 6, "mixed": 5}[part]


def rows() -> list[dict[str, Any]]:
    method = {
        "error": [0.001] * 6,
        "distance": (0.001, 0.002),
        "adopted": True,
        "seconds": 0.002,
        "history": (0.1, 0.0),
    }
    base = {"seed": 0, "sensor": "poses", "metres": 0.001, "radians": 0.002, "success": True, "times": 1}
    base |= {"recovery": 1.9, "seconds": 1.0}
    methods = tables.method_names()
    survey = {"elsewhere": 0.001, "elsewhere_before": 0.01, "told": "the geometry is weak"}
    return [
        base | {"part": "trials", "case": "four", "views": [1], "methods": dict.fromkeys(methods, method)},
        base | survey | {"part": "cubes", "case": "2"},
        base | survey | {"part": "layouts", "case": "60 mm"},
        base | {"part": "mixed", "case": "one_moved", "right": True},
    ]


def test_sessions_are_kept_and_what_is_none_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "figures.json"
    system._write(rows(), file)
    assert [row["part"] for row in system._read(file)] == [row["part"] for row in rows()]
    assert list(tmp_path.iterdir()) == [file]
    for text in ("{}", '[{"part": 1', "[3]"):
        file.write_text(text)
        with pytest.raises(ValueError):
            system._read(file)
    for option in (["--trials", "0"], ["--seed", "-1"]):
        with pytest.raises(SystemExit):
            system._parser().parse_args(option)
    assert "expected 0 or more" in capsys.readouterr().err


def test_tables_and_plots_are_made_of_the_rows(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    system.draw(rows(), tmp_path)
    names = sorted(path.name for path in tmp_path.iterdir())
    kinds = ("cubes", "history", "layouts", "spread")
    assert names == sorted(
        ["calibration_sessions.csv", *(f"calibration_{kind}.{end}" for kind in kinds for end in ("csv", "png"))]
    )
    assert (tmp_path / "calibration_spread.csv").read_text().splitlines()[0] == "method,trial," + ",".join(tables.SIX)
    tables.draw(rows()[3:], tmp_path / "mixed")
    assert [path.name for path in (tmp_path / "mixed").iterdir()] == ["calibration_sessions.csv"]
    title, _, lines = tables._trials_table(rows())
    assert title == "1 bumps, four cubes; decided by 1 view(s), at most 1"
    assert lines[0][:3] == ["the system", "1/1", "1"] and len(lines) == 4
    assert [line[0] for line in tables._survey_table(rows())[2]] == ["2 cube(s)", "60 mm square"]


def test_how_many_views_decisions_took_is_told_of_each_case() -> None:
    mixed = rows()[3]
    counts = [[], [2], [1, 3]]
    runs = [mixed | {"seed": seed, "views": views} for seed, views in enumerate(counts)]
    assert tables._mixed_table(runs)[2] == [["one_moved", "3/3", "2", "3", ""]]
    assert tables._mixed_table([mixed])[2] == [["one_moved", "1/1", "-", "-", ""]], "measured before that was counted"
    assert "decided by 1 view(s), at most 1" in tables._trials_table(rows())[0]


def test_what_is_required() -> None:
    trial = rows()[0]
    assert tables.holds(rows())
    for change in ({"success": False}, {"metres": 0.0021}, {"radians": 0.004}, {"methods": {}}):
        assert not tables.holds([trial | change])


def test_what_was_measured_is_not_measured_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "figures.json"
    file.write_text(json.dumps(rows()))
    played: list[tuple[str, str, int]] = []

    def session(part: str, case: str, seed: int, sensor: str) -> dict[str, Any]:
        played.append((part, case, seed))
        return rows()[3] | {"case": case, "seed": seed}

    monkeypatch.setattr(system, "session", session)
    arguments = ["x", "mixed", "--trials", "1", "--sensor", "poses", "--json", str(file)]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(SystemExit) as ended:
        system.main()
    assert ended.value.code == 0 and ("mixed", "one_moved", 0) not in played and len(played) == 4


@pytest.mark.parametrize("camera", ["wrist", "overhead"])
def test_a_second_bump_while_the_first_is_looked_into_is_found_out_too(camera: str) -> None:
    cubes = system._corners(np.random.default_rng(0))
    first = bump(Pose.from_rotvec((0.03, -0.02, 0.01), (0.05, -0.04, 0.1)))
    second = bump(Pose.from_rotvec((-0.04, 0.03, 0.0), (-0.05, -0.08, 0.1)), at=EVENT_AT + 1.5)
    session = play(scene(cubes, [first, second], duration=14.0, camera=camera), seed=0, sensor="poses")
    metrics = session.result.metrics
    assert metrics["camera_error_m"] < 0.004 and metrics["times_calibrated"] >= 1
    assert session.views and set(session.views) <= {1, 2, 3}


def test_from_other_arm_poses_the_camera_not_the_gripper_points_at_the_cubes() -> None:
    robot = load_robot(Path(__file__).resolve().parents[2] / "etc/robots/gen3.urdf")
    start = np.array(RobotSpec().start)
    gripper, camera = (
        JointChain(robot.between("base_link", link)).forward(start)
        for link in ("end_effector_link", "camera_wrist_link")
    )
    gripper_from_camera = gripper.inverse() @ camera
    for place in EVALUATED_FROM:
        there = survey._aimed(gripper, gripper_from_camera, place) @ Pose((0.0, 0.0, -0.12)) @ gripper_from_camera
        x, y, _ = there.inverse().apply(survey._MIDDLE)
        assert abs(x) < 0.02 and abs(y) < 0.005
