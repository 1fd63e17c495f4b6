"""Human hands in the true world: how they come, hold, move and leave, what they hide, and what sensors tell of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.drivers import HandReading, HandReadings
from agents.plant.config import PlantConfig
from agents.plant.hand_figure import (
    BONES,
    PALM,
    TIP_RADIUS,
    TIPS,
    joints,
    outstretched,
    palm_pose,
    relaxed,
)
from agents.plant.hand_sensor import SIGMA
from agents.plant.hands import blocked
from agents.plant.messages import decode_hand_readings
from agents.plant.reality import Reality
from agents.scenario.format.scenario import (
    Carry,
    Drop,
    HandEnter,
    HandGraspEvent,
    HandLeave,
    HandMove,
    HandRelease,
    Lift,
    ObjectSpec,
    Slide,
    Tilt,
    Topple,
    parse_scenario,
)
from dsr.errors import WireError
from dsr.math3d.transforms import Pose

MakeReality = Callable[..., Reality]
MakeCube = Callable[..., ObjectSpec]
Play = Callable[..., None]
CUBE = (0.35, 0.0, 0.02)


def tips(reality: Reality, number: int = 0) -> np.ndarray:
    return np.array(reality.truth(0.0).hands[number])[list(TIPS)]


def gap(reality: Reality, finger: int, name: str = "cube_3") -> float:
    """m, from a finger's surface to a cube's, which is not turned much."""
    local = np.abs(reality.world.pose(name).inverse().apply(tips(reality)[finger][None])[0])
    outside = np.maximum(local - np.array(reality.world.specs[name].size) / 2, 0.0)
    return float(np.linalg.norm(outside)) - TIP_RADIUS


@pytest.mark.parametrize("side", ["left", "right"])
def test_bones_keep_their_length_and_the_palm_is_the_mean_of_its_joints(side: Any) -> None:
    bent = relaxed(side) - (0.03, 0.0, 0.02)
    for tips_wanted in (relaxed(side), bent):
        points = joints(tips_wanted, side)
        assert points[list(TIPS)] == pytest.approx(tips_wanted)
        assert points[list(PALM)].mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
        straight = outstretched(side)
        lengths, nominal = ([np.linalg.norm(hand[b] - hand[a]) for a, b in BONES] for hand in (points, straight))
        assert lengths == pytest.approx(nominal, rel=0.05)


def test_hands_are_mirror_images_with_the_thumbs_inside() -> None:
    """Seen from above, fingers forward, palms down."""
    right, left = joints(relaxed("right"), "right"), joints(relaxed("left"), "left")
    assert right * (1, -1, 1) == pytest.approx(left)
    pose = palm_pose((0.0, 0.0, 0.0), (-1.0, 0.0), 0.3)
    assert pose.apply(right)[4, 1] > 0.05 > pose.apply(right)[20, 1]
    assert pose.apply(right)[12, 0] > 0.1 and pose.apply(right)[12, 2] < 0.0


def test_a_hand_comes_in_and_leaves(make_reality: MakeReality, play: Play) -> None:
    reality = make_reality(events=[HandEnter(at=0.1, position=(0.35, 0.1, 0.1)), HandLeave(at=3.0)])
    play(reality, 0.05)
    assert reality.truth(0.0).hands == {}
    play(reality, 2.5, start=0.05)
    palm = np.array(reality.truth(0.0).hands[0])[list(PALM)].mean(axis=0)
    assert palm == pytest.approx((0.35, 0.1, 0.1), abs=1e-6)
    play(reality, 2.0, start=2.55)
    assert reality.truth(0.0).hands == {} and reality.experimenter.is_done


def test_a_pinch_holds_from_two_sides_and_the_object_goes_along(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    events = [HandGraspEvent(at=0.0, object="cube_3"), HandMove(at=3.0, by=(0.0, 0.1, 0.15), turn=0.5)]
    reality = make_reality(cube(3, *CUBE), events=events)
    play(reality, 2.9)
    assert reality.truth(0.0).grasped == {"cube_3": "human_hand_0"}
    assert abs(gap(reality, 0)) < 5e-4 and abs(gap(reality, 1)) < 5e-4
    across = (tips(reality)[1] - tips(reality)[0]) / np.linalg.norm(tips(reality)[1] - tips(reality)[0])
    assert abs(across[1]) > 0.99
    play(reality, 2.5, start=2.9)
    assert reality.world.pose("cube_3").t == pytest.approx((0.35, 0.1, 0.17), abs=1e-3)
    assert abs(gap(reality, 0)) < 1e-3 and abs(gap(reality, 1)) < 1e-3


def test_what_a_hand_lets_go_of_in_the_air_falls(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        HandGraspEvent(at=0.0, object="cube_3"),
        HandMove(at=3.0, by=(0.0, 0.0, 0.1), speed=0.5),
        HandRelease(at=4.0),
    ]
    reality = make_reality(cube(3, *CUBE), events=events)
    play(reality, 3.9)
    assert reality.world.pose("cube_3").t[2] == pytest.approx(0.12, abs=1e-3)
    play(reality, 1.0, start=3.9)
    assert reality.world.pose("cube_3").t[2] == pytest.approx(0.02, abs=2e-3)
    assert reality.truth(0.0).grasped == {} and 0 in reality.truth(0.0).hands


def test_a_touch_lies_on_one_side_only_and_drags(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        HandGraspEvent(at=0.0, object="cube_3", style="touch", side=(0.0, -1.0), hand=0),
        HandMove(at=3.0, by=(0.0, 0.08, 0.0)),
    ]
    reality = make_reality(cube(3, *CUBE), events=events)
    play(reality, 2.9)
    truth = reality.truth(0.0)
    assert truth.touched == {"cube_3": "human_hand_0"} and truth.grasped == {}
    assert tips(reality)[1:3, 1] == pytest.approx([-0.02 - TIP_RADIUS] * 2, abs=1e-3)
    play(reality, 1.5, start=2.9)
    assert reality.world.pose("cube_3").t == pytest.approx((0.35, 0.08, 0.02), abs=1e-3)
    assert abs(gap(reality, 1)) < 1e-3


def test_a_hand_does_other_moves_and_lets_go_after_them(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        Carry(at=0.0, object="cube_3", to=(0.3, -0.1, 0.02), hand=1),
        Slide(at=8.0, object="cube_3", by=(0.1, 0.0), hand=1),
    ]
    reality = make_reality(cube(3, *CUBE), events=events)
    play(reality, 2.5)
    assert reality.truth(0.0).grasped == {"cube_3": "human_hand_1"}
    play(reality, 5.0, start=2.5)
    assert reality.truth(0.0).grasped == {} and 1 in reality.truth(0.0).hands
    assert reality.world.pose("cube_3").t == pytest.approx((0.3, -0.1, 0.02), abs=1e-3)
    play(reality, 4.5, start=7.5)
    assert reality.world.pose("cube_3").t == pytest.approx((0.4, -0.1, 0.02), abs=1e-3)
    assert reality.experimenter.is_done


def test_a_lifted_object_is_tilted_in_the_hand_and_dropped(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    events = [
        Lift(at=0.0, object="cube_3", height=0.15, hand=0),
        Tilt(at=4.0, object="cube_3", angle=2.356, hand=0),
        Drop(at=8.0, object="cube_3"),
    ]
    reality = make_reality(cube(3, *CUBE), events=events)
    play(reality, 3.9)
    before = tips(reality)
    play(reality, 3.0, start=3.9)
    assert math.acos(reality.world.pose("cube_3").rotation_matrix[2, 2]) == pytest.approx(2.356, abs=0.01)
    assert np.linalg.norm(tips(reality) - before, axis=1).max() > 0.02
    assert abs(gap(reality, 0)) < 2e-3 and abs(gap(reality, 1)) < 2e-3
    play(reality, 2.5, start=6.9)
    assert reality.truth(0.0).grasped == {} and reality.world.pose("cube_3").t[2] < 0.04


def test_a_hand_pushes_over_the_edge_and_stays_behind(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    reality = make_reality(
        cube(3, 0.3, 0.57), events=[Topple(at=0.0, object="cube_3", direction=(0.0, 1.0), speed=0.1, hand=0)]
    )
    play(reality, 5.0)
    assert reality.world.pose("cube_3").t[2] < -0.5
    assert tips(reality)[:, 2].min() > -0.01


POURING = """
name = "pour"
title = "A hand pours a ball from one container into another"
duration = 20.0
object = [
  {name = "green", model = "container_green", known = true, position = [0.40, 0.18, 0.062]},
  {name = "blue", model = "container_blue", known = true, position = [0.35, -0.12, 0.062]},
  {name = "ball_1", model = "ball", known = true, position = [0.40, 0.18, 0.036]},
]
event = [
  {at = 0.0, do = "hand_grasp", object = "green"},
  {at = 3.0, do = "hand_move", to = [0.40, 0.18, 0.30]},
  {at = 4.5, do = "hand_move", to = [0.35, 0.02, 0.30]},
  {at = 6.0, do = "tilt", object = "green", angle = 2.356, hand = 0},
  {at = 9.5, do = "tilt", object = "green", angle = -2.356, hand = 0},
  {at = 12.5, do = "hand_move", to = [0.40, 0.25, 0.062]},
  {at = 15.0, do = "hand_leave"},
]
"""
OVER_THE_EDGE = """
name = "edge"
title = "A hand slides a cover over the edge of the table, with a cube under it"
duration = 12.0
object = [
  {name = "cover", model = "cover_small", known = true, position = [0.35, 0.40, 0.072]},
  {name = "cube_3", marker_id = 3, position = [0.35, 0.40, 0.02]},
]
event = [{at = 0.0, do = "slide", object = "cover", by = [0.0, 0.35], hand = 0}]
"""


LOADED = """
name = "loaded"
title = "A hand lifts a container with a lid on it, and another container on that"
duration = 12.0
object = [
  {name = "blue", model = "container_blue", known = true, position = [0.35, 0.0, 0.06]},
  {name = "lid", model = "lid", known = true, position = [0.35, 0.0, 0.125]},
  {name = "green", model = "container_green", known = true, position = [0.35, 0.0, 0.191]},
]
event = [
  {at = 0.0, do = "hand_grasp", object = "blue", side = [0.0, -1.0]},
  {at = 2.0, do = "hand_move", by = [0.0, 0.0, 0.1], speed = 0.1},
  {at = 10.0, do = "hand_release"},
]
"""


def test_a_load_stays_on_what_a_hand_holds_still(play: Play) -> None:
    reality = Reality(parse_scenario(LOADED), PlantConfig(sensor="poses"), 0)
    play(reality, 3.2)
    offsets = [_offset(reality, "blue", name) for name in ("lid", "green")]
    play(reality, 6.5, start=3.2)
    assert reality.world.pose("blue").t[2] > 0.15
    for name, before in zip(("lid", "green"), offsets, strict=True):
        assert math.dist(_offset(reality, "blue", name), before) < 1e-3
    reality.close()


HANDED_OVER = """
name = "handed_over"
title = "A cup goes from the right hand to the left one"
duration = 12.0
object = [{name = "cup", model = "container_blue", known = true, position = [0.35, 0.0, 0.06]}]
event = [
  {at = 0.0, do = "hand_grasp", object = "cup", hand = 0},
  {at = 2.0, do = "hand_move", by = [0.0, 0.0, 0.1], hand = 0},
  {at = 4.0, do = "hand_grasp", object = "cup", hand = 1, side = [-1.0, 0.0]},
  {at = 8.0, do = "hand_leave", hand = 0},
]
"""


def test_the_truth_names_both_hands_that_hold_one_thing(play: Play) -> None:
    reality = Reality(parse_scenario(HANDED_OVER), PlantConfig(sensor="poses"), 0)
    both = {"human_hand_0": "cup", "human_hand_1": "cup"}
    play(reality, 3.5)
    assert reality.truth(3.5).pinched == {"human_hand_0": "cup"}
    play(reality, 4.2, start=3.5)
    assert reality.truth(7.7).pinched == both
    play(reality, 4.0, start=7.7)
    assert reality.truth(11.7).pinched == {"human_hand_1": "cup"}
    reality.close()


def test_what_was_held_is_as_heavy_as_before(play: Play) -> None:
    reality = Reality(parse_scenario(LOADED), PlantConfig(sensor="poses"), 0)
    body = reality.world.body("blue")
    mass = reality.world.bullet.getDynamicsInfo(body, -1)[0]
    play(reality, 11.0)
    assert not reality.truth(11.0).grasped
    assert reality.world.bullet.getDynamicsInfo(body, -1)[0] == mass
    reality.close()


def _offset(reality: Reality, base: str, name: str) -> tuple[float, float, float]:
    return (reality.world.pose(base).inverse() @ reality.world.pose(name)).t


def test_a_ball_is_carried_in_a_container_and_poured_by_physics_alone(play: Play) -> None:
    reality = Reality(parse_scenario(POURING), PlantConfig(sensor="poses"), 0)
    ball_in = partial(_is_inside, reality, "ball_1")
    play(reality, 5.9)
    assert ball_in("green") and reality.world.pose("green").t[2] > 0.29
    play(reality, 12.0, start=5.9)
    assert ball_in("blue") and not ball_in("green")
    assert reality.world.pose("green").t == pytest.approx((0.40, 0.25, 0.06), abs=3e-3)
    reality.close()


def test_what_is_under_a_cover_is_pushed_along_and_falls_off_the_table(play: Play) -> None:
    reality = Reality(parse_scenario(OVER_THE_EDGE), PlantConfig(sensor="poses"), 0)
    play(reality, 3.0)
    assert _is_inside(reality, "cube_3", "cover")
    play(reality, 6.0, start=3.0)
    assert reality.world.pose("cube_3").t[2] < -0.6
    reality.close()


def _is_inside(reality: Reality, name: str, container: str) -> bool:
    inside = np.abs(reality.world.pose(container).inverse().apply(reality.world.pose(name).t))
    return bool((inside < np.array(reality.world.specs[container].size) / 2).all())


def test_what_is_handed_over_stays_in_the_other_hand(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [
        HandGraspEvent(at=0.0, object="cube_3", side=(0.0, -1.0)),
        HandMove(at=3.0, by=(0.0, 0.0, 0.15), speed=0.5),
        HandGraspEvent(at=4.0, object="cube_3", hand=1, side=(0.0, 1.0)),
        HandRelease(at=7.0),
        HandMove(at=9.0, hand=1, by=(0.0, 0.1, 0.0), speed=0.5),
        HandRelease(at=10.0, hand=1),
    ]
    reality = make_reality(cube(3, *CUBE), events=events)
    play(reality, 8.5)
    assert reality.truth(0.0).grasped == {"cube_3": "human_hand_1"}
    assert reality.world.pose("cube_3").t == pytest.approx((0.35, 0.0, 0.17), abs=1e-3)
    play(reality, 1.4, start=8.5)
    assert reality.world.pose("cube_3").t == pytest.approx((0.35, 0.1, 0.17), abs=1e-3)
    play(reality, 1.1, start=9.9)
    assert reality.truth(0.0).grasped == {}
    assert reality.world.pose("cube_3").t[2] == pytest.approx(0.02, abs=1e-3)


def test_what_someone_else_takes_from_a_hand_is_not_grasped(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    reality = make_reality(cube(3, *CUBE), events=[HandGraspEvent(at=0.0, object="cube_3")])
    play(reality, 3.0)
    reality.world.remove("cube_3")
    reality._stage.free("cube_3")
    play(reality, 0.1, start=3.0)
    assert reality.truth(0.0).grasped == {}


def test_hands_hide_tags_from_both_sensors(make_reality: MakeReality, cube: MakeCube, play: Play) -> None:
    events = [HandEnter(at=0.0, position=(0.40, 0.0, 0.15))]
    reality = make_reality(cube(3, *CUBE), cube(4, 0.35, 0.2), events=events, config={"sensor": "pixels"})
    reality.frame(0.0)
    assert reality.camera.in_view == ["cube_3", "cube_4"]
    play(reality, 2.0)
    reality.frame(0.0)
    before = reality.world.bullet.getNumBodies()
    frame = reality.frame(0.0)
    assert reality.camera.in_view == ["cube_4"]
    assert [reading.marker_id for reading in reality.readings(0.0).readings] == [4]
    assert reality.world.bullet.getNumBodies() == before
    camera = reality.camera
    ((u, v),) = (
        camera.intrinsics.project(camera.pose.inverse().apply(np.array([[0.40, 0.0, 0.15]]))).round().astype(int)
    )
    color, depth = frame.arrays["color"][v, u].astype(int), frame.arrays["depth"][v, u]
    assert color[0] > color[1] + 20 > color[2] + 20
    assert depth == pytest.approx(0.65 - 0.15 - 0.012, abs=0.01)


def test_landmarks_are_told_with_their_errors_and_what_hides_them(
    make_reality: MakeReality, cube: MakeCube, play: Play
) -> None:
    events = [HandEnter(at=0.0, position=(0.35, 0.0, 0.1), hand=1)]
    reality = make_reality(cube(3, 0.2, -0.2), events=events)
    play(reality, 2.0)
    errors = []
    for _ in range(40):
        (hand,) = reality.hand_readings(1.5).hands  # type: ignore[union-attr]
        assert hand.side == "left"
        seen = np.array(hand.visible)
        truth = reality.camera.pose.inverse().apply(np.array(reality.truth(0.0).hands[1]))
        errors.append((np.array(hand.landmarks) - truth)[seen])
    assert np.concatenate(errors).std() == pytest.approx(SIGMA, rel=0.1)
    assert seen.sum() >= 18
    fingertip = reality.truth(0.0).hands[1][8]
    reality.world.put("cube_3", Pose((fingertip[0], fingertip[1], fingertip[2] + 0.05)))
    (hand,) = reality.hand_readings(1.5).hands  # type: ignore[union-attr]
    assert not hand.visible[8] and hand.visible[0]
    reality.camera.covers += 1
    assert reality.hand_readings(1.5).hands == []  # type: ignore[union-attr]


def test_without_hand_events_nothing_is_told_of_hands(make_reality: MakeReality, cube: MakeCube) -> None:
    reality = make_reality(cube(3, *CUBE))
    assert reality.hand_readings(0.0) is None and reality.truth(0.0).hands == {}


def test_a_hand_that_is_not_there_cannot_act_and_the_run_goes_on(
    make_reality: MakeReality, play: Play, caplog: pytest.LogCaptureFixture
) -> None:
    reality = make_reality(events=[HandRelease(at=0.0), HandMove(at=0.0, by=(0.1, 0.0, 0.0))])
    play(reality, 0.1)
    assert reality.experimenter.is_done and caplog.text.count("hand 0 is not in the scene") == 2


def test_a_view_passes_beside_a_capsule_or_through_it() -> None:
    eye, targets = np.zeros(3), np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.0, 0.0, 0.3]])
    starts, ends = np.array([[-0.1, 0.0, 0.5]]), np.array([[0.1, 0.0, 0.5]])
    assert blocked(eye, targets, starts, ends, np.array([0.05]))[:, 0].tolist() == [True, False, False]


@pytest.mark.parametrize(
    "wrong",
    [
        {"landmarks": ((0.0, 0.0, 0.0),) * 20},
        {"visible": (True,) * 20},
        {"landmarks": ((math.nan, 0.0, 0.0),) * 21},
        {"sigma": -0.1},
        {"side": "both"},
    ],
)
def test_malformed_hand_readings_are_refused(wrong: dict[str, Any]) -> None:
    good = {"side": "left", "landmarks": ((0.0, 0.0, 0.5),) * 21, "visible": (True,) * 21, "sigma": 0.003}
    message = HandReadings(1.0, [HandReading(**good)])
    assert decode_hand_readings(msgspec.msgpack.encode(message)) == message
    with pytest.raises(WireError):
        decode_hand_readings(msgspec.msgpack.encode({"stamp": 1.0, "hands": [{**good, **wrong}]}))
