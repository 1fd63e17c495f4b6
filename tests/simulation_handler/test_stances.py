"""How things rest, lean, roll on and come back into view that percepts do not tell the orientation of."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape
from dsr.math3d.transforms import Pose
from simulation_handler.belief import Belief
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.perceived import PerceivedBody
from simulation_handler.contact.placement import Placement
from simulation_handler.contact.stances import is_sure, likeliest_stance, probabilities, stances
from simulation_handler.motion.leaning import Leaning
from simulation_handler.motion.rolling import rolling
from simulation_handler.perception.paths import Path
from simulation_handler.perception.percepts import SeenObject
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.followed import ASLANT
from tests.simulation_handler.worlds import BALL, CAMERA, PERIOD, ROUND, TABLE

CAN: Vector3 = (0.09, 0.09, 0.06)
CYLINDER: Shape = (Part("cylinder", CAN),)
BOARD: Vector3 = (0.01, 0.08, 0.19)
WALL: Vector3 = (0.09, 0.16, 0.18)
UNTOLD = math.pi**2
LYING = Pose.from_rotvec((0.0, 0.0, 0.0), (0.5 * math.pi, 0.0, 0.0)).q
FLOOR = Solid("table", TABLE, (0.35, 0.0, -0.02), fixed=True)
CONFIG = BeliefConfig()


class World:
    """Things that are seen without their orientation: where their centres are, within 2 mm, or so much `noise` (m)."""

    def __init__(self, seed: int = 0, noise: float = 0.002) -> None:
        self.belief, self.noise = Belief(BeliefConfig()), noise
        self.belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.02)))
        self.rng = np.random.default_rng(seed)
        self.truths: dict[str, Vector3] = {}
        self.told: dict[str, Pose] = {}
        self.now = 100.0

    def add(self, name: str, size: Vector3, at: Vector3, shape: Shape = (), **more: float) -> None:
        """Let a thing be there, with its centre `at` (m)."""
        self.belief.add_object(name, size, mass=0.2, friction=0.7, shape=shape, **more, tagged=False)
        self.truths[name] = at

    def run(self, seconds: float, velocity: Vector3 = (0.0, 0.0, 0.0), moves: str = "") -> None:
        """Let time pass; one thing may move (m/s)."""
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            if moves:
                x, y, z = (a + PERIOD * speed for a, speed in zip(self.truths[moves], velocity, strict=True))
                self.truths[moves] = (x, y, z)
            if round(self.now / PERIOD) % 2:
                for name, place in self.truths.items():
                    x, y, z = np.add(place, self.rng.normal(0.0, self.noise, 3)).tolist()
                    turned = self.told.get(name, Pose()).q
                    covariance = np.diag([4e-6] * 3 + [0.02**2 if name in self.told else UNTOLD] * 3)
                    seen = Pose((x, y, z), turned, self.now, covariance)
                    self.belief.observe([SeenObject(name, seen, self.now, CAMERA, "camera")])
            self.belief.step(self.now)

    def off(self, name: str) -> float:
        """M from where it truly is."""
        pose = self.belief.pose(name)
        assert pose is not None
        return math.dist(pose.t, self.truths[name])

    def tilt(self, name: str) -> float:
        """Rad between its own z axis and the vertical."""
        pose = self.belief.pose(name)
        assert pose is not None
        return math.acos(min(1.0, abs(float(pose.rotation_matrix[2, 2]))))


@pytest.mark.parametrize(("height", "tilt"), [(0.03, 0.0), (0.045, 0.5 * math.pi)])
def test_the_height_of_a_can_tells_whether_it_stands_or_lies(height: float, tilt: float) -> None:
    world = World()
    world.add("can", CAN, (0.35, 0.1, height), CYLINDER)
    world.add("block", (0.06, 0.06, 0.06), (0.5, -0.1, 0.03))
    world.run(3.0)
    assert world.tilt("can") == pytest.approx(tilt, abs=0.01)
    assert world.off("can") < 0.003


def test_what_others_tell_of_the_error_of_depth_tells_how_a_can_stands() -> None:
    """It is seen 15 mm too high, as high as if it lay; but so is all else."""
    world = World()
    world.add("block", (0.06, 0.06, 0.06), (0.5, -0.1, 0.03 + 0.015))
    world.add("cube", (0.04, 0.04, 0.04), (0.2, -0.1, 0.02 + 0.015))
    world.add("can", CAN, (0.35, 0.1, 0.03 + 0.015), CYLINDER)
    world.run(3.0)
    assert world.tilt("can") < 0.01


def test_a_can_lies_so_that_it_is_not_in_the_way_of_what_is_beside_it() -> None:
    long = (0.05, 0.05, 0.12)
    world = World()
    world.add("can", long, (0.35, 0.1, 0.025), (Part("cylinder", long),))
    for k, x in enumerate((0.29, 0.41)):
        world.add(f"block_{k}", (0.06, 0.06, 0.06), (x, 0.1, 0.03))
    world.run(2.0)
    assert max(map(world.off, world.truths)) < 0.004


def test_a_body_with_an_orientation_that_is_seen_is_not_turned() -> None:
    percept = Solid("can", CAN, (0.35, 0.1, 0.045), LYING, shape=CYLINDER)
    sure, tells_nothing = 1e-3 * np.eye(3), UNTOLD * np.eye(3)
    position = 1e-6 * np.eye(3)
    lower = percept.moved((0.35, 0.1, 0.03))
    assert likeliest_stance(PerceivedBody(lower, position, sure), [FLOOR], CONFIG) == pytest.approx(LYING)
    found = stances(PerceivedBody(lower, position, tells_nothing), [FLOOR], CONFIG)
    assert is_sure(found, CONFIG) and found[0].solid.half_height == pytest.approx(0.03)
    assert probabilities(found)[0] > 0.999
    found = stances(PerceivedBody(lower, 1e-2 * np.eye(3), tells_nothing), [FLOOR], CONFIG)
    assert not is_sure(found, CONFIG) and probabilities(found) == pytest.approx([0.5, 0.5], abs=0.05)


@pytest.mark.parametrize(("height", "unsure"), [(0.015, False), (0.044, True)])
def test_a_can_that_is_as_high_as_wide_may_stand_or_lie(height: float, unsure: bool) -> None:
    """Its centre is 30 mm, or 1 mm, higher when it lies; the error of depth is 10 mm, and nothing else tells of it."""
    size = (0.09, 0.09, 2.0 * height)
    world = World()
    world.add("can", size, (0.35, 0.1, height), (Part("cylinder", size),))
    world.run(2.0)
    (island,) = world.belief.islands()
    lies = sum(
        one.weight
        for one in island.worlds
        if (pose := one.objects["can"].pose) is not None and abs(float(pose.rotation_matrix[2, 2])) < 0.5
    )
    assert lies == pytest.approx(0.5, abs=0.2) if unsure else lies < 0.05
    assert sum(one.weight for one in island.worlds) == pytest.approx(1.0)


def test_a_can_on_another_side_is_as_high_as_that_side_has_it() -> None:
    """It is 80 mm high and 90 mm wide. Its height says nothing, for the error of depth is 10 mm."""
    size = (0.09, 0.09, 0.08)
    world = World()
    world.add("can", size, (0.35, 0.1, 0.042), (Part("cylinder", size),))
    world.run(2.0)
    (island,) = world.belief.islands()
    heights: dict[bool, list[float]] = {False: [], True: []}
    for one in island.worlds:
        pose = one.objects["can"].pose
        if pose is not None and one.weight > 0.1:
            heights[abs(float(pose.rotation_matrix[2, 2])) < 0.5].append(pose.t[2])
    assert heights[False] == pytest.approx([0.04] * len(heights[False]), abs=0.001) and heights[False]
    assert heights[True] == pytest.approx([0.045] * len(heights[True]), abs=0.001) and heights[True]


@pytest.mark.parametrize("told", [False, True])
def test_a_board_leans_on_the_box_that_stops_it_and_shoves_nothing(*, told: bool) -> None:
    world, angle = World(), 0.45
    height = 0.5 * (BOARD[2] * math.cos(angle) + BOARD[0] * math.sin(angle))
    reach = 0.5 * (BOARD[2] * math.sin(angle) + BOARD[0] * math.cos(angle))
    world.add("cube", (0.04, 0.04, 0.04), (0.1, -0.2, 0.02))
    world.add("wall", WALL, (0.4, 0.0, 0.09))
    world.add("board", BOARD, (0.4 - 0.045 - reach, 0.0, height))
    if told:
        world.told["board"] = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, angle, 0.0))
    world.run(3.0)
    assert world.tilt("board") == pytest.approx(angle, abs=0.06)
    assert world.off("board") < 0.004
    assert world.off("wall") < 0.003
    assert ("board", "table") in world.belief.supports()


@pytest.mark.parametrize(("friction", "leans"), [(0.7, True), (0.02, False)])
def test_whether_a_board_can_lean_depends_on_the_friction_of_its_table(*, friction: float, leans: bool) -> None:
    world, angle = World(), 0.45
    world.belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.02)), friction=friction)
    world.add("cube", (0.04, 0.04, 0.04), (0.1, -0.2, 0.02))
    world.add("wall", WALL, (0.25 + BOARD[2] * math.sin(angle) + BOARD[0] * math.cos(angle) + 0.045, 0.0, 0.09))
    world.add("board", BOARD, leaning_at(angle, 0.25))
    world.run(2.0)
    assert (world.tilt("board") > 0.3) is leans


def test_what_lies_aslant_on_an_edge_is_likelier_where_it_is_seen() -> None:
    """Nobody sees how the box and the plate are turned. Things that stand by themselves tell the error of depth."""
    world, tilt, size = World(), 0.25, (0.04, 0.04, 0.04)
    for k, y in enumerate((-0.3, -0.2, 0.2, 0.3)):
        world.add(f"cube_{k}", size, (0.1, y, 0.02))
    world.add("plate", (0.2, 0.06, 0.01), (0.35, 0.0, 0.005))
    edge = 0.01 / math.sin(tilt)  # m, of the lower side, from the table to the edge of the plate
    across, up = (part * math.cos(tilt) for part in (edge - 0.02, 0.02))
    box = (0.45 + across - 0.02 * math.sin(tilt), 0.0, up + 0.02 * math.sin(tilt))
    world.add("box", size, box)
    world.run(3.0)
    assert world.off("plate") < 0.003
    (told,) = [island for island in world.belief.islands() if "box" in island.names]
    aslant = [one for one in told.worlds if one.reason == ASLANT]
    assert sum(one.weight for one in aslant) > 0.5
    pose = aslant[0].objects["box"].pose
    assert pose is not None and math.dist(pose.t, box) < 0.002
    cubes = [island for island in world.belief.islands() if island.names[0].startswith("cube")]
    assert len(cubes) == 4 and not any(one.reason == ASLANT for island in cubes for one in island.worlds)


def leaning_at(angle: float, foot: float) -> Vector3:
    """Centre (m) of the board whose lower edge is at x = `foot` (m), leaning by an angle (rad) towards +x."""
    x, z = 0.5 * BOARD[2] * math.sin(angle), 0.5 * BOARD[2] * math.cos(angle)
    return (foot + x + 0.5 * BOARD[0] * math.cos(angle), 0.0, z + 0.5 * BOARD[0] * math.sin(angle))


def test_a_board_that_sinks_after_its_wall_leans_where_it_comes_to_rest() -> None:
    """What explains that both moved knows no leaning: standing, the board would be 17 mm off, and surprise for ever."""
    world, foot, reach = World(), 0.25, BOARD[2] * math.sin(0.2)
    for k, y in enumerate((-0.3, -0.2, 0.2, 0.3)):
        world.add(f"cube_{k}", (0.04, 0.04, 0.04), (0.1, y, 0.02))
    world.add("wall", WALL, (foot + reach + BOARD[0] + 0.5 * WALL[0], 0.0, 0.09))
    world.add("board", BOARD, leaning_at(0.2, foot))
    world.run(2.0)
    for _ in range(10):
        reach += 0.008
        x, y, z = world.truths["wall"]
        world.truths |= {"wall": (x + 0.008, y, z), "board": leaning_at(math.asin(reach / BOARD[2]), foot)}
        world.run(PERIOD)
    world.run(2.0)
    assert world.off("wall") < 0.005
    assert world.off("board") < 0.005
    assert world.tilt("board") == pytest.approx(math.asin(reach / BOARD[2]), abs=0.06)


def test_a_board_leans_where_it_is_seen_though_the_simulation_lets_it_slip() -> None:
    """Its friction is not what the memory says. Lying on an edge, the board would be 23 mm lower."""
    world, angle = World(), 0.9
    for k, y in enumerate((-0.3, -0.2, 0.2, 0.3)):
        world.add(f"cube_{k}", (0.04, 0.04, 0.04), (0.1, y, 0.02))
    wall = 0.25 + BOARD[2] * math.sin(angle) + BOARD[0] * math.cos(angle) + 0.5 * WALL[0]
    world.add("wall", WALL, (wall, 0.0, 0.09))
    world.belief.add_object("board", BOARD, mass=0.2, friction=0.05, tagged=False)
    world.truths["board"] = leaning_at(angle, 0.25)
    world.run(3.0)
    for _ in range(4):
        world.run(0.5)
        assert world.off("board") < 0.004
        assert world.tilt("board") == pytest.approx(angle, abs=0.06)
    assert world.off("wall") < 0.003
    assert ("board", "table") in world.belief.supports()


def test_how_a_body_leans_already_is_one_of_the_ways_however_far_off_it_would_stand() -> None:
    """A plank once was put on its end 0.15 m away: from there, no tilt towards its neighbours was as it leant."""
    world, angle = World(), 0.45
    leaning = leaning_at(angle, 0.25)
    world.add("cube", (0.04, 0.04, 0.04), (0.1, -0.2, 0.02))
    world.add("wall", WALL, (0.25 + BOARD[2] * math.sin(angle) + BOARD[0] * math.cos(angle) + 0.045, 0.0, 0.09))
    world.add("board", BOARD, leaning)
    world.run(2.0)
    bodies = world.belief._bodies
    item, scene = bodies.object("board"), bodies.scene(leaving_out={"board"})
    x, y, _ = leaning
    seen = PerceivedBody(item.percept().moved(leaning), 1e-6 * np.eye(3), UNTOLD * np.eye(3))
    flat = Placement(seen.solid.turned((0.0, 0.0, 0.0, 1.0)).moved((x + 0.03, y + 0.15, 0.095)), ("table",), np.eye(3))
    judge = Leaning(bodies, CONFIG)
    placement, aslant = judge.judge(item, seen, flat, {"wall": scene["wall"]}, scene)
    judge.close()
    assert placement is not None and not placement.is_held and aslant > 0.99
    assert math.dist(placement.solid.position, leaning) < 0.002


def test_what_could_not_stand_beside_a_bar_leans_where_it_is_seen() -> None:
    """Standing, it would be 4 mm lower, which it may be, but 15 mm inside the bar, and was pushed aside each time."""
    world, angle, size = World(), 0.87, (0.09, 0.17, 0.17)
    for k, y in enumerate((-0.3, 0.3)):
        world.add(f"cube_{k}", (0.04, 0.04, 0.04), (0.1, y, 0.02))
    height = 0.5 * (size[0] * math.sin(angle) + size[2] * math.cos(angle))
    world.belief.set_fixture("bar", (0.1, 0.2, 0.1), Pose((0.4 - 0.03 - 0.05, 0.0, 0.18)))
    world.add("box", size, (0.4, 0.0, height))
    world.add("stop", (0.083, 0.083, 0.083), (0.4 + 0.063 + 0.0415, 0.0, 0.0415))
    world.run(2.0)
    for _ in range(10):
        world.run(0.3)
        assert world.off("box") < 0.004
    assert world.tilt("box") == pytest.approx(angle, abs=0.1)
    assert world.off("stop") < 0.003


def test_a_board_that_stands_free_is_not_believed_to_lean() -> None:
    world = World()
    world.add("wall", WALL, (0.6, 0.0, 0.09))
    world.add("board", BOARD, (0.3, 0.0, 0.095))
    world.run(2.0)
    assert world.tilt("board") < 0.02
    assert world.off("board") < 0.003


def test_a_ball_that_rolls_out_of_sight_rolls_on() -> None:
    world = World()
    world.add("ball", BALL, (0.2, 0.0, 0.03), ROUND, rolling_friction=0.0005)
    world.run(1.0)
    world.run(1.0, (0.2, 0.0, 0.0), "ball")
    hidden = dict(world.truths)
    world.truths.clear()
    world.run(0.8)
    pose = world.belief.pose("ball")
    assert pose is not None
    assert pose.t[0] - hidden["ball"][0] == pytest.approx(0.16, abs=0.05)
    assert abs(pose.t[1]) < 0.02


def test_a_ball_that_rolls_over_the_edge_falls_to_the_floor() -> None:
    world = World()
    world.add("ball", BALL, (0.7, 0.0, 0.03), ROUND)
    world.run(1.0)
    world.run(1.35, (0.2, 0.0, 0.0), "ball")
    world.truths.clear()
    world.run(2.0)
    pose = world.belief.pose("ball")
    assert pose is not None
    assert pose.t[0] > 0.95 and pose.t[2] < -0.6


def test_what_comes_out_of_hiding_while_it_moves_is_followed() -> None:
    world = World()
    world.add("ball", BALL, (0.1, 0.0, 0.03), ROUND)
    world.run(1.0)
    world.truths.clear()
    world.run(1.0)
    world.truths["ball"] = (0.4, 0.2, 0.03)
    world.run(0.7, (0.2, 0.0, 0.0), "ball")
    assert world.off("ball") < 0.02


def test_what_is_on_its_way_is_believed_where_it_is_by_now() -> None:
    world = World()
    world.add("ball", BALL, (0.1, 0.0, 0.03), ROUND)
    world.run(1.0)
    world.run(1.0, (0.25, 0.0, 0.0), "ball")
    errors = []
    for _ in range(20):
        world.run(PERIOD, (0.25, 0.0, 0.0), "ball")
        errors.append(world.off("ball"))
    assert np.median(errors) < 0.006


def test_a_cylinder_that_lies_rolls_across_its_axis_and_one_that_stands_does_not() -> None:
    can = Solid("can", CAN, (0.0, 0.0, 0.045), LYING, shape=CYLINDER)
    rotation, spin = rolling(can, (0.09, 0.0, 0.0), free=True)
    assert can.turned(rotation).parts[0].pose.rotation_matrix[:, 2] == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)
    assert spin == pytest.approx((0.0, 2.0, 0.0))
    assert rolling(can, (0.0, 0.09, 0.0), free=False)[1] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    standing = can.turned((0.0, 0.0, 0.0, 1.0))
    assert rolling(standing, (0.09, 0.0, 0.0), free=True) == (standing.rotation, (0.0, 0.0, 0.0))


def test_a_path_tells_where_something_came_back_into_view_while_it_moves() -> None:
    path = Path()
    assert path.velocity == (0.0, 0.0, 0.0)
    for k in range(3):
        path.add(Pose((0.0, 0.0, 0.0), stamp=0.1 * k))
    assert path.reappeared(0.02) is None
    for k in range(5):
        path.add(Pose((0.5 + 0.02 * k, 0.0, 0.0), stamp=2.0 + 0.1 * k))
    first = path.reappeared(0.02)
    assert first is not None and first.t[0] == pytest.approx(0.5)
    assert path.velocity == pytest.approx((0.2, 0.0, 0.0))
