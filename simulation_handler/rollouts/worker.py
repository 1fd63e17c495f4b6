"""A process that simulates scenes for the one that started it, until that one closes the connection or dies.

    python -m simulation_handler.rollouts.worker DESCRIPTOR

The descriptor is that of a socket, on which it says `(READY, None)`, then answers each `(number, scene, seconds)` by
`(number, outcome)`, or by `(number, text)` if the scene cannot be simulated. Standard input is its lifeline.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from multiprocessing.connection import Connection
from typing import Any

from simulation_handler.rollouts.engine import Engine, Outcome
from simulation_handler.rollouts.scene import Scene
from simulation_handler.simulator import SimulationError

READY = 0
"""Number of the first message; jobs have others."""
Reply = tuple[int, Outcome | str | None]


def main() -> None:
    """Answer until the connection ends."""
    threading.Thread(target=_end_with_parent, name="lifeline", daemon=True).start()
    connection: Connection[Any, Any] = Connection(int(sys.argv[1]))
    engine = Engine()
    with contextlib.suppress(EOFError, OSError):
        connection.send((READY, None))
        while True:
            number, scene, seconds = connection.recv()
            connection.send((number, _simulated(engine, scene, seconds)))


def _simulated(engine: Engine, scene: Scene, seconds: float) -> Outcome | str:
    try:
        return engine.run(scene, seconds)
    except SimulationError as error:
        return str(error)


def _end_with_parent() -> None:
    """The kernel closes the other end of standard input when the parent dies, however it dies."""
    with contextlib.suppress(OSError):
        while os.read(0, 1):
            pass
    os._exit(0)


if __name__ == "__main__":
    main()
