"""The interface of the methods that explain surprises, and the type of an explanation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from dsr.vocabulary.explained import ExplainedChange, text_of
from simulation_handler.contact.placement import Placement
from simulation_handler.explaining.hypotheses import Hypothesis
from simulation_handler.explaining.situation import Situation
from simulation_handler.shapes.geometry import Solid


@dataclass(frozen=True)
class Explanation:
    """An explanation by some method, and the changes of the belief that follow from it."""

    changes: tuple[ExplainedChange, ...]
    """What happened."""
    about: tuple[str, ...]
    """Objects that it explains, sorted."""
    solids: Mapping[str, Solid] = field(default_factory=dict)
    """Solids of the objects that the explanation puts elsewhere, at their new poses, by name."""
    placements: Mapping[str, Placement] = field(default_factory=dict)
    """Placements of those objects among `solids` that are seen."""
    held: frozenset[str] = frozenset()
    """Names of those objects among `solids` that something unknown holds."""
    removed: frozenset[str] = frozenset()
    """Objects that are gone."""
    ended: tuple[tuple[str, str], ...] = ()
    """Relations (object, support) that are to end, whatever touches."""
    unexplained: frozenset[str] = frozenset()
    """Objects that are still surprising."""
    changes_belief: bool = True
    """False if all stays as it is: false percepts, a moved camera."""
    score: float | None = None
    """nats: minus its log-probability, up to a constant; None from methods that do not weigh."""
    alternatives: tuple[tuple[float, str], ...] = ()
    """Scores and texts of the rejected hypotheses, the best first."""
    hypothesis: Hypothesis | None = None

    @property
    def text(self) -> str:
        """The changes in a line, such as `moved_with_supports(cube_3; cube_4)`."""
        return text_of(self.changes)


class ExplainingPolicy(Protocol):
    """A method that explains surprises."""

    name: str

    def prepare(self) -> None:
        """Something is not as believed: an explanation may be asked for soon. Called again and again."""

    def explain(self, situation: Situation) -> Explanation | None:
        """The best explanation of `situation.surprising`; None to wait for more evidence."""

    def close(self) -> None:
        """Release the resources of the method."""
