"""Stands in for the arm in a world without one."""

from __future__ import annotations


class NoArm:
    """An arm without joints that holds nothing: as much of `Arm` as is asked of every world."""

    names: tuple[str, ...] = ()
    positions: tuple[float, ...] = ()
    velocities: tuple[float, ...] = ()
    opening = 0.0
    held: str | None = None

    def let_go(self) -> None:
        """Do nothing: there is no held object."""

    def step(self) -> None:
        """Nothing of it moves."""
