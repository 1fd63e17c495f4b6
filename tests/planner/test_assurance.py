"""An action that will probably fail is preceded by a look, which the timeline explains; a sure one is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr import Pose
from dsr.believing.distribution import ATTRIBUTE, Alternative, Whereabouts
from dsr.math3d.quaternions import ANY_TURN
from dsr.math3d.shapes import Part, to_numbers
from dsr.timeline import query
from planner.assurance import LOOKED, chance_within, room_between_fingers, turn_between_fingers
from planner.config import PlannerConfig
from planner.state import KnownSolid
from tests.planner.table import COVERED, SIDE, SIGHT, Run, add_camera, believe, supports

CONFIG = PlannerConfig()
HERE, THERE = (0.42, 0.08), (0.30, 0.30)
ROOM = (0.02, 0.02, 0.02)
LONG = (0.10, 0.04, 0.04)


def told(about_z: float) -> np.ndarray:
    """Covariance of a pose that is known to 1 mm and 0.02 rad, but for a variance (rad^2) about the vertical."""
    return np.diag((*[0.001**2] * 3, 0.02**2, 0.02**2, about_z))


def at(weight: float, place: tuple[float, float], deviation: float = 0.0, **more: object) -> Alternative:
    pose = Pose((*place, SIDE / 2)).with_covariance(np.eye(6) * deviation**2)
    return Alternative(weight=weight, pose=pose, **more)  # type: ignore[arg-type]


def looks_before(run: Run) -> list[str]:
    return [entry.text for entry in query(run.memory, kind=LOOKED)]


def chance(*alternatives: Alternative) -> float:
    solid = KnownSolid((SIDE, SIDE, SIDE), Pose((*HERE, SIDE / 2)))
    return chance_within(Whereabouts("cube_3", alternatives), solid, ROOM)


def test_a_grasp_is_as_probable_as_the_thing_is_between_the_fingers() -> None:
    assert chance(at(1.0, HERE)) == 1.0 and chance(at(0.7, HERE), at(0.3, THERE)) == pytest.approx(0.7)
    assert chance(at(0.6, HERE), Alternative(weight=0.4, pose=None)) == pytest.approx(0.6)
    assert chance(at(0.6, HERE), at(0.4, HERE, hand="hand_0")) == pytest.approx(0.6), "not out of somebody's hand"
    one_sigma = math.erf(1.0 / math.sqrt(2.0))
    assert chance(at(1.0, HERE, 0.02)) == pytest.approx(one_sigma**3), "a deviation as wide as the room, on each axis"
    beside = (HERE[0] + 0.015, HERE[1])
    assert chance(at(0.5, HERE), at(0.5, beside)) == 1.0 and chance(at(0.5, HERE), at(0.5, THERE)) == 0.5


def test_the_fingers_close_along_the_narrow_level_side() -> None:
    def room(size: tuple[float, float, float], pose: Pose = Pose()) -> tuple[float, float, float]:  # noqa: B008
        return room_between_fingers(KnownSolid(size, pose), CONFIG)

    assert room((0.04, 0.04, 0.06)) == pytest.approx((0.02, 0.02, 0.03))
    assert room((0.10, 0.02, 0.04)) == pytest.approx((0.05, 0.03, 0.02))
    assert room((0.09, 0.10, 0.04))[0] == 0.0
    lying = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.5 * math.pi, 0.0))
    assert room((0.05, 0.05, 0.12), lying) == pytest.approx((0.025, 0.015, 0.06)), "its x axis is upright now"


def test_a_box_may_be_turned_as_far_as_it_is_no_wider_than_the_grip() -> None:
    def turn(size: tuple[float, float, float]) -> float:
        return turn_between_fingers(KnownSolid(size, Pose()), CONFIG)

    assert turn((0.04, 0.04, 0.04)) == math.inf, "its diagonal is between the fingers, too"
    most, (long, short) = turn(LONG), LONG[:2]
    assert 0.3 < most < 0.6
    assert long * math.sin(most) + short * math.cos(most) == pytest.approx(CONFIG.widest_grip)
    assert turn((0.10, 0.09, 0.04)) == 0.0


def test_a_grasp_by_a_turn_that_nobody_knows_is_not_sure() -> None:
    def chance(*turns: tuple[float, float]) -> float:
        poses = [Pose.from_rotvec(where.t, (0.0, 0.0, yaw)).with_covariance(told(about_z)) for yaw, about_z in turns]
        alternatives = tuple(Alternative(weight=1.0 / len(poses), pose=pose) for pose in poses)
        solid = KnownSolid(LONG, where)
        return chance_within(Whereabouts("box", alternatives), solid, ROOM, turn=turn_between_fingers(solid, CONFIG))

    where, most = Pose((*HERE, SIDE / 2)), turn_between_fingers(KnownSolid(LONG, Pose()), CONFIG)
    assert chance((0.0, 0.02**2)) == pytest.approx(1.0)
    assert chance((0.0, ANY_TURN)) == pytest.approx(2.0 * most / math.pi, abs=0.05), "as of all turns"
    assert chance((math.pi, 0.0)) == 1.0, "fingers see no difference"
    assert chance((0.0, 0.0), (math.pi / 2, 0.0)) == pytest.approx(0.5)


@pytest.mark.parametrize("about_z", [0.02**2, ANY_TURN])
def test_a_box_of_which_nobody_knows_how_it_is_turned_is_looked_at_before_it_is_picked(about_z: float) -> None:
    with Run() as run:
        add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
        run.memory.update_node("cube_3", size=LONG, marker_id=3)
        pose = Pose((*HERE, SIDE / 2)).with_covariance(told(about_z))
        run.memory.add_edge("world", "cube_3", "Virtual_RT", pose=pose)
        run.arm.on_look = lambda: run.memory.add_edge(
            "world", "cube_3", "Virtual_RT", pose=pose.with_covariance(told(0.02**2))
        )
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        assert len(looks_before(run)) == (about_z == ANY_TURN)


def test_a_doubtful_thing_is_looked_at_before_it_is_picked_and_the_timeline_says_why() -> None:
    with Run() as run:
        add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
        believe(run.memory, "cube_3", at(0.6, HERE), at(0.4, THERE))
        run.arm.hidden["cube_3"] = THERE
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        assert supports(run.memory)["cube_3"] == "cube_4"
        [why] = looks_before(run)
        assert why == (
            "look from above x 0.42 m, y 0.08 m before pick cube_3: cube_3 is where it is believed to be with 60 %; "
            "0.67 nats are expected"
        )
        [look] = run.arm.looks
        assert math.dist(look.t[:2], HERE) <= SIGHT
        assert run.arm.done.index("look camera_wrist done") < run.arm.done.index("pick cube_3 done")
        assert run.memory.transform("world", "cube_3", types=("Virtual_RT",)).t[:2] == pytest.approx((0.30, 0.08))


def test_what_it_will_be_put_on_is_made_sure_before_anything_is_taken_up() -> None:
    with Run() as run:
        add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
        believe(run.memory, "cube_4", at(0.6, (0.30, 0.08)), at(0.4, THERE))
        run.arm.hidden["cube_4"] = (0.30, 0.08)
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        [why] = looks_before(run)
        assert "before pick cube_3: cube_4 is where it is believed to be with 60 %" in why
        assert run.arm.done.index("look camera_wrist done") < run.arm.done.index("pick cube_3 done")


def test_things_that_are_sure_enough_each_but_not_together_are_looked_at() -> None:
    with Run() as run:
        add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
        x, y, _ = run.memory.transform("world", "cube_4", types=("Virtual_RT",)).t
        believe(run.memory, "cube_3", at(0.85, HERE), at(0.15, THERE))
        believe(run.memory, "cube_4", at(0.85, (x, y)), at(0.15, (0.30, -0.30)))
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        assert looks_before(run)


def test_what_is_sure_enough_is_not_looked_at() -> None:
    with Run() as run:
        add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
        believe(run.memory, "cube_3", at(0.85, HERE), at(0.15, THERE))
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        assert looks_before(run) == [] and run.arm.looks == []


def cover_cube_4(run: Run) -> None:
    """Put a cup over it: cube_4 is believed to be there with 0.6, or else gone."""
    run.memory.add_node("cup", "cup", size=(0.07, 0.07, 0.08))
    run.memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((*COVERED, 0.04)))
    run.memory.add_edge("cup", "table", "on", source="contact")
    add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
    for edge in run.memory.edges("Virtual_RT", dst="cube_4"):
        run.memory.remove_edge(*edge.key)
    gone = Alternative(weight=0.4, pose=None)
    believe(run.memory, "cube_4", at(0.6, COVERED, containers=("cup",)), gone)
    run.arm.covered["cube_4"] = "cup"


def test_a_cover_is_lifted_from_what_is_probably_under_it() -> None:
    with Run() as run:
        cover_cube_4(run)
        run.want("on(cube_4,cube_5)")
        run.until("reached")
        assert supports(run.memory)["cube_4"] == "cube_5" and supports(run.memory)["cup"] == "table"
        assert looks_before(run)[0].startswith("lift cup before pick cube_4: cube_4 is where")
        assert run.arm.done.index("place cup table done") < run.arm.done.index("pick cube_4 done")


def test_where_no_look_tells_more_it_goes_on_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    with Run() as run:
        believe(run.memory, "cube_3", at(0.6, HERE), at(0.4, THERE))
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        assert looks_before(run) == []
        assert "pick cube_3 will succeed with 60 %: the arm carries no camera that sends images" in caplog.text


def test_a_look_that_changes_the_relations_makes_another_plan() -> None:
    """The cube turns out to be on another one: the plan that was made for the table is not gone on with."""
    with Run() as run:
        add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
        believe(run.memory, "cube_3", at(0.6, HERE), at(0.4, (0.42, -0.08)))
        run.arm.on_look = lambda: run.memory.add_edge("cube_6", "cube_4", "on", source="contact")
        run.want("on(cube_3,cube_4)")
        run.until(lambda: "look camera_wrist done" in run.arm.done)
        run.until(lambda: run.replans == 1)
        assert "pick cube_3 done" not in run.arm.done


def under_a_cup(run: Run) -> None:
    """The belief sticks to it that the cube is probably under the cup, whatever is seen."""
    run.memory.add_node("cup", "cup", size=(0.07, 0.07, 0.08))
    run.memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((*THERE, 0.04)))
    run.memory.add_edge("cup", "table", "on", source="contact")
    add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
    gone = Alternative(weight=0.4, pose=None)
    believe(run.memory, "cube_3", at(0.6, THERE, containers=("cup",)), gone)


@pytest.mark.parametrize("told_by", ["whereabouts", "in"])
def test_what_is_surely_under_a_cover_is_uncovered_before_it_is_taken(told_by: str) -> None:
    """To lift the cover tells nothing, but without that the arm cannot take the thing."""
    with Run() as run:
        under_a_cup(run)
        run.arm.covered["cube_3"] = "cup"
        if told_by == "in":
            run.memory.add_edge("cube_3", "cup", "in", source="contact")
            believe(run.memory, "cube_3", at(1.0, THERE))
            run.memory.update_node("cube_3", **{ATTRIBUTE: ""})
        else:
            believe(run.memory, "cube_3", at(0.99, THERE, containers=("cup",)), Alternative(weight=0.01, pose=None))
        run.want("on(cube_3,cube_4)")
        run.until("reached", 120.0)
        assert looks_before(run) == ["lift cup before pick cube_3: cube_3 cannot be reached under it"]
        assert run.arm.done.index("place cup table done") < run.arm.done.index("pick cube_3 done")


def test_what_lies_in_something_open_is_taken_out_of_it() -> None:
    wall = (0.005, 0.07, 0.06)
    parts = [Part("box", wall, (side * 0.0325, 0.0, 0.0)) for side in (-1, 1)]
    with Run() as run:
        run.memory.add_node("tray", "container", size=(0.07, 0.07, 0.06), shape=to_numbers(tuple(parts)))
        run.memory.add_edge("world", "tray", "Virtual_RT", pose=Pose((*THERE, 0.03)))
        run.memory.add_edge("tray", "table", "on", source="contact")
        believe(run.memory, "cube_3", at(0.99, THERE, containers=("tray",)), Alternative(weight=0.01, pose=None))
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        assert looks_before(run) == [] and "pick tray done" not in run.arm.done


def test_a_cover_is_lifted_once_however_little_that_tells() -> None:
    with Run() as run:
        under_a_cup(run)
        run.want("on(cube_3,cube_4)")
        run.until("reached", 120.0)
        assert run.arm.done.count("pick cup done") == 1 and run.replans == 1


def test_the_thing_that_is_to_be_moved_may_be_a_cover_itself() -> None:
    """The cube on which the cup will be put is probably under the cup: that shows when the cup is put on the table."""
    with Run() as run:
        cover_cube_4(run)
        run.want("on(cup,cube_4)")
        run.until("reached")
        assert looks_before(run)[0].startswith("lift cup before pick cup: cube_4 is where")
        lifted = ["pick cup done", "place cup table done", "pick cup done", "place cup cube_4 done"]
        assert [told for told in run.arm.done if "cup" in told] == lifted


def test_what_cannot_be_lifted_keeps_nobody_from_trying() -> None:
    with Run() as run:
        under_a_cup(run)
        run.arm.failing.append("pick")
        run.want("on(cube_3,cube_4)")
        run.until("reached", 120.0)
        assert run.arm.done.count("pick cup failed") == 1 and "pick cube_3 done" in run.arm.done


def test_what_another_goal_wants_where_it_is_is_not_lifted() -> None:
    with Run() as run:
        under_a_cup(run)
        run.want("on(cup,table)", maintain=True, priority=5)
        run.until("maintained")
        run.want("on(cube_3,cube_4)")
        run.until(lambda: supports(run.memory).get("cube_3") == "cube_4")
        assert "pick cup done" not in run.arm.done
