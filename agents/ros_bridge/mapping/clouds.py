"""`sensor_msgs/PointCloud2`, and a frame with the arrays `points` (n, 3) in m and `colors` (n, 3)."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import to_header
from agents.ros_bridge.messages.types import RosTypes

CLOUD = "sensor_msgs/msg/PointCloud2"
_FIELD = "sensor_msgs/msg/PointField"
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Number formats by the constants of PointField"""
_MOST_FIELDS = 256
"""Fields of a cloud: lidars have some ten, features of a point some hundred"""
_FRAME_AT = 12
"""Byte of CDR at which the length of `frame_id` is: behind the encapsulation and the stamp"""
_FLOAT32 = 7
_COLOR_FIELDS = ("rgb", "rgba")
Points = NDArray[np.float32]
Colors = NDArray[np.uint8]


def read_cloud(message: Any) -> tuple[Points, Colors | None]:
    """The points (n, 3) m of a cloud in its frame, and their RGB (n, 3) if it has any; points that are not finite are
    left out.

    Raises:
        RosMessageError: without fields x, y, z, or with sizes that do not fit the data.
    """
    records = _records(message)
    names = records.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise RosMessageError(f"a cloud with the fields {', '.join(names) or 'none'}: expected x, y, z")
    points = np.stack([records[axis].astype(np.float32) for axis in "xyz"], axis=-1)
    finite = np.isfinite(points).all(axis=1)
    color = next((name for name in _COLOR_FIELDS if name in names), None)
    if color is None or records.dtype[color].itemsize != 4:
        return points[finite], None
    packed = np.ascontiguousarray(records[color]).view(np.uint32)
    colors = np.stack([packed >> 16, packed >> 8, packed], axis=-1).astype(np.uint8)
    return points[finite], colors[finite]


def check_fields(cdr: bytes | memoryview) -> None:
    """Raise `RosMessageError` for a cloud in CDR with very many fields: each would become an object when it is decoded.

    What else is wrong with the bytes is for the decoder to tell.
    """
    order = "<" if bytes(cdr[1:2]) == b"\1" else ">"
    try:
        (length,) = struct.unpack_from(f"{order}I", cdr, _FRAME_AT)
        end = (_FRAME_AT + 4 + length + 3) & -4
        _, _, number = struct.unpack_from(f"{order}III", cdr, end)  # after height and width
    except struct.error:
        return
    _check_number(number)


def _check_number(fields: int) -> None:
    if fields > _MOST_FIELDS:
        raise RosMessageError(f"a cloud with {fields} fields: expected {_MOST_FIELDS} at most")


def _records(message: Any) -> NDArray[Any]:
    """The points as records, one for each."""
    order = ">" if message.is_bigendian else "<"
    _check_number(len(message.fields))
    fields = [field for field in message.fields if field.count == 1 and field.datatype in _NUMBERS]
    height, width, step, row = message.height, message.width, message.point_step, message.row_step
    data = np.ascontiguousarray(message.data, np.uint8)
    if len({field.name for field in fields}) != len(fields):
        raise RosMessageError("a cloud with two fields of one name")
    if height * width == 0:
        row = step = max(step, 1)
    elif step < 1 or row < step * width or data.size < (height - 1) * row + step * width:
        raise RosMessageError(f"a cloud of {width} x {height} points of {step} bytes has {data.size} bytes")
    # numpy adds offsets in 32 bits: one near the end of these would lead it far behind the data
    if any(field.offset + int(_NUMBERS[field.datatype][1]) > step for field in fields):
        raise RosMessageError(f"a cloud with fields that do not fit {step} bytes")
    try:
        dtype = np.dtype({
            "names": [field.name for field in fields],
            "formats": [order + _NUMBERS[field.datatype] for field in fields],
            "offsets": [field.offset for field in fields],
            "itemsize": step,
        })  # fmt: skip
        records: NDArray[Any] = np.ndarray((height, width), dtype, data if height * width else b"", 0, (row, step))
    except (ValueError, TypeError) as error:
        raise RosMessageError(f"a cloud with fields that do not fit {step} bytes: {error}") from error
    native = records.reshape(-1)
    return native.astype(dtype.newbyteorder("=")) if message.is_bigendian else native


def to_cloud(types: RosTypes, stamp: float, frame: str, points: Points, colors: Colors | None = None) -> Any:
    """A cloud of points (n, 3) m, and RGB (n, 3) in the form that RViz and PCL read."""
    names = ["x", "y", "z"] + ([] if colors is None else ["rgb"])
    records = np.zeros(len(points), dtype=[(name, "<u4" if name == "rgb" else "<f4") for name in names])
    for axis, name in enumerate("xyz"):
        records[name] = points[:, axis]
    if colors is not None:
        red, green, blue = colors.astype(np.uint32).T
        records["rgb"] = red << 16 | green << 8 | blue
    step = records.dtype.itemsize
    fields = [types.new(_FIELD, name=name, offset=4 * i, datatype=_FLOAT32, count=1) for i, name in enumerate(names)]
    return types.new(
        CLOUD, header=to_header(types, stamp, frame), height=1, width=len(points), fields=fields, point_step=step,
        row_step=step * len(points), data=records.view(np.uint8).reshape(-1), is_dense=True,
    )  # fmt: skip
