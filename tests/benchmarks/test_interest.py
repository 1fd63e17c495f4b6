"""What interest spares: counts of bytes and messages, which are the same in each run."""

from __future__ import annotations

import pytest

from benchmarks.interest.curves import fleet_of, idle, joined, writer
from benchmarks.interest.fleets import counted, rest_of


def test_late_join_follows_what_is_asked_for_and_not_the_building() -> None:
    small, large = joined(2, [1])[0], joined(8, [1, 4])
    per_listed_part = (large[0].received - small.received) / 6
    assert 0 < per_listed_part < 150
    assert 3.5 < large[1].received / large[0].received < 4.5


def test_readers_elsewhere_cost_a_writer_nothing() -> None:
    assert [writer(readers, elsewhere=True, writes=20)["messages"] for readers in (0, 3, 9)] == [0, 0, 0]
    assert [writer(readers, elsewhere=False, writes=20)["messages"] for readers in (0, 3, 9)] == [0, 60, 180]


def test_a_robot_gets_what_concerns_its_rooms() -> None:
    parted, whole = (fleet_of(6, parted=parted) for parted in (True, False))
    assert parted["nodes"] == 4 and whole["nodes"] == 7
    assert parted["messages"] < 0.5 * whole["messages"] and parted["bytes"] < 0.5 * whole["bytes"]


def test_a_part_in_which_nothing_happens_costs_a_digest_per_second() -> None:
    assert [idle(parts)["messages"] for parts in (1, 3)] == [2.0, 4.0]


def test_of_what_a_robot_gets_only_digests_and_questions_follow_the_fleet() -> None:
    told: list[str] = []
    small, large, paper, _ = counted((4, 8), told.append)
    assert small["digests"][0] == 4.0 and large["digests"][0] == 8.0
    assert large["questions"][0] > small["questions"][0] > 0.0
    assert rest_of(large) == pytest.approx(rest_of(small), rel=0.05)
    assert paper["robots"] == 1000 and paper["digests"][0] == 1000.0
    assert paper["messages"] == 125.0 * (large["digests"][0] + large["questions"][0]) + rest_of(large)[0]
    assert len(told) == 4 and "1000 robots" in told[2]
