"""Files that cost far more to read than they are large."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.attacks.attack import Arena, Attack, Outcome
from benchmarks.attacks.files.bombs import BOMBS, Bomb
from benchmarks.attacks.files.limited import read_limited


def _reading(bomb: Bomb) -> Callable[[Arena], Outcome]:
    def run(arena: Arena) -> Outcome:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / bomb.name
            file.write_bytes(bomb.make())
            size = file.stat().st_size
            reading = read_limited(file)
        cost = f"{size >> 10} KiB took {reading.seconds:.1f} s of CPU and {reading.peak >> 20} MiB"
        figures = {"seconds": reading.seconds, "peak_bytes": reading.peak, "file_bytes": size}
        return Outcome(reading.ended_well, cost if reading.ended_well else f"{cost}: {reading.said[-200:]}", figures)

    return run


ATTACKS = [
    Attack(
        f"file-{bomb.name}",
        f"hands over a file: {bomb.sentence}",
        "the file is read or refused with a clear error, in 30 s of CPU and 4 GiB of address space",
        _reading(bomb),
    )
    for bomb in BOMBS
]
