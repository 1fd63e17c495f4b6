"""What is seen is judged by what cameras have told, not by how long that took to arrive."""

from __future__ import annotations

import pytest

from dsr.frames.tree import HISTORY
from dsr.perception.scales import FRAME, PRESENT, UNSEEN_AFTER
from simulation_handler.perception.told_until import ToldUntil
from simulation_handler.worlds.circumstances import RESTS, RESTS_UNSEEN
from tests.simulation_handler.test_agent import NAME, Table
from tests.simulation_handler.worlds import cube_at


def looked(period: float = FRAME, late: float = 0.0) -> ToldUntil:
    """After percepts that came each `period`, and `late`, the last one at time 0."""
    told = ToldUntil()
    for count in range(-9, 1):
        told.look([period * count - late], period * count)
    return told


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_where_images_come_often_and_at_once_the_time_is_now(late: float) -> None:
    told = looked(late=late)
    assert told.look([], 0.05) == 0.05 and told.look([0.1 - late], 0.1) == 0.1


@pytest.mark.parametrize(("period", "late"), [(0.1, 0.5), (0.25, 0.4), (0.3, 0.0)])
def test_the_newest_of_late_or_seldom_images_shows_the_present(period: float, late: float) -> None:
    told = looked(period, late)
    for count in range(1, 4):
        before_the_next = told.look([], period * count - 0.01)
        assert before_the_next - (period * (count - 1) - late) <= PRESENT
        told.look([period * count - late], period * count)


@pytest.mark.parametrize(("period", "late"), [(0.1, 0.0), (0.1, 0.5), (0.25, 0.4), (0.3, 0.0)])
def test_the_time_goes_on_where_cameras_fall_silent(period: float, late: float) -> None:
    assert looked(period, late).look([], 10.0) == pytest.approx(10.0 - max(2.0 * period + late - PRESENT, 0.0))


def test_a_clock_that_is_off_by_hours_does_not_set_the_belief_back_by_hours() -> None:
    assert looked(0.1, 7200.0).look([], 20.0) == pytest.approx(20.0 - HISTORY)


def test_a_pause_does_not_make_images_slow() -> None:
    told = looked()
    assert told.look([6.0], 6.0) == 6.0
    assert told.look([], 6.05) == 6.05


def test_old_percepts_of_another_camera_make_nothing_late() -> None:
    told = looked()
    assert told.look([-5.0], 0.05) == 0.05


def test_the_time_goes_back_with_the_clock_alone() -> None:
    told = looked(0.1, 0.1)
    assert told.look([], 3.0) == pytest.approx(3.0, abs=0.1)
    assert told.look([0.5], 3.05) >= 2.9, "what comes late now does not undo what has passed"
    assert told.look([], -3.0) == -3.0


def test_what_is_seen_late_is_seen_and_unseen_once_its_camera_is_silent() -> None:
    table, late = Table(), 0.5
    table.add("cube", cube_at(0.4, 0.1))
    for _ in range(30):
        stamp = table.lockstep.clock.now() - late
        table.perceive("cube", table.camera.percept("cube", table.truths["cube"], stamp))
        table.lockstep.run_for(0.1)
    belief = table.lockstep.runner(NAME).agent.belief
    assert {island.best.reason for island in belief.islands()} == {RESTS}
    assert belief.perceived("cube", belief.evidence().now)
    table.lockstep.run_for(UNSEEN_AFTER + late)
    assert {island.best.reason for island in belief.islands()} == {RESTS_UNSEEN}
    assert not belief.perceived("cube", belief.evidence().now)
    table.lockstep.close()
