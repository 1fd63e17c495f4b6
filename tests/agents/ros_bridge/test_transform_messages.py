"""Transforms encoded and decoded without objects, against `rosbags`."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.messages.transforms import TF_MESSAGE, StampedTransform, decode_transforms, encode_transforms
from tests.agents.ros_bridge.samples import TYPES, header

NAMES = st.text(st.characters(blacklist_characters="\0", blacklist_categories=("Cs",)), max_size=12)
NUMBERS = st.floats(allow_nan=False)
TRANSFORMS = st.lists(
    st.builds(
        StampedTransform, st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1), NAMES, NAMES,
        st.tuples(*[NUMBERS] * 7),
    ),
    max_size=6,
)  # fmt: skip


def as_message(transforms: list[StampedTransform]) -> object:
    made = []
    for sec, nanosec, parent, child, (x, y, z, i, j, k, w) in transforms:
        transform = TYPES.new(
            "geometry_msgs/msg/Transform",
            translation=TYPES.new("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            rotation=TYPES.new("geometry_msgs/msg/Quaternion", x=i, y=j, z=k, w=w),
        )
        above = header(TYPES, parent, sec, nanosec)
        made.append(
            TYPES.new("geometry_msgs/msg/TransformStamped", header=above, child_frame_id=child, transform=transform)
        )
    return TYPES.new(TF_MESSAGE, transforms=made)


@given(TRANSFORMS)
def test_they_are_encoded_as_rosbags_encodes_them(transforms: list[StampedTransform]) -> None:
    message = as_message(transforms)
    cdr = encode_transforms(transforms)
    assert cdr == TYPES.encode(TF_MESSAGE, message)
    assert decode_transforms(cdr) == decode_transforms(memoryview(cdr)) == transforms
    big = bytes(TYPES._store.serialize_cdr(message, TF_MESSAGE, little_endian=False))
    assert decode_transforms(big) == transforms


@given(TRANSFORMS, st.integers(0, 400), st.binary(max_size=8))
def test_they_are_refused_where_rosbags_refuses_them(
    transforms: list[StampedTransform], place: int, other: bytes
) -> None:
    cdr = encode_transforms(transforms)
    broken = cdr[:place] + other + cdr[place + len(other) :]
    try:
        expected = TYPES.encode(TF_MESSAGE, TYPES.decode(TF_MESSAGE, broken))
    except RosMessageError:
        with pytest.raises(RosMessageError):
            decode_transforms(broken)
    else:
        assert encode_transforms(decode_transforms(broken)) == expected


def test_each_truncation_is_refused() -> None:
    cdr = encode_transforms([StampedTransform(1, 2, "world", "arm", (0.0,) * 7)] * 2)
    for length in range(len(cdr)):
        with pytest.raises(RosMessageError):
            decode_transforms(cdr[:length])


def test_a_claim_of_billions_costs_nothing() -> None:
    with pytest.raises(RosMessageError, match="cannot hold 4294967295 transforms"):
        decode_transforms(b"\0\1\0\0" + struct.pack("<I", 2**32 - 1) + bytes(200))


@pytest.mark.parametrize(
    "wrong",
    [
        StampedTransform(2**31, 0, "a", "b", (0.0,) * 7),
        StampedTransform(0, -1, "a", "b", (0.0,) * 7),
        StampedTransform(0, 0, "a", "b", (0.0,) * 6),  # type: ignore[arg-type]
        StampedTransform(0, 0, None, "b", (0.0,) * 7),  # type: ignore[arg-type]
        StampedTransform(0, 0, "\ud800", "b", (0.0,) * 7),
    ],
)
def test_values_that_do_not_fit_are_refused(wrong: StampedTransform) -> None:
    with pytest.raises(RosMessageError):
        encode_transforms([wrong])
