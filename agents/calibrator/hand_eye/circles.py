"""Finds a grid of dark circles in a grey image: dots that are neighbours by the steps of a lattice, grown from one dot.

Other things around, a dot of another size, and a few dots that are hidden do no harm.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.calibrator.hand_eye.grids import upright
from dsr.math3d.transforms import Array

_BLOCKS = (0.12, 0.05, 0.02)
"""Sides of the neighbourhoods that a dot must be darker than, over the diagonal of the image. Large ones come first: of
a dot that is larger than its neighbourhood only the rim is dark"""
_DARKER = 7
"""Grey levels by which a dot is darker than its neighbourhood, at least"""
_LEAST_AREA = 12.0
"""px^2 of a dot: of smaller ones the centre is too uncertain"""
_LARGEST = 0.01
"""Area of a dot over that of the image, at most"""
_ROUND = 0.85
"""Area of a dot over that of the ellipse with its moments, and over its convex hull, at least"""
_OBLIQUE = 6.0
"""Length over width of a dot, at most: nothing is measured well at a flatter angle"""
_OFF = 0.25
"""Distance of a dot from where the lattice predicts it, over the step, at most"""
_ALIKE = 4.0
"""Area of a dot over that of its neighbour, at most: some grids have one larger dot"""
_MISSING = 0.1
"""Share of the dots that may be hidden"""
_SEEDS = 40
"""Dots from which a lattice is grown until one is complete"""
_RING = 1.6
"""Radius of what is looked at around a dot, over its own: to the white between dots"""
_FITS = 0.15
"""Distance of a dot from where all others put it by a homography and the lens, over the step, at most"""
_STEPS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])


class _Dots(NamedTuple):
    centres: Array
    """(k, 2) px"""
    areas: Array
    """(k,) px^2"""


def find_circles(grey: NDArray[np.uint8], columns: int, rows: int) -> Array | None:
    """(rows * columns, 2) px centres, row by row; NaN of hidden ones. None if no such grid shows.

    Seen from the front, columns count to the right and rows down. Which corner is the first, and of a square grid which
    direction, its look does not tell.
    """
    dots = _dots(grey)
    if len(dots.areas) < (1.0 - _MISSING) * columns * rows:
        return None
    best: Array | None = None
    for seed in _seeds(dots):
        grid = _grid(_grown(dots, *seed), dots, columns, rows)
        if grid is not None and (best is None or np.isfinite(grid).sum() > np.isfinite(best).sum()):
            best = grid
            if np.isfinite(best).all():
                break
    if best is None:
        return None
    flat = best.reshape(-1, 2)
    _drop_misfits(flat, columns, rows)
    return flat if np.isfinite(flat[:, 0]).sum() >= (1.0 - _MISSING) * columns * rows else None


def _dots(grey: NDArray[np.uint8]) -> _Dots:
    """All that looks like a dark dot."""
    height, width = grey.shape
    centres: list[tuple[float, float]] = []
    areas: list[float] = []
    for share in _BLOCKS:
        block = 2 * round(0.5 * share * math.hypot(width, height)) + 3
        dark = cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, block, _DARKER)
        contours, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for outline in contours:
            contour = np.asarray(outline, np.int32)
            area = cv2.contourArea(contour)
            if _LEAST_AREA <= area <= _LARGEST * width * height and _is_round(contour, area):
                x, y, radius = _refined(grey, contour, area)
                known = np.array(centres).reshape(-1, 2)
                if len(known) == 0 or np.hypot(*(known - (x, y)).T).min() > 0.5 * radius:
                    centres.append((x, y))
                    areas.append(area)
    return _Dots(np.array(centres).reshape(-1, 2), np.array(areas))


def _is_round(contour: NDArray[np.int32], area: float) -> bool:
    (_, _), (length, width), _ = cv2.fitEllipse(contour) if len(contour) >= 5 else ((0, 0), (0, 0), 0)
    short, long = sorted((length, width))
    if not short > 0.0 or long > _OBLIQUE * short:
        return False
    hull = cv2.contourArea(cv2.convexHull(contour))
    # a contour runs through the centres of the outer pixels: half a pixel is missing all around
    ellipse = 0.25 * math.pi * short * long
    return area > _ROUND * hull and _ROUND < area / ellipse < 1.0 / _ROUND


def _refined(grey: NDArray[np.uint8], contour: NDArray[np.int32], area: float) -> tuple[float, float, float]:
    """Centre of the darkness (px) in and around a dot, and the dot's radius."""
    moments = cv2.moments(contour)
    x, y = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
    left, top, width, height = cv2.boundingRect(contour)
    radius = math.sqrt(area / math.pi)
    margin = math.ceil((_RING - 1.0) * radius) + 1
    rows = slice(max(0, top - margin), min(grey.shape[0], top + height + margin))
    columns = slice(max(0, left - margin), min(grey.shape[1], left + width + margin))
    patch = grey[rows, columns].astype(np.float64)
    mask = np.zeros(patch.shape, np.uint8)
    cv2.drawContours(mask, [contour], -1, 1, cv2.FILLED, offset=(-columns.start, -rows.start))
    near = cv2.dilate(mask, np.ones((2 * margin - 1, 2 * margin - 1), np.uint8)) > 0
    inner = cv2.dilate(mask, np.ones((3, 3), np.uint8)) > 0
    around = patch[near & ~inner]
    if not len(around):
        return x, y, radius
    darkness = np.where(inner, np.maximum(np.median(around) - patch, 0.0), 0.0)
    total = float(darkness.sum())
    if total <= 0.0:
        return x, y, radius
    v, u = np.mgrid[rows, columns]
    return float((darkness * u).sum() / total), float((darkness * v).sum() / total), radius


def _seeds(dots: _Dots) -> Iterable[tuple[int, int, int]]:
    """Dots that have neighbours of their size on both sides in two directions, with one neighbour in each direction."""
    given = 0
    for index in range(len(dots.areas)):
        away = dots.centres - dots.centres[index]
        near = np.argsort((away**2).sum(axis=1))[1:9]
        near = np.array([other for other in near if _are_alike(dots, index, other)], dtype=np.intp)
        pairs = [
            one
            for one in near
            if any(np.linalg.norm(away[one] + away[other]) < _OFF * np.linalg.norm(away[one]) for other in near)
        ]
        for first in pairs[:1]:
            for second in pairs[1:]:
                u, v = away[first], away[second]
                if abs(u[0] * v[1] - u[1] * v[0]) > _OFF * np.linalg.norm(u) * np.linalg.norm(v):
                    given += 1
                    yield index, int(first), int(second)
                    break
        if given >= _SEEDS:
            return


def _are_alike(dots: _Dots, one: int, other: int) -> bool:
    return 1.0 / _ALIKE < float(dots.areas[one] / dots.areas[other]) < _ALIKE


def _grown(dots: _Dots, seed: int, first: int, second: int) -> dict[tuple[int, int], int]:
    """Dots by their place in the lattice, found from one dot and its neighbours in two directions."""
    places = {(0, 0): seed, (1, 0): first, (0, 1): second}
    u, v = (dots.centres[other] - dots.centres[seed] for other in (first, second))
    steps = dict.fromkeys(places, (u, v))  # of the lattice at each dot: both bend with perspective and lens
    queue = list(places)
    taken = set(places.values())
    while queue:
        place = queue.pop(0)
        here = dots.centres[places[place]]
        for di, dj in _STEPS.tolist():
            there = (place[0] + di, place[1] + dj)
            if there in places:
                continue
            step = di * steps[place][0] + dj * steps[place][1]
            off = np.linalg.norm(dots.centres - (here + step), axis=1)
            nearest = int(off.argmin())
            if nearest in taken or off[nearest] > _OFF * np.linalg.norm(step):
                continue
            places[there] = nearest
            taken.add(nearest)
            seen = dots.centres[nearest] - here
            steps[there] = (seen * di, steps[place][1]) if di else (steps[place][0], seen * dj)
            queue.append(there)
    return places


def _grid(places: dict[tuple[int, int], int], dots: _Dots, columns: int, rows: int) -> Array | None:
    """(rows, columns, 2) px of the window of a lattice that has the most dots, right-handed; None if too many lack."""
    where = np.array(list(places))
    low = where.min(axis=0)
    width, height = where.max(axis=0) - low + 1
    full = np.full((height, width, 2), np.nan)
    for (i, j), index in places.items():
        full[j - low[1], i - low[0]] = dots.centres[index]
    best: Array | None = None
    for picture in (full, np.swapaxes(full, 0, 1)):
        for top in range(picture.shape[0] - rows + 1):
            for left in range(picture.shape[1] - columns + 1):
                window = picture[top : top + rows, left : left + columns]
                if best is None or np.isfinite(window).sum() > np.isfinite(best).sum():
                    best = window
    if best is None or np.isfinite(best[..., 0]).sum() < (1.0 - _MISSING) * columns * rows:
        return None
    return upright(best)


def _drop_misfits(grid: Array, columns: int, rows: int) -> None:
    """Set to NaN the dots (n, 2) that their neighbours on both sides do not confirm."""
    picture = grid.reshape(rows, columns, 2)
    for axis in (0, 1):
        along = np.moveaxis(picture, axis, 0)
        before, middle, after = along[:-2], along[1:-1], along[2:]
        off = np.linalg.norm(0.5 * (before + after) - middle, axis=-1)
        step = np.linalg.norm(0.5 * (after - before), axis=-1)
        wrong = off > _FITS * step
        middle[wrong] = np.nan
