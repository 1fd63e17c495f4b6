"""Keeps all worlds and parts that a memory holds, each in a folder of its own: they outlive those who made them.

    keeper = WorldKeeper(memory, Path("state"))     # worlds of which the folder holds the state are there again

The base is kept in the folder itself (dsr/persistence/keeper.py), every other world in `worlds/<name>/<channel>` below.
The keeper has every world open, so it also hands them on; it drops what is deleted, and its files. Parts of the graph
(dsr/parts) are kept in `parts/<name>`. A part that is not held any more leaves its files, for whoever holds it later.
"""

from __future__ import annotations

import contextlib
import logging
import shutil
import threading
from collections.abc import Collection
from pathlib import Path

from dsr.errors import DsrError
from dsr.graph.schema import WORLD_RECORD
from dsr.memory import Memory
from dsr.network.keys import ALL, BASE
from dsr.persistence.generations import Generations
from dsr.persistence.keeper import StateKeeper
from dsr.replication.collector import collector_paused
from dsr.threads import new_thread

PERIOD = 0.25
"""s between two looks at the list of worlds."""
RETRY = 5.0
"""s until the list is looked through again although it is as it was, and worlds that could not be kept are tried."""
MOST_WORLDS = 256
"""Worlds that are kept: each takes two threads, and who may list worlds may list any number. Those that the folder
holds come first."""

_log = logging.getLogger("dsr.persistence")


class WorldKeeper:
    """Restores base, worlds and parts of a memory from a folder, and keeps their state there until it is closed.

    Args:
        memory: the memory of the base; it should have joined its graph.
        folder: made if missing; belongs to one keeper at a time.
        threaded: work in threads of its own. Without, call `flush` several times a second.
        interest: parts to hold and to keep, "*" for all, listed or not. Parts that the memory holds are kept anyway.

    Raises:
        ConfigError: if the folder is in use, cannot be written, or no snapshot of the base in it can be read.
        TransportError: if those who hold one of the parts do not answer.
    """

    def __init__(
        self, memory: Memory, folder: Path, *, threaded: bool = True, interest: Collection[str] = ()
    ) -> None:
        self._memory = memory
        self._folder, self._parts_folder = folder / "worlds", folder / "parts"
        self._threaded = threaded
        self._keepers: dict[Path, StateKeeper] = {}
        self._parts: dict[str, StateKeeper] = {}
        self._refused: set[Path] = set()
        self._told: set[Path] = set()
        self._retry_at = 0.0
        self._list = memory.watch(node_type=WORLD_RECORD)
        self._stop = threading.Event()
        self._looking = threading.Lock()
        self.base = StateKeeper(memory, folder, threaded=threaded)
        """The keeper of the base."""
        self._hold_parts(interest)
        self._look()
        self._thread = new_thread(self._run, "dsr-worlds") if threaded else None
        memory.on_close(self.close)
        if self._thread:
            self._thread.start()

    @property
    def restored(self) -> bool:
        """Whether the folder held a state of the base."""
        return self.base.restored

    def flush(self) -> None:
        """Follow the list of worlds, and write new changes of all of them to the disk, now."""
        self._look()
        self.base.flush()
        for keeper in [*self._keepers.values(), *self._parts.values()]:
            keeper.flush()

    def close(self) -> None:
        """Keep parts that came since the last look, and follow the list no more; worlds are kept until they close."""
        if self._stop.is_set():
            return
        self._stop.set()
        if self._thread and self._thread is not threading.current_thread():
            self._thread.join()
        self._list.close()
        with self._looking:
            self._keep_parts(self._memory.interest)

    def _run(self) -> None:
        while not self._memory.clock.wait(self._stop, PERIOD):
            self._look()

    def _look(self) -> None:
        """Keep what is new in the list, and drop what is not in it any more.

        Somebody may have listed any number of worlds: as long as nothing changes, nobody pays for all of them.
        """
        with self._looking:
            now = self._memory.clock.monotonic()
            if self._list.poll() or now >= self._retry_at:
                self._follow_list(now)
            self._keep_parts(self._memory.interest)

    def _follow_list(self, now: float) -> None:
        channels = self._memory.world_channels()
        wanted = {self._folder / name / channels[name]: name for name in self._parents_first(channels)}
        for folder in [folder for folder in self._keepers if folder not in wanted]:
            self._keepers.pop(folder).close()
        self._remove_others(set(wanted))
        self._told = {folder for folder in self._told if folder in wanted or folder.parent == self._parts_folder}
        new = [folder for folder in wanted if folder not in self._keepers and folder not in self._refused]
        if now < self._retry_at:
            new = [folder for folder in new if folder not in self._told]
        else:
            self._retry_at = now + RETRY
        for folder in sorted(new, key=lambda folder: not folder.exists()):
            if len(self._keepers) < MOST_WORLDS:
                self._keep(wanted[folder], folder)
            else:
                self._tell(folder, f"world {wanted[folder]!r} is not kept: {MOST_WORLDS} others are")

    def _hold_parts(self, interest: Collection[str]) -> None:
        """Hold the parts that are asked for, first those of which something is kept here."""
        if not interest:
            return
        kept = {folder.name for folder in _own_folders(self._parts_folder)}
        wanted = [info.name for info in self._memory.parts()] if ALL in interest else interest
        self._memory.hold_kept_parts(sorted(kept.intersection(wanted)), lambda part: self._keep_parts((part,)))
        self._memory.hold_part(*interest, unlisted=True)

    def _keep_parts(self, names: Collection[str]) -> None:
        """Keep these parts, and each other one no more that is not held."""
        for name in [name for name in self._parts if name not in self._memory.interest]:
            self._parts.pop(name).close()
        for name in names:
            folder = self._parts_folder / name
            if name in self._parts or folder in self._refused:
                continue
            try:
                self._parts[name] = StateKeeper(self._memory, folder, threaded=self._threaded, part=name)
            except (DsrError, RuntimeError) as error:
                self._tell(folder, f"part {name!r} is not kept: {error}")
                if folder.exists():
                    self._refused.add(folder)

    def _parents_first(self, names: Collection[str]) -> list[str]:
        """Overlays after what they show, which is opened with them."""
        parents = {info.name: info.looks_through_to for info in self._memory.worlds()}
        ordered: dict[str, None] = {}
        for name in sorted(set(names) - {BASE}):
            chain: dict[str, None] = {}
            at: str | None = name
            while at is not None and at in names and at not in chain and at not in ordered:
                chain[at] = None
                at = parents.get(at)
            ordered |= dict.fromkeys(reversed(chain))
        return list(ordered)

    def _keep(self, name: str, folder: Path) -> None:
        try:
            with collector_paused():
                content = tuple(Generations(folder).restored())
            world = self._memory.hold_world(name, content=content)
            self._keepers[folder] = StateKeeper(world, folder, threaded=self._threaded, content=content)
        except (DsrError, OSError, RuntimeError) as error:  # try again, unless the folder is what is wrong
            self._tell(folder, f"world {name!r} is not kept: {error}")
            if folder.exists():
                self._refused.add(folder)

    def _tell(self, folder: Path, text: str) -> None:
        """Log what is wrong with a world, once."""
        if folder not in self._told:
            self._told.add(folder)
            _log.warning("%s", text)

    def _remove_others(self, wanted: set[Path]) -> None:
        """Deleted worlds leave no files."""
        for world in _own_folders(self._folder):
            for folder in _own_folders(world):
                if folder not in wanted:
                    shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):
                world.rmdir()  # if it is empty


def _own_folders(folder: Path) -> list[Path]:
    """The folders in `folder`, if it is one; what lies behind a link is somebody else's, and never removed."""
    if folder.is_symlink() or not folder.is_dir():
        return []
    return [found for found in folder.iterdir() if found.is_dir() and not found.is_symlink()]
