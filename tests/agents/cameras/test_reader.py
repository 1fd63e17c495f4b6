"""The thread that reads a device: newest frames, and devices that refuse, vanish, hang, lie or break."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from agents.cameras.errors import CorruptFrameError, DeviceError, EndOfPicturesError
from agents.cameras.given_intrinsics import GivenIntrinsics
from agents.cameras.reader import CameraReader
from agents.drivers import Diagnosed
from dsr.images.blobs import Frame
from tests.agents.cameras.conftest import FakeDevice, eventually, noisy

Read = Callable[..., CameraReader]
CALIBRATION = "fx = 60.0\nfy = 60.0\ncx = 31.5\ncy = 23.5\nwidth = {width}\nheight = 48\n"


def next_frame(reader: CameraReader) -> Frame:
    found: list[Frame] = []
    eventually(lambda: found.extend(filter(None, [reader.frame()])) or found)
    return found[0]


def test_each_frame_comes_once_and_the_newest_first(device: FakeDevice, read: Read) -> None:
    device.script.extend(noisy(number) for number in range(5))
    reader = read()
    eventually(lambda: reader.counts.get("passed over") == 4)
    frame = reader.frame()
    assert frame is not None and frame.stamp == 4.0 and reader.frame() is None
    assert reader.trouble == "" and isinstance(reader, Diagnosed)


def test_a_device_that_is_not_there_is_waited_for(device: FakeDevice, read: Read) -> None:
    device.refuses = DeviceError("there is no /dev/video9")
    reader = read()
    eventually(lambda: device.opened >= 3)
    assert reader.trouble == "there is no /dev/video9" and reader.counts == {"lost": 1}
    device.refuses = None
    device.script.append(noisy(1))
    assert next_frame(reader).stamp == 1.0
    assert reader.trouble == ""


def test_unplugged_and_plugged_in_again(device: FakeDevice, read: Read, caplog: pytest.LogCaptureFixture) -> None:
    device.script.extend([noisy(1), DeviceError("unplugged"), noisy(2)])
    reader = read()
    eventually(lambda: reader.counts.get("passed over") == 1)  # the second picture is here
    assert next_frame(reader).stamp == 2.0 and device.opened == 2
    assert "camera cam is gone: unplugged" in caplog.text
    assert "camera cam is back" in caplog.text and device.closed >= 1


@pytest.mark.parametrize("error", [RuntimeError("usb"), ValueError("?"), MemoryError()])
def test_whatever_a_library_raises_the_thread_lives_on(device: FakeDevice, read: Read, error: Exception) -> None:
    device.script.extend([error, noisy(2)])
    reader = read()
    assert next_frame(reader).stamp == 2.0
    assert reader.counts["lost"] == 1


def test_corrupt_frames_are_dropped_and_counted(device: FakeDevice, read: Read) -> None:
    device.script.extend([CorruptFrameError("half a JPEG")] * 3)
    reader = read()
    eventually(lambda: reader.counts.get("corrupt") == 3)
    assert "half a JPEG" in reader.trouble and device.opened == 1
    device.script.append(noisy(1))
    assert next_frame(reader).stamp == 1.0
    assert reader.trouble == ""


def test_a_device_that_gives_nothing_usable_is_opened_again(device: FakeDevice, read: Read) -> None:
    reader = read(silence=0.05)
    eventually(lambda: device.opened >= 2)
    assert "no usable picture for 0.05 s" in reader.trouble


def test_a_frozen_device_is_opened_again_and_shows_nothing_until_it_moves(device: FakeDevice, read: Read) -> None:
    reader = read(frozen=0.02, silence=60.0)
    first = noisy(7)
    stamps = iter(range(10**6))

    def freeze() -> bool:
        if len(device.script) < 5:
            device.script.append(Frame(float(next(stamps)), first.arrays, {}))
        return device.opened >= 3

    eventually(freeze)
    assert "frozen" in reader.trouble and reader.counts["frozen"] > 0
    reader.frame()
    device.script.clear()
    device.script.append(noisy(8))
    eventually(lambda: (frame := reader.frame()) is not None and frame.arrays["color"][0, 0, 0] == 48)
    assert reader.trouble == ""


def test_a_device_that_hangs_is_told_and_holds_up_nobody(device: FakeDevice, read: Read) -> None:
    hanging = threading.Event()
    device.read = lambda wait: hanging.wait() and None  # type: ignore[method-assign,assignment]
    reader = read(silence=0.02)
    eventually(lambda: "no picture for" in reader.trouble)
    assert reader.frame() is None
    hanging.set()


def test_pictures_of_another_size_than_the_calibration_go_on_without_intrinsics(
    device: FakeDevice, read: Read, tmp_path: Path
) -> None:
    file = tmp_path / "camera.toml"
    file.write_text(CALIBRATION.format(width=128))
    device.script.append(noisy(1))
    reader = read(intrinsics=GivenIntrinsics(str(file)))
    assert next_frame(reader).meta == {}
    assert "64 x 48 px, and its calibration is about 128 x 48" in reader.trouble
    assert reader.counts["another size"] == 1


def test_intrinsics_that_were_given_are_in_each_frame(device: FakeDevice, read: Read, tmp_path: Path) -> None:
    file = tmp_path / "camera.toml"
    file.write_text(CALIBRATION.format(width=64))
    device.script.append(noisy(1))
    assert next_frame(read(intrinsics=GivenIntrinsics(str(file)))).meta == {
        "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5,
    }  # fmt: skip


def test_the_end_of_a_file_is_no_trouble(device: FakeDevice, read: Read) -> None:
    device.script.extend([noisy(1), EndOfPicturesError("the file is at its end")])
    reader = read(silence=0.01)
    eventually(lambda: reader.ended)
    assert reader.trouble == "" and device.opened == 1 and not device.is_open
    assert next_frame(reader).stamp == 1.0


def test_closing_releases_the_device_and_ends_the_thread(device: FakeDevice, read: Read) -> None:
    reader = read()
    eventually(lambda: device.is_open)
    reader.close()
    reader.close()
    assert not device.is_open
    assert not any(thread.name == "camera cam" for thread in threading.enumerate())
