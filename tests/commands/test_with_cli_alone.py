"""With the extra `cli` alone, every command either does its work or says which extra it needs, before it begins."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.recorder.images import pack
from agents.recorder.index import TimedRecord
from agents.replay.traffic import Traffic
from dsr import Frame, Memory
from dsr.cli.commands import OWN, plugins
from dsr.config.extras import EXTRAS
from dsr.images.blobs import encode_frame
from dsr.network.keys import Keys
from tests.agents.replay.conftest import Studio

OF_CLI = {library for library, extra in EXTRAS.items() if extra == "cli"}
_WITHOUT = f"import sys\nsys.modules.update(dict.fromkeys({sorted(set(EXTRAS) - OF_CLI)!r}))\n"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command where no other extra is installed."""
    program = f"{_WITHOUT}sys.argv = {['dsr', *arguments]!r}\nfrom dsr.cli import start\nstart()\n"
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)


def test_every_command_shows_its_help() -> None:
    load = "from dsr.cli.commands import load_command\n"
    names = [name for name in (*OWN, *plugins()) if name != "ros"]  # all of that one needs its extra
    program = f"{_WITHOUT}{load}for name in {names!r}: load_command(name)\n"
    subprocess.run([sys.executable, "-c", program], timeout=60, check=True)


def test_drivers_are_listed_and_those_that_cannot_be_tried_say_why(tmp_path: Path) -> None:
    done = run("drivers", "list", "--json")
    assert done.returncode == 0, done.stderr
    rows = {row["name"]: row for row in json.loads(done.stdout)}
    needs = {"video": "sim", "realsense": "realsense", "ros": "ros", "dynamixel": "dynamixel"}
    for name, extra in needs.items():
        assert rows[name]["extra"] == extra and f"pip install 'dsr-memory[{extra}]'" in rows[name]["missing"][0]
        done = run("drivers", "try", name, *(["file=a.mp4"] if name == "video" else []))
        assert done.returncode == 2 and f"pip install 'dsr-memory[{extra}]'" in done.stderr, done.stderr


def test_a_recording_is_replayed(tmp_path: Path) -> None:
    studio = Studio(tmp_path / "run")
    studio.memory.add_node("world", "world")
    studio.run(1.0)
    recording = str(studio.finish())
    done = run("replay", recording, "--speed", "max", "--no-stay")
    assert done.returncode == 0, done.stderr
    assert "graph replay" in done.stdout
    assert run("record", "info", recording).returncode == 0
    assert run("timeline", recording).returncode == 0


def test_images_are_recorded_with_opencv_only(memory: Memory, tmp_path: Path) -> None:
    options = ("record", "--for", "1", "--folder", str(tmp_path / "run"))
    done = run(*options)
    said = "camera images need OpenCV: the library 'cv2' is not installed; run: pip install 'dsr-memory[sim]'"
    assert done.returncode == 2 and done.stderr.splitlines()[-1] == said
    done = run(*options, "--without", "images")
    assert done.returncode == 0 and (tmp_path / "run" / "recording.mcap").exists()


def test_packed_images_are_left_out_of_a_replay_and_that_is_said_once(
    memory: Memory, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    frame = Frame(1.0, {"color": np.zeros((16, 16, 3), np.uint8)}, {})
    record = TimedRecord(0, "blob/camera", encode_frame(pack(frame, 90)))
    monkeypatch.setitem(sys.modules, "cv2", None)
    traffic = Traffic(memory.transport, Keys("scene"), memory.clock)
    for _ in range(2):
        traffic.publish(record)
    assert [one.getMessage() for one in caplog.records] == [
        "images are left out: camera images need OpenCV: the library 'cv2' is not installed; "
        "run: pip install 'dsr-memory[sim]'"
    ]
