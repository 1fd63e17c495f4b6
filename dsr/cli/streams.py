"""What is printed where the output cannot hold every character, is closed, is no terminal, or cannot redraw lines."""

from __future__ import annotations

import codecs
import io
import os
import signal
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

READER_LEFT = 128 + signal.SIGPIPE
"""Exit code of a command whose output nobody reads any more, as shells give of programs that this ends."""
_HANDLER = "dsr-replaced"
_NO_END = 10_000  # columns: more than any line has, and rich still lays tables out at once


def _replace(error: UnicodeError) -> tuple[str, int]:
    """What is written instead of characters that cannot be encoded; an error handler of `codecs`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(REPLACED.get(character, "?") for character in lacking), error.end


codecs.register_error(_HANDLER, _replace)


class _Pipe(io.FileIO):
    """Standard output or error. Once its reader has gone, what is written is dropped.

    Of standard output that also ends the command, and quietly: a `SystemExit` passes all handlers of errors, closes
    what is open, and is caught by nobody.
    """

    def write(self, data: Any, /) -> int:
        """Write bytes; raises `SystemExit` if nobody reads them any more."""
        try:
            return super().write(data)
        except BrokenPipeError:
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, self.fileno())
            os.close(nothing)
            if self.fileno() == sys.__stderr__.fileno():  # type: ignore[union-attr]
                return len(data)
            raise SystemExit(READER_LEFT) from None


def open_closed_streams() -> None:
    """Let standard streams that are closed lead nowhere; what is opened next would get their numbers."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # this has the lowest number that is free
            stream = open(number, mode, closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def prepare_output() -> None:
    """From now on, standard output and standard error replace characters that their encoding lacks.

    Otherwise a name from the graph, or a mark of ours, would end a command in a terminal that is set to Latin-1.
    If the reader of standard output leaves, as `head` does, the command ends with exit code `READER_LEFT`.
    """
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is getattr(sys, f"__{name}__") and isinstance(stream, io.TextIOWrapper):
            raw = _Pipe(number, "wb", closefd=False)
            setattr(sys, name, _text(raw, stream))
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def _text(raw: _Pipe, like: io.TextIOWrapper) -> io.TextIOWrapper:
    """A text stream that writes to `raw` as `like` did."""
    at_once = like.write_through
    below: Any = raw if at_once else io.BufferedWriter(raw)
    return io.TextIOWrapper(
        below, like.encoding, _HANDLER, line_buffering=like.line_buffering, write_through=at_once
    )


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
