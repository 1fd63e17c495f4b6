"""What one arm minds of the others: their parts, what is left of their ways, who goes first, when they are near."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from agents.arm_controller.joints import Joints
from agents.arm_controller.model.arm_model import load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.urdf import MOST_LINKS
from agents.arm_controller.motion.obstacles import Load
from agents.arm_controller.motion.others import APART, COAST, MOST_BOXES, SILENT, STRIDE, Announcer, OtherArms
from agents.arm_controller.motion.trajectory import Trajectory
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.files.built_in import ETC

MODEL = load_arm(ETC / "robots" / "gen3.urdf")
FIGURE = Figure(MODEL)
REST = np.array([0.0, 0.0, np.pi, -0.96, 0.0, -2.09, np.pi / 2])
FACING = Pose((0.95, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))
PART = (-0.1, -0.05, 0.0, 0.1, 0.05, 0.2)


@pytest.fixture
def memory() -> Iterator[Memory]:
    clock = ManualClock(100.0)
    with closing(Memory("test", "mission", transport=LocalNetwork(clock).connect("mission"), clock=clock)) as memory:
        memory.add_node("world", "world")
        for name in ("arm", "arm_2", "arm_3"):
            memory.add_node(name, "arm")
        yield memory


def put(memory: Memory, arm: str, place: tuple[float, float, float], stamp: float) -> None:
    """One part of an arm, as its controller writes it."""
    memory.add_edge("world", arm, "RT", pose=Pose((0.0, 0.0, 0.0)))
    memory.add_node(f"{arm}_link_1", "body", bounds=PART)
    memory.add_edge(arm, f"{arm}_link_1", "RT", pose=Pose(place).with_stamp(stamp))


def way() -> Trajectory:
    """A turn of the first joint by 1 rad within 2 s."""
    times = np.linspace(0.0, 2.0, 101)
    return Trajectory(times, np.array([[0.5 * time, *REST[1:]] for time in times]))


def test_the_parts_of_other_arms_are_obstacles_under_their_names(memory: Memory) -> None:
    put(memory, "arm_2", (0.5, 0.0, 0.1), 100.0)
    others = OtherArms(memory, "arm")
    (part,) = others.obstacles(100.0)
    assert others.names() == ["arm_2", "arm_3"] and part.name == "arm_2"
    assert part.pose.t == pytest.approx((0.5, 0.0, 0.2)), "the middle of its bounds"
    assert part.size == pytest.approx((0.2 + 2 * APART, 0.1 + 2 * APART, 0.2 + 2 * APART))
    assert OtherArms(memory, "arm_2").obstacles(100.0) == [], "an arm does not mind itself"


def test_what_another_arm_holds_is_a_part_of_it(memory: Memory) -> None:
    memory.add_node("arm_2_gripper", "gripper")
    memory.add_node("cube_3", "cube", size=(0.04, 0.04, 0.04))
    memory.add_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.5, 0.0, 0.3)))
    memory.add_edge("arm_2_gripper", "cube_3", "grasping")
    (held,) = OtherArms(memory, "arm").obstacles(100.0)
    assert (held.name, held.pose.t) == ("arm_2", (0.5, 0.0, 0.3))


def test_what_is_left_of_an_announced_way_is_an_obstacle(memory: Memory) -> None:
    announcer, others = Announcer(memory, "arm_2", FIGURE), OtherArms(memory, "arm")
    announcer.announce(way(), 100.0, FACING, Load(0.085))
    put(memory, "arm_2", (0.5, 0.0, 0.1), 100.0)
    whole = others.obstacles(100.0)
    put(memory, "arm_2", (0.5, 0.0, 0.1), 101.5)
    left = others.obstacles(101.5)
    put(memory, "arm_2", (0.5, 0.0, 0.1), 102.5)
    assert len(whole) > 1.5 * len(left) > 2
    boxes = FIGURE.boxes(way().positions[-1:], 0.085).centers[0, FIGURE.base_boxes :]
    ends = [FACING.apply(center) for center in boxes]
    centers = np.array([box.pose.t for box in left])
    assert all(np.linalg.norm(centers - end, axis=1).min() < 1e-6 for end in ends), "to where it ends"
    announcer.withdraw()
    announcer.rest()
    assert len(others.obstacles(102.5)) == 1


def test_an_arm_that_died_while_it_braked_may_be_anywhere_it_could_have_come_to(memory: Memory) -> None:
    announcer, others = Announcer(memory, "arm_2", FIGURE), OtherArms(memory, "arm")
    announcer.announce(way(), 100.0, FACING, Load(0.085))
    put(memory, "arm_2", (0.5, 0.0, 0.1), 100.2)
    announcer.withdraw()
    assert "way_since" not in memory.node("arm_2") and not others.precedes("arm_2")
    assert len(others.obstacles(160.0)) > 1
    announcer.rest()
    assert len(others.obstacles(160.0)) == 1, "its joints"


def test_no_part_slips_between_two_announced_places(memory: Memory) -> None:
    Announcer(memory, "arm_2", FIGURE).announce(way(), 100.0, FACING, Load(0.085))
    told = np.array(memory.node("arm_2")["way"]).reshape(len(memory.node("arm_2")["way_times"]), -1, 10)
    steps = np.linalg.norm(np.diff(told[:, :, :3], axis=0), axis=2)
    assert steps.max() <= STRIDE


def test_an_arm_that_tells_nothing_more_may_be_on_its_way_for_a_while(memory: Memory) -> None:
    Announcer(memory, "arm_2", FIGURE).announce(way(), 100.0, FACING, Load(0.085))
    put(memory, "arm_2", (0.5, 0.0, 0.1), 100.2)
    others = OtherArms(memory, "arm")
    alive, dead, later = (len(others.obstacles(now)) for now in (100.2, 100.3 + SILENT, 160.0))
    assert 1 < dead == later < alive, "the part of its way that it may have reached, for ever"
    times = memory.node("arm_2")["way_times"]
    assert sum(time <= 100.2 + COAST for time in times) < len(times)


def test_who_has_wanted_to_go_for_longer_goes_first(memory: Memory) -> None:
    first, second = OtherArms(memory, "arm"), OtherArms(memory, "arm_2")
    one, other = (Announcer(memory, name, FIGURE) for name in ("arm", "arm_2"))
    assert not first.precedes("arm_2") and second.precedes("arm"), "by name, as long as nobody wants anything"
    other.wait_for("arm", 100.0)
    one.announce(way(), 101.0, Pose.identity(), Load(0.085))
    assert first.precedes("arm_2") and not second.precedes("arm")
    assert first.waits_for_us() == ["arm_2"] and second.waits_for_us() == []
    other.announce(way(), 105.0, FACING, Load(0.085))
    assert memory.node("arm_2")["way_since"] == 100.0 and first.precedes("arm_2"), "waiting counts"
    other.withdraw()
    assert not first.precedes("arm_2") and "waits_for" not in memory.node("arm_2")


def test_only_the_arm_that_moves_into_the_other_is_near(memory: Memory) -> None:
    others = OtherArms(memory, "arm")
    tip = MODEL.chain.forward(tuple(REST)).t
    put(memory, "arm_2", (tip[0], 0.2, tip[2] - 0.1), 100.0)

    def near(rate: float) -> str:
        joints = Joints(100.0, tuple(REST), (rate, *[0.0] * 6), 0.085, False)
        return others.is_near(FIGURE, Pose.identity(), joints)

    into, away = -1.2, 1.2  # rad/s: the first joint turns about an axis that points down
    assert (near(into), near(0.0), near(away)) == ("arm_2", "", "")


def test_an_arm_that_fell_silent_is_minded_along_its_way(memory: Memory) -> None:
    """Its controller died: it moves on until its device stops it, and nobody tells where it is."""
    others = OtherArms(memory, "arm")
    tip = MODEL.chain.forward(tuple(REST)).t
    put(memory, "arm_2", (0.9, 0.9, 0.0), 100.0)
    ahead = (tip[0], 0.15, tip[2], 0.0, 0.0, 0.0, 1.0, 0.2, 0.1, 0.2)
    memory.update_node("arm_2", way=ahead, way_times=(100.5,))

    def near(stamp: float) -> str:
        joints = Joints(stamp, tuple(REST), (-1.2, *[0.0] * 6), 0.085, False)
        return others.is_near(FIGURE, Pose.identity(), joints)

    assert (near(100.1), near(100.1 + SILENT)) == ("", "arm_2")


def test_a_way_that_is_announced_changes_the_claims(memory: Memory) -> None:
    others, announcer = OtherArms(memory, "arm_2"), Announcer(memory, "arm", FIGURE)
    put(memory, "arm", (0.4, 0.0, 0.1), 100.0)
    before = others.claims()
    announcer.announce(way(), 100.0, Pose.identity(), Load(0.085))
    assert others.claims() != before and {box.name for box in others.obstacles_of_first(100.0)} == {"arm"}
    announcer.withdraw()
    announcer.rest()
    assert others.claims() == before


def test_an_arm_that_stands_still_is_not_near_when_the_other_one_comes(memory: Memory) -> None:
    others = OtherArms(memory, "arm")
    tip = MODEL.chain.forward(tuple(REST)).t
    for stamp, y in ((100.0, 0.22), (100.05, 0.16), (100.1, 0.10)):
        put(memory, "arm_2", (tip[0], y, tip[2] - 0.1), stamp)
        joints = Joints(stamp, tuple(REST), (0.0,) * 7, 0.085, False)
        assert others.is_near(FIGURE, Pose.identity(), joints) == ""


def test_however_many_arms_links_and_boxes_somebody_makes_up_few_are_looked_at(memory: Memory) -> None:
    put(memory, "arm_2", (0.5, 0.0, 0.1), 100.0)
    for number in range(MOST_LINKS + 9):
        memory.add_node(f"arm_2_link_{number + 1}", "body")
    others = OtherArms(memory, "arm")
    assert len(others._links("arm_2")) == MOST_LINKS
    box = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1, 0.1, 0.1)
    memory.update_node("arm_3", way=MOST_BOXES * box, way_times=(100.0,))
    assert others.unreadable() == ""
    memory.update_node("arm_3", way=(MOST_BOXES + 1) * box, way_times=(100.0,))
    assert others.unreadable() == "arm_3"
