"""Images, depth, compressed images, intrinsics and clouds, there and back."""

from __future__ import annotations

import struct
import sys
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping import images
from agents.ros_bridge.mapping.cameras import read_camera_info, read_lens, read_pinhole, to_camera_info
from agents.ros_bridge.mapping.clouds import CLOUD, check_fields, read_cloud, to_cloud
from agents.ros_bridge.messages.types import types_of
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

TYPES = types_of("jazzy")
RNG = np.random.default_rng(5)
COLOR = RNG.integers(0, 256, (6, 8, 3), dtype=np.uint8)


def image(encoding: str, array: NDArray[Any], *, pad: int = 0, big: bool = False, **changes: Any) -> Any:
    """An Image with `pad` bytes after each row."""
    order = array.astype(array.dtype.newbyteorder(">")) if big else array
    rows = order.reshape(len(order), -1).view(np.uint8)
    rows = np.concatenate([rows, np.full((len(rows), pad), 77, np.uint8)], axis=1)
    fields = {
        "height": array.shape[0], "width": array.shape[1], "encoding": encoding, "is_bigendian": int(big),
        "step": rows.shape[1], "data": rows.reshape(-1), **changes,
    }  # fmt: skip
    return TYPES.decode(images.IMAGE, TYPES.encode(images.IMAGE, TYPES.new(images.IMAGE, **fields)))


@pytest.mark.parametrize(
    ("encoding", "array"),
    [
        ("rgb8", COLOR),
        ("RGB8", COLOR),
        ("bgr8", COLOR[:, :, ::-1]),
        ("8UC3", COLOR[:, :, ::-1]),
        ("rgba8", np.dstack([COLOR, COLOR[:, :, 0]])),
        ("bgra8", np.dstack([COLOR[:, :, ::-1], COLOR[:, :, 0]])),
        ("rgb16", COLOR.astype(np.uint16) * 256 + 9),
        ("bgr16", COLOR[:, :, ::-1].astype(np.uint16) * 256 + 9),
    ],
)
@pytest.mark.parametrize("pad", [0, 5])
@pytest.mark.parametrize("big", [False, True])
def test_colour_of_all_encodings_is_rgb(encoding: str, array: NDArray[Any], pad: int, big: bool) -> None:
    found = images.read_color(image(encoding, np.ascontiguousarray(array), pad=pad, big=big))
    np.testing.assert_array_equal(found, COLOR)
    assert found.dtype == np.uint8 and found.flags.c_contiguous


@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_grey_becomes_equal_channels(encoding: str) -> None:
    found = images.read_color(image(encoding, COLOR[:, :, 0].copy()))
    np.testing.assert_array_equal(found, np.repeat(COLOR[:, :, :1], 3, axis=2))
    np.testing.assert_array_equal(images.read_color(image("mono16", COLOR[:, :, 0].astype(np.uint16) * 256)), found)


@pytest.mark.parametrize(
    ("encoding", "code"),
    [("yuv422", cv2.COLOR_YUV2RGB_UYVY), ("uyvy", cv2.COLOR_YUV2RGB_UYVY), ("yuyv", cv2.COLOR_YUV2RGB_YUY2)],
)
def test_yuv_is_converted_as_opencv_does(encoding: str, code: int) -> None:
    packed = RNG.integers(16, 236, (6, 8, 2), dtype=np.uint8)
    expected = cv2.cvtColor(packed, code)
    assert np.abs(images.read_color(image(encoding, packed)).astype(int) - expected).max() <= 2


def test_depth_is_in_metres_and_zero_where_unknown() -> None:
    millimetres = np.array([[0, 1500], [65535, 3]], np.uint16)
    np.testing.assert_allclose(images.read_depth(image("16UC1", millimetres, pad=2)), [[0.0, 1.5], [65.535, 0.003]])
    metres = np.array([[np.nan, 1.5], [np.inf, -2.0]], np.float32)
    np.testing.assert_array_equal(images.read_depth(image("32FC1", metres)), [[0.0, 1.5], [0.0, 0.0]])
    np.testing.assert_array_equal(images.read_depth(image("32FC1", metres, big=True)), [[0.0, 1.5], [0.0, 0.0]])


@pytest.mark.parametrize(
    "array",
    [
        COLOR,
        COLOR[:, :, 0].copy(),
        np.linspace(0, 4, 48, dtype=np.float32).reshape(6, 8),
        np.full((6, 8), 7, np.uint16),
    ],
)
def test_what_goes_out_comes_back(array: NDArray[Any]) -> None:
    message = images.to_image(TYPES, 12.5, "camera", array)
    again = TYPES.decode(images.IMAGE, TYPES.encode(images.IMAGE, message))
    np.testing.assert_array_equal(images.pixels(again), array)
    assert (again.header.frame_id, again.header.stamp.sec) == ("camera", 12)


@pytest.mark.parametrize(
    "message",
    [
        image("bayer_rggb8", COLOR[:, :, 0].copy()),
        image("rgb8", COLOR, height=7),
        image("rgb8", COLOR, step=3),
        image("rgb8", COLOR, width=0),
        image("rgb8", COLOR, height=2**31, width=2**31),
        image("rgba8", COLOR),
    ],
)
def test_an_image_that_does_not_fit_its_data_is_refused(message: Any) -> None:
    with pytest.raises(RosMessageError):
        images.read_color(message)


def test_depth_is_no_colour_and_colour_no_depth() -> None:
    with pytest.raises(RosMessageError, match="no colour"):
        images.read_color(image("32FC1", np.ones((2, 2), np.float32)))
    with pytest.raises(RosMessageError, match="no depth"):
        images.read_depth(image("rgb8", COLOR))
    with pytest.raises(RosMessageError, match="no colour, grey or depth"):
        images.to_image(TYPES, 0.0, "", COLOR[:, :, :2])


def compressed(format: str, data: bytes) -> Any:
    return TYPES.new(images.COMPRESSED, format=format, data=np.frombuffer(data, np.uint8))


def packed(extension: str, array: NDArray[Any]) -> bytes:
    return bytes(cv2.imencode(extension, array)[1].tobytes())


def test_compressed_colour() -> None:
    png = packed(".png", COLOR[:, :, ::-1])
    np.testing.assert_array_equal(images.read_compressed_color(compressed("rgb8; png compressed bgr8", png)), COLOR)
    smooth = np.full((32, 32, 3), (200, 40, 90), np.uint8)
    jpeg = images.read_compressed_color(compressed("jpeg", packed(".jpg", smooth[:, :, ::-1])))
    assert np.abs(jpeg.astype(int) - smooth).max() <= 4
    grey = images.read_compressed_color(compressed("png", packed(".png", COLOR[:, :, 0])))
    np.testing.assert_array_equal(grey, np.repeat(COLOR[:, :, :1], 3, axis=2))


def test_compressed_depth() -> None:
    millimetres = np.array([[0, 1500], [65535, 3]], np.uint16)
    png = packed(".png", millimetres)
    plain = images.read_compressed_depth(compressed("16UC1; png compressed ", png))
    np.testing.assert_allclose(plain, [[0.0, 1.5], [65.535, 0.003]], rtol=1e-6)
    headed = struct.pack("<iff", 0, 0.0, 0.0) + png
    np.testing.assert_array_equal(images.read_compressed_depth(compressed("16UC1; compressedDepth png", headed)), plain)
    a, b = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0
    metres = np.array([[0.5, 2.0], [7.0, 9.9]], np.float32)
    coded = (a / metres + b).astype(np.uint16)
    coded[0, 0] = 0
    found = images.read_compressed_depth(
        compressed("32FC1; compressedDepth png", struct.pack("<iff", 0, a, b) + packed(".png", coded))
    )
    np.testing.assert_allclose(found, [[0.0, 2.0], [7.0, 9.9]], rtol=2e-2)
    with pytest.raises(RosMessageError, match="RVL"):
        images.read_compressed_depth(compressed("16UC1; compressedDepth rvl", headed))


def test_data_that_claim_to_be_huge_are_not_unpacked() -> None:
    png = bytearray(packed(".png", COLOR))
    png[16:24] = struct.pack(">II", 100_000, 100_000)
    with pytest.raises(RosMessageError, match="at most"):
        images.read_compressed_color(compressed("png", bytes(png)))


def test_without_its_library_compressed_images_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(RosMessageError, match="cannot be read"):
        images.read_compressed_color(compressed("png", b""))


@settings(max_examples=200)
@given(st.binary(max_size=100).map(lambda rest: b"\xff\xd8\xff" + rest) | st.binary(max_size=60))
def test_any_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(RosMessageError):
        images.read_compressed_color(compressed("jpeg", data))


INTRINSICS = Intrinsics(600.0, 610.0, 319.5, 239.5, 640, 480)


def test_intrinsics_come_back_with_their_distortion() -> None:
    distorted = replace(INTRINSICS, distortion=Distortion("plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.05)))
    message = to_camera_info(TYPES, 3.0, "camera", distorted)
    again = TYPES.decode("sensor_msgs/msg/CameraInfo", TYPES.encode("sensor_msgs/msg/CameraInfo", message))
    assert read_camera_info(again) == distorted and read_lens(again) == distorted.distortion
    assert read_camera_info(again, rectified=True) == INTRINSICS
    assert read_camera_info(to_camera_info(TYPES, 3.0, "camera", INTRINSICS)) == INTRINSICS


def test_a_part_of_the_image_and_binning_move_the_principal_point() -> None:
    message = to_camera_info(TYPES, 3.0, "camera", INTRINSICS)
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 100, 40, 320, 240
    message.binning_x = message.binning_y = 2
    assert read_camera_info(message) == Intrinsics(300.0, 305.0, 109.75, 99.75, 160, 120)


def test_a_camera_that_was_not_calibrated_is_told() -> None:
    message = TYPES.new("sensor_msgs/msg/CameraInfo", width=640, height=480)
    with pytest.raises(RosMessageError, match="not calibrated"):
        read_camera_info(message)
    message = to_camera_info(TYPES, 3.0, "camera", INTRINSICS)
    message.d = np.full(100, 0.5)
    with pytest.raises(RosMessageError, match="coefficients"):
        read_lens(message)
    with pytest.raises(RosMessageError, match="coefficients"):
        read_camera_info(message)
    assert read_pinhole(message) == INTRINSICS


def test_a_cloud_comes_back() -> None:
    points = RNG.normal(size=(20, 3)).astype(np.float32)
    colors = RNG.integers(0, 256, (20, 3), dtype=np.uint8)
    message = TYPES.decode(CLOUD, TYPES.encode(CLOUD, to_cloud(TYPES, 1.0, "lidar", points, colors)))
    found, rgb = read_cloud(message)
    np.testing.assert_array_equal(found, points)
    np.testing.assert_array_equal(rgb, colors)
    points[3, 1] = np.nan
    found, rgb = read_cloud(to_cloud(TYPES, 1.0, "lidar", points))
    np.testing.assert_array_equal(found, np.delete(points, 3, axis=0))
    assert rgb is None
    assert read_cloud(to_cloud(TYPES, 1.0, "lidar", points[:0]))[0].shape == (0, 3)


def cloud(dtype: str, big: bool, padding: int) -> Any:
    """An organised cloud of 2 x 3 points with other fields in between, and rows with a gap."""
    order = ">" if big else "<"
    numbers = {"f4": 7, "f8": 8}
    size = np.dtype(dtype).itemsize
    names = ("intensity", "x", "ring", "y", "z")
    formats = ("f4", dtype, "u2", dtype, dtype)
    offsets = (0, 8, 8 + size, 16 + size, 16 + 2 * size)
    step = 16 + 3 * size
    record = np.dtype({"names": names, "formats": [order + f for f in formats], "offsets": offsets, "itemsize": step})
    data = np.zeros((2, 3 * step + padding), np.uint8)
    for row in range(2):
        points = np.zeros(3, record)
        points["x"], points["y"], points["z"], points["ring"] = [1, 2, 3], [row] * 3, [0.5] * 3, 7
        data[row, : 3 * step] = points.view(np.uint8)
    codes = {"f4": numbers["f4"], "f8": numbers["f8"], "u2": 4}
    fields = [
        TYPES.new("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=codes[format], count=1)
        for name, offset, format in zip(names, offsets, formats, strict=True)
    ]
    return TYPES.new(
        CLOUD, height=2, width=3, fields=fields, is_bigendian=big, point_step=step, row_step=data.shape[1],
        data=data.reshape(-1),
    )  # fmt: skip


@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 5])
def test_any_layout_of_a_cloud_is_read(dtype: str, big: bool, padding: int) -> None:
    expected = [[1, 0, 0.5], [2, 0, 0.5], [3, 0, 0.5], [1, 1, 0.5], [2, 1, 0.5], [3, 1, 0.5]]
    np.testing.assert_array_equal(read_cloud(cloud(dtype, big, padding))[0], expected)


def test_a_cloud_of_very_many_fields_is_refused() -> None:
    message = cloud("f4", False, 0)
    message.fields = message.fields * 60
    with pytest.raises(RosMessageError, match="300 fields"):
        read_cloud(message)
    for frame in ("", "lidar", "lidar_link"):
        message.header.frame_id = frame
        cdr = TYPES.encode(CLOUD, message)
        with pytest.raises(RosMessageError, match="300 fields"):
            check_fields(cdr)
    few = TYPES.encode(CLOUD, cloud("f4", False, 0))
    for end in range(len(few) + 1):
        check_fields(few[:end])  # the decoder tells what is wrong with it


@pytest.mark.parametrize(
    ("name", "value"),
    [("width", 2**31), ("height", 3), ("point_step", 2), ("row_step", 0), ("point_step", 0)],
)
def test_a_cloud_that_does_not_fit_its_data_is_refused(name: str, value: int) -> None:
    message = cloud("f4", False, 0)
    setattr(message, name, value)
    with pytest.raises(RosMessageError):
        read_cloud(message)
    message = cloud("f4", False, 0)
    for offset in (2**31, 2**31 - 1, 2**31 - 4, 2**32 - 1, message.point_step - 3):  # numpy adds in 32 bits
        message.fields[1].offset = offset
        with pytest.raises(RosMessageError, match="do not fit"):
            read_cloud(message)
    message.fields[1].name = "w"
    with pytest.raises(RosMessageError):
        read_cloud(message)
