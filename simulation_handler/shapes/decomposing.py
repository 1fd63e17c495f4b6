"""Hollow bodies as a few convex pieces.

By V-HACD (K. Mamou, "Volumetric hierarchical approximate convex decomposition", 2016). It is part of pybullet, takes
seconds and holds the interpreter meanwhile, so it runs in a process of its own:
`python -m simulation_handler.shapes.decomposing IN.obj OUT.obj CONCAVITY`. Equal meshes have equal pieces.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pybullet
from numpy.typing import NDArray

Points = NDArray[np.float64]

_CONCAVITIES = (0.005, 0.02, 0.08)  # by how much a piece may be hollow, in V-HACD's measure: the finest first
_RESOLUTION = 50_000  # voxels
_CORNERS = 32  # of a piece
_DECOMPOSING_LIMIT = 60.0  # s


def decomposed(vertices: Points, triangles: NDArray[np.int64], most: int) -> list[Points] | None:
    """The corners of at most `most` convex pieces that make up a closed surface, as fine as so many allow.

    Args:
        vertices: (n, 3) m
        triangles: (m, 3) indices
        most: pieces.

    Returns:
        None if that takes more pieces, or fails.
    """
    with tempfile.TemporaryDirectory(prefix="dsr-hollow-") as folder:
        source, result = Path(folder) / "in.obj", Path(folder) / "out.obj"
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles.tolist()]
        source.write_text("\n".join([*lines, ""]), encoding="ascii")
        for concavity in _CONCAVITIES:
            command = [sys.executable, "-m", __name__, str(source), str(result), str(concavity)]
            try:
                subprocess.run(
                    command, check=True, timeout=_DECOMPOSING_LIMIT, capture_output=True, stdin=subprocess.DEVNULL
                )
                pieces = _pieces(result.read_text(encoding="ascii"))
            except (OSError, ValueError, subprocess.SubprocessError):
                return None
            if 0 < len(pieces) <= most:
                return pieces
    return None


def _pieces(text: str) -> list[Points]:
    """The vertices of each object of an OBJ file."""
    found: list[list[list[float]]] = []
    for line in text.splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "o":
            found.append([])
        elif kind == "v" and found:
            found[-1].append([float(word) for word in rest.split()])
    return [np.array(piece) for piece in found if len(piece) >= 4]


def main(source: str, result: str, concavity: str) -> None:
    """Write the convex pieces of an OBJ file to another one."""
    pybullet.vhacd(
        source, result, f"{result}.log", concavity=float(concavity), resolution=_RESOLUTION,
        maxNumVerticesPerCH=_CORNERS,
    )  # fmt: skip


if __name__ == "__main__":
    main(*sys.argv[1:])
