"""Whether objects that are recognised by their colour can be told from one another and from all else in the image."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path as FilePath

from agents.colors import (
    APART,
    DARKEST,
    FLOOR,
    GREY,
    PALETTE,
    SHADE,
    SKIN,
    SLEEVE,
    TABLE,
    Color,
    spectral_angle,
)
from agents.scenario.format.model import Scenario
from agents.urdf_elements import attribute, parse_urdf, read_urdf


def color_clash(scenario: Scenario, robots: FilePath | None) -> tuple[int, str] | None:
    """The index of the first object whose colour does not tell it from all else, and why; None if all can be told.

    Args:
        scenario: with the models of its objects filled in.
        robots: folder of the robots' descriptions, which tell the arm's colours; None if it is not known.

    Raises:
        ConfigError: for a description that cannot be read.
    """
    known = [index for index, spec in enumerate(scenario.objects) if spec.by_color]
    around = list(_surroundings(scenario, robots)) if known else []
    for index in known:
        spec = scenario.objects[index]
        color = spec.color or (0.0, 0.0, 0.0)
        if math.hypot(*color) * SHADE < DARKEST:
            return index, f"{spec.name!r} is recognised by its colour, but {color} is too dark to be told from black"
        what, other = min([*_others(scenario, index), *around], key=lambda named: _apart(color, named[1]))
        if (angle := spectral_angle(color, other)) < APART:
            return index, (
                f"{spec.name!r} is recognised by its colour, but that of {what} is too much like it: "
                f"{math.degrees(angle):.0f} degrees between {_shown(color)} and {_shown(other)}; expected "
                f"{math.degrees(APART):.0f} or more, whatever their brightness"
            )
    return None


def _apart(a: Color, b: Color) -> float:
    """The angle (rad) between colours, without what rounding makes of it: of equal ones the first counts."""
    return round(spectral_angle(a, b), 9)


def _others(scenario: Scenario, index: int) -> Iterator[tuple[str, Color]]:
    """The other objects with the colours that they are drawn in."""
    for number, spec in enumerate(scenario.objects):
        if number != index:
            yield repr(spec.name), spec.color or PALETTE[number % len(PALETTE)]


def _surroundings(scenario: Scenario, robots: FilePath | None) -> Iterator[tuple[str, Color]]:
    """All else that is drawn."""
    yield from (("the table", TABLE), ("the floor", FLOOR), ("tags and all that is grey", GREY))
    if any(getattr(event, "hand", None) is not None for event in scenario.events):
        yield from (("hands", SKIN), ("sleeves", SLEEVE))
    models = dict.fromkeys(spec.model for spec in scenario.arms.values() if not FilePath(spec.model).suffix)
    for model in models if robots is not None else ():
        file = FilePath(robots or "") / f"{model}.urdf"
        for color in parse_urdf(read_urdf(file), str(file), _robot_colors):
            yield "the arm", color


def _robot_colors(root: ET.Element) -> list[Color]:
    """All that are bright enough to be one; ValueError for what is none."""
    found = []
    for element in root.iter("color"):
        red, green, blue, _ = map(float, attribute(element, "rgba").split())
        if math.hypot(red, green, blue) >= DARKEST:
            found.append((red, green, blue))
    return found


def _shown(color: Color) -> str:
    return f"({', '.join(f'{part:.3g}' for part in color)})"
