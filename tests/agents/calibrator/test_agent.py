"""Requests to calibrate a camera, from the graph to the graph."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from dsr.graph.schema import MAX_LENGTH
from dsr.math3d.transforms import Pose
from dsr.timeline import Chronicle
from dsr.vocabulary.calibration import (
    ADOPTED,
    CALIBRATED,
    LOOKING,
    REFUSED,
    Report,
    read_report,
    request_calibration,
    request_undo,
)
from tests.agents.calibrator.scenes import BUMP, CLUSTER, DOWN, FLIP, WIDE, Stage, cubes

SetUp = Callable[..., Stage]


@pytest.fixture
def set_up() -> Iterator[SetUp]:
    stages: list[Stage] = []

    def make(*arguments: Any, **options: Any) -> Stage:
        stages.append(Stage(*arguments, **options))
        return stages[-1]

    yield make
    for stage in stages:
        stage.lockstep.close()


def status(stage: Stage, request: str) -> tuple[str, str]:
    node = stage.memory.node(request)
    return node["status"], node["explanation"]


def report(stage: Stage, request: str) -> Report:
    found = read_report(stage.memory, request)
    assert found is not None
    return found


def test_a_camera_on_a_stand_is_put_right(set_up: SetUp) -> None:
    stage = set_up()
    stage.look(1.0)
    request = request_calibration(stage.memory)
    stage.look(0.5)
    assert status(stage, request) == (LOOKING, "0 of 1 views")
    assert stage.error[0] > 0.03
    stage.look()
    assert status(stage, request)[0] == ADOPTED
    assert stage.error[0] < 0.003 and stage.error[1] < math.radians(0.3)
    written: Pose = stage.memory.edge("world", "camera", "RT")["pose"]
    assert written.stamp == 0.0 and written.covariance is not None
    assert stage.memory.transform("world", "camera", at=1.0).t == written.t


def test_the_report_and_the_event_say_what_changed(set_up: SetUp) -> None:
    stage = set_up()
    stage.seen_off["cube_3"] = Pose((0.06, 0.0, 0.0))
    request = request_calibration(stage.memory, "camera")
    stage.look()
    found = report(stage, request)
    assert (found.camera, found.parent, found.method, found.adopted) == ("camera", "world", "robust", True)
    assert Pose(found.before[:3], found.before[3:]).distance(DOWN @ BUMP)[0] < 1e-9
    written: Pose = stage.memory.edge("world", "camera", "RT")["pose"]
    assert Pose(found.after[:3], found.after[3:]).distance(written)[0] < 1e-9
    assert found.shift_m == pytest.approx(np.linalg.norm(BUMP.translation), abs=0.003)
    assert [one.name for one in found.objects if one.is_outlier] == ["cube_3"]
    good = [one for one in found.objects if not one.is_outlier]
    assert all(10.0 * one.after_m < 0.03 < one.before_m for one in good)
    (event,) = Chronicle(stage.memory).query(kind=CALIBRATED)
    assert event.participants == ("camera", "cube_1", "cube_2", "cube_3", "cube_4")
    assert event.text == found.text and "not explained: cube_3" in event.text
    assert read_report(stage.memory, event.name) == found


def test_a_camera_that_is_right_is_left_alone(set_up: SetUp) -> None:
    stage = set_up()
    request_calibration(stage.memory)
    stage.look()
    written = stage.memory.edge("world", "camera", "RT")["pose"]
    request = request_calibration(stage.memory)
    stage.look()
    assert status(stage, request)[0] == ADOPTED and report(stage, request).unchanged
    assert "is where it was believed to be" in report(stage, request).text
    assert stage.memory.edge("world", "camera", "RT")["pose"] is written
    assert len(Chronicle(stage.memory).query(kind=CALIBRATED)) == 1
    request = request_calibration(stage.memory, force=True)
    stage.look()
    assert not report(stage, request).unchanged, "what is forced is written"
    assert stage.memory.edge("world", "camera", "RT")["pose"] is not written


def test_what_is_seen_on_the_way_between_two_views_does_not_count(set_up: SetUp) -> None:
    stage = set_up("gripper", cubes(WIDE))
    request = request_calibration(stage.memory, views=2)
    stage.look(1.4)
    for step in range(70):
        turn = 0.02 * step
        stage.world_from_parent = Pose.from_rotvec((0.1 * turn, 0.0, 0.0), (0.0, 0.0, turn))
        stage.look(0.1)
    assert status(stage, request) == (LOOKING, "1 of 2 views")
    stage.look(1.4)
    assert status(stage, request)[0] == ADOPTED
    assert report(stage, request).views == 2 and report(stage, request).sightings == 8


def test_the_hand_eye_transform_from_several_arm_poses(set_up: SetUp) -> None:
    stage = set_up("gripper", cubes(WIDE[:2]))
    request = request_calibration(stage.memory, views=3)
    for turn in ((0.0, 0.0, 0.0), (0.1, 0.1, 0.4), (-0.1, 0.1, -0.4)):
        stage.world_from_parent = Pose.from_rotvec((0.3 * turn[0], 0.2 * turn[1], 0.0), turn)
        stage.look(1.4)
    assert status(stage, request)[0] == ADOPTED
    assert report(stage, request).views == 3
    assert stage.error[0] < 0.003 and stage.error[1] < math.radians(0.3)


@pytest.mark.parametrize("force", [False, True])
def test_fewer_views_than_wanted_do_only_by_force(set_up: SetUp, force: bool) -> None:
    stage = set_up("gripper", views_patience=3.0)
    request = request_calibration(stage.memory, views=3, force=force)
    stage.look(2.5)
    assert status(stage, request) == (LOOKING, "1 of 3 views")
    stage.look(1.0)
    if force:
        assert status(stage, request)[0] == ADOPTED and report(stage, request).views == 1
    else:
        assert status(stage, request)[0] == REFUSED and "only 1 of 3 views" in status(stage, request)[1]


def test_a_camera_on_a_stand_has_only_one_view(set_up: SetUp) -> None:
    stage = set_up()
    request = request_calibration(stage.memory, views=2)
    stage.look(0.5)
    assert status(stage, request)[0] == REFUSED and "camera stands still" in status(stage, request)[1]


@pytest.mark.parametrize("places", [CLUSTER, WIDE[:1]])
def test_weak_geometry_is_refused_unless_it_is_forced(set_up: SetUp, places: Any) -> None:
    stage = set_up(objects=cubes(places))
    request = request_calibration(stage.memory)
    stage.look()
    answer, why = status(stage, request)
    assert answer == REFUSED and "geometry is weak" in why and report(stage, request).weak
    assert stage.error[0] > 0.03 and not Chronicle(stage.memory).query(kind=CALIBRATED)
    request = request_calibration(stage.memory, force=True)
    stage.look()
    assert status(stage, request)[0] == ADOPTED and "forced" in status(stage, request)[1]
    assert stage.error[0] < 0.02


def test_cubes_that_moved_are_no_moved_camera(set_up: SetUp) -> None:
    stage = set_up()
    stage.seen_off.update(cube_1=Pose((0.05, 0.0, 0.0)), cube_2=Pose((0.0, 0.06, 0.0)), cube_3=FLIP)
    request = request_calibration(stage.memory)
    stage.look()
    assert status(stage, request)[0] == REFUSED and "no pose of the camera" in status(stage, request)[1]


def test_what_is_held_gone_or_not_believed_to_stand_still_does_not_count(set_up: SetUp) -> None:
    stage = set_up(objects=cubes((*WIDE, (0.0, 0.0), (0.05, 0.05), (-0.05, 0.0))))
    memory = stage.memory
    memory.add_node("gripper", "gripper")
    memory.add_edge("gripper", "cube_5", "grasping")
    memory.update_node("cube_6", present=False)
    request = request_calibration(memory)
    stage.look(0.4)
    memory.add_edge("world", "cube_7", "Virtual_RT", pose=Pose((0.3, 0.1, 0.02)))
    stage.look()
    assert [one.name for one in report(stage, request).objects] == ["cube_1", "cube_2", "cube_3", "cube_4"]


@pytest.mark.parametrize(
    ("options", "why"),
    [({"target": "camerra"}, "did you mean 'camera'"), ({"method": "magic"}, "unknown method 'magic'"),
     ({"views": 1000}, "expected 1 to"), ({"target": "cube_1"}, "no camera 'cube_1'")],
)  # fmt: skip
def test_a_request_that_makes_no_sense_is_refused(set_up: SetUp, options: dict[str, Any], why: str) -> None:
    stage = set_up()
    stage.memory.add_node("wish", "calibration", **options)
    stage.look(0.3)
    assert status(stage, "wish")[0] == REFUSED and why in status(stage, "wish")[1]


def test_a_camera_that_sees_nothing_is_refused_in_time(set_up: SetUp) -> None:
    stage = set_up(patience=2.0)
    request = request_calibration(stage.memory)
    stage.wait(1.5)
    assert status(stage, request)[0] == LOOKING
    stage.wait(1.0)
    assert status(stage, request)[0] == REFUSED and "has seen nothing of use" in status(stage, request)[1]
    assert read_report(stage.memory, request) is None


def test_which_of_two_cameras_must_be_said(set_up: SetUp) -> None:
    stage = set_up()
    stage.memory.add_node("another", "camera")
    request = request_calibration(stage.memory)
    stage.wait(0.3)
    assert status(stage, request) == (REFUSED, "which camera? there are another, camera")


def test_withdrawn_and_old_requests_are_forgotten(set_up: SetUp) -> None:
    stage = set_up(keep=1.0)
    first, second = (request_calibration(stage.memory) for _ in range(2))
    stage.look(0.5)
    stage.memory.remove_node(first)
    stage.look()
    assert status(stage, second)[0] == ADOPTED
    stage.wait(1.5)
    assert second not in stage.memory


def test_a_restarted_calibrator_begins_afresh(set_up: SetUp) -> None:
    stage = set_up()
    request = request_calibration(stage.memory)
    stage.look(0.8)
    stage.lockstep.kill("calibrator")
    stage.lockstep.restart("calibrator")
    stage.look(2.0)
    assert status(stage, request)[0] == ADOPTED


def test_of_two_cameras_the_one_that_sees_objects_is_meant(set_up: SetUp) -> None:
    stage = set_up()
    stage.memory.add_node("another", "camera")
    stage.look(0.2)
    request = request_calibration(stage.memory)
    stage.look()
    assert status(stage, request)[0] == ADOPTED and report(stage, request).camera == "camera"


def test_no_arm_moves_a_camera_on_a_stand(set_up: SetUp) -> None:
    stage = set_up()
    request = request_calibration(stage.memory, views=2, move=True)
    stage.look()
    assert status(stage, request)[0] == REFUSED and "no arm is there that moves camera" in status(stage, request)[1]


def test_the_last_calibration_is_taken_back_on_request(set_up: SetUp) -> None:
    stage = set_up()
    refused = request_undo(stage.memory)
    stage.wait(0.3)
    assert "tells of no calibration" in stage.memory.node(refused)["explanation"]
    before = stage.memory.edge("world", "camera", "RT")["pose"]
    request = request_calibration(stage.memory)
    stage.look()
    found = [(one.name, one.after_m, one.before_m) for one in report(stage, request).objects]
    after = stage.memory.edge("world", "camera", "RT")["pose"]
    undone = request_undo(stage.memory, "camera")
    stage.wait(0.3)
    assert stage.memory.edge("world", "camera", "RT")["pose"].distance(before) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert report(stage, undone).text == "camera is believed where it was before its last calibration"
    assert [(one.name, one.before_m, one.after_m) for one in report(stage, undone).objects] == found and found
    assert [event.text for event in Chronicle(stage.memory).query(kind=CALIBRATED)][-1] == report(stage, undone).text
    request_undo(stage.memory)
    stage.wait(0.3)
    again = stage.memory.edge("world", "camera", "RT")["pose"]
    assert again.distance(after) == pytest.approx((0.0, 0.0), abs=1e-9)
    np.testing.assert_allclose(again.covariance, after.covariance, rtol=1e-6)
    stage.memory.add_edge("world", "camera", "RT", pose=Pose((1.0, 0.0, 0.0)) @ after)
    refused = request_undo(stage.memory)
    stage.wait(0.3)
    assert "was given another pose since" in stage.memory.node(refused)["explanation"]


@pytest.mark.parametrize("name", ["target", "method"])
def test_a_request_of_the_greatest_length_is_refused_and_ends_nothing(set_up: SetUp, name: str) -> None:
    stage = set_up()
    stage.memory.add_node("calibration_long", "calibration", **{"target": "camera", name: "x" * MAX_LENGTH})
    stage.wait(0.3)
    assert status(stage, "calibration_long")[0] == REFUSED
