"""The XML of robot and object descriptions (URDF): the outer element, and poses and numbers in it."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from dsr.errors import ConfigError
from dsr.files.data_files import read_file
from dsr.math3d.quaternions import Vector3, from_rotvec, product
from dsr.math3d.transforms import Pose

_MOST_BYTES = 10_000_000
_LONGEST_TEXT = 500  # characters of an error, which may show what stands in the file
_ORIGIN: Vector3 = (0.0, 0.0, 0.0)
_FARTHEST = 1e5
"""m, as of the vertices of meshes: what is longer was given in another unit"""

T = TypeVar("T")


def read_urdf(file: Path) -> bytes:
    """What a file holds. Raises `ConfigError`."""
    return read_file(file, _MOST_BYTES)


def parse_urdf(data: bytes, file: str, understand: Callable[[ET.Element], T]) -> T:
    """What `understand` makes of the outer element <robot> of `data` that came from `file`.

    It may raise ValueError, which becomes a `ConfigError` like everything else that is wrong with the data. Without
    DOCTYPE and ENTITY nothing can be expanded or fetched. The parser reads only encodings that write them as ASCII
    does, and UTF-16, which adds zeros.
    """
    letters = data.replace(b"\0", b"")
    if len(data) > _MOST_BYTES or b"<!DOCTYPE" in letters or b"<!ENTITY" in letters:
        raise ConfigError(f"expected at most {_MOST_BYTES} bytes without DOCTYPE and ENTITY", file=file)
    try:
        root = _outer_element(data)
        if root.tag != "robot":
            raise ValueError(f"the outer element is <{root.tag}>, expected <robot>")
        if any("xacro}" in element.tag for element in root.iter()):
            raise ValueError("it has xacro macros, in which links may hide; expand them first: xacrodoc FILE -o NEW")
        return understand(root)
    except ET.ParseError as error:
        raise ConfigError(f"not valid XML: {error}", file=file, line=error.position[0]) from error
    except ValueError as error:
        raise ConfigError(f"{error!s:.{_LONGEST_TEXT}}", file=file) from error


def _outer_element(data: bytes) -> ET.Element:
    try:
        return ET.fromstring(data)
    except (LookupError, ValueError) as error:  # an encoding that is unknown, or no text's
        raise ValueError(f"cannot be decoded: {error}; expected the encoding UTF-8") from error


def origin(element: ET.Element | None) -> Pose:
    """Pose of an <origin>, the identity without one; rpy is Rz(yaw) Ry(pitch) Rx(roll)."""
    if element is None:
        return Pose.identity()
    roll, pitch, yaw = vector(element, "rpy", _ORIGIN)
    place = vector(element, "xyz", _ORIGIN)
    _check_lengths(element, place)
    turned = product(from_rotvec((0.0, 0.0, yaw)), from_rotvec((0.0, pitch, 0.0)))
    return Pose(place, product(turned, from_rotvec((roll, 0.0, 0.0))))


def collision_solid(collision: ET.Element) -> tuple[str, Vector3]:
    """What a <collision> is, `box`, `cylinder` or `sphere`, and the edges (m) of the box around it, in its own frame.

    Lengths that are not given are 0. ValueError for any other shape, for several, and for lengths of no robot.
    """
    solids = collision.findall("geometry/*")
    if len(solids) != 1:
        raise ValueError(f"expected one <geometry> of one shape, got {len(solids)}")
    solid = solids[0]
    across, length = 2.0 * number(solid, "radius", 0.0), number(solid, "length", 0.0)
    size = vector(solid, "size", _ORIGIN)
    _check_lengths(solid, (across, length, *size))
    if solid.tag == "box":
        return "box", size
    if solid.tag == "cylinder":
        return "cylinder", (across, across, length)
    if solid.tag == "sphere":
        return "sphere", (across, across, across)
    file = f" {solid.get('filename')!r}" if solid.get("filename") else ""
    raise ValueError(f"<{solid.tag}>{file} is not supported here; expected <box>, <cylinder> or <sphere> around it")


def _check_lengths(element: ET.Element, lengths: Iterable[float]) -> None:
    """Raise ValueError for a length that no robot has: sums and products of such ones are no numbers any more."""
    longest = max(map(abs, lengths))
    if longest > _FARTHEST:
        raise ValueError(f"<{element.tag}>: a length of {longest:g} m; at most {_FARTHEST:g}: is the scale right?")


def attribute(element: ET.Element, name: str) -> str:
    """The attribute `name`, which must be there."""
    value = element.get(name)
    if not value:
        raise ValueError(f"a <{element.tag}> has no {name!r}")
    return value


def number(element: ET.Element, name: str, default: float) -> float:
    """The attribute `name` as a finite number; ValueError if it is none."""
    return _finite(element, name, element.get(name, "").split(), (default,))[0]


def vector(element: ET.Element, name: str, default: Vector3) -> Vector3:
    """The attribute `name` as three finite numbers; ValueError if it is not."""
    x, y, z = _finite(element, name, element.get(name, "").split(), default)
    return x, y, z


def _finite(element: ET.Element, name: str, words: list[str], default: tuple[float, ...]) -> tuple[float, ...]:
    """The words as finite numbers, as many as the default has; the default if there are none."""
    if not words:
        return default
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if len(numbers) != len(default) or not all(map(math.isfinite, numbers)):
        wanted = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
        raise ValueError(f"<{element.tag} {name}={element.get(name)!r}>: expected {wanted}")
    return numbers
