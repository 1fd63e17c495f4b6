"""Hypotheses: sets of changes that together may explain the percepts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

FALLS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions, in the frame of the object, in which it may have fallen off its support."""
FROM_GLIMPSE = len(FALLS)
"""Stands for a direction: it fell from where it was last seen. So do the numbers above, for other ways of going on."""


@dataclass(frozen=True, order=True)
class Move:
    """A move of a seen object to its percept, with the unseen objects that moved along."""

    name: str
    moved_along: tuple[str, ...] = ()
    """Unseen objects that moved rigidly with it: its supports, its contents."""
    beneath: tuple[str, ...] = ()
    """Unseen objects from elsewhere that are below it now, lowest first."""
    held: bool = False
    """Whether something unknown holds the object and those that moved along."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of changes that together lead from the beliefs to the percepts."""

    moves: tuple[Move, ...] = ()
    """One move for each object that moved and is seen, sorted."""
    removed: frozenset[str] = frozenset()
    """Objects that were taken away altogether."""
    fallen: tuple[tuple[str, int], ...] = ()
    """Unseen objects that fell off their support, and in which of the directions `FALLS`, or above those; sorted."""
    kept: frozenset[str] = frozenset()
    """Objects whose percepts are false: they are where they were believed to be."""
    camera_moved: bool = False
    """Whether the camera moved, instead of the objects."""

    @property
    def moved(self) -> dict[str, Move]:
        """The moves by the object that is seen."""
        return {move.name: move for move in self.moves}

    @property
    def unseen(self) -> frozenset[str]:
        """Objects that are nowhere to be seen and of which something is said."""
        hidden = {name for move in self.moves for name in (*move.moved_along, *move.beneath)}
        return frozenset(hidden) | self.removed | {name for name, _ in self.fallen}

    def with_move(self, move: Move) -> Hypothesis:
        """Copy the hypothesis with another move of one object; objects that moved along do nothing else."""
        taken = {*move.moved_along, *move.beneath}
        others = [
            replace(
                other,
                moved_along=tuple(name for name in other.moved_along if name not in taken),
                beneath=tuple(name for name in other.beneath if name not in taken),
            )
            for other in self.moves
            if other.name != move.name
        ]
        return replace(
            self,
            moves=tuple(sorted([*others, move])),
            removed=self.removed - taken,
            fallen=tuple(fall for fall in self.fallen if fall[0] not in taken),
            kept=self.kept - {move.name},
        )

    def without_percept(self, name: str) -> Hypothesis:
        """This one, with an object's percepts taken for false."""
        moves = tuple(move for move in self.moves if move.name != name)
        return replace(self, moves=moves, kept=self.kept | {name})

    def with_removed(self, names: Iterable[str]) -> Hypothesis:
        """This one, with unseen objects taken away."""
        gone = frozenset(names)
        return replace(self._without_unseen(gone), removed=self.removed | gone)

    def with_fall(self, name: str, direction: int) -> Hypothesis:
        """This one, with an unseen object fallen off its support."""
        cleared = self._without_unseen(frozenset({name}))
        return replace(cleared, fallen=tuple(sorted([*cleared.fallen, (name, direction)])))

    def _without_unseen(self, names: frozenset[str]) -> Hypothesis:
        moves = tuple(
            replace(
                move,
                moved_along=tuple(name for name in move.moved_along if name not in names),
                beneath=tuple(name for name in move.beneath if name not in names),
            )
            for move in self.moves
        )
        fallen = tuple(fall for fall in self.fallen if fall[0] not in names)
        return replace(self, moves=moves, fallen=fallen, removed=self.removed - names)
