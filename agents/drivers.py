"""The interface of drivers for arms, cameras and sensors, real or simulated.

The simulated plant is one driver (`agents.plant.driver`); a RealSense, a Kinova Kortex or ROS 2 topics
plug in at the same place. Drivers are named in a system file as `module:Class`, or as `dsr drivers list` names them,
and are made with `Class(bus, keys)`.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import typing
from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol, runtime_checkable

import msgspec

from dsr.config.extras import missing_extra
from dsr.config.plugins import DRIVERS, load
from dsr.config.toml import convert
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.vocabulary.intrinsics import Intrinsics

SILENCE = 3.0
"""s without a usable picture after which a camera counts as gone: no camera is that slow, and people still wait"""


class ArmState(msgspec.Struct, frozen=True):
    """One sample of an arm's joints and gripper."""

    stamp: float
    """Time of the sample, s."""
    names: tuple[str, ...]
    """Joint names as in the URDF, without the gripper's."""
    positions: tuple[float, ...]
    """Joint positions, rad, in the order of the chain."""
    velocities: tuple[float, ...]
    """Joint velocities, rad/s, in the order of the chain."""
    gripper_opening: float
    """m between the finger pads"""
    gripper_contact: bool
    """Both pads touch something."""
    fault: str = ""
    """Why the device stopped by itself, or refuses to move, in words; empty if it does as it is told."""
    efforts: tuple[float, ...] = ()
    """Torque (N m), force (N) or current (A) of each joint, as the device tells it; empty if it tells none."""
    gripper_effort: float | None = None
    """Force (N) or current (A) with which the fingers press, as the device tells it; None if it tells none."""


class TagReading(msgspec.Struct, frozen=True):
    """The measured pose of one tagged object."""

    marker_id: int
    pose: tuple[float, float, float, float, float, float, float]
    """camera_from_object, at the object's centre: translation (m), then a quaternion (x, y, z, w)"""
    sigma_translation: float
    """m, standard deviation of each coordinate"""
    sigma_rotation: float
    """rad, standard deviation about each axis"""


class TagCorners(msgspec.Struct, frozen=True):
    """One tag as a device found it in an image, without its pose."""

    marker_id: int
    corners: tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]
    """px, integers at pixel centres, from the top left one as printed by OpenCV, clockwise"""
    sigma: float
    """px, standard deviation of each coordinate"""


class ColorReading(msgspec.Struct, frozen=True):
    """The place of an object that is recognised by its colour, and at most how it leans."""

    color: tuple[float, float, float]
    """Red, green, blue, 0 to 1, as the object's node has it"""
    position: tuple[float, float, float]
    """m, the object's centre in the camera's optical frame"""
    sigma: float
    """m, standard deviation of each coordinate"""
    up: tuple[float, float, float] | None = None
    """Unit vector of the object's own z axis in the camera's optical frame, if its shape shows that"""
    ahead: tuple[float, float, float] | None = None
    """Likewise of its own x axis, or of what looks like that; it says nothing of what is round"""


class TagReadings(msgspec.Struct, frozen=True):
    """The objects that a camera recognises at one instant, by tags and by colours."""

    stamp: float
    """Time of the exposure, s."""
    readings: list[TagReading]
    intrinsics: Intrinsics | None = msgspec.field(default=None, name="lens")  # as it is called in messages
    """Through which they are seen, if the device tells."""
    colors: list[ColorReading] = []
    corners: list[TagCorners] = []
    """Tags without poses, which follow from their size and `intrinsics`."""


class HandReading(msgspec.Struct, frozen=True):
    """The measured landmarks of one human hand."""

    side: Literal["left", "right", "unknown"]
    landmarks: tuple[tuple[float, float, float], ...]
    """21 points, m, in the camera's optical frame, at the centres of the joints in MediaPipe's order: wrist, then
    four of each digit from thumb to little finger; whatever for those that are not visible"""
    visible: tuple[bool, ...]
    """Whether each landmark is visible."""
    sigma: float
    """m, standard deviation of each coordinate"""


class HandReadings(msgspec.Struct, frozen=True):
    """The human hands that a camera sees at one instant, in no particular order."""

    stamp: float
    """Time of the exposure, s."""
    hands: list[HandReading]
    intrinsics: Intrinsics | None = msgspec.field(default=None, name="lens")  # as it is called in messages
    """Through which they are seen, if the device tells."""


class PersonReading(msgspec.Struct, frozen=True):
    """The eyes of a person, as a tracker of heads or gazes tells them."""

    name: str
    """Whose they are."""
    pose: tuple[float, float, float, float, float, float, float]
    """frame_from_person: translation (m), then a quaternion (x, y, z, w); between the eyes, x along the gaze, y left"""
    sigma_translation: float
    """m, standard deviation of each coordinate"""
    sigma_rotation: float
    """rad, standard deviation about each axis"""
    fov: tuple[float, float] | None = None
    """rad, horizontal and vertical: what they see at once, if that is known"""


class PersonReadings(msgspec.Struct, frozen=True):
    """The persons that are in the scene at one instant."""

    stamp: float
    """Time of the readings, s."""
    persons: list[PersonReading]


class ArmDriver(Protocol):
    """An arm with a gripper."""

    def state(self) -> ArmState | None:
        """The newest sample, or None before the first."""

    def follow(self, times: tuple[float, ...], positions: tuple[tuple[float, ...], ...]) -> None:
        """Pass through joint `positions` (rad) at `times` (s from now, increasing), and stay at the last ones."""

    def move_gripper(self, opening: float) -> None:
        """Open or close to `opening` m between the pads."""

    def stop(self) -> None:
        """Come to rest at once, within the limits of the joints, and stay there."""

    def keep_alive(self) -> None:
        """The controller lives, and means the present motion to go on; told at each of its ticks.

        A device that moves on by itself must come to rest when it was not told so for a while, 0.1 s if it can: the
        process of the controller may have died. The driver's own process may have died with it.
        """

    def close(self) -> None:
        """Release the device."""


@runtime_checkable
class Announcing(Protocol):
    """A driver of an arm that also says when a sample comes."""

    def on_sample(self, call: Callable[[], object]) -> None:
        """Call this, in any thread, at each new sample."""


class CameraDriver(Protocol):
    """A colour and depth camera."""

    def frame(self) -> Frame | None:
        """The newest frame if it was not returned before, else None.

        Arrays: `color` (h, w, 3) uint8 RGB, `depth` (h, w) float32 m (0 where unknown).
        Meta: `fx fy cx cy` in px, and `stamp` s of the exposure on the frame.
        """

    def close(self) -> None:
        """Release the device."""


@runtime_checkable
class Diagnosed(Protocol):
    """A driver that also tells how its device does, for the status of the agent that uses it."""

    @property
    def trouble(self) -> str:
        """What is wrong now, in words; empty if nothing is."""

    @property
    def counts(self) -> Mapping[str, int]:
        """What went wrong or was passed over since the start, by name."""


class TagDriver(Protocol):
    """A camera that detects tags by itself, or a simulated one that skips the images."""

    def readings(self) -> TagReadings | None:
        """The newest readings if they were not returned before, else None."""

    def close(self) -> None:
        """Release the device."""


class HandDriver(Protocol):
    """A camera that finds hands by itself, or a simulated one that skips the images."""

    def readings(self) -> HandReadings | None:
        """The newest readings if they were not returned before, else None."""

    def close(self) -> None:
        """Release the device."""


class PersonDriver(Protocol):
    """A tracker of heads or gazes."""

    def readings(self) -> PersonReadings | None:
        """The newest readings if they were not returned before, else None."""

    def close(self) -> None:
        """Release the device."""


class CameraEntry(msgspec.Struct, frozen=True):
    """What `dsr drivers` knows of a driver of cameras; packages name theirs in the entry point group `dsr.drivers`."""

    driver: str
    """`module:Class` of a `CameraDriver`"""
    what: str
    """Whose pictures it gives"""
    gives: str
    """What is in its frames: `colour`, `colour and depth`"""
    needs: str
    """What must be there, beside the software"""
    missing: Callable[[], list[str]]
    """What of that, and of the software, is not there now, each with the remedy; empty if all is"""
    extra: str = ""
    """The extra of the distribution that brings the software; empty for none"""
    example: tuple[str, ...] = ()
    """Options as `KEY=VALUE` without which it cannot be made"""
    on_bus: bool = False
    """Whether its pictures come over the network of a running graph"""


class ArmEntry(CameraEntry, frozen=True):
    """What `dsr drivers` knows of a driver of arms: `driver` is an `ArmDriver`, and `gives` joints."""


def camera_entry(name: str) -> CameraEntry:
    """The entry of the driver of that name. Raises `ConfigError` if there is none."""
    entry = load(DRIVERS, name, "driver")
    if not isinstance(entry, CameraEntry):
        raise ConfigError(f"driver {name!r}: its package gives a {type(entry).__name__}, expected a CameraEntry")
    return entry


def make_driver(name: str, bus: Transport, keys: Keys, /, **options: Any) -> Any:
    """Make the driver `module:Class`, or that of an entry; `options` are passed on.

    Raises `ConfigError` for an unknown name, or options that it does not have, or that are of another type.
    """
    factory = _factory(name)
    try:
        inspect.signature(factory).bind(bus, keys, **options)
    except TypeError as error:
        raise ConfigError(f"driver {name!r}: {error}; its options: {', '.join(_options(factory)) or 'none'}") from error
    _check_types(name, factory, options)
    return factory(bus, keys, **options)


def drivers_in(config: object) -> set[str]:
    """The names of drivers in a configuration, at any depth."""
    found, waiting = set(), [config]
    while waiting:
        one = waiting.pop()
        if isinstance(one, Mapping):
            found |= {one["driver"]} if isinstance(one.get("driver"), str) else set()
            waiting += one.values()
        elif isinstance(one, list | tuple):
            waiting += one
    return found


def has_option(name: str, option: str) -> bool:
    """Whether the driver `module:Class`, or that of an entry, has an option. Raises `ConfigError` if there is none."""
    return option in _options(_factory(name))


def _factory(name: str) -> Any:
    """What makes drivers of that name. Raises `ConfigError`."""
    place = name if ":" in name else camera_entry(name).driver
    module, _, cls = place.partition(":")
    try:
        factory = getattr(importlib.import_module(module), cls)
    except (ImportError, AttributeError, ValueError) as error:
        reason = missing_extra(error) or error
        raise ConfigError(f"driver {name!r} cannot be loaded ({reason}); expected 'module:Class'") from error
    if not callable(factory):
        raise ConfigError(f"driver {name!r} is a {type(factory).__name__}; expected 'module:Class'")
    return factory


def _check_types(name: str, factory: Any, options: Mapping[str, Any]) -> None:
    """Raise `ConfigError` for an option of another type than the driver says; what it does not say is not checked."""
    try:
        said = typing.get_type_hints(factory.__init__ if inspect.isclass(factory) else factory)
    except (NameError, TypeError, AttributeError):
        return
    for option, value in options.items():
        with contextlib.suppress(TypeError):  # a type that no file can tell
            if option in said:
                convert(value, said[option], f"driver {name!r}: option {option!r}")


def _options(factory: Any) -> list[str]:
    """The options of a driver by name, without `bus` and `keys`, which come first."""
    return list(inspect.signature(factory).parameters)[2:]
