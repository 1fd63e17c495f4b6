"""Files that cost far more to read than they are large."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.attacks.attack import Arena, Attack, Outcome
from benchmarks.attacks.files.bombs import BOMBS
from benchmarks.attacks.files.limited import read_limited


def _bombs(arena: Arena) -> Outcome:
    failed, slowest, largest = [], 0.0, 0
    with tempfile.TemporaryDirectory() as folder:
        for bomb in BOMBS:
            file = Path(folder) / bomb.name
            file.write_bytes(bomb.make())
            reading = read_limited(file)
            file.unlink()
            slowest, largest = max(slowest, reading.seconds), max(largest, reading.peak)
            if not reading.ended_well:
                failed.append(f"{bomb.name}: {reading.said[-100:]}")
    effect = f"{len(BOMBS) - len(failed)} of {len(BOMBS)} ended well; most {slowest:.0f} s CPU, {largest >> 20} MiB"
    return Outcome(not failed, "; ".join([effect, *failed]), {"seconds": slowest, "peak_bytes": largest})


ATTACKS = [
    Attack(
        "file-bombs",
        "hands over recordings, models, graphs, scenarios and images that unpack to gigabytes",
        "each is read or refused with a clear error, in 30 s of CPU and 4 GiB of address space",
        _bombs,
    )
]
