"""The files of a state folder: generations of a snapshot and a journal of later changes.

`journal-7` begins before `snapshot-7` is taken, so a snapshot with its journal and all later ones is the whole state.
The generation before the newest is kept: if the newest snapshot is damaged, nothing is lost.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from dsr.crdt.delta import Delta
from dsr.errors import ConfigError, WireError
from dsr.files.private_files import DRAFT_SUFFIX, new_file, replacing, sync_folder
from dsr.persistence.records import HEADER, append_record, read_records
from dsr.replication.wire import decode_kept, encode_delta

_log = logging.getLogger("dsr.persistence")


class Generations:
    """Reads and writes the files of one folder; the caller holds its lock."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        for draft in folder.glob(f".*{DRAFT_SUFFIX}"):  # a crash left it
            draft.unlink(missing_ok=True)
        numbers = [*self._numbers("snapshot"), *self._numbers("journal")]
        self.newest = max(numbers, default=0)
        """Number of the newest generation; 0 if there is none."""

    def _numbers(self, kind: str) -> list[int]:
        stems = (path.name.removeprefix(f"{kind}-") for path in self._folder.glob(f"{kind}-*"))
        return sorted(int(stem) for stem in stems if stem.isdecimal())

    def _file(self, kind: str, number: int) -> Path:
        return self._folder / f"{kind}-{number:06d}"

    def restored(self) -> Iterator[Delta]:
        """The state in pieces, to be joined in any order.

        Raises:
            ConfigError: if there are snapshots but none can be read.
        """
        snapshots = self._numbers("snapshot")
        base = 0
        for number in reversed(snapshots):
            deltas = self._snapshot(number)
            if deltas:
                base = number
                yield from deltas
                break
        if snapshots and not base:
            raise ConfigError(f"no snapshot in {self._folder} can be read; move the folder away to begin anew")
        journals = [number for number in self._numbers("journal") if number >= base]
        for number in journals:
            yield from self._journal(number)
        if snapshots or journals:
            yield Delta(live=frozenset(), examined=[])  # writes to what is known by now to be gone wait no more

    def _snapshot(self, number: int) -> list[Delta]:
        """The pieces of a snapshot; none if it is not complete: the last piece is the one that says what lives."""
        file = self._file("snapshot", number)
        try:
            records = read_records(file)
            deltas = [decode_kept(payload) for payload in records.payloads]
            problem = records.problem or ("" if deltas and deltas[-1].live is not None else "it is not complete")
        except (ConfigError, WireError) as error:
            deltas, problem = [], str(error)
        if problem:
            _log.warning("%s is damaged (%s): restoring from the one before and what was new since", file, problem)
            return []
        return deltas

    def _journal(self, number: int) -> Iterator[Delta]:
        file = self._file("journal", number)
        records = read_records(file)
        if records.problem:
            _log.warning("%s: %s, as a crash leaves it; what stands before is restored", file, records.problem)
        for payload in records.payloads:
            try:
                yield decode_kept(payload)
            except WireError as error:
                _log.warning("%s: a record was left out: %s", file, error)

    def begin(self) -> IO[bytes]:
        """Begin the next generation: its journal, empty. Raises `OSError`."""
        self._drop_empty()
        journal = new_file(self._file("journal", self.newest + 1))
        self.newest += 1
        journal.write(HEADER)
        return journal

    def write_snapshot(self, deltas: Iterable[Delta]) -> int:
        """Write the snapshot of the newest generation and drop those before the last; its bytes. Raises `OSError`."""
        size = len(HEADER)
        with replacing(self._file("snapshot", self.newest)) as file:
            file.write(HEADER)
            for delta in deltas:
                size += append_record(file, encode_delta(delta))
        self._drop_old()
        return size

    def _drop_empty(self) -> None:
        """Remove the journals of generations that could not be begun."""
        for number in set(self._numbers("journal")) - set(self._numbers("snapshot")):
            file = self._file("journal", number)
            if file.stat().st_size <= len(HEADER):
                file.unlink()

    def _drop_old(self) -> None:
        """Keep the newest two snapshots and all journals since the first of them."""
        kept = self._numbers("snapshot")[-2:]
        for kind in ("snapshot", "journal"):
            for number in self._numbers(kind):
                if number < kept[0]:
                    self._file(kind, number).unlink(missing_ok=True)
        sync_folder(self._folder)
