"""Computes which perspective of a world sees which things, at this moment."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from dsr.memory import Memory
from dsr.visibility.bodies import Posed, bodies_of, read_posed
from dsr.visibility.perspectives import PERSON, WIDTH, Perspective, read_perspectives
from dsr.visibility.picture import Body, Picture, VisibleFraction

LEAST_SHARE = 0.2
"""Least share (0 to 1) of a thing's pixels, as it would have alone, from which on the thing is visible."""
BAND = 0.05
"""Hysteresis of the share: a visible thing stays visible until its share is below `LEAST_SHARE` by this much."""
LEAST_PIXELS = 3
"""Least number of pixels of a visible thing."""


class VisibleScene(NamedTuple):
    """The bodies of a world that can be seen, or hide others."""

    bodies: list[Body]
    things: frozenset[str]
    """Names of those that are looked for."""
    persons: frozenset[str] = frozenset()
    """Names of the persons."""

    @staticmethod
    def of(memory: Memory, posed: list[Posed] | None = None) -> VisibleScene:
        """The scene of a world, or of what was read of it."""
        posed = read_posed(memory) if posed is None else posed
        things = frozenset(one.name for one in posed if one.is_thing)
        persons = frozenset(one.name for one in posed if one.kind == PERSON)
        return VisibleScene(bodies_of(memory, posed), things, persons)

    def seen_from(self, perspective: Perspective) -> Picture:
        """Draw the scene from a perspective. A perspective's own body hides nothing from it."""
        others = [body for body in self.bodies if body.name != perspective.name]
        return Picture(perspective.world_from_view, perspective.intrinsics, others, self.things | self.persons)


def visibility(
    memory: Memory, names: Iterable[str] | None = None, width: int = WIDTH
) -> dict[tuple[str, str], VisibleFraction]:
    """Compute how much of every thing is seen from every perspective of a world, by (perspective, thing).

    Args:
        memory: the world.
        names: of the perspectives; all by default.
        width: px, of the pictures that are drawn for it.

    Raises:
        ConfigError: for a name of no perspective, or a width that no picture has.
    """
    perspectives = read_perspectives(memory, names, width)
    scene = VisibleScene.of(memory)
    return {
        (perspective.name, thing): picture.visible(thing)
        for perspective in perspectives
        for picture in [scene.seen_from(perspective)]
        for thing in sorted(scene.things)
    }


def is_enough(share: float, was_seen: bool, least_share: float = LEAST_SHARE, band: float = BAND) -> bool:
    """Whether such a share of something is enough to be seen, if it was before, or was not."""
    return share >= least_share - (band if was_seen else 0.0)


def is_seen(visible: VisibleFraction, least_share: float = LEAST_SHARE, least_pixels: int = LEAST_PIXELS) -> bool:
    """Whether enough of a thing shows to call it visible."""
    return visible.share >= least_share and visible.pixels >= least_pixels
