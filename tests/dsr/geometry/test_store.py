"""The meshes of a process: each once, bounded in memory and on disk, never other bytes than the hash says."""

from __future__ import annotations

import gc
import logging
import os
from pathlib import Path

import pytest

from dsr.geometry.cache import DiskCache, cache_folder
from dsr.geometry.store import MeshStore
from tests.dsr.geometry.shapes import block, cloud


def files(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()}


def test_equal_meshes_are_one() -> None:
    store = MeshStore()
    first = store.put(block())
    assert store.put(block()) is first and store.get(first.hash) is first
    assert store.size == first.nbytes


def test_memory_is_bounded_and_what_is_in_use_is_found_all_the_same() -> None:
    meshes = [cloud(100, seed) for seed in range(5)]
    store = MeshStore(limit=2 * meshes[0].nbytes)
    for mesh in meshes:
        store.put(mesh)
    assert store.size == 2 * meshes[0].nbytes
    assert store.get(meshes[0].hash) is meshes[0]
    gone = meshes[1].hash
    del meshes, mesh
    gc.collect()
    assert store.get(gone) is None


def test_one_mesh_may_be_larger_than_all_memory_for_meshes() -> None:
    store = MeshStore(limit=10)
    assert store.get(store.put(block()).hash) == block()


def test_the_disk_outlives_the_process(tmp_path: Path) -> None:
    MeshStore(DiskCache(tmp_path)).put(block())
    assert MeshStore(DiskCache(tmp_path)).get(block().hash) == block()
    assert files(tmp_path) == {f"{block().hash}.mesh"}


def test_the_disk_is_bounded_and_forgets_what_was_used_least(tmp_path: Path) -> None:
    meshes = [cloud(50, seed) for seed in range(4)]
    disk = DiskCache(tmp_path, limit=3 * meshes[0].nbytes)
    for age, mesh in enumerate(meshes[:3]):
        disk.write(mesh.hash, mesh.data)
        os.utime(tmp_path / f"{mesh.hash}.mesh", (age, age))
    assert disk.read(meshes[0].hash) is not None  # used now
    disk.write(meshes[3].hash, meshes[3].data)
    assert files(tmp_path) == {f"{meshes[k].hash}.mesh" for k in (0, 2, 3)}
    disk.write(cloud(500).hash, cloud(500).data)  # larger than the cache
    assert len(files(tmp_path)) == 3


@pytest.mark.parametrize("damage", [b"", b"x", None])
def test_a_damaged_file_is_dropped_and_counted(tmp_path: Path, damage: bytes | None) -> None:
    store = MeshStore(disk := DiskCache(tmp_path))
    disk.write(block().hash, block().data)
    file = tmp_path / f"{block().hash}.mesh"
    file.write_bytes(file.read_bytes()[:-1] + b"!" if damage is None else damage)
    assert store.get(block().hash) is None
    assert disk.mismatched == 1 and files(tmp_path) == set()
    assert store.put(block()) == block() and disk.read(block().hash) is not None


def test_bytes_that_are_no_mesh_are_not_given_out(tmp_path: Path) -> None:
    from dsr.geometry.mesh import hash_of

    disk = DiskCache(tmp_path)
    disk.write(hash_of(b"no mesh"), b"no mesh")
    assert MeshStore(disk).get(hash_of(b"no mesh")) is None


def test_without_a_disk_it_goes_on(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    store = MeshStore(DiskCache(tmp_path / "file" / "below"))
    with caplog.at_level(logging.WARNING):
        mesh = store.put(block())
        store.put(cloud(3))
    assert store.get(mesh.hash) is mesh and store.get("0" * 64) is None
    assert len(caplog.records) == 1


def test_forgotten_is_forgotten(tmp_path: Path) -> None:
    store = MeshStore(DiskCache(tmp_path))
    hash = store.put(block()).hash
    store.forget(hash)
    assert store.get(hash) is None and store.size == 0 and files(tmp_path) == set()


def test_the_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "dsr" / "meshes"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "dsr" / "meshes"
