"""What vanishes on its way: how fast it may have been, and the courses on which it may have gone on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining.glimpses import DRAW_COUNT
from simulation_handler.motion.courses import Courses
from simulation_handler.motion.setting_out import starts_of
from simulation_handler.perception.percepts import WeighedPercept
from simulation_handler.perception.tracking import Given, PerceptTrack
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject

PERIOD = 0.1
"""s between percepts"""
NOISE = 0.001
"""m, of each coordinate of a percept"""
RADIUS = 0.03


def percepts(*places: float, y: float = 0.0) -> list[WeighedPercept]:
    """Of a ball that is seen along x, one a period."""
    return [
        WeighedPercept(
            PERIOD * number, np.array((x, y, RADIUS)), (0.0, 0.0, 0.0, 1.0),
            np.array((NOISE**2 * np.eye(3), 4.0 * np.eye(3))), np.array((0.0, 0.0, -1.0)),
        )
        for number, x in enumerate(places)
    ]  # fmt: skip


def see(ball: BelievedObject, percept: WeighedPercept) -> None:
    """Let the record of a ball take in a percept."""
    PerceptTrack.add([Given(ball.track, percept)])
    ball.note(percept, "camera")


def speeds(*places: float, count: int = 40) -> np.ndarray:
    """(count,) m/s along x."""
    return np.array([start.velocity[0] for start in starts_of(percepts(*places), count)])


def test_one_moved_percept_tells_the_direction_and_the_least_speed() -> None:
    found = speeds(0.0, 0.0, 0.0, 0.03)
    assert found.min() > 0.9 * 0.03 / PERIOD, "it was at rest until one period before, at least"
    assert found.std() > 0.3 * found.mean(), "and may have set out at any time since"
    across = [start.velocity[1] for start in starts_of(percepts(0.0, 0.0, 0.0, 0.03), 40)]
    assert np.std(across) < 0.3 * found.std()


def test_the_more_percepts_show_it_on_its_way_the_better_its_speed_is_known() -> None:
    spreads = [
        speeds(*places).std() for places in ((0.0, 0.0, 0.0, 0.03), (0.0, 0.0, 0.03, 0.06), (0.0, 0.03, 0.06, 0.09))
    ]
    assert spreads[0] > 3.0 * spreads[1] and spreads[1] > spreads[2]
    assert np.median(speeds(0.0, 0.03, 0.06, 0.09)) == pytest.approx(0.3, rel=0.1)


def test_what_gets_slower_is_as_fast_as_it_was_at_last() -> None:
    """It slows down by 0.5 m/s^2, from 0.6 to 0.15 m/s. On average over the last four percepts, it had 0.225 m/s."""
    found = speeds(*(0.6 * time - 0.25 * time**2 for time in PERIOD * np.arange(10)))
    assert np.median(found) == pytest.approx(0.15, abs=0.015)
    assert found.std() < 0.03


def test_what_has_bounced_is_as_fast_as_it_was_since() -> None:
    found = speeds(0.0, 0.05, 0.1, 0.15, 0.2, 0.18, 0.16, 0.14)
    assert np.median(found) == pytest.approx(-0.2, abs=0.03)


def test_what_was_seen_at_rest_may_have_set_out_but_just_now() -> None:
    found = speeds(0.0, 0.0, 0.0, 0.0)
    assert abs(np.median(found)) < 0.05 and np.abs(found).max() < 1.2
    assert found.std() < speeds(0.0, 0.0, 0.0, 0.03).std()


def test_the_typical_start_comes_first() -> None:
    found = speeds(0.0, 0.0, 0.0, 0.03)
    assert found[0] < found.mean() and (found < found[0]).mean() == pytest.approx(0.5, abs=0.2)


class Table:
    """A ball on a table, which is seen for a while and then not any more."""

    def __init__(self, *places: float) -> None:
        config = BeliefConfig()
        self.bodies = Bodies(config)
        self.bodies.set_fixture("table", (4.0, 4.0, 0.04), Pose((0.0, 0.0, -0.02)))
        self.ball = self.add("ball", *places)
        self.courses = Courses(self.bodies, config)
        self.now = self.ball.track.last_stamp

    def add(self, name: str, *places: float, y: float = 0.0) -> BelievedObject:
        """A ball that was seen at these places along x."""
        size = (2 * RADIUS, 2 * RADIUS, 2 * RADIUS)
        ball = self.bodies.add_object(name, size, 0.05, 0.5, (Part("sphere", size),), rolling_friction=0.002)
        self.bodies.put(ball, (places[0], y, RADIUS), (0.0, 0.0, 0.0, 1.0))
        for percept in percepts(*places, y=y):
            see(ball, percept)
        return ball

    def run(self, seconds: float) -> np.ndarray:
        """(n, 3) m, where it may be by then."""
        for _ in range(round(seconds / 0.05)):
            self.now += 0.05
            self.bodies.sim.step(12)
            self.courses.update(self.now)
        return np.array([one.pose.t for one in self.courses.of("ball")])

    def close(self) -> None:
        self.courses.close()
        self.bodies.sim.close()


MOVES = (*(0.0,) * 8, 0.03)


def test_it_goes_on_in_many_courses_and_the_simulation_in_a_typical_one() -> None:
    table = Table(*MOVES)
    assert len(table.run(0.2)) == 0, "it may be seen again"
    early, late = table.run(0.2), table.run(1.0)
    assert len(early) == len(late) == DRAW_COUNT
    assert late[:, 0].std() > early[:, 0].std() > 0.01
    assert np.abs(late[:, 2] - RADIUS).max() < 0.005, "they go through each other, not over each other"
    assert table.bodies.sim.position("ball")[0] == pytest.approx(late[0, 0], rel=0.1)
    table.close()


def test_a_wall_stops_them_all() -> None:
    table = Table(*MOVES)
    table.bodies.set_fixture("wall", (0.02, 1.0, 0.3), Pose((0.15, 0.0, 0.15)))
    assert table.run(2.0)[:, 0].max() < 0.15 - RADIUS
    table.close()


@pytest.mark.parametrize("end", ["seen", "held", "removed"])
def test_they_end(end: str) -> None:
    table = Table(*MOVES)
    table.run(0.5)
    if end == "seen":
        PerceptTrack.add([Given(table.ball.track, replace(percepts(0.2)[0], stamp=table.now))])
    elif end == "held":
        table.ball.hand = "hand"
    else:
        table.bodies.remove("ball")
    assert len(table.run(0.1)) == 0
    table.close()


def test_what_rested_when_it_vanished_has_none() -> None:
    table = Table(*(0.0,) * 9)
    assert len(table.run(1.0)) == 0
    table.close()


def test_they_are_the_same_in_each_run() -> None:
    tables = Table(*MOVES), Table(*MOVES)
    one, other = (table.run(0.6) for table in tables)
    assert (one == other).all()
    for table in tables:
        table.close()


def test_what_is_held_has_none() -> None:
    table = Table(*MOVES)
    table.ball.hand = "hand"
    assert len(table.run(1.0)) == 0
    table.close()


def test_a_thing_without_two_percepts_has_none() -> None:
    table = Table(0.0)
    assert isinstance(table.ball, BelievedObject) and len(table.run(1.0)) == 0
    table.close()


def test_what_is_glimpsed_once_after_it_was_carried_elsewhere_unseen_has_none() -> None:
    table = Table(*(0.0,) * 9)
    table.now += 10.0  # s
    seen = percepts(0.3)[0]
    see(table.ball, replace(seen, stamp=table.now))
    assert len(table.run(1.0)) == 0, "nobody knows how fast it came there, nor from where"
    table.close()


@pytest.mark.parametrize("hung_there", [False, True])
def test_what_is_seen_once_in_the_air_may_fall_anywhere_near_unless_it_hung_there(hung_there: bool) -> None:
    table = Table(0.0)
    above = (0.0, 0.0, 0.3)
    table.bodies.put(table.ball, above, (0.0, 0.0, 0.0, 1.0))
    table.bodies.set_static(table.ball, True)
    for stamp in (5.0, 10.0) if hung_there else (10.0,):
        table.now = stamp
        see(table.ball, WeighedPercept(**{**vars(percepts(0.0)[0]), "stamp": stamp, "position": np.array(above)}))
    assert len(table.ball.track.way) == 1
    falling, fallen = table.run(0.35), table.run(2.0)
    assert len(falling) == (0 if hung_there else DRAW_COUNT)
    if not hung_there:
        assert np.ptp(falling[:, 2]) > 0.02, "it may be let go of just then, or have been on its way up or down"
        assert fallen[:, :2].std(axis=0).min() > 0.05
    table.close()


def test_what_is_perceived_in_a_wall_goes_on_before_it_where_cameras_see_it() -> None:
    table = Table(0.0)
    table.bodies.set_fixture("wall", (4.0, 0.004, 1.0), Pose((0.0, 0.0, 0.5)))
    table.bodies.put(table.ball, (0.0, 0.003 + RADIUS, 0.3), (0.0, 0.0, 0.0, 1.0))  # it was least far to this side
    table.bodies.set_static(table.ball, True)
    table.now = 10.0
    glimpse = {"stamp": 10.0, "position": np.array((0.0, 0.003, 0.3)), "ray": np.array((0.0, 0.6, -0.8))}
    see(table.ball, WeighedPercept(**{**vars(percepts(0.0)[0]), **glimpse}))
    fallen = table.run(2.0)
    assert len(fallen) == DRAW_COUNT and fallen[:, 1].max() < -RADIUS
    table.close()


def test_one_percept_in_the_air_gives_the_simulated_body_no_velocity() -> None:
    table = Table(0.0)
    above = (0.0, 0.0, 0.3)
    table.bodies.put(table.ball, above, (0.0, 0.0, 0.0, 1.0))
    table.now = table.ball.hovering_since = 10.0
    see(table.ball, WeighedPercept(**{**vars(percepts(0.0)[0]), "stamp": 10.0, "position": np.array(above)}))
    assert len(table.run(0.6)) == DRAW_COUNT
    assert np.abs(table.bodies.sim.position("ball")[:2]).max() < 0.001, "it falls straight down, as was believed"
    table.close()


def test_what_rolls_on_a_rough_table_comes_to_rest_sooner() -> None:
    way = [0.03 * k for k in range(8)]
    ends = []
    for friction in (0.5, 2.0):
        table = Table(*way)
        table.bodies.set_fixture("table", (4.0, 4.0, 0.04), Pose((0.0, 0.0, -0.02)), friction=friction)
        ends.append(float(np.median(table.run(6.0)[:, 0])) - way[-1])
    assert ends[1] < 0.4 * ends[0]


def test_a_table_that_turns_out_to_be_rough_slows_down_what_rolls_on_it_already() -> None:
    way, ends = [0.03 * k for k in range(8)], []
    for rougher in (False, True):
        table = Table(*way)
        before = float(np.median(table.run(0.5)[:, 0]))
        if rougher:
            table.bodies.set_fixture("table", (4.0, 4.0, 0.04), Pose((0.0, 0.0, -0.02)), friction=2.8)
        ends.append(float(np.median(table.run(6.0)[:, 0])) - before)
    assert ends[1] < 0.5 * ends[0]


def test_its_way_since_a_gap_tells_how_fast_it_was() -> None:
    table = Table(*(0.0,) * 9)
    table.now += 10.0  # s
    for percept in percepts(0.3, 0.27, 0.24, 0.21):
        table.now += PERIOD
        see(table.ball, replace(percept, stamp=table.now))
    assert table.run(0.5)[:, 0].max() < 0.21, "all go on the way that was seen"
    table.close()


def test_a_long_pause_costs_no_more_than_a_short_one() -> None:
    table = Table(*MOVES)
    table.now += 1e4  # s, as after a machine that slept while the ball was on its way
    paused = table.run(0.05)
    assert len(paused) == DRAW_COUNT
    assert (table.run(0.1)[:, 0] > paused[:, 0] + 0.001).any(), "time beyond is lost, so they are still on their way"
    table.close()


def test_of_several_that_vanish_at_once_the_courses_begin_one_after_the_other() -> None:
    table = Table(*MOVES)
    table.add("other", *MOVES, y=0.4)
    begun = []
    for _ in range(16):
        table.run(0.05)
        begun.append([name for name in ("ball", "other") if table.courses.of(name)])
    assert [] in begun and ["ball"] in begun and begun[-1] == ["ball", "other"]
    ball, second = (np.array([one.pose.t for one in table.courses.of(name)])[:, 0] for name in ("ball", "other"))
    assert second == pytest.approx(ball, abs=0.002), "who began later has lost no time"
    table.close()


def test_each_tells_what_carries_it_there() -> None:
    table = Table(*MOVES)
    table.bodies.set_fixture("table", (1.0, 4.0, 0.04), Pose((0.0, 0.0, -0.02)))
    table.run(1.1)
    found = table.courses.of("ball")
    fallen = [one for one in found if one.pose.t[0] > 0.5]
    assert 0 < len(fallen) < DRAW_COUNT
    assert all(one.supports == (() if one in fallen else ("table",)) for one in found)
    table.close()
