"""Recordings of strangers, on which agents are run anew."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from agents.replay.anew import run_anew
from benchmarks.attacks.attack import Arena, Attack, Outcome
from dsr.errors import ConfigError

_AGENT = "surprise"
_BEGIN = 1e9
_DECADES = 1e10
_MOST_SECONDS = 30.0
"""CPU seconds; each second of a recording takes 50 ticks"""


def _recording(folder: Path, *stamps: float, **metadata: str) -> Path:
    writer = RecordingWriter(folder / "recording.mcap", {"graph": "tabletop", **metadata})
    for stamp in stamps:
        writer.write(RecordedMessage(stamp, "truth", b""))
    writer.close()
    return writer.path


def _names_a_program(describe: Callable[[Path], dict[str, str]], module: str) -> Callable[[Arena], Outcome]:
    def run(arena: Arena) -> Outcome:
        with tempfile.TemporaryDirectory() as name:
            folder, refused = Path(name), ""
            sys.modules.pop(module, None)  # whoever imported one of that name before is no attacker
            (folder / f"{module}.py").write_text("raise SystemExit('this program was run')\n", encoding="utf-8")
            try:
                run_anew(_recording(folder, _BEGIN, **describe(folder)), [_AGENT])
            except ConfigError as error:
                refused = str(error)
        ran = module in sys.modules or "this program was run" in refused
        return Outcome(bool(refused) and not ran, f"refused: {bool(refused)}; imported: {ran}")

    return run


def _by_system(folder: Path) -> dict[str, str]:
    system = folder / "system.toml"
    system.write_text(f'graph = "x"\n[[agent]]\nname = "{_AGENT}"\nclass = "found_beside:Agent"\n', encoding="utf-8")
    return {"system": str(system)}


def _by_driver(folder: Path) -> dict[str, str]:
    return {"system": "tabletop", "agents": json.dumps({_AGENT: {"driver": "this:c"}})}


def _skips_decades(arena: Arena) -> Outcome:
    stamps = [_BEGIN + later for later in (0.0, 0.5, _DECADES, _DECADES + 0.5)]
    with tempfile.TemporaryDirectory() as name:
        begin = time.process_time()
        outcome = run_anew(_recording(Path(name), *stamps), [_AGENT])
        took = time.process_time() - begin
    held = took < _MOST_SECONDS and not outcome.failures
    return Outcome(held, f"{outcome.seconds:.3g} s were run in {took:.1f} s", {"seconds": took})


ATTACKS = [
    Attack(
        "recording-system",
        "hands over a recording whose system is a file beside a program",
        "the program is not run, and who reads the recording is told",
        _names_a_program(_by_system, "found_beside"),
    ),
    Attack(
        "recording-driver",
        "hands over a recording of an agent whose driver is a module",
        "the module is not imported, and who reads the recording is told",
        _names_a_program(_by_driver, "this"),
    ),
    Attack(
        "recording-decades",
        "hands over a recording of four messages that span three centuries",
        "agents are run on it in a moment",
        _skips_decades,
    ),
]
