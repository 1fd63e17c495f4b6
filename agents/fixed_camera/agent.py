"""Puts a camera that no arm carries into the working memory, and forwards its frames."""

from __future__ import annotations

from typing import Any

import msgspec

from agents.camera_feed import CameraFeed
from agents.drivers import CameraDriver, make_driver
from agents.scenario.format.scenario import CameraSpec, load_scenario
from dsr.agent import Access, Agent
from dsr.errors import ConfigError
from dsr.frames.tree import WORLD
from dsr.vocabulary.intrinsics import INTRINSICS


class FixedCameraConfig(msgspec.Struct, frozen=True):
    """The believed pose of the camera, and the source of its frames."""

    node: str = "camera_fixed"
    """Name of its node, which is also that of its stream of frames."""
    driver: str = "agents.plant.driver:PlantCamera"
    """`module:Class` of a `CameraDriver`, or a name of `dsr drivers list`."""
    options: dict[str, Any] = {}
    """Passed to the driver."""
    mount: CameraSpec | None = None
    """Pose of the camera on its stand; None if the `[camera]` of a scenario tells it."""
    scenario: str = ""
    """Name or file of the scenario whose `[camera]` tells that, if `mount` is not given."""


class FixedCamera(Agent):
    """Stands between one camera and the working memory.

    Its pose is written once: one that is in the graph already, as by a calibration, stays.
    """

    name = "fixed_camera"
    rate_hz = 50.0
    writes = Access(nodes=("world", "camera"), edges=("RT",), attributes=("stream", *INTRINSICS))
    publishes = ("blob/*",)
    Config = FixedCameraConfig
    config: FixedCameraConfig

    def setup(self) -> None:
        """Make the driver and write the pose. Raises `ConfigError` for an unknown driver or a camera without a pose."""
        config = self.config
        pose = self._mount().pose
        driver: CameraDriver = make_driver(config.driver, self.bus, self.keys, **config.options)
        self._feed = CameraFeed(self.memory, config.node, driver, self.log)
        with self.memory.batch():
            if WORLD not in self.memory:
                self.memory.add_node(WORLD, "world")
            if config.node not in self.memory:
                self.memory.add_node(config.node, "camera", stream=config.node)
            if self.memory.get_edge(WORLD, config.node, "RT") is None:
                self.memory.add_edge(WORLD, config.node, "RT", pose=pose)

    def tick(self, now: float) -> None:
        """Forward the newest frame, and tell how the camera does."""
        self._feed.forward()
        self.degraded, self.counts = self._feed.trouble, self._feed.counts

    def teardown(self) -> None:
        """Release the camera."""
        if hasattr(self, "_feed"):
            self._feed.close()

    def _mount(self) -> CameraSpec:
        if self.config.mount is not None:
            return self.config.mount
        if not self.config.scenario:
            raise ConfigError("the camera's pose is not known; expected `mount` or `scenario`")
        scenario = load_scenario(self.config.scenario)
        if not isinstance(scenario.camera, CameraSpec):
            raise ConfigError(
                f"scenario {scenario.name!r} has the camera {scenario.camera!r}; "
                "expected a table [camera] with `position` and `look_at`"
            )
        return scenario.camera
