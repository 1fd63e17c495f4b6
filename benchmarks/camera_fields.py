"""What the cameras of each system see of the table, and how far the arm reaches: an SVG from above, with coordinates.

    python -m benchmarks.camera_fields --svg docs/images/camera_fields.svg

Fields are where the borders of the image meet a horizontal plane. Those of a camera on a stand are of its most common
place in the built-in scenarios. The reach is where the tool can point straight down, by the joints' limits alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.grasping.grasps import looking_down
from agents.arm_controller.model.kinematics import JointChain, UnreachableError
from agents.arm_controller.model.urdf import load_robot
from agents.plant.config import PlantConfig
from agents.scenario.format.scenario import CameraSpec, RobotSpec, Scenario, TableSpec, load_scenario
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]
ROBOT = Path(__file__).resolve().parents[1] / "etc" / "robots" / "gen3.urdf"
HEIGHTS = (0.0, 0.2)
"""m above the table's top, of the planes on which fields are drawn: what stands higher must be further in"""
FARTHEST = 3.0
"""m from the camera along the plane, where a field that has no end is cut"""
TOOL_HEIGHT = 0.02
"""m above the table, of the tool that points down: the centre of a cube"""
STEP = 0.01
"""m, of the reach"""
_POINTS = 25  # of each border of an image
_PIXELS = 260  # for a metre in the picture
_MARGIN = 50  # px
_LEGEND = 60  # px
_COLORS = ("#1f77b4", "#d62728", "#2ca02c")


class Field(NamedTuple):
    """What a camera sees of horizontal planes."""

    name: str
    outlines: tuple[Array, ...]
    """(n, 2) m, x and y in the world, one for each of `HEIGHTS`"""


class Panel(NamedTuple):
    """One table with what looks at it."""

    title: str
    table: TableSpec
    fields: tuple[Field, ...]
    reach: tuple[float, float] | None = None
    """m, least and greatest distance from the arm's base that the tool reaches pointing down"""


def panels() -> list[Panel]:
    """A panel of the systems with an arm, and one of those with a camera on a stand."""
    config = PlantConfig()
    overhead = Pose(config.overhead[:3], config.overhead[3:])
    tabletop, stand = load_scenario("hovering"), load_scenario("cups_and_balls")
    robot = load_robot(ROBOT)
    wrist = JointChain(robot.between("base_link", "camera_wrist_link")).forward(RobotSpec().start)
    fields = (_field("overhead", overhead, tabletop), _field("wrist, at the start", wrist, tabletop))
    assert isinstance(stand.camera, CameraSpec)
    above = stand.table.position[2]
    x, y, z = stand.camera.position
    name = f"fixed, at {x:g}, {y:g}, {z - above:g} m"
    reach = arm_reach(JointChain(robot.between("base_link", "tool_link")))
    return [
        Panel("tabletop, hands, imagination", tabletop.table, fields, reach),
        Panel("reasoner, people", stand.table, (_field(name, stand.camera.pose, stand),)),
    ]


def footprint(world_from_camera: Pose, intrinsics: Intrinsics, height: float) -> Array:
    """(n, 2) m, x and y of where the borders of an image meet the plane at world z `height`; empty if they never do."""
    across, down = (
        np.linspace(-0.5, intrinsics.width - 0.5, _POINTS),
        np.linspace(-0.5, intrinsics.height - 0.5, _POINTS),
    )
    borders = [
        np.column_stack([across, np.full(_POINTS, down[0])]),
        np.column_stack([np.full(_POINTS, across[-1]), down]),
        np.column_stack([across[::-1], np.full(_POINTS, down[-1])]),
        np.column_stack([np.full(_POINTS, across[0]), down[::-1]]),
    ]
    pixels = np.vstack(borders)
    rays = intrinsics.rays(pixels)
    rays = rays @ world_from_camera.rotation_matrix.T
    drop = height - world_from_camera.t[2]
    if drop >= 0 or not (rays[:, 2] < 0).any():
        return np.zeros((0, 2))
    level = np.linalg.norm(rays[:, :2], axis=1)
    times = np.where(rays[:, 2] < 0, drop / np.minimum(rays[:, 2], -1e-9), np.inf)
    times = np.minimum(times, FARTHEST / np.maximum(level, 1e-9))
    outline: Array = np.array(world_from_camera.t[:2]) + rays[:, :2] * times[:, None]
    return outline


def arm_reach(chain: JointChain) -> tuple[float, float]:
    """Least and greatest distance (m) from the base at which the tool can point straight down, `TOOL_HEIGHT` high."""
    rng = np.random.default_rng(0)
    reached = []
    for distance in np.arange(0.0, 1.0, STEP):
        target = looking_down((float(distance), 0.0, TOOL_HEIGHT), np.array([0.0, 1.0, 0.0]))
        try:
            chain.inverse(target, RobotSpec().start, rng=rng)
        except UnreachableError:
            continue
        reached.append(float(distance))
    return min(reached), max(reached)


def svg(found: Sequence[Panel]) -> str:
    """The panels side by side; x to the right, y up, a line for every 0.1 m."""
    pictures = [_picture(panel) for panel in found]
    width, height = sum(size[0] for _, size in pictures), max(size[1] for _, size in pictures)
    parts, left = [], 0
    for text, size in pictures:
        parts.append(f'<g transform="translate({left} 0)">{text}</g>')
        left += size[0]
    extent = f'width="{width}" height="{height}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {extent} font-family="sans-serif" font-size="11">'
    return "\n".join([head, f'<rect width="{width}" height="{height}" fill="white"/>', *parts, "</svg>"]) + "\n"


def _field(name: str, pose: Pose, scenario: Scenario) -> Field:
    config = PlantConfig()
    intrinsics = Intrinsics.from_fov(config.width, config.height, config.fov)
    top = scenario.table.position[2]
    return Field(name, tuple(footprint(pose, intrinsics, top + height) for height in HEIGHTS))


class _Map:
    """Places of the world in a panel of the picture."""

    def __init__(self, table: TableSpec) -> None:
        (x, y, _), (length, width, _) = table.position, table.size
        self.table = (x - length / 2, y - width / 2), (x + length / 2, y + width / 2)
        self.low = min(-0.2, self.table[0][0] - 0.1), self.table[0][1] - 0.15
        self.high = self.table[1][0] + 0.1, self.table[1][1] + 0.15

    @property
    def size(self) -> tuple[int, int]:
        """px, with room for labels."""
        across, up = (high - low for low, high in zip(self.low, self.high, strict=True))
        return round(across * _PIXELS) + 2 * _MARGIN, round(up * _PIXELS) + 2 * _MARGIN + _LEGEND

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a point (m, world) is in the picture, px."""
        return _MARGIN + (x - self.low[0]) * _PIXELS, _MARGIN + (self.high[1] - y) * _PIXELS


def _picture(panel: Panel) -> tuple[str, tuple[int, int]]:
    """A panel as SVG, and its size (px)."""
    place = _Map(panel.table)
    (left, upper), (right, lower) = place.at(place.low[0], place.high[1]), place.at(place.high[0], place.low[1])
    clip = panel.title.partition(",")[0]
    frame = f'x="{left:.1f}" y="{upper:.1f}" width="{right - left:.1f}" height="{lower - upper:.1f}"'
    (x0, y0), (x1, y1) = place.table
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    parts = [f'<clipPath id="{clip}"><rect {frame}/></clipPath>', f'<g clip-path="url(#{clip})">']
    parts += [_polygon(place, corners, "#888", fill="#f2ead8"), *_grid(place), *_rings(place, panel.reach or ())]
    for field, color in zip(panel.fields, _COLORS, strict=False):
        outlines = zip(field.outlines, ("", "5 4"), strict=True)
        parts += [_polygon(place, outline, color, dashes) for outline, dashes in outlines]
    parts += ["</g>", *_labels(place), _text(left, upper - 12, f"{panel.title}; x to the right, y up (m)")]
    named = [f"{field.name}; dashed: {HEIGHTS[1]:g} m above the table" for field in panel.fields]
    lines = [*zip(named, _COLORS, strict=False)]
    if panel.reach is not None:
        lines.append((f"arm, tool down: {panel.reach[0]:.2f} to {panel.reach[1]:.2f} m from its base", "#666"))
    parts += [_text(left, lower + 34 + 16 * number, *line) for number, line in enumerate(lines)]
    return "\n".join(parts), place.size


def _marks(low: float, high: float) -> list[float]:
    return [tenth / 10 for tenth in range(int(np.ceil(low * 10 - 1e-9)), int(np.floor(high * 10 + 1e-9)) + 1)]


def _grid(place: _Map) -> list[str]:
    ends = [((x, place.low[1]), (x, place.high[1])) for x in _marks(place.low[0], place.high[0])]
    ends += [((place.low[0], y), (place.high[0], y)) for y in _marks(place.low[1], place.high[1])]
    points = [(*place.at(*first), *place.at(*last)) for first, last in ends]
    return [
        '<path d="M{:.1f} {:.1f}L{:.1f} {:.1f}" stroke="#ccc" stroke-width="0.5"/>'.format(*four) for four in points
    ]


def _rings(place: _Map, radii: Iterable[float]) -> list[str]:
    x, y = place.at(0.0, 0.0)
    ring = '<circle cx="{:.1f}" cy="{:.1f}" r="{:.1f}" fill="none" stroke="#888" stroke-width="2"/>'
    return [ring.format(x, y, radius * _PIXELS) for radius in radii]


def _labels(place: _Map) -> list[str]:
    across = [(x, place.at(x, place.low[1])) for x in _marks(place.low[0], place.high[0])]
    up = [(y, place.at(place.low[0], y)) for y in _marks(place.low[1], place.high[1])]
    texts = [_text(px, py + 14, f"{x:.1f}", anchor="middle") for x, (px, py) in across if round(10 * x) % 2 == 0]
    return texts + [_text(px - 4, py + 4, f"{y:.1f}", anchor="end") for y, (px, py) in up if round(10 * y) % 2 == 0]


def _polygon(place: _Map, outline: Array, color: str, dashes: str = "", fill: str = "none") -> str:
    points = " ".join("{:.1f},{:.1f}".format(*place.at(*point)) for point in outline.tolist())
    return f'<polygon points="{points}" fill="{fill}" stroke="{color}" stroke-width="2" stroke-dasharray="{dashes}"/>'


def _text(x: float, y: float, text: str, color: str = "#222", anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{color}" text-anchor="{anchor}">{text}</text>'


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the corners of all fields, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--svg", type=Path, help="write the picture to this file")
    options = parser.parse_args(arguments)
    found = panels()
    for panel in found:
        for field in panel.fields:
            for height, outline in zip(HEIGHTS, field.outlines, strict=True):
                (x0, y0), (x1, y1) = outline.min(axis=0), outline.max(axis=0)
                where = f"x {x0:.2f} to {x1:.2f}, y {y0:.2f} to {y1:.2f} m"
                print(f"{panel.title}: {field.name}, {height:g} m above the table: {where}")
        if panel.reach is not None:
            near, far = panel.reach
            print(f"{panel.title}: the arm reaches {near:.2f} to {far:.2f} m from its base, tool down")
    if options.svg:
        options.svg.parent.mkdir(parents=True, exist_ok=True)
        options.svg.write_text(svg(found), encoding="utf-8")


if __name__ == "__main__":
    main()
