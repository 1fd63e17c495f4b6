"""Shows how far a measurement is: one line that changes on a terminal, lines now and then elsewhere."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.markup import escape

from benchmarks.rows import Row, number
from benchmarks.timing import monotonic

EVERY = 10.0
"""s between two steps that are printed where nobody sees a line change: a log stays short, and nobody takes a long
group for a stuck one."""


class Progress:
    """Tells steps and rows to a person or a log.

    Args:
        console: where to.
        show: shows a step on the line that changes; None where there is no such line.
        now: gives the time, s.
    """

    def __init__(
        self, console: Console, show: Callable[[str], None] | None, now: Callable[[], float] = monotonic
    ) -> None:
        self._console = console
        self._show = show
        self._now = now
        self._start = now()
        self._told_at = self._start - EVERY

    def step(self, text: str) -> None:
        """Tell what is being measured now."""
        if self._show is not None:
            self._show(text)
        elif self._now() - self._told_at >= EVERY:
            self._tell(text)

    def row(self, row: Row) -> None:
        """Tell a row as soon as it was measured."""
        ratio = f", {number(row.ratio)} of {row.peer[0].name}" if row.peer and row.ratio is not None else ""
        self._tell(f"{row.row}: {number(row.value)} {row.unit}{ratio}")

    def _tell(self, text: str) -> None:
        self._told_at = self._now()
        self._console.print(escape(f"{self._told_at - self._start:5.0f} s  {text}"), soft_wrap=True)


@contextlib.contextmanager
def progress_on(console: Console) -> Iterator[Progress]:
    """Show progress on a console for as long as the context lasts."""
    if not console.is_terminal:
        yield Progress(console, None)
        return
    with console.status("starting", spinner="line") as status:
        yield Progress(console, lambda text: status.update(escape(text)))
