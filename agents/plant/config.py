"""Configuration of the plant."""

from __future__ import annotations

from typing import Literal

import msgspec

from agents.plant.camera import OVERHEAD
from agents.plant.renderer import RendererName
from dsr.vocabulary.distortion import Distortion

SensorKind = Literal["pixels", "poses", "none"]


class PlantConfig(msgspec.Struct, frozen=True):
    """Configuration of the agent `plant`."""

    scenario: str = ""
    """Path of a scenario file, or the name of a built-in one."""
    robot: str = ""
    """Name of a robot in `etc/robots` or path of a URDF file, in place of the scenario's"""
    untagged: bool = False
    """Whether its boxes and cylinders have no tags."""
    sensor: SensorKind = "pixels"
    """`pixels`: rendered images. `poses`: true poses of what is recognised with measured noise, no images.
    `none`: cameras deliver nothing."""
    start: float = 0.0
    """s, time 0 of the scenario; 0.0 waits for the `Start` message of the runner"""
    width: int = 640
    height: int = 480
    """Height of camera images, px."""
    fov: float = 0.98
    """rad, horizontal field of view; 0.98 gives a focal length of 600 px at 640 px"""
    distortion: Distortion | None = None
    """Of the lenses of all cameras; None: they are ideal."""
    overhead: tuple[float, float, float, float, float, float, float] = (*OVERHEAD.t, *OVERHEAD.q)
    """world_from_camera of the overhead camera (optical frame): m, then a quaternion (x, y, z, w)"""
    deadman: float = 0.08
    """s without a sign of life of the arm's controller after which a moving arm stops by itself: four ticks of the
    controller, so that it stops within 0.1 s; 0.0 for never"""
    camera_hz: float = 10.0
    more_cameras: tuple[str, ...] = ()
    """Names of cameras that deliver beside the scenario's: `overhead`, or `wrist` where the arm has one."""
    state_hz: float = 60.0
    """As often as the plant ticks: a controller that ticks at 50 Hz finds a new sample in each of its ticks"""
    truth_hz: float = 20.0
    renderer: RendererName = "auto"
    """`auto` and `opengl` use OpenGL where it works, `tiny` always renders in software."""
