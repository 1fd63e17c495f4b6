"""Configuration of the scene estimator."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from agents.scene_estimator.pose import NoiseModel, NotNegative, Positive
from dsr.vocabulary.perceived import CAMERA_SPEED, CAMERA_TURN
from dsr.vocabulary.tags import TAG_RATIO


class TagSensor(msgspec.Struct, frozen=True):
    """A device that detects tags by itself, read beside the camera's frames."""

    driver: str
    """`module:Class` of a `TagDriver`."""
    options: dict[str, Any] = {}
    """Passed to the driver."""


class SceneEstimatorConfig(msgspec.Struct, frozen=True):
    """The cameras, the tags, and when a percept can be trusted."""

    cameras: tuple[str, ...] = ("camera_overhead", "camera_wrist")
    """Camera nodes whose frames are looked at, when there are any."""
    tag_sensors: dict[str, TagSensor] = {}
    """Tag sensors by camera node."""
    tag_ratio: Annotated[float, msgspec.Meta(gt=0, le=1)] = TAG_RATIO
    """Side of a tag's black square over that of the face it is on."""
    default_size: Positive = 0.04
    """m, edge of a cube that is seen for the first time."""
    insert_after: Annotated[int, msgspec.Meta(ge=0)] = 3
    """Frames in a row, after the first, in which an unknown tag must be seen to become a node."""
    insert_within: Positive = 0.03
    """m, how far it may seem to move meanwhile."""
    blocks: bool = False
    """Whether boxes and cylinders that nobody tagged are found by depth, on tables."""
    blocks_after: Annotated[int, msgspec.Meta(ge=0)] = 8
    """Frames in a row, after the first, in which one must be seen to become a node: more than an unknown tag needs."""
    blocks_sure: Positive = 0.005
    """m, standard deviation up to which its extents must be known meanwhile: what is hidden of it is not."""
    max_age: Positive = 0.7
    """s after which an object that was not seen again is not `perceived` any more (Sallami et al., Sec. V)."""
    max_camera_speed: NotNegative = CAMERA_SPEED
    """m/s; while the camera moves faster, nothing is published."""
    max_camera_turn: NotNegative = CAMERA_TURN
    """rad/s up to which a camera counts as at rest."""
    noise: NoiseModel = NoiseModel()
