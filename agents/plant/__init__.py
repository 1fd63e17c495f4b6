"""The simulated reality: a physics world that plays the arm, the camera and the experimenter.

`Plant` is loaded on first use, so that the drivers (`agents.plant.driver`) need no physics engine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.plant.plant import Plant

__all__ = ["Plant"]


def __getattr__(name: str) -> Any:
    if name != "Plant":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from agents.plant.plant import Plant

    return Plant
