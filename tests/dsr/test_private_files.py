"""Folders and files of one user: permissions, links of others, names that somebody prepared."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from dsr.errors import ConfigError, TransportError
from dsr.files.private_files import lock_file, new_file, private_folder, replacing, write_json
from dsr.geometry.cache import DiskCache
from dsr.network.rendezvous import Registration, members, runtime_dir
from dsr.persistence.generations import Generations
from dsr.persistence.keeper import StateKeeper
from tests.dsr.conftest import Net


def permissions(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture(autouse=True)
def _open_umask() -> object:
    before = os.umask(0o000)
    yield
    os.umask(before)


@pytest.fixture
def other_user(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is on the disk belongs to somebody else."""
    stranger = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: stranger)


def test_a_private_folder_is_closed_to_others(tmp_path: Path) -> None:
    assert permissions(private_folder(tmp_path / "deep" / "state")) == 0o700
    (tmp_path / "open").mkdir(mode=0o777)
    assert permissions(private_folder(tmp_path / "open")) == 0o700


def test_own_links_count_and_files_do_not(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "state").symlink_to(tmp_path / "disk")
    assert private_folder(tmp_path / "state") == tmp_path / "state"
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError):
        private_folder(tmp_path / "file")


@pytest.mark.usefixtures("other_user")
def test_what_belongs_to_others_is_not_used(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    with pytest.raises(PermissionError, match="belongs to another user"):
        private_folder(tmp_path / "theirs")
    (tmp_path / "link").symlink_to(tmp_path / "theirs")
    with pytest.raises(PermissionError, match="link of another user"):
        private_folder(tmp_path / "link")


@pytest.mark.usefixtures("other_user")
def test_a_link_in_place_of_the_fallback_runtime_folder_deletes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    victim = tmp_path / "victim" / "lab"
    victim.mkdir(parents=True)
    (victim / "thesis.endpoint").write_text("years of work")
    (tmp_path / f"dsr-{os.getuid()}").symlink_to(victim.parent)
    with pytest.raises(TransportError, match=r"link of another user.*XDG_RUNTIME_DIR"):
        members("lab")
    assert (victim / "thesis.endpoint").read_text() == "years of work"


def test_the_runtime_folder_and_what_is_in_it_are_closed_to_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    registration = Registration("lab", "a-1", "tcp/127.0.0.1:1")
    entry = tmp_path / "dsr" / "lab" / "a-1.endpoint"
    assert [permissions(path) for path in (runtime_dir(), entry.parent, entry)] == [0o700, 0o700, 0o600]
    registration.close()


def test_no_write_goes_through_a_link(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for name in ("new", "lock"):
        (tmp_path / name).symlink_to(victim)
    with pytest.raises(OSError, match="exists"):
        new_file(tmp_path / "new")
    with pytest.raises(OSError, match="symbolic links"):
        lock_file(tmp_path / "lock")
    with replacing(tmp_path / "new") as file:
        file.write(b"theirs")
    assert victim.read_text() == "mine"
    assert (tmp_path / "new").read_text() == "theirs"
    assert permissions(tmp_path / "new") == 0o600


def test_drafts_have_names_that_nobody_can_prepare(tmp_path: Path) -> None:
    names = set()
    for _ in range(2):
        with replacing(tmp_path / "file"):
            names |= {path.name for path in tmp_path.iterdir() if path.name != "file"}
    assert len(names) == 2
    assert not any(str(os.getpid()) in name for name in names)
    with pytest.raises(ZeroDivisionError), replacing(tmp_path / "file"):
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_kept_state_is_closed_to_others(net: Net, tmp_path: Path) -> None:
    folder = tmp_path / "state"
    memory = net.join("a")
    keeper = StateKeeper(memory, folder, threaded=False)
    memory.add_node("table", "table")
    keeper.flush()
    assert permissions(folder) == 0o700
    assert {permissions(file) for file in folder.iterdir()} == {0o600}
    assert len(list(folder.iterdir())) >= 3
    memory.close()


@pytest.mark.usefixtures("other_user")
def test_state_in_a_folder_of_others_is_refused(net: Net, tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    with pytest.raises(ConfigError, match="belongs to another user"):
        StateKeeper(net.join("a"), tmp_path / "state", threaded=False)


def test_drafts_of_a_crash_are_removed(tmp_path: Path) -> None:
    new_file(tmp_path / ".snapshot-000001.0123456789abcdef.new").close()
    Generations(tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_mesh_cache_is_closed_to_others(tmp_path: Path) -> None:
    cache = DiskCache(tmp_path / "meshes")
    cache.write("0" * 64, b"bytes")
    assert permissions(tmp_path / "meshes") == 0o700
    assert [permissions(file) for file in (tmp_path / "meshes").iterdir()] == [0o600]


def test_json_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "new" / "result.json"
    write_json({"a": 1.5}, file)
    assert file.read_text() == '{\n  "a": 1.5\n}\n'
    with pytest.raises(TypeError):
        write_json({"a": object()}, file)
    assert file.read_text() == '{\n  "a": 1.5\n}\n'
    assert [path.name for path in file.parent.iterdir()] == ["result.json"]
    reading, writing = os.pipe()
    write_json([1], Path(f"/dev/fd/{writing}"))
    os.close(writing)
    with os.fdopen(reading) as pipe:
        assert pipe.read() == "[\n  1\n]\n"
