"""A replay in a terminal: joins the graph, plays, obeys keys and the control service, shows where it is."""

from __future__ import annotations

import contextlib
import math
import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from agents.replay.control import Command, Controls
from agents.replay.player import STEP, Player
from agents.replay.source import ReplayedGraph
from dsr.cli.streams import redraws
from dsr.clock import WALL_CLOCK
from dsr.vocabulary.replayed import Replayed

_SEQUENCES = {"\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left", "\x1b[H": "home", " ": "space"}
_MOST_BYTES = 1024


class Keyboard:
    """Keys pressed since the last look; none if the standard input is no terminal. A context manager."""

    def __init__(self) -> None:
        self.present = sys.stdin.isatty()
        self._before: list[Any] = []

    def __enter__(self) -> Keyboard:
        if self.present:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.present:
            with contextlib.suppress(termios.error):  # the terminal is gone
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def pressed(self) -> list[str]:
        """Names of the keys: `space`, `left`, `right`, `up`, `down`, `home`, or a character."""
        if not self.present or not select.select([sys.stdin], [], [], 0.0)[0]:
            return []
        data = os.read(sys.stdin.fileno(), _MOST_BYTES)
        self.present = bool(data)  # no more will come at the end of the input
        return list(split_keys(data.decode(errors="ignore")))


def split_keys(text: str) -> Iterator[str]:
    """The names of the keys that a terminal sent as `text`."""
    while text:
        known = next((sequence for sequence in _SEQUENCES if text.startswith(sequence)), text[0])
        yield _SEQUENCES.get(known, known)
        text = text[len(known) :]


_JUMP = 5.0  # s, of the arrow keys
_BAR = 30  # characters
_HINT = "space pause  ←→ 5 s  ↑↓ speed  home  q quit"


class Session:
    """Plays until the end, `q`, the command `quit` or Ctrl-C.

    Args:
        source: the recording.
        player: plays it.
        controls: of the player.
        tell: is given the time in the recording after each step.
        stay: at the end, hold the last state until told to quit.
        console: for the status line.
    """

    def __init__(
        self,
        source: ReplayedGraph,
        player: Player,
        controls: Controls,
        *,
        tell: Callable[[Replayed], None],
        stay: bool,
        console: Console,
    ) -> None:
        self._source = source
        self._player = player
        self._controls = controls
        self._tell = tell
        self._stay = stay
        self._console = console
        keys: dict[str, Callable[[], Command]] = {
            "space": lambda: Command("pause" if player.playing and not player.ended else "resume"),
            "left": lambda: Command("seek", player.time - _JUMP),
            "right": lambda: Command("seek", player.time + _JUMP),
            "up": lambda: Command("speed", player.speed * 2.0),
            "down": lambda: Command("speed", player.speed / 2.0 if math.isfinite(player.speed) else 1.0),
            "home": lambda: Command("seek", 0.0),
            "q": lambda: Command("quit"),
        }
        self._keys = keys

    def run(self) -> None:
        """Play."""
        clock, player, never = WALL_CLOCK, self._player, threading.Event()
        with Keyboard() as keyboard, Live(console=self._console, auto_refresh=False, transient=True) as live:
            while not (self._controls.wants_to_quit or (player.ended and not self._stay)):
                for key in keyboard.pressed():
                    if key in self._keys:
                        self._controls.obey(self._keys[key]())
                self._controls.run()
                player.step(clock.monotonic())
                self._tell(Replayed(player.begin + player.time, player.begin))
                if redraws(self._console):
                    live.update(self._line(keyboard.present), refresh=True)
                fast = player.speed == math.inf and player.playing and not player.ended
                clock.wait(never, 0.0 if fast else STEP)

    def _line(self, has_keys: bool) -> Text:
        """Where the replay is."""
        player = self._player
        share = player.time / player.until if player.until else 1.0
        filled = round(share * _BAR)
        state = "■ end " if player.ended else "▶ " if player.playing else "❚❚ "
        of_day = datetime.fromtimestamp(self._source.index.begin + player.time, UTC).strftime("%H:%M:%S")
        speed = "max" if player.speed == math.inf else f"×{player.speed:g}"
        text = Text(f"{state}{player.time:7.1f} / {player.until:.1f} s  {of_day} UTC  {speed:<5} ")
        text.append("━" * filled, "bold cyan").append("━" * (_BAR - filled), "dim")
        return text.append(f"  {_HINT}", "dim") if has_keys else text
