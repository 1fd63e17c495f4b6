"""What is printed where standard output cannot hold every character, is no terminal, or cannot redraw lines."""

from __future__ import annotations

import codecs
import io
import os
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

REPLACED = {
    "✓": "+", "✗": "x", "▶": ">", "■": "#", "❚": "|", "━": "-", "·": ".", "←": "<-", "→": "->", "↑": "^", "↓": "v",
    "≤": "<=", "≥": ">=", "×": "x", "±": "+-", "°": " deg", "–": "-", "—": "-", "…": "...", "‘": "'", "’": "'",
    "“": '"', "”": '"',
}  # fmt: skip
"""What stands for characters that commands print, where the output's encoding lacks them; `?` stands for all others."""

_HANDLER = "dsr-replaced"
_NO_END = 10_000  # columns: more than any line has, and rich still lays tables out at once


def _replace(error: UnicodeError) -> tuple[str, int]:
    """What is written instead of characters that cannot be encoded; an error handler of `codecs`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(REPLACED.get(character, "?") for character in lacking), error.end


codecs.register_error(_HANDLER, _replace)


def replace_what_cannot_be_written() -> None:
    """From now on, standard output and standard error replace characters that their encoding lacks.

    Otherwise a name from the graph, or a mark of ours, would end a command in a terminal that is set to Latin-1.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def make_console(**options: Any) -> Console:
    """A console for people and pipes. Lines for a pipe or file have no end, unless `COLUMNS` says where it is.

    Names stay whole there: what `grep` looks for is not spread over two lines.
    """
    from rich.console import Console  # slow to import, and not needed for `--help` and `--version`

    console = Console(highlight=False, **options)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _NO_END
    return console


def redraws(console: Console) -> bool:
    """Whether what was drawn can be drawn over: on a terminal, unless it is a dumb one (`TERM=dumb`)."""
    return console.is_terminal and not console.is_dumb_terminal
