"""The experimenter's moves: when they begin, where things end up, and what comes along."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from agents.plant import experimenter as truths
from agents.plant.hand_moves import PUSHES
from agents.plant.moves import MOVES
from agents.plant.person_moves import PERSON_MOVES
from agents.plant.reality import Reality
from agents.plant.world import upright, yaw_of
from agents.scenario.format.scenario import (
    EVENTS,
    PREDICATES,
    ArmError,
    CameraBump,
    CameraCover,
    Carry,
    Drop,
    FalsePercept,
    Lift,
    ObjectSpec,
    PlaceEvent,
    Remove,
    Slide,
    Swap,
    Tilt,
    Topple,
)

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]
Play = Callable[..., None]


def test_every_move_and_predicate_of_the_format_is_known() -> None:
    assert MOVES.keys() | PUSHES.keys() | PERSON_MOVES.keys() == {
        event for event in EVENTS.values() if not event.by_runner
    }
    assert set(truths.PREDICATES) == set(PREDICATES)


def test_place_happens_in_time_and_the_object_rests(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = PlaceEvent(at=0.5, object="cube_3", position=(0.3, 0.1, 0.02), yaw=0.3)
    reality = make_reality(cube(3, 0.42, 0.08), events=[event])
    play(reality, 0.45)
    assert reality.world.pose("cube_3").t == pytest.approx((0.42, 0.08, 0.02), abs=1e-3)
    play(reality, 0.5, start=0.45)
    assert reality.world.pose("cube_3").t == pytest.approx((0.3, 0.1, 0.02), abs=1e-3)
    assert yaw_of(reality.world.pose("cube_3")) == pytest.approx(0.3, abs=1e-3)
    assert reality.world.is_still("cube_3") and reality.experimenter.is_done


def test_place_onto_another_keeps_the_yaw(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = PlaceEvent(at=0.0, object="cube_3", onto="cube_4", offset=(0.005, 0.0))
    reality = make_reality(cube(3, 0.42, 0.08, yaw=0.5), cube(4, 0.3, 0.0), events=[event])
    play(reality, 0.5)
    assert reality.world.pose("cube_3").t == pytest.approx((0.305, 0.0, 0.06), abs=1e-3)
    assert yaw_of(reality.world.pose("cube_3")) == pytest.approx(0.5, abs=1e-2)


def test_two_objects_swap_at_once(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        PlaceEvent(at=0.1, object="cube_3", position=(0.3, 0.0, 0.02)),
        PlaceEvent(at=0.1, object="cube_4", position=(0.42, 0.08, 0.02)),
    ]
    reality = make_reality(cube(3, 0.42, 0.08), cube(4, 0.3, 0.0), events=events)
    play(reality, 0.5)
    assert reality.world.pose("cube_3").t == pytest.approx((0.3, 0.0, 0.02), abs=1e-3)
    assert reality.world.pose("cube_4").t == pytest.approx((0.42, 0.08, 0.02), abs=1e-3)


def test_tower_slides_rigidly(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = Slide(at=0.0, object="cube_4", to=(0.22, 0.14), yaw=math.pi / 2, speed=0.2)
    reality = make_reality(cube(4, 0.3, 0.08), cube(3, 0.31, 0.08, 0.06), events=[event])
    play(reality, 0.25)
    halfway = reality.world.pose("cube_4").t
    assert 0.03 < math.dist(halfway, (0.3, 0.08, 0.02)) < 0.07
    play(reality, 1.5, start=0.25)
    assert reality.world.pose("cube_4").t == pytest.approx((0.22, 0.14, 0.02), abs=1e-3)
    assert reality.world.pose("cube_3").t == pytest.approx((0.22, 0.15, 0.06), abs=1e-3)
    assert yaw_of(reality.world.pose("cube_4")) == pytest.approx(math.pi / 2, abs=1e-2)


def test_without_contents_only_friction_takes_the_upper_one_along(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    event = Slide(at=0.0, object="cube_4", to=(0.2, 0.08), speed=2.0, contents=False)
    reality = make_reality(cube(4, 0.4, 0.08), cube(3, 0.4, 0.08, 0.06), events=[event])
    play(reality, 1.0)
    assert reality.world.pose("cube_4").t == pytest.approx((0.2, 0.08, 0.02), abs=1e-3)
    assert reality.world.pose("cube_3").t[0] > 0.28


def test_carry_goes_over_what_is_between(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = Carry(at=0.0, object="cube_3", to=(0.2, 0.0, 0.02), height=0.1, speed=0.5)
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.4, 0.0, 0.06), cube(5, 0.3, 0.0), events=[event])
    highest = 0.0
    for step in range(360):
        reality.step(step / 240)
        highest = max(highest, reality.world.pose("cube_3").t[2])
    assert highest == pytest.approx(0.12, abs=2e-3)
    assert reality.world.pose("cube_3").t == pytest.approx((0.2, 0.0, 0.02), abs=1e-3)
    assert reality.world.pose("cube_4").t == pytest.approx((0.2, 0.0, 0.06), abs=1e-3)
    assert reality.world.pose("cube_5").t == pytest.approx((0.3, 0.0, 0.02), abs=1e-3)


def test_lift_holds_until_drop(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [Lift(at=0.0, object="cube_3", height=0.1, speed=0.5), Drop(at=1.0, object="cube_3")]
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.4, 0.0, 0.06), events=events)
    play(reality, 0.99)
    assert reality.world.pose("cube_3").t == pytest.approx((0.4, 0.0, 0.12), abs=1e-3)
    assert reality.world.pose("cube_4").t == pytest.approx((0.4, 0.0, 0.16), abs=1e-3)
    play(reality, 1.0, start=0.99)
    assert reality.world.pose("cube_3").t[2] == pytest.approx(0.02, abs=1e-3)


def test_what_is_on_a_tilted_object_slides_off(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        Lift(at=0.0, object="cube_3", height=0.2, speed=1.0),
        Tilt(at=0.5, object="cube_3", angle=1.2, axis=(0.0, 2.0, 0.0), speed=2.0),
    ]
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.4, 0.0, 0.06), events=events)
    play(reality, 2.0)
    held = reality.world.pose("cube_3")
    assert held.t == pytest.approx((0.4, 0.0, 0.22), abs=1e-3)
    assert held.rotation_matrix[:, 2] == pytest.approx((math.sin(1.2), 0.0, math.cos(1.2)), abs=0.02)
    assert reality.world.pose("cube_4").t[2] < 0.1


def test_removed_object_is_not_in_the_truth(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.3, 0.0), events=[Remove(at=0.1, object="cube_3")])
    play(reality, 0.2)
    assert list(reality.truth(0.0).objects) == ["cube_4"]


def test_camera_is_bumped_and_covered_for_a_while(make_reality: MakeReality, play: Play) -> None:
    events = [CameraBump(at=0.1, translation=(0.01, 0.0, 0.0)), CameraCover(at=0.2, duration=0.3)]
    reality = make_reality(events=events)
    before = reality.camera.pose
    play(reality, 0.3)
    assert (before.inverse() @ reality.camera.pose).t == pytest.approx((0.01, 0.0, 0.0))
    assert reality.camera.covers == 1
    play(reality, 0.3, start=0.3)
    assert reality.camera.covers == 0


def test_condition_starts_an_event_after_its_delay(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        PlaceEvent(at=0.5, object="cube_3", onto="cube_4"),
        Remove(when="built(cube_3, cube_4) and resting(cube_4)", delay=0.5, object="cube_4"),
    ]
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.3, 0.0), events=events)
    play(reality, 1.0)
    assert "cube_4" in reality.world
    play(reality, 0.6, start=1.0)
    assert "cube_4" not in reality.world


def test_lifted_needs_clear_air_below(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        Lift(at=0.0, object="cube_3", height=0.009),
        Lift(at=1.0, object="cube_3", height=0.009),
        Remove(when="lifted(cube_3)", object="cube_4"),
    ]
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.3, 0.0), events=events)
    play(reality, 1.0)
    assert "cube_4" in reality.world
    play(reality, 1.0, start=1.0)
    assert "cube_4" not in reality.world


def test_tower_in_the_hand_does_not_count_as_built(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [Lift(at=0.0, object="cube_4", height=0.05), Remove(when="built(cube_3, cube_4)", object="cube_5")]
    reality = make_reality(cube(4, 0.3, 0.0), cube(3, 0.3, 0.0, 0.06), cube(5, 0.4, 0.0), events=events)
    play(reality, 1.5)
    assert "cube_5" in reality.world


def test_impossible_move_is_given_up_and_the_others_go_on(
    make_reality: MakeReality, cube: MakeCube, play: Play, caplog: pytest.LogCaptureFixture
) -> None:
    events = [
        Remove(at=0.0, object="cube_3"),
        Slide(at=0.1, object="cube_3", to=(0.3, 0.0)),
        Remove(at=0.2, object="cube_4"),
    ]
    reality = make_reality(cube(3, 0.4, 0.0), cube(4, 0.3, 0.0), events=events)
    play(reality, 0.3)
    assert "no object 'cube_3' in the scene" in caplog.text
    assert not list(reality.world)


def test_experimenter_takes_an_object_out_of_the_gripper(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    reality = make_reality(cube(3, 0.4, 0.0), events=[PlaceEvent(at=1.5, object="cube_3", position=(0.5, 0.1, 0.02))])
    reality.world.put("cube_3", reality.arm.link_pose("tool_link"))
    reality.arm.move_gripper(0.0)
    grip = reality.experimenter._stage.take("cube_3", contents=False)
    play(reality, 1.0)
    assert reality.arm.held == "cube_3"
    reality.experimenter._stage.release("cube_3")
    assert grip.names == ("cube_3",)
    play(reality, 1.0, start=1.0)
    assert reality.arm.held is None
    assert reality.world.pose("cube_3").t == pytest.approx((0.5, 0.1, 0.02), abs=1e-3)
    assert np.isfinite(reality.arm.positions).all()


def test_swapped_objects_stand_at_their_own_height(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = Swap(at=0.1, object="cube_3", other="cube_4")
    reality = make_reality(cube(3, 0.42, 0.08, 0.04, size=(0.04, 0.04, 0.08)), cube(4, 0.3, 0.0), events=[event])
    play(reality, 0.5)
    assert reality.world.pose("cube_3").t == pytest.approx((0.3, 0.0, 0.04), abs=1e-3)
    assert reality.world.pose("cube_4").t == pytest.approx((0.42, 0.08, 0.02), abs=1e-3)


def test_towers_swap_and_are_put_elsewhere_with_their_contents(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    events = [
        Swap(at=0.1, object="cube_4", other="cube_5", contents=True),
        PlaceEvent(at=1.0, object="cube_4", position=(0.2, 0.2, 0.02), yaw=0.5, contents=True),
    ]
    reality = make_reality(cube(4, 0.3, 0.08), cube(3, 0.3, 0.09, 0.06), cube(5, 0.4, -0.1), events=events)
    play(reality, 0.9)
    assert reality.world.pose("cube_5").t == pytest.approx((0.3, 0.08, 0.02), abs=1e-3)
    assert reality.world.pose("cube_3").t == pytest.approx((0.4, -0.09, 0.06), abs=1e-3)
    play(reality, 0.5, start=0.9)
    turned = (0.2 - 0.01 * math.sin(0.5), 0.2 + 0.01 * math.cos(0.5), 0.06)
    assert reality.world.pose("cube_3").t == pytest.approx(turned, abs=1e-3)


def test_an_upper_cube_falls_when_it_is_toppled(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = Topple(at=0.1, object="cube_3", direction=(0.0, -2.0), speed=0.3)
    reality = make_reality(cube(4, 0.3, 0.08), cube(3, 0.3, 0.08, 0.06), events=[event])
    play(reality, 2.0)
    x, y, z = reality.world.pose("cube_3").t
    assert (x, z) == pytest.approx((0.3, 0.02), abs=5e-3) and y < 0.045
    assert reality.world.pose("cube_4").t == pytest.approx((0.3, 0.08, 0.02), abs=2e-3)


def test_a_cube_turns_in_place(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = Slide(at=0.0, object="cube_3", by=(0.0, 0.0), turn=math.pi / 4)
    reality = make_reality(cube(3, 0.3, 0.08, yaw=0.2), events=[event])
    play(reality, 1.0)
    assert reality.world.pose("cube_3").t == pytest.approx((0.3, 0.08, 0.02), abs=1e-3)
    assert yaw_of(reality.world.pose("cube_3")) == pytest.approx(0.2 + math.pi / 4, abs=1e-2)


def test_a_false_percept_lasts_for_its_frames_and_leaves_the_truth_alone(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    event = FalsePercept(at=0.1, object="cube_3", frames=2, translation=(0.05, 0.0, 0.0))
    reality = make_reality(cube(3, 0.35, 0.08), cube(4, 0.35, -0.08), events=[event])
    play(reality, 0.2)
    before = reality.world.poses()
    seen = [
        {reading.marker_id: reading.pose[:2] for reading in reality.readings(0.1 * frame).readings}
        for frame in range(3)
    ]
    shifts = [math.dist(readings[3], seen[2][3]) for readings in seen[:2]]
    assert shifts == pytest.approx([0.05, 0.05], abs=5e-3)
    assert math.dist(seen[0][4], seen[2][4]) < 5e-3
    assert reality.world.poses() == before
    assert not reality.experimenter.is_done
    play(reality, 0.1, start=0.2)
    assert reality.experimenter.is_done


def test_a_false_percept_shows_in_images(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = FalsePercept(at=0.0, object="cube_3", translation=(0.0, 0.1, 0.0))
    reality = make_reality(
        cube(3, 0.35, 0.0), events=[event], config={"sensor": "pixels", "renderer": "tiny", "width": 160, "height": 120}
    )
    play(reality, 0.1)
    before = reality.world.pose("cube_3")
    wrong, right = (reality.frame(stamp).arrays["depth"] for stamp in (0.1, 0.2))
    assert reality.world.pose("cube_3").distance(before)[0] < 1e-9
    nearer = np.argwhere(wrong - right < -0.02).mean(axis=0)
    further = np.argwhere(wrong - right > 0.02).mean(axis=0)
    assert nearer[1] < further[1] - 10, "the image's left is world +y"


def test_an_arm_error_shifts_what_the_sensors_say_and_not_the_arm(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    event = ArmError(at=0.1, translation=(0.0, 0.0, -0.015), duration=1.0)
    reality, undisturbed = make_reality(cube(3, 0.35, 0.08), events=[event]), make_reality(cube(3, 0.35, 0.08))
    arm, told = reality.arm, []
    for start in (0.0, 0.6):
        play(reality, 0.6, start=start)
        play(undisturbed, 0.6, start=start)
        told.append(reality.arm_state(start).positions)
    assert arm.positions == undisturbed.arm.positions
    true = undisturbed.arm.link_pose("tool_link")
    for joint, position in zip(arm.names, told[0], strict=True):
        arm_joint = next(
            i
            for i in range(reality.world.bullet.getNumJoints(arm.body))
            if reality.world.bullet.getJointInfo(arm.body, i)[1].decode() == joint
        )
        reality.world.bullet.resetJointState(arm.body, arm_joint, position)
    error = np.subtract(arm.link_pose("tool_link").t, true.t)
    assert error == pytest.approx((0.0, 0.0, -0.015), abs=8e-4)
    assert told[1] == undisturbed.arm.positions, "the error is over"


def test_conditions_on_the_gripper(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, 0.35, 0.08, 0.075), cube(4, 0.35, 0.08))
    stage = reality.experimenter._stage
    reality.world.put("cube_3", upright((0.36, 0.08, 0.075), 0.0))
    assert truths.idle(stage) and not truths.held(stage, "cube_3")
    assert not truths.lowering(stage, "cube_3", "cube_4")
    reality.arm._held = "cube_3"
    assert truths.held(stage, "cube_3") and not truths.idle(stage)
    assert truths.lowering(stage, "cube_3", "cube_4")
    for elsewhere in ((0.36, 0.08, 0.081), (0.38, 0.08, 0.075), (0.36, 0.08, 0.059)):
        reality.world.put("cube_3", upright(elsewhere, 0.0))
        assert not truths.lowering(stage, "cube_3", "cube_4")


def test_the_truth_tells_when_moves_began_and_ended_and_what_moves(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    events = [
        PlaceEvent(at=0.1, object="cube_4", position=(0.3, -0.1, 0.02)),
        Slide(at=0.2, object="cube_3", to=(0.3, 0.08), speed=0.1),
        Remove(at=9.0, object="cube_3"),
    ]
    reality = make_reality(cube(3, 0.35, 0.08), cube(4, 0.35, -0.08), events=events)
    play(reality, 0.5)
    truth = reality.truth(0.5)
    assert truth.moves == {1: (pytest.approx(0.1, abs=5e-3),) * 2, 2: (pytest.approx(0.2, abs=5e-3), None)}
    assert truth.moving == ("cube_3",)
    play(reality, 0.5, start=0.5)
    assert reality.truth(1.0).moves[2] == pytest.approx((0.2, 0.7), abs=1e-2)
    assert reality.truth(1.0).moving == ()


@pytest.mark.parametrize("sensor", ["poses", "pixels"])
def test_the_truth_tells_which_tags_the_camera_could_see(
    make_reality: MakeReality, cube: MakeCube, play: Play, sensor: str
) -> None:
    config = {"sensor": sensor, "renderer": "tiny"}
    cubes = (cube(4, 0.35, 0.1), cube(3, 0.35, 0.1, 0.06), cube(5, 0.35, -0.1))
    reality = make_reality(*cubes, events=[CameraCover(at=0.1, duration=1.0)], config=config)
    look = reality.frame if sensor == "pixels" else reality.readings
    look(0.0)
    assert set(reality.truth(0.0).in_view) == {"cube_3", "cube_5"}
    play(reality, 0.2)
    look(0.2)
    assert reality.truth(0.2).in_view == ()
