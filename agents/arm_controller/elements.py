"""Poses and numbers in the XML elements of a robot description (URDF)."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from dsr.quaternions import Vector3, from_rotvec, product
from dsr.transforms import Pose

_ORIGIN: Vector3 = (0.0, 0.0, 0.0)


def origin(element: ET.Element | None) -> Pose:
    """Pose of an <origin>, the identity without one; rpy is Rz(yaw) Ry(pitch) Rx(roll)."""
    if element is None:
        return Pose.identity()
    roll, pitch, yaw = vector(element, "rpy", _ORIGIN)
    turned = product(from_rotvec((0.0, 0.0, yaw)), from_rotvec((0.0, pitch, 0.0)))
    return Pose(vector(element, "xyz", _ORIGIN), product(turned, from_rotvec((roll, 0.0, 0.0))))


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
        raise ValueError(f"<{element.tag} {name}={element.get(name)!r}>: expected {len(default)} finite numbers")
    return numbers
