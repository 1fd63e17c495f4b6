"""Arm controller and simulated reality in lockstep: cubes are truly grasped, carried, stacked, and lost."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from agents.arm_controller import ArmController
from agents.arm_controller.joints import Joints
from agents.arm_controller.safety.watchdog import CLEARED
from agents.plant import Plant
from agents.plant.reality import Reality
from benchmarks.pick_bench import CUBE, Bench, Block, BlockForm, cubes
from dsr import Pose

PLACES = [(0.42, 0.08, 0.4), (0.30, 0.08, -1.2), (0.30, -0.08, 2.0), (0.42, -0.08, 0.1)]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with Bench(cubes(PLACES)) as bench:
        yield bench


def reality(bench: Bench) -> Reality:
    plant = bench.lockstep.runner("plant").agent
    assert isinstance(plant, Plant)
    return plant._reality


def grasped(bench: Bench) -> list[str]:
    return [edge.dst for edge in bench.memory.edges("grasping")]


def tilt(pose: Pose) -> float:
    return math.acos(min(1.0, float(pose.rotation_matrix[2, 2])))


def test_each_tick_of_the_controller_has_a_new_sample(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    controller = bench.lockstep.runner("arm_controller").agent
    assert isinstance(controller, ArmController)
    stamps = []
    write = controller._body.write

    def note(joints: Joints) -> None:
        stamps.append(joints.stamp)
        write(joints)

    monkeypatch.setattr(controller._body, "write", note)
    bench.run(2.0)
    assert len(set(stamps)) == 2.0 * ArmController.rate_hz


def test_four_cubes_become_two_towers(bench: Bench) -> None:
    for cube, support in (("cube_3", "cube_4"), ("cube_6", "cube_5")):
        assert bench.act("pick", target=cube) == "done"
        assert grasped(bench) == [cube]
        assert bench.act("place", target=cube, destination=support) == "done"
        assert grasped(bench) == []
    bench.run(0.5)
    for cube, support in (("cube_3", "cube_4"), ("cube_6", "cube_5")):
        above, below = bench.pose(cube), bench.pose(support)
        assert above.t == pytest.approx((*below.t[:2], CUBE * 1.5), abs=1e-3)
        assert tilt(above) < 0.01
        yaws = [math.atan2(*pose.rotation_matrix[1::-1, 0]) for pose in (above, below)]
        assert math.remainder(yaws[0] - yaws[1], math.pi / 2) == pytest.approx(0.0, abs=0.03)


def test_a_tower_is_taken_down_again(bench: Bench) -> None:
    for skill, attributes in (
        ("pick", {"target": "cube_3"}),
        ("place", {"target": "cube_3", "destination": "cube_4"}),
        ("pick", {"target": "cube_3"}),
        ("place", {"target": "cube_3", "destination": "table", "target_pose": Pose((0.42, 0.0, 0.02))}),
    ):
        assert bench.act(skill, **attributes) == "done"
    bench.run(0.5)
    assert bench.pose("cube_3").t == pytest.approx((0.42, 0.0, 0.02), abs=2e-3)
    assert bench.pose("cube_4").t == pytest.approx((0.30, 0.08, 0.02), abs=2e-3)


def test_a_halted_arm_keeps_what_it_holds_and_goes_on_when_asked(bench: Bench) -> None:
    assert bench.act("pick", target="cube_3") == "done"
    name = bench.request("place", target="cube_3", destination="cube_5")
    bench.run(0.8)
    bench.memory.update_node(name, request="halt")
    bench.run(0.2)
    assert bench.memory.node(name)["status"] == "halted"
    here = bench.pose("cube_3")
    bench.run(2.0)
    assert bench.pose("cube_3").distance(here)[0] < 2e-3
    assert grasped(bench) == ["cube_3"]
    assert bench.act("place", target="cube_3", destination="cube_5") == "done"
    assert bench.pose("cube_3").t == pytest.approx((0.30, -0.08, 0.06), abs=2e-3)


def test_what_the_experimenter_takes_out_of_the_gripper_is_dropped(bench: Bench) -> None:
    assert bench.act("pick", target="cube_3") == "done"
    name = bench.request("place", target="cube_3", destination="cube_5")
    bench.run(0.8)
    stage = reality(bench).experimenter._stage
    taken = stage.take("cube_3", contents=False)
    for step in range(60):
        taken.move_to(Pose((0.0, 0.0, 0.002)) @ taken.pose)
        bench.run(1 / 60)
        stage.act()
        if step == 59:
            stage.release("cube_3")
    bench.run(1.0)
    node = bench.memory.node(name)
    assert (node["status"], node["explanation"]) == ("failed", "dropped cube_3")
    assert grasped(bench) == []


def test_a_restarted_controller_knows_what_it_holds(bench: Bench) -> None:
    assert bench.act("pick", target="cube_3") == "done"
    name = bench.request("place", target="cube_3", destination="cube_5")
    bench.run(0.8)
    bench.lockstep.kill("arm_controller")
    bench.run(0.5)
    bench.lockstep.restart("arm_controller")
    bench.run(CLEARED + 0.1)  # the arm has stopped by itself, and says so until the controller lives
    node = bench.memory.node(name)
    assert (node["status"], node["explanation"]) == ("failed", "the arm controller was restarted")
    assert grasped(bench) == ["cube_3"]
    assert bench.act("place", target="cube_3", destination="cube_5") == "done"
    assert bench.pose("cube_3").t == pytest.approx((0.30, -0.08, 0.06), abs=3e-3)


def test_a_support_that_is_higher_than_believed_is_met_and_stood_upon(bench: Bench) -> None:
    assert bench.act("pick", target="cube_3") == "done"
    bench.lower("cube_4", 0.008)
    assert bench.act("place", target="cube_3", destination="cube_4") == "done"
    bench.run(0.5)
    assert bench.pose("cube_3").t == pytest.approx((0.30, 0.08, 0.06), abs=6e-3)


@pytest.mark.parametrize(("wide", "high"), [(0.04, 0.01), (0.02, 0.035), (0.01, 0.04), (0.08, 0.02)])
def test_low_narrow_and_wide_boxes_are_lifted(wide: float, high: float) -> None:
    with Bench([Block("box", (0.40, 0.05, 0.7), (wide, wide, high))]) as bench:
        assert bench.act("pick", target="box") == "done"
        assert grasped(bench) == ["box"]
        bench.run(0.5)
        assert bench.pose("box").t[2] == pytest.approx(high / 2 + 0.08, abs=3e-3)
        assert tilt(bench.pose("box")) < 0.02


def test_a_low_box_goes_onto_another_one_and_down_again() -> None:
    with Bench([Block("plate", (0.40, 0.08, 0.7), (0.06, 0.06, 0.012)), *cubes([(0.32, -0.08, 0.1)])]) as bench:
        goal = Pose((0.42, 0.05, 0.006))
        for skill, attributes in (
            ("pick", {"target": "plate"}),
            ("place", {"target": "plate", "destination": "cube_3"}),
            ("pick", {"target": "plate"}),
            ("place", {"target": "plate", "destination": "table", "target_pose": goal}),
        ):
            assert bench.act(skill, **attributes) == "done"
        bench.run(0.5)
        assert bench.pose("plate").t == pytest.approx(goal.t, abs=3e-3)
        assert bench.pose("cube_3").t == pytest.approx((0.32, -0.08, 0.02), abs=2e-3)


def test_beside_a_wall_a_box_is_held_off_its_middle_and_the_wall_stays() -> None:
    wall = Block("wall", (0.45, 0.05, 0.0), (0.02, 0.3, 0.15), mass=50.0)
    with Bench([Block("box", (0.40, 0.05, 0.0), (0.06, 0.06, 0.03)), wall]) as bench:
        assert bench.act("pick", target="box") == "done"
        bench.run(0.5)
        assert bench.pose("box").t[2] > 0.09 and tilt(bench.pose("box")) < 0.02
        assert bench.pose("wall").t == pytest.approx((0.45, 0.05, 0.075), abs=1e-3)


def test_the_same_seed_gives_the_same_run() -> None:
    ends = []
    for _ in range(2):
        with Bench(cubes(PLACES), seed=3) as bench:
            bench.act("pick", target="cube_3")
            bench.act("place", target="cube_3", destination="cube_4")
            ends.append([bench.pose(name) for name in ("cube_3", "cube_4")])
    assert ends[0] == ends[1]
    assert np.isfinite(ends[0][0].t).all()


def carried(bench: Bench, high: float) -> None:
    """Pick the thing and put it down elsewhere on the table: it is truly lifted, and truly stands there."""
    before = bench.pose("thing").t
    assert bench.act("pick", target="thing") == "done"
    assert grasped(bench) == ["thing"]
    bench.run(0.3)
    assert bench.pose("thing").t == pytest.approx((*before[:2], before[2] + 0.08), abs=4e-3)
    goal = Pose((0.38, 0.15, high / 2))
    assert bench.act("place", target="thing", destination="table", target_pose=goal) == "done"
    assert grasped(bench) == []
    bench.run(0.5)
    assert bench.pose("thing").t == pytest.approx(goal.t, abs=5e-3)


@pytest.mark.parametrize(
    ("form", "wide", "high"),
    [
        ("ball", 0.01, 0.01), ("ball", 0.04, 0.04), ("ball", 0.08, 0.08), ("cylinder", 0.01, 0.06),
        ("cylinder", 0.08, 0.06), ("cup", 0.06, 0.08), ("cup", 0.10, 0.09), ("box", 0.04, 0.45),
    ],
)  # fmt: skip
def test_round_things_cups_and_tall_things_are_carried(form: BlockForm, wide: float, high: float) -> None:
    """A cup of 100 mm is wider than the gripper: it is held at its rim."""
    with Bench([Block("thing", (0.40, 0.0, 0.3), (wide, wide, high), form=form)]) as bench:
        carried(bench, high)


@pytest.mark.parametrize(
    ("form", "wide", "high"), [("box", 0.04, 0.10), ("cylinder", 0.06, 0.12), ("ball", 0.06, 0.06)]
)
def test_from_a_shelf_things_are_taken_by_their_side(form: BlockForm, wide: float, high: float) -> None:
    shelf = [
        Block("roof", (0.62, 0.0, 0.0), (0.3, 0.4, 0.02), mass=5.0, above=0.24),
        *(Block(f"leg_{number}", (0.62, y, 0.0), (0.3, 0.02, 0.24), mass=5.0) for number, y in ((1, 0.19), (2, -0.19))),
    ]
    with Bench([Block("thing", (0.56, 0.0, 0.1), (wide, wide, high), form=form), *shelf]) as bench:
        before = [bench.pose(block.name) for block in shelf]
        carried(bench, high)
        assert all(bench.pose(block.name).distance(pose)[0] < 2e-3 for block, pose in zip(shelf, before, strict=True))


def test_what_is_too_wide_from_above_is_held_above_and_below() -> None:
    foot = Block("foot", (0.40, 0.0, 0.3), (0.05, 0.05, 0.08), mass=1.0)
    with Bench([Block("thing", (0.40, 0.0, 0.3), (0.14, 0.14, 0.03), above=0.08), foot]) as bench:
        assert bench.act("pick", target="thing") == "done"
        bench.run(0.3)
        assert bench.pose("thing").t[2] == pytest.approx(0.175, abs=4e-3)
        assert tilt(bench.pose("thing")) < 0.05


def test_what_slipped_out_of_the_gripper_is_grasped_again(bench: Bench) -> None:
    name = bench.request("pick", target="cube_3")
    place = bench.pose("cube_3")
    while bench.pose("cube_3").t[2] < place.t[2] + 0.04:
        bench.run(0.02)
    simulated = reality(bench)
    simulated.arm.let_go()
    simulated.world.put("cube_3", place)
    told = set()
    for _ in range(200):
        bench.run(0.1)
        told.add(bench.memory.node(name)["explanation"])
        if bench.memory.node(name)["status"] != "running":
            break
    assert "cube_3 slipped out: grasp 2 of 3" in told
    assert bench.memory.node(name)["status"] == "done" and grasped(bench) == ["cube_3"]
    assert bench.pose("cube_3").t[2] == pytest.approx(place.t[2] + 0.08, abs=4e-3)
