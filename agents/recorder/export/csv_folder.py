"""A recording as a folder of CSV files: one a table, with a header, and a README about tables, columns and units."""

from __future__ import annotations

import contextlib
import csv
import shutil
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from agents.recorder.export.samples import ExportSelection, OnProgress, rows_of
from agents.recorder.export.tables import TABLES, Table
from agents.replay.source import ReplayedGraph
from dsr.errors import ConfigError


class Exported(NamedTuple):
    """What an export has written."""

    rows: dict[str, int]
    """Number of rows of each table."""
    problems: list[str]
    """What of the recording could not be read."""
    malformed: int
    """Messages that could not be decoded."""


def export_csv(
    source: ReplayedGraph, folder: Path, wanted: ExportSelection, on_progress: OnProgress | None = None
) -> Exported:
    """Write the wanted rows of a recording to `folder`; if that fails or is interrupted, nothing is left there.

    Raises:
        ConfigError: if the folder exists and holds something, or the selection fits nothing.
    """
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise ConfigError(f"{folder}: expected a folder that does not exist, or is empty")
    folder.parent.mkdir(parents=True, exist_ok=True)
    under_way = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        exported = _write(source, under_way, wanted, on_progress)
        under_way.replace(folder)
    except BaseException:
        shutil.rmtree(under_way, ignore_errors=True)
        raise
    return exported


def _write(source: ReplayedGraph, folder: Path, wanted: ExportSelection, on_progress: OnProgress | None) -> Exported:
    counts = dict.fromkeys(wanted.tables, 0)
    tables = [table for table in TABLES if table.name in wanted.tables]
    with contextlib.ExitStack() as files:
        writers: dict[str, Any] = {}
        for table in tables:
            file = files.enter_context((folder / f"{table.name}.csv").open("w", encoding="utf-8", newline=""))
            writers[table.name] = csv.writer(file, lineterminator="\n")
            writers[table.name].writerow([column.name for column in table.columns])
        for name, (time, *rest) in rows_of(source, wanted, on_progress):
            writers[name].writerow([f"{time:.6f}", *rest])
            counts[name] += 1
    exported = Exported(counts, source.problems, source.malformed)
    (folder / "README.txt").write_text(_readme(source, tables, exported), encoding="utf-8")
    return exported


def _readme(source: ReplayedGraph, tables: list[Table], exported: Exported) -> str:
    """What the folder holds, for people."""
    lines = [f"Tables of the recording {source.index.path.name} of graph {source.index.metadata.get('graph', '')},"]
    lines += [f"whose first message arrived at {source.index.begin:.6f} s since the Unix epoch.", ""]
    lines += [f"Incomplete: {problem}" for problem in exported.problems]
    if exported.malformed:
        lines.append(f"Left out: {exported.malformed} messages that make no sense")
    for table in tables:
        lines += [f"{table.name}.csv: {exported.rows[table.name]} rows", f"  {table.meaning}"]
        lines += [f"    {column.name:<16} {column.meaning}" for column in table.columns]
        lines.append("")
    return "\n".join(lines)
