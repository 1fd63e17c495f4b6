"""Descriptions of objects (URDF) in `etc/objects` or beside a scenario file: their shapes and masses.

An object is one link without joints. The link is called after the type of the object: `cube`, `box`, `container`, `cup`
or `ball`. Its <collision> elements (box, cylinder, sphere; at most 16) are its parts, so a container is one box for
each wall; the frame is free, it is moved to the centre of the bounding box. What is drawn is what collides: of <visual>
only the colour of the first <material> counts. <inertial> gives the mass; inertia follows from the parts. <contact> may
give `lateral_friction` and `rolling_friction`, as pybullet reads them. https://wiki.ros.org/urdf/XML/link
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple, cast

from agents.urdf_elements import attribute, collision_solid, number, origin, parse_urdf, read_urdf
from dsr.errors import ConfigError, suggest
from dsr.files.built_in import ETC
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import MOST_PARTS, Part, PartKind, Shape, bounds, box, centred
from dsr.vocabulary.relations import THINGS

DEFAULT_FRICTION = 0.6
"""Coulomb coefficient of what does not say."""

_LARGEST = 5.0  # m, edge of a bounding box
_THINNEST = 0.001  # m, edge of a part: through what is thinner, others fall
LIGHTEST, HEAVIEST = 0.0001, 100.0
"""kg, bounds of what an object weighs"""
_DIGITS = 9  # of lengths in m, beyond which sums are rounded


class ObjectModel(NamedTuple):
    """An object as its description (URDF) defines it."""

    type: str
    """Node type, one of `dsr.vocabulary.relations.THINGS`."""
    size: Vector3
    """Edge lengths of the bounding box, m."""
    shape: Shape
    """Parts of the shape, in the frame at the centre of the bounding box; none for a solid box."""
    mass: float
    """Mass of the object, kg."""
    friction: float
    """Coulomb coefficient"""
    rolling_friction: float
    """m, lever arm of the resistance to rolling"""
    color: Vector3 | None
    """Red, green, blue, 0 to 1"""


def model_files() -> dict[str, Path]:
    """Find the models that come with the system, by name: `etc/objects` here or in the installed package."""
    folders = (ETC / "objects", Path("etc/objects"))
    return {file.stem: file for folder in folders for file in sorted(folder.glob("*.urdf"))}


def find_model(name_or_path: str, folder: Path) -> Path:
    """The file of a model: a path ending in `.urdf`, relative to `folder`, or a name. Raises `ConfigError`."""
    if name_or_path.endswith(".urdf"):
        return folder / name_or_path
    known = model_files()
    if name_or_path not in known:
        hint = suggest(name_or_path, known)
        raise ConfigError(f"unknown model {name_or_path!r}; {hint}, or a path ending in '.urdf'")
    return known[name_or_path]


def load_model(file: Path) -> ObjectModel:
    """The object described in a URDF file. Raises `ConfigError`."""
    return parse_model(read_urdf(file), str(file))


def parse_model(data: bytes, file: str = "<urdf>") -> ObjectModel:
    """The object described by URDF `data` that came from `file`. Raises `ConfigError`."""
    return parse_urdf(data, file, _object)


def _object(root: ET.Element) -> ObjectModel:
    if (joint := root.find("joint")) is not None:
        raise ValueError(f"<joint name={joint.get('name')!r}>: an object has no joints; expected one <link>")
    links = root.findall("link")
    if len(links) != 1:
        raise ValueError(f"{len(links)} <link> elements; expected one")
    type = attribute(links[0], "name")
    if type not in THINGS:
        raise ValueError(f"<link name={type!r}>: expected the type of the object; {suggest(type, THINGS)}")
    size, shape = _size_and_shape(links[0])
    if type == "ball" and [part.kind for part in shape] != ["sphere"]:
        raise ValueError("<link name='ball'>: a ball is one <sphere>; expected that, or another type")
    return ObjectModel(
        type=type,
        size=size,
        shape=shape,
        mass=_mass(links[0]),
        friction=_contact(links[0], "lateral_friction", DEFAULT_FRICTION),
        rolling_friction=_contact(links[0], "rolling_friction", 0.0),
        color=_color(links[0], root),
    )


def _size_and_shape(link: ET.Element) -> tuple[Vector3, Shape]:
    collisions = link.findall("collision")
    if not 1 <= len(collisions) <= MOST_PARTS:
        name = attribute(link, "name")
        raise ValueError(f"<link name={name!r}>: {len(collisions)} <collision> elements; expected 1 to {MOST_PARTS}")
    return size_and_shape(tuple(_part(index, collision) for index, collision in enumerate(collisions, start=1)))


def size_and_shape(parts: Shape) -> tuple[Vector3, Shape]:
    """The edge lengths (m) of the bounding box of some parts, and the parts in the frame at its centre.

    A single upright box has no parts. Raises `ValueError` for too many parts, and for parts too thin, too large, or
    round with unequal diameters.
    """
    if not 1 <= len(parts) <= MOST_PARTS:
        raise ValueError(f"{len(parts)} parts; expected 1 to {MOST_PARTS}")
    for index, part in enumerate(parts, start=1):
        _check_thickness(f"part {index} ({part.kind})", part.size)
        _check_roundness(index, part)
    shape, _ = centred(parts)
    low, high = bounds(shape)
    x, y, z = (round(b - a, _DIGITS) for a, b in zip(low, high, strict=True))
    if not all(edge <= _LARGEST for edge in (x, y, z)):  # numbers that overflow differ by none
        raise ValueError(f"an object of {x:g} x {y:g} x {z:g} m; expected at most {_LARGEST} m")
    return (x, y, z), () if shape == box((x, y, z)) else shape


def _part(index: int, collision: ET.Element) -> Part:
    where = f"<collision> {index}"
    try:
        pose = origin(collision.find("origin"))
        kind, size = collision_solid(collision)
        _check_thickness(f"<{kind}>", size)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    x, y, z = (round(value, _DIGITS) for value in pose.t)
    return Part(cast(PartKind, kind), size, (x, y, z), pose.q)


def _check_thickness(what: str, size: Vector3) -> None:
    if min(size) < _THINNEST:
        found = " x ".join(f"{edge:g}" for edge in size)
        raise ValueError(f"{what}: expected lengths of at least {_THINNEST} m, got {found}")


def _check_roundness(index: int, part: Part) -> None:
    across = part.size[: {"box": 1, "cylinder": 2, "sphere": 3}[part.kind]]  # the diameters
    if len(set(across)) > 1:
        found = " x ".join(f"{edge:g}" for edge in across)
        raise ValueError(f"part {index} ({part.kind}): expected equal diameters, got {found} m")


def _mass(link: ET.Element) -> float:
    inertial = link.find("inertial")
    element = None if inertial is None else inertial.find("mass")
    mass = 0.0 if element is None else number(element, "value", 0.0)
    if not LIGHTEST <= mass <= HEAVIEST:
        name, bounds_kg = attribute(link, "name"), f"{LIGHTEST:g} to {HEAVIEST:g} kg"
        raise ValueError(f"<link name={name!r}>: expected <inertial> with <mass value=...> of {bounds_kg}")
    return mass


def _contact(link: ET.Element, name: str, default: float) -> float:
    element = link.find(f"contact/{name}")
    value = default if element is None else number(element, "value", default)
    if not 0.0 <= value <= 5.0:
        raise ValueError(f"<{name} value={value:g}>: expected 0 to 5")
    return value


def _color(link: ET.Element, root: ET.Element) -> Vector3 | None:
    """Of the first <visual>'s <material>, which may refer to one of the <robot> by name."""
    material = link.find("visual/material")
    if material is None:
        return None
    element = material.find("color")
    if element is None:
        name = attribute(material, "name")
        named = [other.find("color") for other in root.findall("material") if other.get("name") == name]
        element = next((color for color in named if color is not None), None)
        if element is None:
            raise ValueError(f"<material name={name!r}>: no <color rgba=...> here or in the <robot>")
    words = attribute(element, "rgba").split()
    try:
        red, green, blue, _ = map(float, words)
    except ValueError:
        raise ValueError(f"<color rgba={element.get('rgba')!r}>: expected 4 numbers") from None
    if not all(0.0 <= part <= 1.0 for part in (red, green, blue)):
        raise ValueError(f"<color rgba={element.get('rgba')!r}>: expected numbers from 0 to 1")
    return red, green, blue
