"""The model's file: where it is, whether it is whole, and how it is got out of a wheel."""

from __future__ import annotations

import errno
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from agents.hand_tracker import HandTrackerConfig
from agents.hand_tracker.cli import app
from agents.hand_tracker.model import fetch as fetching
from agents.hand_tracker.model.fetch import from_index, from_wheel
from agents.hand_tracker.model.files import (
    DETECTOR,
    LANDMARKER,
    VERSION,
    ModelFiles,
    fetched_file,
    read_fetched,
    read_model,
    write_model,
)
from agents.hand_tracker.model.loading import wants_model
from dsr.errors import ConfigError

from .conftest import PHOTOS

FALSE = {DETECTOR: b"TFL3 not the detector", LANDMARKER: b"TFL3 nor the landmarks"}
NETWORKS = (
    "mediapipe/modules/palm_detection/palm_detection_full.tflite",
    "mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def wheel(file: Path, *entries: str) -> Path:
    with zipfile.ZipFile(file, "w") as archive:
        for entry in entries:
            archive.writestr(entry, b"TFL3 of others")
    return file


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments))


def test_what_is_written_is_read_and_not_packed(tmp_path: Path) -> None:
    file = tmp_path / "new" / "model.task"
    write_model(FALSE, file)
    assert read_model(file) == ModelFiles(str(file), FALSE)
    with zipfile.ZipFile(file) as archive:  # MediaPipe maps the entries
        assert all(entry.compress_type == zipfile.ZIP_STORED for entry in archive.infolist())
    assert [path.name for path in file.parent.iterdir()] == ["model.task"]


def test_the_fetched_model_is_in_the_cache_folder_and_must_be_the_published_one(cache: Path) -> None:
    assert fetched_file() == cache / "dsr" / "hands" / VERSION / "hand_landmarker.task"
    with pytest.raises(ConfigError, match="no model file"):
        read_fetched()
    assert not wants_model(HandTrackerConfig()) and wants_model(HandTrackerConfig(finder="model"))
    write_model(FALSE, fetched_file())
    assert wants_model(HandTrackerConfig()) and not wants_model(HandTrackerConfig(finder="colour"))
    with pytest.raises(ConfigError, match="wrong checksum"):
        read_fetched()


def test_a_wheel_without_the_networks_or_with_others_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no wheel"):
        from_wheel(tmp_path / "none.whl")
    (tmp_path / "text.whl").write_text("no archive")
    with pytest.raises(ConfigError, match="cannot be read as a wheel"):
        from_wheel(tmp_path / "text.whl")
    with pytest.raises(ConfigError, match="lacks mediapipe/modules/palm_detection"):
        from_wheel(wheel(tmp_path / "empty.whl", "mediapipe/__init__.py"))
    with pytest.raises(ConfigError, match="wrong checksum"):
        from_wheel(wheel(tmp_path / "other.whl", *NETWORKS))
    with pytest.raises(ConfigError, match="no wheel '/dev/zero'"):
        from_wheel(Path("/dev/zero"))


def test_a_network_that_would_fill_the_memory_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetching, "MOST_BYTES", 3)
    with pytest.raises(ConfigError, match="of at most 3 bytes"):
        from_wheel(wheel(tmp_path / "other.whl", *NETWORKS))


def test_an_index_without_the_wheel_and_one_with_another_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pip itself, which must not look anywhere but in a folder."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    with pytest.raises(ConfigError, match=r"does not have mediapipe 0\.10\.21, or cannot be reached.*--from-wheel"):
        from_index(print, quiet=True)
    name = f"mediapipe-{VERSION}"
    wheel(
        tmp_path / f"{name}-cp311-cp311-manylinux_2_28_x86_64.whl",
        f"{name}.dist-info/METADATA",
        f"{name}.dist-info/WHEEL",
    )
    with pytest.raises(ConfigError, match="wrong checksum: it is not the published wheel"):
        from_index(print, quiet=True)


def test_without_pip_it_says_how_to_do_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetching.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"has no pip.*--from-wheel"):
        from_index(print)


def test_a_full_disk_leaves_the_old_model_and_says_how_much_room_there_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(contents: object, file: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(file))

    monkeypatch.setattr(fetching, "from_wheel", lambda file: FALSE)
    monkeypatch.setattr("agents.hand_tracker.model.files.write_model", full)
    result = run("fetch", "--from-wheel", "any.whl", "--to", str(tmp_path / "model.task"))
    assert isinstance(result.exception, ConfigError) and "there is no room" in str(result.exception)
    assert not (tmp_path / "model.task").exists()


def test_nothing_is_downloaded_for_a_place_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fetching, "from_index", lambda *_, **__: pytest.fail("it was downloaded"))
    (tmp_path / "text").write_text("no folder")
    for place, reason in ((tmp_path, "it is a folder"), (tmp_path / "text" / "model.task", "cannot be written")):
        result = run("fetch", "--force", "--to", str(place))
        assert isinstance(result.exception, ConfigError)
        assert reason in str(result.exception)
        assert "choose another place with --to" in str(result.exception)


def test_a_wheel_that_is_named_is_read_even_if_a_model_is_there(model_file: Path, tmp_path: Path) -> None:
    there = tmp_path / "model.task"
    there.write_bytes(model_file.read_bytes())
    result = run("fetch", "--from-wheel", str(tmp_path / "none.whl"), "--to", str(there))
    assert isinstance(result.exception, ConfigError)
    assert "no wheel" in str(result.exception)
    assert there.read_bytes() == model_file.read_bytes()


def test_fetching_replaces_a_damaged_model_and_keeps_a_whole_one(model_file: Path, tmp_path: Path) -> None:
    whole = read_model(model_file)
    source = tmp_path / "mediapipe.whl"
    with zipfile.ZipFile(source, "w") as archive:
        for entry, name in zip(NETWORKS, (DETECTOR, LANDMARKER), strict=True):
            archive.writestr(entry, whole.contents[name])
    fetched_file().parent.mkdir(parents=True)
    fetched_file().write_bytes(model_file.read_bytes()[:100_000])
    assert run("status").exit_code == 1
    result = run("fetch", "--from-wheel", str(source))
    assert result.exit_code == 0 and "fetching it anew" in result.stdout
    assert read_fetched().contents == whole.contents
    assert "already there" in run("fetch").stdout
    status = run("status")
    assert status.exit_code == 0 and "LiteRT runs it" in status.stdout


def test_pictures_are_tried_and_drawn(model_file: Path, tmp_path: Path) -> None:
    found = run("try", str(PHOTOS / "nocurl.jpg"), "--model", str(model_file), "--out", str(tmp_path / "out"))
    assert found.exit_code == 0 and "right" in found.stdout
    assert (tmp_path / "out" / "nocurl.png").stat().st_size > 10_000
    (tmp_path / "text.png").write_text("no picture")
    wrong = run("try", str(tmp_path / "text.png"), "--model", str(model_file))
    assert isinstance(wrong.exception, ConfigError) and "is no picture" in str(wrong.exception)


def test_no_drawing_takes_the_place_of_a_picture_or_of_another_drawing(tmp_path: Path) -> None:
    own = tmp_path / "hand.png"
    own.write_bytes(b"mine")
    (tmp_path / "other").mkdir()
    for pictures, said in (([own], "hand.png would be overwritten"), ([own, tmp_path / "other/hand.jpg"], "one name")):
        tried = run("try", *map(str, pictures), "--out", str(tmp_path))
        assert isinstance(tried.exception, ConfigError) and said in str(tried.exception)
    assert own.read_bytes() == b"mine"


@pytest.mark.parametrize("picture", ["nowhere.png", "/dev/zero", "."])
def test_what_is_no_file_is_no_picture(picture: str) -> None:
    tried = run("try", picture)
    assert isinstance(tried.exception, ConfigError) and "cannot be read" in str(tried.exception)


def test_without_litert_the_status_says_what_to_install(model_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_model(read_model(model_file).contents, fetched_file())
    monkeypatch.setitem(sys.modules, "ai_edge_litert", None)
    monkeypatch.delitem(sys.modules, "ai_edge_litert.interpreter", raising=False)
    status = run("status")
    assert status.exit_code == 1 and "dsr-memory[hands]" in status.stdout
