"""Writes percepts: RT edges from camera to object, and which objects are perceived now."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import NamedTuple

from agents.drivers import TagDriver, TagReadings, make_driver
from agents.frame_images import images
from agents.scene_estimator.blocks import KnownVolume, SeenBlocks, UntaggedObjects
from agents.scene_estimator.color_reader import ColorReader
from agents.scene_estimator.colored import ColoredObjects, ColorSighting, read_colors
from agents.scene_estimator.config import SceneEstimatorConfig, TagSensor
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.objects import TaggedObjects
from agents.scene_estimator.sighting import FrameSource, Outlines, Sighting, read_sensor
from agents.stillness import stood_still
from dsr.agent import Access, Agent
from dsr.errors import WireError
from dsr.frames.tree import WORLD
from dsr.images.blobs import Frame
from dsr.math3d.transforms import Pose
from dsr.perception.scales import TICK_RATE
from dsr.vocabulary.intrinsics import INTRINSICS, Intrinsics
from dsr.vocabulary.relations import THINGS

_OF_BLOCKS = ("size_sigma", "source")  # attributes of what is found by depth


class ExposureSightings(NamedTuple):
    """Sightings of one exposure."""

    tags: list[Sighting]
    colors: list[ColorSighting]
    blocks: SeenBlocks | None


class SceneEstimator(Agent):
    """Recognises objects by AprilTags, colours and depth in all cameras' frames, and publishes poses with covariance.

    A tag that is read tells more than a colour. An object whose tag no camera reads is looked for by its colour.
    Objects that no camera has seen for `max_age` are not `perceived`; their last percept stays.
    """

    name = "scene_estimator"
    rate_hz = TICK_RATE
    reads = Access(
        nodes=("camera", *THINGS),
        edges=("RT",),
        attributes=("marker_id", "color", "size", "shape", "perceived", "last_seen", *_OF_BLOCKS),
    )
    writes = Access(
        nodes=("camera", *THINGS),
        edges=("RT",),
        attributes=("marker_id", "color", "size", "shape", "perceived", "last_seen", *_OF_BLOCKS, *INTRINSICS),
    )
    publishes = ("blob/*/detections",)
    Config = SceneEstimatorConfig
    config: SceneEstimatorConfig

    def setup(self) -> None:
        """Listen to the cameras. Raises `ConfigError` for a driver that cannot be made."""
        config = self.config
        self.skipped: Counter[str] = Counter()
        """Frames that were not used, by reason."""
        self._closing = ExitStack()
        take = self._closing.enter_context
        self._objects = take(closing(TaggedObjects(self.memory, config, self.log)))
        self._colored = take(closing(ColoredObjects(self.memory, config.max_age)))
        self._untagged = take(closing(UntaggedObjects(self.memory, config, self.log)))
        self._tag_readers = {
            camera: FrameSource(self._objects.size, config.tag_ratio, config.noise)
            for camera in (*config.cameras, *config.tag_sensors)
        }
        self._color_reader = ColorReader(config.noise)
        self._streams = {camera: take(closing(self.memory.frames(camera))) for camera in config.cameras}
        self._sensors = {camera: take(closing(self._driver(sensor))) for camera, sensor in config.tag_sensors.items()}
        self._last_seen: dict[str, float] = {}
        self._without_depth: set[str] = set()
        """Cameras in whose last images objects are looked for that only depth shows"""

    def _driver(self, sensor: TagSensor) -> TagDriver:
        driver: TagDriver = make_driver(sensor.driver, self.bus, self.keys, **sensor.options)
        return driver

    def tick(self, now: float) -> None:
        """Look at each camera's newest frame, then at who was not seen for long."""
        self._objects.update()
        self._colored.update()
        self._untagged.update()
        for camera, stamp, sightings in self._look():
            if camera not in self.memory:
                self.skipped["no camera node yet"] += 1
            elif not self._camera_stood_still(camera, stamp):
                self._skip("camera moved", f"{camera} moved, or its pose is not known then")
            else:
                self._publish(camera, stamp, sightings)
        self._age(now)

    def _look(self) -> Iterator[tuple[str, float, ExposureSightings]]:
        """(camera, stamp, sightings) of everything new."""
        for camera, stream in self._streams.items():
            frame = stream.latest()
            if frame is not None and (seen := self._read(camera, frame)) is not None:
                yield camera, frame.stamp, seen
        for camera, sensor in self._sensors.items():
            readings = sensor.readings()
            if readings is not None:
                self._describe(camera, readings.intrinsics)
                try:
                    tags = read_sensor(readings, self.config.noise) + self._tag_readers[camera].read_corners(readings)
                    self._note_read(tags, readings.stamp)
                    yield camera, readings.stamp, ExposureSightings(tags, self._sensed_colors(camera, readings), None)
                except WireError as error:
                    self._skip("malformed", f"{camera}: {error}")

    def _sensed_colors(self, camera: str, readings: TagReadings) -> list[ColorSighting]:
        """Without a known pose of the camera, nothing is known of how they lean."""
        world_from_camera = self._world_from_camera(camera, readings.stamp) if readings.colors else None
        return read_colors(readings, self._colored, self.config.noise, world_from_camera)

    def _describe(self, camera: str, intrinsics: Intrinsics | None) -> None:
        """Write the intrinsics of a sensor without images, whose frames would tell them, if the node says others."""
        node = self.memory.get_node(camera)
        values = {} if intrinsics is None else intrinsics.attributes()
        if node is not None and any(node.get(name) != value for name, value in values.items()):
            self.memory.update_node(camera, **values)

    def _read(self, camera: str, frame: Frame) -> ExposureSightings | None:
        try:
            sightings, outlines = self._tag_readers[camera].read(frame)
        except WireError as error:
            self._skip("malformed", f"{camera}: {error}")
            return None
        self._show(camera, frame.stamp, outlines)
        self._note_read(sightings, frame.stamp)
        return ExposureSightings(
            sightings, self._read_colors(camera, frame), self._read_blocks(camera, frame, sightings)
        )

    def _note_read(self, tags: list[Sighting], stamp: float) -> None:
        nodes = (self._objects.find(tag.marker_id) for tag in tags)
        self._colored.note_read((node.name for node in nodes if node is not None), min(stamp, self.clock.now()))

    def _read_colors(self, camera: str, frame: Frame) -> list[ColorSighting]:
        self._note_depth(camera, "depth" in frame.arrays or not self._colored.known)
        looked_for = self._colored.looked_for(frame.stamp)
        world_from_camera = self._world_from_camera(camera, frame.stamp) if looked_for else None
        if world_from_camera is None:
            return []
        return self._color_reader.read(frame, looked_for, world_from_camera)

    def _read_blocks(self, camera: str, frame: Frame, tags: list[Sighting]) -> SeenBlocks | None:
        color, depth, intrinsics = images(frame)
        if not self.config.blocks or depth is None or not self._camera_stood_still(camera, frame.stamp):
            return None
        world_from_camera = self._world_from_camera(camera, frame.stamp)
        if world_from_camera is None:
            return None
        tagged = [KnownVolume.box(tag.pose, self._objects.size(tag.marker_id)) for tag in tags]
        view = FrameView(depth, intrinsics, world_from_camera)
        return self._untagged.read(view, color, frame.stamp, self.clock.now(), tagged)

    def _note_depth(self, camera: str, has_depth: bool) -> None:
        """Tell, in the status too, which cameras lack the depth without which colours tell no place."""
        if has_depth:
            self._without_depth.discard(camera)
        else:
            self._skip("no depth", f"{camera} gives no depth: in its images only tags are recognised")
            self._without_depth.add(camera)
        cameras = ", ".join(sorted(self._without_depth))
        self.degraded = f"no depth from {cameras}: only tags are recognised there" if cameras else ""

    def _world_from_camera(self, camera: str, stamp: float) -> Pose | None:
        """None, and counted, if it is not known."""
        pose = self.memory.get_transform(WORLD, camera, at=stamp)
        if pose is None:
            self._skip("no camera pose", f"{camera}: its pose in the world is not known then")
        return pose

    def _show(self, camera: str, stamp: float, outlines: Outlines) -> None:
        """Publish where in the image the tags were found, for viewers."""
        self.memory.put_frame(f"{camera}/detections", Frame(stamp, dict(outlines._asdict()), {}))

    def _camera_stood_still(self, camera: str, stamp: float) -> bool:
        return stood_still(self.memory, camera, stamp, self.config.max_camera_speed, self.config.max_camera_turn)

    def _publish(self, camera: str, stamp: float, seen: ExposureSightings) -> None:
        tags, colors, blocks = seen
        with self.memory.batch():
            self._objects.consider(camera, tags)
            for sighting in tags:
                node = self._objects.find(sighting.marker_id)
                if node is not None:
                    self._write(camera, node.name, sighting.pose)
            if colors:
                self._publish_colors(camera, stamp, colors)
            found = [] if blocks is None else self._untagged.consider(camera, blocks, stamp)
            for name, camera_from_object in found:
                if name in self.memory:
                    self._write(camera, name, camera_from_object)

    def _publish_colors(self, camera: str, stamp: float, sightings: list[ColorSighting]) -> None:
        """They stand upright in the world, as far as anybody knows, so that the camera's pose there is needed."""
        world_from_camera = self._world_from_camera(camera, stamp)
        if world_from_camera is None:
            return
        for sighting in sightings:
            if sighting.name in self.memory:
                self._write(camera, sighting.name, sighting.pose(world_from_camera))

    def _write(self, camera: str, name: str, camera_from_object: Pose) -> None:
        self.memory.add_edge(camera, name, "RT", pose=camera_from_object)
        self._note_seen(name, camera_from_object.stamp)

    def _note_seen(self, name: str, stamp: float) -> None:
        """A camera whose clock is ahead sees it now, not later."""
        stamp = min(stamp, self.clock.now())
        self._last_seen[name] = max(stamp, self._last_seen.get(name, 0.0))
        perceived = self.memory.node(name).get("perceived") is True
        changed = {} if perceived else {"perceived": True}
        self.memory.update_node(name, last_seen=self._last_seen[name], **changed)

    def _age(self, now: float) -> None:
        """Also those that an earlier run of this agent saw: their nodes say when."""
        for node in self.memory.nodes(THINGS):
            if node.get("perceived") and now - self._seen_at(node.name, now) > self.config.max_age:
                self.memory.update_node(node.name, perceived=False)

    def _seen_at(self, name: str, now: float) -> float:
        """When it was seen, s; what nobody has ever told about gets a fresh start."""
        return self._last_seen.setdefault(name, self.memory.node(name).get("last_seen", now))

    def _skip(self, reason: str, detail: str) -> None:
        self.skipped[reason] += 1
        if self.skipped[reason] == 1:
            self.log.warning("frame skipped: %s (further ones are only counted)", detail)

    def teardown(self) -> None:
        """Stop listening."""
        self._closing.close()
