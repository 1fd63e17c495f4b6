"""A recording of a RealSense, made with the real library: a software device, its recorder, and what they show."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsr.clock import WALL_CLOCK

WIDTH, HEIGHT, FPS = 320, 240, 30
"""px, px and Hz, of both streams"""
COUNT = 24
"""Pictures of each kind"""
LATER = 4.0
"""ms by which depth is exposed after colour"""
COEFFICIENTS = [0.05, -0.1, 0.001, 0.002, 0.0]
"""Of the colour camera's lens"""
BESIDE = (0.03, -0.002, 0.001)
"""m, the depth camera's place in the colour camera's frame"""
TURNED = 0.02
"""rad about its z axis"""
Image = NDArray[Any]


def color(number: int, scale: int = 1) -> Image:
    """The image of that number, red 10 times as much and with a pattern; larger by `scale`."""
    image = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    image[..., 0] = 10 * number
    image[::2, ::2, 2] = 30
    return image.repeat(scale, 0).repeat(scale, 1)


def depth(number: int, scale: int = 1) -> Image:
    """A wall at 2 m, and at 0.8 m and as many mm as `number` a box in its middle; a corner is unknown."""
    image = np.full((HEIGHT, WIDTH), 2000, np.uint16)
    image[80:160, 120:200] = 800 + number
    image[:20, :20] = 0
    return image.repeat(scale, 0).repeat(scale, 1)


def record(rs: Any, path: Path, scale: int = 1) -> None:
    """Write the recording, with images larger by `scale`; it takes about a second."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "software")
    device.register_info(rs.camera_info.serial_number, "42")
    sensors = {"depth": device.add_sensor("Depth"), "color": device.add_sensor("Color")}
    profiles = {
        "depth": sensors["depth"].add_video_stream(
            _stream(rs, rs.stream.depth, 0, rs.format.z16, 2, scale, 300.0, None)
        ),
        "color": sensors["color"].add_video_stream(
            _stream(rs, rs.stream.color, 1, rs.format.rgb8, 3, scale, 280.0, COEFFICIENTS)
        ),
    }
    sensors["depth"].add_read_only_option(rs.option.depth_units, 0.001)
    profiles["depth"].register_extrinsics_to(profiles["color"], extrinsics(rs))
    recorder = rs.recorder(str(path), device)
    queue = rs.frame_queue(2 * COUNT)
    opened = recorder.query_sensors()
    for sensor in opened:
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(queue)
    for number in range(COUNT):
        for kind, pixels, late in (("color", color(number, scale), 0.0), ("depth", depth(number, scale), LATER)):
            frame = rs.software_video_frame()
            frame.pixels, frame.stride, frame.bpp = pixels, pixels.strides[0], pixels.strides[1]
            frame.timestamp = 5000.0 + number * 1e3 / FPS + late
            frame.domain = rs.timestamp_domain.hardware_clock
            frame.frame_number = number + 1
            frame.profile = profiles[kind].as_video_stream_profile()
            if kind == "depth":
                frame.depth_units = 0.001
            sensors[kind].on_video_frame(frame)
        WALL_CLOCK.wait(threading.Event(), 1.0 / FPS)
    for sensor in opened:
        sensor.stop()
        sensor.close()


def extrinsics(rs: Any) -> Any:
    """Pose of the depth camera in the colour camera's frame, as the library has it: column by column."""
    made = rs.extrinsics()
    c, s = float(np.cos(TURNED)), float(np.sin(TURNED))
    made.rotation, made.translation = [c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0], list(BESIDE)
    return made


def intrinsics(rs: Any, focal: float, model: Any, coefficients: list[float], scale: int = 1) -> Any:
    """A lens as the library has it, `focal` px for images that are not scaled."""
    made = rs.intrinsics()
    made.width, made.height = WIDTH * scale, HEIGHT * scale
    made.fx = made.fy = focal * scale
    made.ppx, made.ppy = made.width / 2 - 0.5, made.height / 2 - 0.5
    made.model, made.coeffs = model, coefficients
    return made


def _stream(
    rs: Any, kind: Any, number: int, format: Any, size: int, scale: int, focal: float, coefficients: list[float] | None
) -> Any:
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.bpp = kind, 0, number, format, size
    stream.width, stream.height, stream.fps = WIDTH * scale, HEIGHT * scale, FPS
    model = rs.distortion.brown_conrady if coefficients else rs.distortion.none
    stream.intrinsics = intrinsics(rs, focal, model, coefficients or [0.0] * 5, scale)
    return stream
