"""`dsr drivers`: lists and tries drivers without a graph, and leaves nothing behind."""

from __future__ import annotations

import importlib.metadata
import json
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from agents.cameras import cli, entries
from agents.drivers import ArmEntry, CameraEntry, camera_entry, make_driver
from agents.plant.messages import frame_key
from dsr import Frame, LocalNetwork
from dsr.clock import WALL_CLOCK
from dsr.config.plugins import DRIVERS, provided
from dsr.connecting import open_transport
from dsr.errors import ConfigError
from dsr.images.blobs import frame_chunks
from dsr.network.keys import Keys
from dsr.network.rendezvous import endpoints
from tests.agents.ros_bridge.bags.made import drive, rosbag2

SIZE = (64, 48)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20.0, SIZE)
    for number in range(8):
        writer.write(np.full((SIZE[1], SIZE[0], 3), 20 * number, np.uint8))
    writer.release()
    return path


def run(*arguments: str) -> Any:
    return CliRunner().invoke(cli.app, list(arguments))


def test_all_drivers_are_listed_with_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(entries, "devices", list)
    rows = {row["name"]: row for row in json.loads(run("list", "--json").stdout)}
    assert {"bag", "plant", "ros", "video", "webcam"} <= rows.keys()
    assert not rows["webcam"]["available"] and "no camera is connected" in rows["webcam"]["missing"][0]
    assert rows["video"]["available"] and rows["video"]["gives"] == "colour"
    monkeypatch.setattr(cli.console, "width", 160)
    text = run("list").stdout
    assert "webcam" in text and "missing here" in text


@pytest.mark.parametrize("name", provided(DRIVERS))
def test_the_class_of_each_entry_is_there_and_takes_its_example(name: str) -> None:
    entry = camera_entry(name)
    options = dict(map(cli._option, entry.example))
    first = "port|joints" if isinstance(entry, ArmEntry) else "name"
    with pytest.raises(ConfigError, match=f"its options: ({first}),? ?"):
        make_driver(name, LocalNetwork().connect("a"), Keys("g"), **options, no_such_option=1)


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("video", {"file": 3}, "option 'file': expected `str`, got `int`"),
        ("webcam", {"device": 1.5}, "option 'device': expected `int | str`, got `float`"),
        ("webcam", {"width": True}, "option 'width': expected `int`, got `bool`"),
        ("webcam", {"fps": "fast"}, "option 'fps': expected `float`, got `str`"),
        ("os:path", {}, "is a module; expected 'module:Class'"),
    ],
)
def test_options_of_another_type_and_what_is_no_driver_are_refused(
    name: str, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        make_driver(name, LocalNetwork().connect("a"), Keys("g"), **options)


def test_a_library_that_is_not_there_is_told_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (missing,) = camera_entry("video").missing()
    assert missing == "the library 'cv2' is not installed; run: pip install 'dsr-memory[sim]'"


def test_without_permission_the_remedy_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(entries, "devices", lambda: [tmp_path])
    assert camera_entry("webcam").missing() == []
    monkeypatch.setattr("os.access", lambda *_: False)
    assert "usermod" in camera_entry("webcam").missing()[0]


def test_an_entry_of_somebody_else_that_cannot_be_loaded_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = importlib.metadata.EntryPoint("odd", "nowhere:ENTRY", DRIVERS)
    monkeypatch.setattr("dsr.config.plugins.entry_points", lambda **_: importlib.metadata.EntryPoints([broken]))
    (row,) = json.loads(run("list", "--json").stdout)
    assert not row["available"] and "driver 'odd' (nowhere:ENTRY) cannot be loaded" in row["missing"][0]
    other = importlib.metadata.EntryPoint("odd", "agents.cameras:Webcam", DRIVERS)
    monkeypatch.setattr("dsr.config.plugins.entry_points", lambda **_: importlib.metadata.EntryPoints([other]))
    with pytest.raises(ConfigError, match="expected a CameraEntry"):
        camera_entry("odd")


def test_a_video_is_tried_and_its_picture_saved(video: Path, tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    options = (f"file={video}", "fov=90", "loop=false", "--no-view", "--save", str(picture))
    result = run("try", "video", *options)
    assert result.exit_code == 0, result.output
    assert "64 x 48 px" in result.stdout and "fx 32.0" in result.stdout and "90 deg" not in result.stdout
    assert "no depth: objects are found by their tags only" in result.stdout.replace("\n", " ")
    assert f'options = {{ file = "{video}", fov = 90, loop = false }}' in result.stdout
    assert cv2.imread(str(picture)).shape == (48, 64, 3)
    found = json.loads(run("try", "video", *options[:3], "--no-view", "--json").stdout)
    assert found["width"] == 64 and found["depth_known"] is None and found["rate_hz"] == pytest.approx(20.0, rel=0.01)


def test_a_simulated_camera_is_tried_over_its_running_graph(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    image = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    meta: dict[str, float | int | str] = {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5}
    bus, registration = open_transport("eyes", "plant")
    ended = threading.Event()

    def send() -> None:
        while not WALL_CLOCK.wait(ended, 0.05):
            frame = Frame(WALL_CLOCK.now(), {"color": image, "depth": np.ones(image.shape[:2], np.float32)}, meta)
            bus.publish_bulk(frame_key(Keys("eyes"), "overhead"), frame_chunks(frame))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        result = run("try", "plant", "--graph", "eyes", "--no-view", "--for", "5", "--json")
        assert len(endpoints("eyes")) == 1, "who tried is gone"
    finally:
        ended.set()
        sender.join()
        registration.close()
        bus.close()
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["frames"] > 0 and found["depth_known"] == 1.0 and found["missing"] == []


def test_a_bag_is_tried(tmp_path: Path) -> None:
    bag = rosbag2(tmp_path / "drive", drive())
    result = run("try", "bag", f"bag={bag}", "--no-view", "--for", "1", "--json")
    found = json.loads(result.stdout)
    assert result.exit_code == 0 and found["frames"] > 1 and found["depth_known"] == 1.0
    assert found["intrinsics"]["fx"] > 0.0


def test_no_picture_is_said_with_the_reason_and_leaves_no_file(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    options = (f"device={tmp_path}/video9", "--no-view", "--for", "0.3", "--save", str(picture))
    result = run("try", "webcam", *options)
    assert result.exit_code == 1 and "no picture came" in result.stdout and "there is no" in result.stdout
    assert not picture.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("webcan",), "unknown driver 'webcan'; did you mean 'webcam'"),
        (("webcam", "device"), "expected an option as KEY=VALUE"),
        (("webcam", "devise=1"), "its options: name, device"),
        (("nowhere:Camera",), "cannot be loaded"),
        (("video", "file=nowhere.mp4"), "there is no such file"),
        (("webcam", "--save", "picture.txt"), "expected a name that ends with .png"),
        (("webcam", "--save", "/proc/none/a.png"), "cannot be written"),
        (("plant", "--graph", "nobody-runs-this"), "no graph 'nobody-runs-this' runs"),
    ],
)
def test_wrong_input_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # no graph runs there
    result = run("try", *arguments, "--no-view")
    assert isinstance(result.exception, ConfigError) and said in str(result.exception)


def test_values_are_those_of_toml_or_text() -> None:
    pairs = ("a=2", "b=true", "c=/dev/video2", 'd={ transport = "dds" }', "e=[1.5]", "f=", "g=60.0")
    assert dict(map(cli._option, pairs)) == {
        "a": 2, "b": True, "c": "/dev/video2", "d": {"transport": "dds"}, "e": [1.5], "f": "", "g": 60.0,
    }  # fmt: skip
    assert cli._toml({"a": [1, "x"], "b": True}) == '{ a = [1, "x"], b = true }'


def test_ctrl_c_ends_it_with_what_was_found(video: Path) -> None:
    program = [sys.executable, "-m", "dsr.cli", "drivers", "try", "video", f"file={video}", "--for", "100", "--no-view"]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and "Ctrl-C ends it" in process.stdout.readline()
    WALL_CLOCK.wait(threading.Event(), 1.0)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60.0)
    assert process.returncode == 0 and "64 x 48 px" in out and err == ""


def test_an_entry_says_all_that_a_list_shows() -> None:
    assert set(CameraEntry.__struct_fields__) >= set(cli.Row.__struct_fields__) - {"name", "available"}
