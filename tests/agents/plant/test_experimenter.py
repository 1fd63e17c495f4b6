from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from agents.plant import truths
from agents.plant.moves import MOVES
from agents.plant.reality import Reality
from agents.plant.world import yaw_of
from agents.scenario.format import (
    EVENTS,
    PREDICATES,
    CameraBump,
    CameraCover,
    Carry,
    Drop,
    Lift,
    ObjectSpec,
    Place,
    Remove,
    Slide,
    Tilt,
)

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]
Play = Callable[..., None]


def test_every_move_and_predicate_of_the_format_is_known() -> None:
    assert set(MOVES) == {event for event in EVENTS.values() if not event.by_runner}
    assert set(truths.PREDICATES) == set(PREDICATES)


def test_place_happens_in_time_and_the_object_rests(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = Place(at=0.5, object="cube_3", position=(0.3, 0.1, 0.02), yaw=0.3)
    reality = make_reality(cube(3, 0.42, 0.08), events=[event])
    play(reality, 0.45)
    assert reality.world.pose("cube_3").t == pytest.approx((0.42, 0.08, 0.02), abs=1e-3)
    play(reality, 0.5, start=0.45)
    assert reality.world.pose("cube_3").t == pytest.approx((0.3, 0.1, 0.02), abs=1e-3)
    assert yaw_of(reality.world.pose("cube_3")) == pytest.approx(0.3, abs=1e-3)
    assert reality.world.is_still("cube_3") and reality.experimenter.is_done


def test_place_onto_another_keeps_the_yaw(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    event = Place(at=0.0, object="cube_3", onto="cube_4", offset=(0.005, 0.0))
    reality = make_reality(cube(3, 0.42, 0.08, yaw=0.5), cube(4, 0.3, 0.0), events=[event])
    play(reality, 0.5)
    assert reality.world.pose("cube_3").t == pytest.approx((0.305, 0.0, 0.06), abs=1e-3)
    assert yaw_of(reality.world.pose("cube_3")) == pytest.approx(0.5, abs=1e-2)


def test_two_objects_swap_at_once(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        Place(at=0.1, object="cube_3", position=(0.3, 0.0, 0.02)),
        Place(at=0.1, object="cube_4", position=(0.42, 0.08, 0.02)),
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
        Place(at=0.5, object="cube_3", onto="cube_4"),
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
    reality = make_reality(cube(3, 0.4, 0.0), events=[Place(at=1.5, object="cube_3", position=(0.5, 0.1, 0.02))])
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
