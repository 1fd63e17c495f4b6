"""Random bodies: their shape, size, mass and friction, without a place."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from agents.scenario.generate.draw import Draw, NumberRange
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape, bounds

SIDE = NumberRange(0.04, 0.09)
"""m, edges of solid things: a hand can pinch them, and a tag of 4 cm can be read at 1.5 m"""
HEIGHT = NumberRange(0.04, 0.12)
"""m, heights of solid things: up to a can of food"""
RADIUS = NumberRange(0.018, 0.035)
"""m, of balls: from a table-tennis ball to a tennis ball"""
OPENING = NumberRange(0.07, 0.10)
"""m, diameters of cups: a ball or a cube of the smallest size fits in"""
BOWL = NumberRange(0.11, 0.17)
"""m, diameters of bowls at the rim"""
CRATE = NumberRange(0.12, 0.18)
"""m, edges of open boxes, trays and covers, seen from above: several small things fit in"""
DEPTH = NumberRange(0.07, 0.13)
"""m, heights of cups, open boxes and covers"""
SHALLOW = NumberRange(0.02, 0.04)
"""m, heights of trays: what is in a tray is seen over its rim"""
WALL = 0.004
"""m, thickness of walls and bottoms: contact is sure from 3 mm on"""
MASS = NumberRange(0.03, 0.6)
"""kg, from an empty cup to a full can"""
FRICTION = NumberRange(0.35, 0.9)
"""Coulomb coefficients, from polished wood to rubber"""
ROLLING = NumberRange(0.0004, 0.003)
"""m, lever arm of the resistance to rolling: a ball of 0.5 m/s comes to rest after 0.1 to 1 m"""
_RING = 12
"""Walls of a round vessel: with the bottom they are within the parts that a body may have."""
_FLARE = NumberRange(0.2, 0.5)
"""rad from the vertical, of a bowl's walls"""

Kind = Literal["cube", "box", "container", "cup", "ball"]


class LooseBody(msgspec.Struct, frozen=True, kw_only=True):
    """A thing that has no place yet."""

    what: str
    """What people call it, the beginning of its name."""
    type: Kind
    size: Vector3
    """m, edge lengths of the bounding box"""
    shape: Shape = ()
    """Parts of the shape, in the frame at the centre of the bounding box; none for a solid box."""
    mass: float
    """kg"""
    friction: float
    """Coulomb coefficient"""
    rolling_friction: float = 0.0
    """m, lever arm of the resistance to rolling"""
    can_have_tag: bool = False
    """Whether its upper face is closed and large enough for a tag."""

    @property
    def radius(self) -> float:
        """m, of the circle around it, seen from above"""
        round_section = len(self.shape) == 1 or self.what in ("cup", "bowl")
        return self.size[0] / 2 if round_section else math.hypot(*self.size[:2]) / 2


def cube(draw: Draw) -> LooseBody:
    """A cube, mostly of the size that tags are used on."""
    edge = 0.04 if draw.chance() else draw.number(SIDE)
    return _body(draw, "cube", "cube", (edge, edge, edge), can_have_tag=True)


def box(draw: Draw) -> LooseBody:
    """A solid box of any proportions."""
    size = (draw.number(SIDE), draw.number(SIDE), draw.number(HEIGHT))
    return _body(draw, "box", "box", size, can_have_tag=True)


def can(draw: Draw) -> LooseBody:
    """An upright cylinder."""
    width = draw.number(SIDE)
    size = (width, width, draw.number(HEIGHT))
    return _body(draw, "can", "box", size, (Part("cylinder", size),), rolls=True)


def ball(draw: Draw) -> LooseBody:
    """A ball that comes to rest by itself."""
    edge = round(2 * draw.number(RADIUS), 4)
    size = (edge, edge, edge)
    return _body(draw, "ball", "ball", size, (Part("sphere", size),), rolls=True)


def board(draw: Draw) -> LooseBody:
    """A thin board that stands on its lower edge; its flat side faces along its x axis."""
    thickness, width, height = NumberRange(0.008, 0.016), NumberRange(0.05, 0.10), NumberRange(0.10, 0.18)
    return _body(draw, "board", "box", (draw.number(thickness), draw.number(width), draw.number(height)))


def plank(draw: Draw) -> LooseBody:
    """A thin board that lies on its flat side; it is longest along its x axis."""
    length, width, thickness = NumberRange(0.12, 0.24), NumberRange(0.05, 0.10), NumberRange(0.008, 0.016)
    return _body(draw, "plank", "box", (draw.number(length), draw.number(width), draw.number(thickness)))


def wall(draw: Draw) -> LooseBody:
    """A tall box that hides what is behind it, and does not fall easily."""
    thickness, width, height = NumberRange(0.08, 0.12), NumberRange(0.14, 0.22), NumberRange(0.16, 0.24)
    size = (draw.number(thickness), draw.number(width), draw.number(height))
    return _body(draw, "wall", "box", size)


def cup(draw: Draw) -> LooseBody:
    """An open round cup with upright walls."""
    width, height = draw.number(OPENING), draw.number(DEPTH)
    return _vessel(draw, "cup", "cup", _ring(width, height, 0.0))


def bowl(draw: Draw) -> LooseBody:
    """An open round bowl with walls that lean outwards."""
    flare, width = draw.number(_FLARE), draw.number(BOWL)
    height = draw.number(NumberRange(0.04, 0.07))
    return _vessel(draw, "bowl", "cup", _ring(width - 2 * height * math.tan(flare), height, flare))


def crate(draw: Draw) -> LooseBody:
    """An open box."""
    size = (draw.number(CRATE), draw.number(CRATE), draw.number(DEPTH))
    return _vessel(draw, "crate", "container", _open_box(size, upwards=True))


def tray(draw: Draw) -> LooseBody:
    """A tray with a low rim."""
    size = (draw.number(CRATE), draw.number(CRATE), draw.number(SHALLOW))
    return _vessel(draw, "tray", "container", _open_box(size, upwards=True))


def cover(draw: Draw) -> LooseBody:
    """A box without a bottom, to put over things."""
    size = (draw.number(CRATE), draw.number(CRATE), draw.number(DEPTH))
    return _vessel(draw, "cover", "container", _open_box(size, upwards=False))


def lid(draw: Draw, vessel: LooseBody) -> LooseBody:
    """A flat lid that lies on the rim of a vessel."""
    overhang = 0.01  # m, in all, over the rim
    size = (round(vessel.size[0] + overhang, 4), round(vessel.size[1] + overhang, 4), 0.01)
    return _body(draw, "lid", "box", size, can_have_tag=True)


SOLIDS = (cube, box, can)
"""Things with a flat top, that others can stand on."""
SMALL = (cube, ball)
"""Things that fit into vessels."""
VESSELS = (cup, bowl, crate, tray)
"""Things that others can be in."""


def small(draw: Draw, room: float) -> LooseBody:
    """A cube or a ball that fits into an opening of `room` m with some play."""
    edge = round(min(0.7 * room, draw.number(NumberRange(0.03, 0.05))), 4)
    size = (edge, edge, edge)
    if draw.chance():
        return _body(draw, "ball", "ball", size, (Part("sphere", size),), rolls=True)
    return _body(draw, "cube", "cube", size, can_have_tag=True)


def inner_width(vessel: LooseBody) -> float:
    """m, of the free room at the bottom of a vessel or under a cover"""
    low, high = bounds((vessel.shape[0],))
    return min(high[0] - low[0], high[1] - low[1]) - 2 * WALL


def floor_of(vessel: LooseBody) -> float:
    """m, from the lowest point of a vessel up to where its contents lie"""
    return 0.0 if vessel.what == "cover" else vessel.shape[0].size[2]


def _vessel(draw: Draw, what: str, type: Kind, shape: Shape) -> LooseBody:
    low, high = bounds(shape)
    x, y, z = (round(b - a, 6) for a, b in zip(low, high, strict=True))
    return _body(draw, what, type, (x, y, z), shape)


def _body(
    draw: Draw, what: str, type: Kind, size: Vector3, shape: Shape = (), *, can_have_tag: bool = False,
    rolls: bool = False,
) -> LooseBody:  # fmt: skip
    return LooseBody(
        what=what,
        type=type,
        size=size,
        shape=shape,
        mass=draw.factor(MASS),
        friction=draw.number(FRICTION),
        rolling_friction=draw.factor(ROLLING) if rolls else 0.0,
        can_have_tag=can_have_tag and min(size[:2]) >= SIDE.low,
    )


def _ring(width: float, height: float, flare: float) -> Shape:
    """A round bottom of `width` m and a ring of walls, `flare` rad from the vertical."""
    bottom = Part("cylinder", _rounded(width, width, WALL), _rounded(0.0, 0.0, (WALL - height) / 2))
    rise = height - WALL
    slant = rise / math.cos(flare)
    reach = width / 2 - WALL / 2 + rise * math.tan(flare) / 2
    chord = 2 * (width / 2 + rise * math.tan(flare)) * math.tan(math.pi / _RING)
    walls = []
    for number in range(_RING):
        angle = 2 * math.pi * number / _RING
        turn = quaternions.product(
            quaternions.from_rotvec((0.0, 0.0, angle)), quaternions.from_rotvec((0.0, flare, 0.0))
        )
        position = _rounded(reach * math.cos(angle), reach * math.sin(angle), WALL / 2)
        a, b, c, d = (round(value, 6) for value in turn)
        walls.append(Part("box", _rounded(WALL, chord, slant), position, (a, b, c, d)))
    return (bottom, *walls)


def _open_box(size: Vector3, *, upwards: bool) -> Shape:
    """Bottom (or top) first, then four walls."""
    x, y, z = size
    side = 1.0 if upwards else -1.0
    rise, middle = z - WALL, side * WALL / 2
    return (
        Part("box", _rounded(x, y, WALL), _rounded(0.0, 0.0, side * (WALL - z) / 2)),
        Part("box", _rounded(WALL, y, rise), _rounded((x - WALL) / 2, 0.0, middle)),
        Part("box", _rounded(WALL, y, rise), _rounded((WALL - x) / 2, 0.0, middle)),
        Part("box", _rounded(x - 2 * WALL, WALL, rise), _rounded(0.0, (y - WALL) / 2, middle)),
        Part("box", _rounded(x - 2 * WALL, WALL, rise), _rounded(0.0, (WALL - y) / 2, middle)),
    )


def _rounded(x: float, y: float, z: float) -> Vector3:
    return round(x, 6), round(y, 6), round(z, 6)
