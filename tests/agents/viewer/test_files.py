"""The files of a recorded view: when the next one begins, and which are removed."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.viewer.config import ViewerConfig
from agents.viewer.files import ViewFiles


def put(path: Path, size: int) -> None:
    path.write_bytes(b"x" * size)


def test_a_file_ends_when_it_has_its_part_of_the_room(tmp_path: Path) -> None:
    files = ViewFiles(tmp_path, keep_mb=0.008)
    first = files.begin()
    put(first, 10)
    assert not any(files.is_full(now) for now in (0.0, 3.0))
    put(first, 1000)
    assert files.is_full(4.0)
    assert files.begin() == tmp_path / "recording-2.rrd"
    assert not files.is_full(5.0)


def test_a_file_holds_as_much_again_as_its_beginning(tmp_path: Path) -> None:
    """Otherwise a large scene would begin one file after the other."""
    files = ViewFiles(tmp_path, keep_mb=0.008)
    path = files.begin()
    put(path, 5000)
    assert not any(files.is_full(0.1 * tick) for tick in range(100))
    put(path, 9999)
    assert not files.is_full(11.0)
    put(path, 10_000)
    assert files.is_full(12.0)


def test_the_oldest_files_go_also_those_of_a_viewer_before(tmp_path: Path) -> None:
    for name in ("recording", "recording-2", "recording-10", "other"):
        put(tmp_path / f"{name}.rrd", 3000)
    path = ViewFiles(tmp_path, keep_mb=0.008).begin()
    assert path == tmp_path / "recording-11.rrd"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["other.rrd", "recording-10.rrd", "recording-2.rrd"]


def test_without_a_limit_nothing_ends_and_nothing_goes(tmp_path: Path) -> None:
    put(tmp_path / "recording.rrd", 3000)
    files = ViewFiles(tmp_path, keep_mb=0.0)
    put(files.begin(), 100_000)
    assert not any(files.is_full(now) for now in (0.0, 10.0, 1e6))
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("keep_mb", [-1.0, float("nan"), float("inf")])
def test_a_limit_that_is_none_is_refused(keep_mb: float) -> None:
    with pytest.raises(ValueError, match="keep_mb"):
        ViewerConfig(keep_mb=keep_mb)
