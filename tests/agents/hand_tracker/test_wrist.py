"""Where the arm leaves the outline of a hand: sleeves and the edge of the image, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from agents.hand_tracker import HandTrackerConfig
from agents.hand_tracker.fingertips import Patch, Tip
from agents.hand_tracker.sighting import SeenHand
from agents.hand_tracker.skin import away_from, find_wrist
from agents.hand_tracker.tracks import HandTrack, Tracks
from dsr.math3d.transforms import Pose

FOCAL, DISTANCE = 600.0, 0.9
METRE = FOCAL / DISTANCE  # px
SHAPE = (480, 640)


class Scene:
    """A hand of 0.18 m x 0.06 m from column 300 on, before a table 0.2 m behind it."""

    def __init__(self, first_column: int = 300) -> None:
        self.depth = np.full(SHAPE, DISTANCE + 0.2, np.float32)
        self.body = np.zeros(SHAPE, bool)
        self.rows = slice(220, 220 + round(0.06 * METRE))
        self.columns = slice(first_column, first_column + round(0.18 * METRE))
        self.depth[self.rows, self.columns] = DISTANCE
        self.middle = np.array([first_column + 0.06 * METRE, 240.0])

    def add(self, columns: slice, rows: slice | None = None, depth: float = DISTANCE) -> None:
        """Something above the table that has not the colour of skin."""
        rows = rows or self.rows
        self.body[rows, columns], self.depth[rows, columns] = True, depth

    def wrist(self) -> np.ndarray | None:
        inside = np.ones((self.rows.stop - self.rows.start, self.columns.stop - self.columns.start), bool)
        patch = Patch((self.columns.start, self.rows.start), inside, DISTANCE)
        return find_wrist(patch, self.middle, self.body, self.depth, FOCAL)


def test_a_sleeve_begins_at_the_wrist() -> None:
    scene = Scene()
    scene.add(slice(100, 300))
    wrist = scene.wrist()
    assert wrist is not None
    assert wrist == pytest.approx((298.0, 239.5), abs=3.0)


def test_a_hand_that_the_image_cuts_off_has_its_wrist_there() -> None:
    scene = Scene(0)
    wrist = scene.wrist()
    assert wrist is not None
    assert wrist == pytest.approx((0.0, 239.5), abs=1.0)


def test_nothing_tells_the_wrist_of_a_bare_hand() -> None:
    assert Scene().wrist() is None


def test_what_is_far_behind_a_hand_does_not_go_on_from_it() -> None:
    scene = Scene()
    scene.add(slice(100, 300), depth=DISTANCE + 0.06)
    assert scene.wrist() is None


def test_a_small_object_in_the_fingers_is_no_sleeve() -> None:
    scene = Scene()
    end = scene.columns.stop
    scene.add(slice(end, end + round(0.03 * METRE)))
    assert scene.wrist() is None
    scene.add(slice(100, 300))
    wrist = scene.wrist()
    assert wrist is not None and wrist[0] < 300.0


def test_between_a_sleeve_and_a_large_box_in_the_fingers_nothing_is_told() -> None:
    scene = Scene()
    scene.add(slice(100, 300))
    scene.add(slice(scene.columns.stop, scene.columns.stop + 150))
    assert scene.wrist() is None


def test_corners_of_a_sleeve_are_no_fingertips() -> None:
    wrist, middle = np.array([100.0, 200.0]), np.array([150.0, 200.0])
    corner, finger = (Tip(np.array(place), np.array([1.0, 0.0])) for place in ((102.0, 220.0), (230.0, 210.0)))
    assert away_from(wrist, middle, [corner, finger]) == [finger]


def test_a_guessed_rotation_is_not_smoothed_into_one_that_is_seen() -> None:
    guessed, told = Pose.from_rotvec((0, 0, 0), (0, 0, 3.0)), Pose.from_rotvec((0, 0, 0), (0, 0, 0.2))
    track = HandTrack(0, HandTrackerConfig(), guessed.with_stamp(1.0), "unknown", "skin colour", np.eye(3))
    for k, (pose, sigma) in enumerate([(guessed, 1.0), (guessed, 1.0), (told, 0.15)]):
        seen = SeenHand(pose.with_stamp(1.1 + 0.1 * k), {}, False, "unknown", 0.004, sigma**2 * np.eye(3))
        track.update(seen, "skin colour")
    assert track.palm.distance(told)[1] < 0.05
    assert track.turn_sigma == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("apart", "is_whole", "hands"), [(0.06, True, 1), (0.1, True, 2), (0.1, False, 1), (0.2, False, 2)]
)
def test_a_part_of_a_hand_that_something_cuts_in_two_is_no_other_hand(apart: float, is_whole: bool, hands: int) -> None:
    tracks = Tracks(HandTrackerConfig())
    for k in range(3):
        stamp = 1.0 + 0.1 * k
        hand = SeenHand(Pose((0.0, 0.0, 1.0), stamp=stamp), {}, False, "unknown", 0.004)
        other = SeenHand(Pose((apart, 0.0, 1.0), stamp=stamp), {}, False, "unknown", 0.004, is_whole=is_whole)
        tracks.update([hand, other] if k else [hand], "skin colour", stamp)
    assert len(tracks.by_number) == hands
