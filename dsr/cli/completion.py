"""What the shell completes: names of graphs that run here, names of systems, folders of runs; never an error."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path

from dsr.errors import DsrError
from dsr.network.rendezvous import graphs


def complete_graph(incomplete: str) -> list[str]:
    """Names of the graphs in which somebody on this machine takes part."""
    with contextlib.suppress(DsrError, OSError):
        return _beginning_with(incomplete, graphs())
    return []


def complete_system(incomplete: str) -> list[str]:
    """Names of the systems in `etc/systems`; nothing for a path, which the shell completes itself."""
    from dsr.runtime.system import known_systems  # every command has this module, and few need that one

    return _beginning_with(incomplete, known_systems())


def complete_recording(incomplete: str) -> list[str]:
    """The folders in `runs/` with recordings, newest first; nothing for another path."""
    with contextlib.suppress(OSError):
        files = sorted(Path("runs").glob("*/*.mcap"), key=lambda file: -file.stat().st_mtime)
        return _beginning_with(incomplete, dict.fromkeys(str(file.parent) for file in files))
    return []


def _beginning_with(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
