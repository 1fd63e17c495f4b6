"""Configuration of the hand tracker."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

from dsr.vocabulary.perceived import CAMERA_SPEED, CAMERA_TURN

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
FinderName = Literal["auto", "model", "colour"]
RunnerName = Literal["litert", "mediapipe"]


class HandSensor(msgspec.Struct, frozen=True):
    """A device that finds hands by itself, read beside the camera's frames."""

    driver: str
    """`module:Class` of a `HandDriver`."""
    options: dict[str, Any] = {}
    """Passed to the driver."""


class SkinModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of colour, depth and size from which a region counts as a hand, without MediaPipe."""

    hue: tuple[float, float] = (0.0, 26.0)
    """degrees; a lower bound above the upper one goes through 360"""
    saturation: tuple[Share, Share] = (0.18, 0.56)
    value: tuple[Share, Share] = (0.25, 1.0)
    """Brightness of the brightest channel."""
    depth: tuple[Positive, Positive] = (0.15, 1.2)
    """m along the optical axis"""
    above_table: NotNegative = 0.008
    """m over a known table, below which nothing is a hand"""
    area: tuple[Positive, Positive] = (0.0015, 0.04)
    """m^2, of the patch of skin that is a hand"""


class Smoothing(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The One-Euro filters of positions and rotations."""

    cutoff: Positive = 1.5
    """Hz, of what does not move"""
    per_speed: NotNegative = 40.0
    """Hz per m/s, by which motion raises the cutoff"""
    per_turn: NotNegative = 4.0
    """Hz per rad/s, likewise for rotations"""
    speed_cutoff: Positive = 2.0
    """Hz, of the speed itself"""


class HandTrackerConfig(msgspec.Struct, frozen=True):
    """The cameras, how hands are found in their frames, and how long they are remembered."""

    cameras: tuple[str, ...] = ("camera_overhead", "camera_wrist")
    """Camera nodes whose frames are looked at, when there are any."""
    hand_sensors: dict[str, HandSensor] = {}
    """Hand sensors by camera node."""
    finder: FinderName = "auto"
    """`model`: MediaPipe's, and where it cannot be used, by skin colour, `degraded`; `colour`: by skin colour and
    depth, for gloves (set `skin`) and little light; `auto`: the model if it was fetched or is named, else colour"""
    model: str = ""
    """A `hand_landmarker.task` to use; else the one that `dsr hands fetch` got."""
    runner: RunnerName = "litert"
    """What runs the model: LiteRT, or MediaPipe's own program, which needs the extra `mediapipe`."""
    swap_sides: bool = False
    """The model says left for right, as on mirrored images."""
    least_score: Share = 0.5
    """Of the model: for a palm, and for a hand in the square about one, to count."""
    least_side_score: Share = 0.7
    """Of the model, below which it is left open whether a hand is a right or a left one."""
    max_camera_speed: NotNegative = CAMERA_SPEED
    """m/s; while a camera moves faster, what it shows is not used."""
    max_camera_turn: NotNegative = CAMERA_TURN
    """rad/s up to which a camera counts as at rest."""
    skin: SkinModel = SkinModel()
    smoothing: Smoothing = Smoothing()
    fingertip_radius: Positive = 0.008
    """m, from the surface that the camera sees to the centre"""
    palm_radius: Positive = 0.012
    """m, likewise: half the thickness of the palm"""
    most_speed: Positive = 1.5
    """m/s, of a hand: what is further away is another one"""
    max_age: Positive = 0.5
    """s after which a hand or fingertip that was not seen again is not `perceived` any more"""
    finger_retention: Positive = 2.0
    """s after which an unseen fingertip of a hand that is seen is forgotten; until then it goes with the palm"""
    retention: Positive = 30.0
    """s after which a hand that was not seen again is forgotten, unless it grasps something"""
