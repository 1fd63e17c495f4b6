"""Follows which perspective of a world sees which things, and tells the changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from dsr.math3d.tolerance import PoseTolerance
from dsr.memory import Memory
from dsr.visibility.bodies import Posed, read_posed
from dsr.visibility.looking import BAND, LEAST_PIXELS, LEAST_SHARE, VisibleScene, is_enough
from dsr.visibility.perspectives import (
    CAMERA,
    PERSON,
    PERSPECTIVES,
    WIDTH,
    Perspective,
    persons_there,
    read_perspectives,
)
from dsr.visibility.picture import Picture, VisibleFraction
from dsr.vocabulary.perceived import camera_nodes
from dsr.vocabulary.relations import nodes_by_name

_STILL = 3e-4  # m, and of the entries of rotation matrices: what moved by less is where it was
_SWAYS = 5e-3  # likewise, of persons
_STEADY = PoseTolerance(5e-3, 1e-2)  # m, rad: a perspective that moved by less shows the same


class SightChange(NamedTuple):
    """A change of visibility: a thing came into the sight of a perspective, or went out of it."""

    perspective: str
    thing: str
    seen: bool
    visible: VisibleFraction


class VisibilityMonitor:
    """Tracks which perspective of a world sees which things, with hysteresis.

    A visible thing stays so until its share is clearly below the least.

    Pictures are drawn anew only from perspectives that moved, or when something else did. To be used by one thread.

    Args:
        memory: the world.
        perspectives: names of cameras and persons; all by default, also those that come.
        least_share: of the pixels that a thing would have alone, from which on it is seen.
        least_pixels: of a thing that is seen.
        band: by how much the share of what is seen may be below the least.
        width: px, of the pictures.
        kinds: types of nodes that count as perspectives: `camera`, `person`.
    """

    def __init__(
        self,
        memory: Memory,
        perspectives: Iterable[str] | None = None,
        *,
        least_share: float = LEAST_SHARE,
        least_pixels: int = LEAST_PIXELS,
        band: float = BAND,
        width: int = WIDTH,
        kinds: Iterable[str] = PERSPECTIVES,
    ) -> None:
        self._memory = memory
        self._kinds = frozenset(kinds)
        self._names = None if perspectives is None else frozenset(perspectives)
        self._least_share, self._least_pixels, self._band, self._width = least_share, least_pixels, band, width
        self._posed: list[Posed] = []
        self._drawn: dict[str, tuple[Perspective, Picture]] = {}
        self._visibilities: dict[tuple[str, str], VisibleFraction] = {}
        self._seen: frozenset[tuple[str, str]] = frozenset()
        self.scene = VisibleScene([], frozenset())
        """What there was at the last look."""
        self.pictures = 0
        """How many were drawn."""

    @property
    def visibilities(self) -> Mapping[tuple[str, str], VisibleFraction]:
        """Visible fractions at the last look, by (perspective, thing), for all perspectives."""
        return self._visibilities

    @property
    def seen(self) -> frozenset[tuple[str, str]]:
        """(perspective, thing) of all that is seen."""
        return self._seen

    @property
    def perspectives(self) -> list[str]:
        """Names of the perspectives that were drawn at the last look."""
        return list(self._drawn)

    def sees(self, perspective: str, thing: str) -> bool:
        """Whether a thing was seen from there at the last look."""
        return (perspective, thing) in self._seen

    def picture(self, perspective: str) -> Picture:
        """The picture of a perspective at the last look. Raises `KeyError` if it was not drawn."""
        return self._drawn[perspective][1]

    def update(self) -> list[SightChange]:
        """Look again; returns what came into sight, or went out of it, since the last time."""
        posed = read_posed(self._memory)
        if not _is_same(posed, self._posed) or any(one.meshes for one in posed):
            self._posed, self._drawn = posed, {}
            self.scene = VisibleScene.of(self._memory, posed)
        self._look()
        things = sorted(self.scene.things)
        self._visibilities = {
            (name, thing): picture.visible(thing) for name, (_, picture) in self._drawn.items() for thing in things
        }
        before, self._seen = (
            self._seen,
            frozenset(key for key, visible in self._visibilities.items() if self._is_seen(key, visible)),
        )
        nothing = VisibleFraction(0.0, 0, 0, "")
        return [
            SightChange(*key, key in self._seen, self._visibilities.get(key, nothing))
            for key in sorted(before ^ self._seen)
        ]

    def _wanted(self) -> list[str]:
        """Names of the perspectives that are there and count; unless they were named, no more than are usual."""
        memory = self._memory
        if self._names is not None:
            return [node.name for node in nodes_by_name(memory, self._kinds) if node.name in self._names]
        found = persons_there(memory, memory.clock.now()) if PERSON in self._kinds else []
        if CAMERA in self._kinds:
            found += camera_nodes(memory)
        return sorted(node.name for node in found)

    def _look(self) -> None:
        """Draw the pictures that are not up to date."""
        drawn = {}
        for perspective in read_perspectives(self._memory, self._wanted(), self._width):
            known = self._drawn.get(perspective.name)
            if known is None or not _is_still(known[0], perspective):
                known = (perspective, self.scene.seen_from(perspective))
                self.pictures += 1
            drawn[perspective.name] = known
        self._drawn = drawn

    def _is_seen(self, key: tuple[str, str], visible: VisibleFraction) -> bool:
        enough = is_enough(visible.share, key in self._seen, self._least_share, self._band)
        return enough and visible.pixels >= self._least_pixels


def _is_same(posed: list[Posed], before: list[Posed]) -> bool:
    if [one[:4] for one in posed] != [one[:4] for one in before]:
        return False
    if not posed:
        return True
    moved = np.abs(np.array([a.matrix - b.matrix for a, b in zip(posed, before, strict=True)])).max(axis=(1, 2))
    limits = np.array([_SWAYS if one.kind == PERSON else _STILL for one in posed])
    return bool((moved < limits).all())


def _is_still(before: Perspective, now: Perspective) -> bool:
    same_lens = before.intrinsics == now.intrinsics
    return same_lens and _STEADY.covers(before.world_from_view, now.world_from_view)
