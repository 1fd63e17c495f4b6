"""The time for which writes are held back to be sent together: entered and left in few calls, in each tick."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager


class Hold(AbstractContextManager[None]):
    """Calls `change(1)` when it is entered and `change(-1)` when it is left."""

    __slots__ = ("_change",)

    def __init__(self, change: Callable[[int], None]) -> None:
        self._change = change

    def __enter__(self) -> None:
        self._change(1)

    def __exit__(self, *_: object) -> None:
        self._change(-1)
