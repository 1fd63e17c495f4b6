"""Places for cameras go to those that speak, and to each agent as many as to the others."""

from __future__ import annotations

import time
from collections.abc import Iterable

from agents.viewer.places import TURN, Places

STEP = 0.5
"""s between two looks"""


class Room:
    """Places for four cameras, of which some speak."""

    def __init__(self, **made: Iterable[str]) -> None:
        self.places = Places(4)
        self.cameras = {name: frozenset([maker]) for maker, names in made.items() for name in names}
        self.now = 0.0
        self.shown: dict[str, float] = dict.fromkeys(self.cameras, 0.0)
        """s for which each camera that speaks had a place"""

    def live(self, seconds: float, *speaking: str) -> None:
        for _ in range(round(seconds / STEP)):
            chosen = self.places.given(self.cameras, self.now)
            assert len(chosen) == len(set(chosen)) == min(4, len(self.cameras))
            for name in chosen:
                if name in speaking:
                    self.places.note(name, self.now)
                    self.shown[name] += STEP
            self.now += STEP


def test_cameras_that_spoke_once_give_their_places_to_those_that_still_speak() -> None:
    """Each of the made-up ones sends one image, and the real one comes later."""
    fakes = [f"fake_{number}" for number in range(4)]
    room = Room(one=fakes)
    room.live(1.0, *fakes)
    room.cameras["real"] = frozenset(["one"])
    room.shown["real"] = 0.0
    room.live(20 * TURN, "real")
    assert room.shown["real"] > 18 * TURN


def test_without_others_that_wait_a_silent_camera_keeps_its_place() -> None:
    room = Room(one=["a", "b"])
    room.live(1.0, "a", "b")
    room.live(100.0, "a")
    assert room.places.given(room.cameras, room.now) == ["a", "b"]


def test_of_too_many_that_speak_each_has_its_turn() -> None:
    cameras = [f"camera_{number}" for number in range(8)]
    room = Room(one=cameras)
    room.live(160 * TURN, *cameras)
    assert min(room.shown.values()) > 0.8 * 80 * TURN


def test_an_agent_with_many_cameras_that_speak_leaves_others_their_places() -> None:
    fakes = [f"fake_{number}" for number in range(40)]
    room = Room(liar=fakes)
    room.live(2 * TURN, *fakes)
    room.cameras |= {"real_1": frozenset(["honest"]), "real_2": frozenset(["honest"])}
    room.shown |= {"real_1": 0.0, "real_2": 0.0}
    room.live(20 * TURN, *fakes, "real_1", "real_2")
    assert min(room.shown["real_1"], room.shown["real_2"]) > 17 * TURN


def test_a_clock_that_is_set_back_stops_no_turn() -> None:
    cameras = [f"camera_{number}" for number in range(5)]
    room = Room(one=cameras)
    room.now = 1e6
    room.live(2 * TURN, *cameras)
    room.now = 0.0
    room.live(10 * TURN, *cameras)
    assert min(room.shown.values()) > 0.0


def test_any_number_of_cameras_that_wait_take_little_time() -> None:
    def seconds(count: int) -> float:
        places, cameras = Places(64), {f"camera_{number}": frozenset(["liar"]) for number in range(count)}
        begin = time.process_time()
        for turn in range(5):
            places.given(cameras, TURN * turn)
        return time.process_time() - begin

    few, many = (min(seconds(count) for _ in range(3)) for count in (2000, 16000))
    assert many < 16.0 * few and many < 1.0, f"{few:.3f} s, {many:.3f} s"
