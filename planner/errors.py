"""Why there is no plan.

PlanningError
├── SolverMissing       it is not installed
├── SolverFailed        it broke off, took too long, or wrote what is no plan
├── GoalNotPossible     the goal names what cannot be moved, or is nowhere
├── Unsolvable          the solver has proved that no plan leads to the goal
└── NoPlace             nowhere on the table is room
"""

from __future__ import annotations

from dsr.errors import DsrError


class PlanningError(DsrError):
    """Root of the errors of this package."""


class SolverMissing(PlanningError):  # noqa: N818 - reads better than SolverMissingError
    """Fast Downward is not installed."""


class SolverFailed(PlanningError):  # noqa: N818
    """The solver gave no answer."""


class GoalNotPossible(PlanningError):  # noqa: N818
    """The goal cannot be expressed in the domain."""


class Unsolvable(PlanningError):  # noqa: N818
    """There is no plan."""


class NoPlace(PlanningError):  # noqa: N818
    """There is no room."""
