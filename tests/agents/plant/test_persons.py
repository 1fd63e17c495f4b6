"""Persons in the true world: they come, turn, walk and leave; the tracker tells of those who are there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.drivers import PersonReading, PersonReadings
from agents.plant.messages import decode_person_readings
from agents.plant.persons import SIGMA_TRANSLATION, gaze
from agents.plant.reality import Reality
from agents.scenario.format.scenario import PersonEnter, PersonLeave, PersonSpec, PersonTurn, PersonWalk
from dsr.errors import WireError

MakeReality = Callable[..., Reality]
Play = Callable[..., None]
SALLY = PersonSpec(name="sally", position=(1.0, 0.0, 0.5), look_at=(0.0, 0.0, 0.5))


def looks_along(reality: Reality, name: str) -> np.ndarray:
    return np.asarray(reality.persons[name].pose.rotation_matrix[:, 0])


@pytest.mark.parametrize("look_at", [(2.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.5, -3.0)])
def test_a_gaze_is_along_x_with_the_head_upright(look_at: tuple[float, float, float]) -> None:
    pose = gaze((0.5, 0.2, 0.4), look_at)
    way = np.subtract(look_at, (0.5, 0.2, 0.4))
    assert np.allclose(pose.rotation_matrix[:, 0], way / np.linalg.norm(way))
    assert pose.rotation_matrix[2, 1] == pytest.approx(0.0) and pose.rotation_matrix[2, 2] > 0.0


def test_persons_come_turn_walk_and_leave(make_reality: MakeReality, play: Play) -> None:
    events = [
        PersonEnter(at=0.5, person="sally"),
        PersonTurn(at=1.0, person="sally", look_at=(1.0, 1.0, 0.5)),
        PersonWalk(at=2.5, person="sally", to=(0.0, 1.0, 0.5), look_at=(0.0, 0.0, 0.5)),
        PersonLeave(at=5.0, person="sally"),
    ]
    reality = make_reality(persons=[msgspec.structs.replace(SALLY, present=False)], events=events)
    assert reality.truth(0.0).persons == {}
    play(reality, 0.9)
    assert [person.name for person in reality.person_readings(0.0).persons] == ["sally"]  # type: ignore[union-attr]
    assert np.allclose(looks_along(reality, "sally"), (-1.0, 0.0, 0.0))
    play(reality, 1.5, start=0.9)
    assert np.allclose(looks_along(reality, "sally"), (0.0, 1.0, 0.0))
    play(reality, 2.5, start=2.4)
    assert reality.truth(0.0).persons["sally"][:3] == pytest.approx((0.0, 1.0, 0.5))
    assert np.allclose(looks_along(reality, "sally"), (0.0, -1.0, 0.0))
    play(reality, 0.2, start=4.9)
    assert reality.truth(0.0).persons == {} and reality.person_readings(0.0) == PersonReadings(0.0, [])


def test_a_move_of_who_is_not_there_is_given_up(make_reality: MakeReality, play: Play, caplog: Any) -> None:
    leaving = [PersonLeave(at=0.0, person="sally"), PersonTurn(at=0.1, person="sally", look_at=(0.0, 0.0, 0.0))]
    play(make_reality(persons=[SALLY], events=leaving), 0.5)
    assert "'sally' is not in the scene" in caplog.text


def test_the_tracker_has_the_errors_that_it_tells(make_reality: MakeReality) -> None:
    reality = make_reality(persons=[SALLY])
    found = np.array([reality.person_readings(0.0).persons[0].pose[:3] for _ in range(400)])  # type: ignore[union-attr]
    assert found.std(axis=0) == pytest.approx([SIGMA_TRANSLATION] * 3, rel=0.2)
    assert found.mean(axis=0) == pytest.approx(SALLY.position, abs=1e-3)


def test_without_persons_nothing_is_told(make_reality: MakeReality) -> None:
    assert make_reality().person_readings(0.0) is None


@pytest.mark.parametrize(
    "reading",
    [
        PersonReading("sally", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.01, 0.01),
        PersonReading("sally", (float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), 0.01, 0.01),
        PersonReading("sally", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), -0.01, 0.01),
        PersonReading("sally", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), 0.01, 0.01, (float("inf"), 1.0)),
    ],
)
def test_malformed_readings_are_refused(reading: PersonReading) -> None:
    with pytest.raises(WireError):
        decode_person_readings(msgspec.msgpack.encode(PersonReadings(1.0, [reading])))


def test_readings_survive_the_wire() -> None:
    readings = PersonReadings(
        1.0, [PersonReading("sally", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), 0.01, 0.01, (1.0, 0.5))]
    )
    assert decode_person_readings(msgspec.msgpack.encode(readings)) == readings
