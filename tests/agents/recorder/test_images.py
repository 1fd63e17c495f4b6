"""Packed camera frames come back as they were, up to the stated losses."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from agents.recorder.images import DEPTH_UNIT, Image, pack, unpack
from dsr.errors import WireError
from dsr.images.blobs import Frame, decode_frame, encode_frame


@pytest.fixture
def frame() -> Frame:
    rng = np.random.default_rng(1)
    color = cv2.resize(rng.integers(0, 255, (6, 8, 3)).astype(np.uint8), (64, 48))
    depth = rng.uniform(0.3, 2.0, (48, 64)).astype(np.float32)
    depth[0, 0] = 0.0
    return Frame(12.5, {"color": color, "depth": depth, "ids": np.arange(3, dtype=np.int32)}, {"fx": 600.0})


def test_images_come_back_through_the_wire(frame: Frame) -> None:
    found = unpack(decode_frame(encode_frame(pack(frame, 95))))
    assert found.stamp == frame.stamp and found.meta == frame.meta
    assert set(found.arrays) == set(frame.arrays)
    assert np.abs(found.arrays["depth"] - frame.arrays["depth"]).max() <= 0.51 * DEPTH_UNIT
    assert np.abs(found.arrays["color"].astype(int) - frame.arrays["color"]).mean() < 4
    np.testing.assert_array_equal(found.arrays["ids"], frame.arrays["ids"])


def test_packing_makes_frames_small(frame: Frame) -> None:
    assert len(encode_frame(pack(frame, 90))) < 0.6 * len(encode_frame(frame))


def test_depths_out_of_range_become_unknown() -> None:
    depth = np.array([[np.nan, np.inf, -1.0, 7.0, 6.5]], np.float32)
    found = unpack(pack(Frame(0.0, {"depth": depth}, {}), 90)).arrays["depth"]
    np.testing.assert_allclose(found, [[0, 0, 0, 0, 6.5]], atol=DEPTH_UNIT)


@pytest.mark.parametrize("shape", [(0, 0, 3), (4, 4), (4, 4, 4), (66_000, 1, 3)])
def test_a_colour_array_that_is_no_image_stays(shape: tuple[int, ...]) -> None:
    color = np.zeros(shape, np.uint8)
    assert pack(Frame(0.0, {"color": color}, {}), 90).arrays["color"] is color


def test_a_broken_image_is_an_error_of_the_wire() -> None:
    with pytest.raises(WireError, match=r"color\.jpeg"):
        unpack(Frame(0.0, {"color.jpeg": np.zeros(10, np.uint8)}, {}))


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("color.jpeg", np.zeros((4, 4), np.uint8)),
        ("color.png", np.zeros((4, 4, 3), np.uint16)),
        ("color.png", np.zeros((4, 4, 4), np.uint8)),
        ("depth.png", np.zeros((4, 4, 3), np.uint8)),
        ("depth.png", np.zeros((4, 4), np.uint8)),
    ],
)
def test_an_image_of_another_layout_is_an_error_of_the_wire(name: str, image: Image) -> None:
    """One grey picture in a recording ended the replay before."""
    _, data = cv2.imencode(".jpg" if name.endswith("jpeg") else ".png", image)
    with pytest.raises(WireError, match="of shape"):
        unpack(Frame(0.0, {name: data.ravel()}, {}))


@pytest.mark.parametrize("unit", ["fine", "", 0.0, -1.0, float("inf"), float("nan"), 1e300, 1e34, 1e-300])
def test_a_unit_of_depth_that_is_no_length_is_an_error_of_the_wire(unit: float | str) -> None:
    packed = pack(Frame(0.0, {"depth": np.ones((4, 4), np.float32)}, {}), 90)
    with pytest.raises(WireError, match="depth_unit"):
        unpack(Frame(0.0, packed.arrays, {"depth_unit": unit}))
