"""How a history begins: processes with empty disks in a folder of their own, and limits that are soon met."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.years.disk import FailingDisk, failing_disks
from benchmarks.years.history import History
from benchmarks.years.meshes import PIECE
from dsr.crdt import pieces
from dsr.geometry import transfer
from dsr.persistence import keeper

KEPT = 2
"""Processes that keep the state on a disk."""
SHORT_JOURNAL = 2048
"""bytes, so that generations follow one another within minutes"""
MOST_EXAMINED = (8, 40, 2000)
"""Elements that an answer looks at in one piece: pieces of all sizes, and not so many that they take longer than
all have to catch up, at two ticks each"""
IN_MEMORY = next((name for name in ("/dev/shm",) if os.access(name, os.W_OK)), None)
"""Folder for the files of simulated disks, where there is one in memory: what a disk loses is simulated, too."""


@contextlib.contextmanager
def begun(places: int, seed: int, *, secured: bool = False) -> Iterator[History]:
    """A history that begins: processes with empty disks, of which journals are short and answers come in many pieces.

    Args:
        places: processes, of which the first `KEPT` have disks.
        seed: of all that is random.
        secured: see `History`.
    """
    examined = MOST_EXAMINED[np.random.default_rng(seed).integers(len(MOST_EXAMINED))]
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="dsr-years-", dir=IN_MEMORY)))
        disks = [FailingDisk(folder / str(place), seed + place) for place in range(min(KEPT, places))]
        stack.enter_context(failing_disks(disks))
        stack.enter_context(mock.patch.object(keeper, "LEAST_JOURNAL", SHORT_JOURNAL))
        stack.enter_context(mock.patch.object(pieces, "MAX_EXAMINED", examined))
        stack.enter_context(mock.patch.object(transfer, "MOST_ASKED", PIECE))
        yield History(places, seed, disks, secured=secured)
