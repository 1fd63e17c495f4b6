"""A process that simulates scenes for the one that started it, until that one closes the connection or dies.

    python -m simulation_handler.physics.rollouts.worker DESCRIPTOR

The descriptor is that of a socket for the messages of messages.py; standard input is the lifeline.
"""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading

from simulation_handler.physics.rollouts.engine import Engine
from simulation_handler.physics.rollouts.messages import READY, Reply, RolloutJob, receive_job, send
from simulation_handler.physics.rollouts.scene import RolloutScene
from simulation_handler.physics.simulator import SimulationError


def main() -> None:
    """Answer until the connection ends."""
    threading.Thread(target=_end_with_parent, name="lifeline", daemon=True).start()
    engine = Engine()
    with socket.socket(fileno=int(sys.argv[1])) as connection, contextlib.suppress(OSError):
        send(connection, READY)
        while True:
            send(connection, _simulated(engine, receive_job(connection)))


def _simulated(engine: Engine, job: RolloutJob) -> Reply:
    try:
        return Reply(job.number, engine.run(RolloutScene(job.bodies), job.seconds))
    except SimulationError as error:
        return Reply(job.number, error=str(error))


def _end_with_parent() -> None:
    """The kernel closes the other end of standard input when the parent dies, however it dies."""
    with contextlib.suppress(OSError):
        while os.read(0, 1):
            pass
    os._exit(0)


if __name__ == "__main__":
    main()
