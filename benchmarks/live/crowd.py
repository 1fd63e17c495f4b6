"""A scenario with many tagged cubes on the table, of which two swap places every few seconds."""

from __future__ import annotations

import math
from pathlib import Path

PITCH = 0.05
"""m between the centres of two neighbours: a finger's breadth between cubes of 4 cm. A hundred of them fill what the
overhead camera sees."""
_CENTRE = (0.35, 0.0)  # m, x and y, below the overhead camera
_HALF = 0.02  # m, half the edge of a cube


def write_crowd(folder: Path, objects: int, seconds: float, period: float) -> Path:
    """Write the scenario file; two of its `objects` cubes swap places every `period` s until `seconds`."""
    side = math.ceil(math.sqrt(objects))
    lines = [f'name = "crowd_{objects}"', f'title = "{objects} cubes"', f"duration = {seconds:.1f}"]
    for number in range(objects):
        row, column = divmod(number, side)
        x, y = (middle + PITCH * (place - (side - 1) / 2) for middle, place in zip(_CENTRE, (row, column), strict=True))
        lines += ["[[object]]", f'name = "cube_{number}"', f"marker_id = {number}"]
        lines += [f"position = [{x:.4f}, {y:.4f}, {_HALF}]"]
    for turn in range(math.ceil(seconds / period) - 1 if objects > 1 else 0):
        first, other = f"cube_{turn % objects}", f"cube_{(turn + objects // 2) % objects}"
        lines += ["[[event]]", f"at = {period * (turn + 1):.2f}", 'do = "swap"']
        lines += [f'object = "{first}"', f'other = "{other}"']
    file = folder / f"crowd_{objects}.toml"
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file
