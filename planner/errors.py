"""Why there is no plan, and why one cannot be carried out.

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


class Setback(Exception):  # noqa: N818 - nothing is wrong with the program
    """Execution cannot go on as planned."""


class PlanDeviation(Setback):
    """The relations changed, and nobody planned it."""


class Outdated(Setback):
    """The next step is not possible by the present belief."""


class Failure(Setback):
    """An action failed, or did not have its effect."""


class Interruption(Setback):
    """The arm controller is gone, or a camera may have moved; the world may be as it was."""


class GivingUp(Exception):  # noqa: N818
    """The goal cannot be reached: the status to write, and why."""

    def __init__(self, status: str, explanation: str) -> None:
        super().__init__(explanation)
        self.status = status
