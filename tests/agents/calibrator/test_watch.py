"""Calibrations that begin by themselves, from the explanation that a camera moved to the verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from agents.calibrator.solve.robust import OUTLIER
from dsr.math3d.transforms import Pose, log
from dsr.timeline import EXPLAINED, Chronicle
from dsr.vocabulary.calibration import (
    ADOPTED,
    CALIBRATED,
    CALIBRATION,
    CONFIRMED,
    IN_DOUBT,
    PROVISIONAL,
    REFUSED,
    STEADY,
    SURPRISE,
    read_report,
    request_calibration,
    request_undo,
)
from dsr.vocabulary.explained import CAMERA_MOVED, ExplainedChange, encoded, text_of
from dsr.vocabulary.intentions import DONE, FAILED, NOTHING_GRASPED
from tests.agents.calibrator.scenes import BUMP, CLUSTER, DOWN, WIDE, Stage, cubes

SetUp = Callable[..., Stage]
MOVED = Pose((0.05, 0.03, 0.0))
ELSEWHERE = Pose.from_rotvec((0.0, 0.0, 0.0), (0.3, 0.0, 0.9))


@pytest.fixture
def set_up() -> Iterator[SetUp]:
    """A stage that has looked for a while with a camera that is where it is believed to be."""
    stages: list[Stage] = []

    def make(*arguments: Any, **options: Any) -> Stage:
        stage = Stage(*arguments, **options)
        stages.append(stage)
        stage.memory.add_edge(stage.parent, "camera", "RT", pose=DOWN)
        stage.look(2.0)
        return stage

    yield make
    for stage in stages:
        stage.lockstep.close()


def explain(stage: Stage, *changes: ExplainedChange) -> None:
    """As the simulation handler does once things have been surprising for a while."""
    told = changes or (ExplainedChange(CAMERA_MOVED),)
    chronicle = Chronicle(stage.memory, "simulation_handler")
    chronicle.happened(EXPLAINED, tuple(stage.objects), text=text_of(told), changes=encoded(told))


def mount(stage: Stage) -> str:
    return str(stage.memory.node("camera").get("mount", STEADY))


def answer(stage: Stage) -> tuple[str, str]:
    (node,) = stage.memory.nodes(CALIBRATION)
    assert node["source"] == SURPRISE
    return node["status"], node["explanation"]


def move_alike(stage: Stage, moved: Pose = MOVED) -> None:
    stage.objects = {name: moved @ pose for name, pose in stage.objects.items()}


def test_a_bumped_camera_is_doubted_then_put_right(set_up: SetUp) -> None:
    stage = set_up()
    stage.parent_from_camera = DOWN @ BUMP
    stage.look(0.8)
    explain(stage)
    stage.look(0.5)
    assert mount(stage) == IN_DOUBT and stage.error[0] > 0.03
    stage.look()
    assert mount(stage) == STEADY and answer(stage)[0] == ADOPTED
    assert stage.error[0] < 0.003 and stage.error[1] < math.radians(0.3)
    (event,) = Chronicle(stage.memory).query(kind=CALIBRATED)
    assert event.text == answer(stage)[1]


def led_astray(set_up: SetUp) -> tuple[Stage, Pose]:
    """A camera is bumped, and a belief has followed what it saw before that is explained; where that was before."""
    stage = set_up()
    stage.parent_from_camera = DOWN @ BUMP
    stage.look(0.8)
    believed = stage.memory.edge("world", "cube_1", "Virtual_RT")["pose"]
    stage.memory.add_edge("world", "cube_1", "Virtual_RT", pose=Pose((0.04, 0.0, 0.0)) @ believed)
    explain(stage)
    return stage, believed


def test_the_beliefs_from_before_count(set_up: SetUp) -> None:
    stage, _ = led_astray(set_up)
    stage.look()
    (node,) = stage.memory.nodes(CALIBRATION)
    report = read_report(stage.memory, node.name)
    assert report is not None and report.adopted and not any(one.is_outlier for one in report.objects)


def test_two_moved_cubes_leave_the_camera_where_it_is(set_up: SetUp) -> None:
    stage = set_up(confirmed_for=2.0)
    for name in ("cube_1", "cube_2"):
        stage.objects[name] = MOVED @ stage.objects[name]
    explain(stage)
    stage.look()
    assert mount(stage) == CONFIRMED and answer(stage)[0] == REFUSED and stage.error[0] == 0.0
    assert "2 of 4 objects are seen where they are believed" in answer(stage)[1]
    stage.look(2.0)
    assert mount(stage) == STEADY


def test_a_camera_on_a_stand_that_all_moved_before_is_moved_provisionally(set_up: SetUp) -> None:
    stage = set_up()
    move_alike(stage)
    explain(stage)
    stage.look()
    assert mount(stage) == PROVISIONAL and answer(stage)[0] == ADOPTED
    assert stage.error[0] == pytest.approx(0.058, abs=0.003)


def test_a_pose_that_is_taken_back_on_request_stays(set_up: SetUp) -> None:
    stage = set_up(confirmed_for=2.0)
    move_alike(stage)
    explain(stage)
    stage.look()
    assert mount(stage) == PROVISIONAL
    request_undo(stage.memory)
    stage.look(0.5)
    assert mount(stage) == CONFIRMED and stage.error[0] == 0.0
    explain(stage)
    stage.look(2.0)
    assert mount(stage) == STEADY and stage.error[0] == 0.0


def test_a_second_bump_while_beliefs_are_led_back_is_found_out(set_up: SetUp) -> None:
    stage, believed = led_astray(set_up)
    stage.look(1.5)
    assert mount(stage) == CONFIRMED and stage.error[0] < 0.003
    stage.memory.add_edge("world", "cube_1", "Virtual_RT", pose=believed)
    stage.parent_from_camera = DOWN @ BUMP @ BUMP
    stage.look(0.5)
    explain(stage, *(ExplainedChange("moved_alone", ((f"cube_{number}",),)) for number in range(1, 5)))
    stage.look(4.0)
    assert mount(stage) == STEADY and stage.error[0] < 0.003


@pytest.mark.parametrize("is_camera", [True, False])
def test_one_that_an_arm_carries_waits_for_a_view_from_elsewhere(set_up: SetUp, is_camera: bool) -> None:
    stage = set_up("gripper")
    if is_camera:
        stage.parent_from_camera = MOVED.inverse() @ DOWN
    else:
        move_alike(stage)
    explain(stage)
    stage.look(2.0)
    assert mount(stage) == IN_DOUBT and stage.memory.edge("gripper", "camera", "RT")["pose"].t == DOWN.t
    stage.world_from_parent = ELSEWHERE
    stage.look(2.0)
    assert (mount(stage), answer(stage)[0]) == ((STEADY, ADOPTED) if is_camera else (CONFIRMED, REFUSED))
    assert stage.error[0] < 0.003 and stage.error[1] < math.radians(0.3)


def test_what_was_adopted_for_want_of_a_view_is_taken_back_when_one_tells(set_up: SetUp) -> None:
    stage = set_up("gripper", elsewhere_patience=1.5)
    move_alike(stage)
    explain(stage)
    stage.look(2.5)
    assert mount(stage) == PROVISIONAL and stage.error[0] > 0.05
    written = stage.memory.edge("gripper", "camera", "RT")["pose"]
    stage.world_from_parent = ELSEWHERE
    stage.look(0.5)
    assert mount(stage) == IN_DOUBT
    stage.look()
    assert mount(stage) == CONFIRMED and stage.error[0] == 0.0
    event = Chronicle(stage.memory).query(kind=CALIBRATED)[-1]
    report = read_report(stage.memory, event.name)
    assert report is not None and "after all" in event.text == report.text
    assert report.before == pytest.approx((*written.t, *written.q)) and report.after[:3] == DOWN.t
    assert all(one.before_m < 0.005 < one.after_m for one in report.objects) and len(report.objects) == 4


def test_weak_geometry_waits_and_then_gives_up(set_up: SetUp) -> None:
    stage = set_up("gripper", cubes(CLUSTER), elsewhere_patience=3.0)
    stage.parent_from_camera = DOWN @ BUMP
    explain(stage)
    stage.look(2.5)
    assert mount(stage) == IN_DOUBT
    stage.look(1.5)
    assert mount(stage) == STEADY and answer(stage)[0] == REFUSED and "geometry is weak" in answer(stage)[1]
    explain(stage)
    stage.look(4.0)
    assert mount(stage) == CONFIRMED, "the same objects will not tell later, either"


def test_nothing_begins_by_itself_if_that_is_not_wanted(set_up: SetUp) -> None:
    stage = set_up(by_itself=False)
    explain(stage)
    stage.look()
    assert not list(stage.memory.nodes(CALIBRATION)) and "mount" not in stage.memory.node("camera")


def test_other_explanations_are_none_of_our_business(set_up: SetUp) -> None:
    stage = set_up()
    explain(stage, ExplainedChange("moved_alone", (("cube_1",),)))
    stage.look()
    assert not list(stage.memory.nodes(CALIBRATION))


def test_a_doubt_ends_with_what_gave_rise_to_it(set_up: SetUp) -> None:
    stage = set_up()
    explain(stage)
    stage.wait(3.5)
    assert mount(stage) == STEADY and "nothing seems displaced any more" in answer(stage)[1]


def test_a_restarted_calibrator_leaves_no_camera_in_doubt(set_up: SetUp) -> None:
    stage = set_up("gripper")
    move_alike(stage)
    explain(stage)
    stage.look(1.5)
    assert mount(stage) == IN_DOUBT
    stage.lockstep.kill("calibrator")
    stage.lockstep.restart("calibrator")
    stage.look(0.3)
    assert mount(stage) == STEADY and answer(stage) == (REFUSED, "the calibrator was restarted")


def test_objects_that_come_into_view_later_tell(set_up: SetUp) -> None:
    stage = set_up()
    hidden = {name: stage.objects.pop(name) for name in ("cube_2", "cube_3", "cube_4")}
    stage.parent_from_camera = DOWN @ BUMP
    explain(stage)
    stage.look(2.0)
    assert mount(stage) == IN_DOUBT and stage.error[0] > 0.03
    stage.objects |= hidden
    stage.look(1.5)
    assert mount(stage) == STEADY and stage.error[0] < 0.003


def attempt(stage: Stage, target: str, status: str, why: str = "") -> None:
    name = f"action_9_{target}_{status}"
    stage.memory.add_node(name, "action", skill="pick", target=target, status=status, explanation=why)


def in_vain(set_up: SetUp) -> Stage:
    """A camera on a stand that was moved provisionally, after a grasp in vain that was earlier."""
    stage = set_up()
    attempt(stage, "cube_1", FAILED, NOTHING_GRASPED)
    move_alike(stage)
    explain(stage)
    stage.look()
    assert mount(stage) == PROVISIONAL
    return stage


def test_a_grasp_in_vain_says_that_all_objects_were_moved(set_up: SetUp) -> None:
    stage = in_vain(set_up)
    attempt(stage, "cube_2", FAILED, "out of reach")
    stage.look(0.5)
    assert mount(stage) == PROVISIONAL
    attempt(stage, "cube_3", FAILED, NOTHING_GRASPED)
    stage.look(0.3)
    assert mount(stage) == CONFIRMED and stage.error[0] == 0.0
    assert "found nothing where cube_3" in Chronicle(stage.memory).query(kind=CALIBRATED)[-1].text


def test_a_grasp_that_holds_says_that_the_camera_moved(set_up: SetUp) -> None:
    stage = in_vain(set_up)
    attempt(stage, "cube_2", DONE)
    stage.look(0.3)
    assert mount(stage) == STEADY and stage.error[0] > 0.05
    assert len(Chronicle(stage.memory).query(kind=CALIBRATED)) == 1


def test_two_objects_in_view_are_enough_and_what_comes_later_corrects_the_pose(set_up: SetUp) -> None:
    stage = set_up()
    hidden = {name: stage.objects.pop(name) for name in ("cube_3", "cube_4")}
    stage.parent_from_camera = DOWN @ BUMP
    explain(stage)
    stage.look(2.0)
    assert mount(stage) == STEADY and stage.misplaced < 0.003
    stage.objects |= hidden
    stage.look(2.0)
    assert stage.error[0] < 0.003 and stage.misplaced < 0.003


@pytest.mark.parametrize("places", [WIDE[:2], WIDE[1:3], CLUSTER, CLUSTER[:2]])
def test_where_few_tell_of_a_bump_on_a_stand_what_they_leave_open_is_as_before(
    set_up: SetUp, places: tuple[tuple[float, float], ...]
) -> None:
    stage = set_up(objects=cubes(places))
    stage.parent_from_camera = DOWN @ BUMP
    explain(stage)
    stage.look(2.0)
    assert mount(stage) == STEADY and stage.misplaced < 0.003
    written = stage.memory.edge("world", "camera", "RT")["pose"]
    off = log(written.inverse() @ stage.parent_from_camera)
    assert off @ np.linalg.solve(written.covariance, off) < OUTLIER, "the covariance tells how much is open"


def test_a_calibration_on_request_ends_the_doubt(set_up: SetUp) -> None:
    stage = set_up(objects=cubes(WIDE[:1]))
    stage.parent_from_camera = DOWN @ BUMP
    explain(stage)
    stage.look()
    assert mount(stage) == IN_DOUBT
    request = request_calibration(stage.memory, "camera", force=True)
    stage.look()
    assert stage.memory.node(request)["status"] == ADOPTED
    assert mount(stage) == STEADY and stage.misplaced < 0.003
    stage.look(2.0)
    assert stage.misplaced < 0.003


def restart(stage: Stage) -> None:
    stage.lockstep.kill("calibrator")
    stage.lockstep.restart("calibrator")


def test_a_restarted_calibrator_watches_a_provisional_pose_on(set_up: SetUp) -> None:
    stage = in_vain(set_up)
    restart(stage)
    stage.look(2.0)
    assert mount(stage) == PROVISIONAL and stage.error[0] > 0.05
    attempt(stage, "cube_3", FAILED, NOTHING_GRASPED)
    stage.look(0.3)
    assert mount(stage) == CONFIRMED and stage.error[0] < 1e-6


def test_it_does_not_if_the_pose_was_written_by_others_meanwhile(set_up: SetUp) -> None:
    stage = in_vain(set_up)
    stage.lockstep.kill("calibrator")
    stage.memory.add_edge("world", "camera", "RT", pose=DOWN)
    stage.lockstep.restart("calibrator")
    stage.look(0.3)
    assert mount(stage) == STEADY
