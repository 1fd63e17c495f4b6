"""The meshes that one process has: in memory up to a limit, behind that on disk."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from weakref import WeakValueDictionary

from dsr.errors import WireError
from dsr.geometry.cache import DiskCache
from dsr.geometry.mesh import Mesh

MEMORY_LIMIT = 1 << 28
"""bytes of meshes that are kept in memory though nobody uses them now"""
_log = logging.getLogger("dsr.meshes")


class MeshStore:
    """Meshes by hash; each is in memory once, however many ask for it. May be used from any thread.

    Args:
        disk: where meshes outlive the process; nowhere if None.
        limit: bytes that are kept in memory; those used least lately are left to the disk.
    """

    def __init__(self, disk: DiskCache | None = None, limit: int = MEMORY_LIMIT) -> None:
        self.disk = disk
        self.limit = limit
        self.size = 0
        """bytes that are kept in memory now"""
        self._kept: OrderedDict[str, Mesh] = OrderedDict()
        self._alive: WeakValueDictionary[str, Mesh] = WeakValueDictionary()
        self._lock = threading.Lock()

    def put(self, mesh: Mesh) -> Mesh:
        """Keep a mesh, in memory and on disk; returns the equal one that was here before, if any."""
        kept = self._remember(mesh)
        if self.disk is not None:
            self.disk.write(mesh.hash, mesh.data)
        return kept

    def get(self, hash: str) -> Mesh | None:
        """The mesh with this hash, if it is here."""
        with self._lock:
            mesh = self._kept.get(hash) or self._alive.get(hash)
            if mesh is not None:
                self._use(mesh)
                return mesh
        data = self.disk.read(hash) if self.disk is not None else None
        if data is None:
            return None
        try:
            return self._remember(Mesh.decode(data, hash))
        except WireError as error:  # whoever wrote it knew its hash, and it is no mesh all the same
            _log.warning("the cached mesh %s: %s", hash, error)
            return None

    def forget(self, hash: str) -> None:
        """Keep it no longer, here or on disk; who uses it still may."""
        with self._lock:
            mesh = self._kept.pop(hash, None)
            self._alive.pop(hash, None)
            self.size -= mesh.nbytes if mesh is not None else 0
        if self.disk is not None:
            self.disk.forget(hash)

    def _remember(self, mesh: Mesh) -> Mesh:
        with self._lock:
            known = self._kept.get(mesh.hash) or self._alive.get(mesh.hash) or mesh
            self._use(known)
            return known

    def _use(self, mesh: Mesh) -> None:
        if mesh.hash not in self._kept:
            self._kept[mesh.hash] = self._alive[mesh.hash] = mesh
            self.size += mesh.nbytes
        self._kept.move_to_end(mesh.hash)
        while self.size > self.limit and len(self._kept) > 1:
            _, oldest = self._kept.popitem(last=False)
            self.size -= oldest.nbytes
