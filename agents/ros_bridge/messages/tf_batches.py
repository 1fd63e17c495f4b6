"""Messages of tf decoded at once: of a publisher's second message with the same frames, only the numbers are read.

Whoever publishes many frames does so again and again, with the same names in the same order. Then all that differs
between two messages lies at the same places, and numpy reads it in one turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from agents.ros_bridge.messages.transforms import StampedTransform, decode_transforms

_HEADER = 4
"""Bytes of the encapsulation header; the second one tells the byte order"""
_LITTLE = 1
_MANY = 8
"""Transforms of one message from which on numpy takes less time than Python"""
_MOST_LAYOUTS = 256
"""Layouts that are remembered, one for each publisher and length; beyond these, the oldest is forgotten"""
_MOST_BYTES = 1 << 22
"""Bytes of all messages whose layouts are remembered, which take ten times as many: 40 000 transforms, of one message
or of many"""


class TfBatch:
    """The transforms of one message.

    Args:
        names: parent and child of each.
        stamps: s since the Unix epoch, of each.
        numbers: (n, 7) translation (m) and quaternion (x, y, z, w) of each, parent_from_child; not checked.
    """

    def __init__(
        self, names: Sequence[tuple[str, str]], stamps: Sequence[float],
        numbers: NDArray[np.float64] | Sequence[Sequence[float]],
    ) -> None:  # fmt: skip
        self.names, self.stamps = names, stamps
        self._numbers = numbers

    @cached_property
    def numbers(self) -> Sequence[Sequence[float]]:
        """Seven numbers of each transform: translation (m), then a quaternion (x, y, z, w); not checked."""
        numbers = self._numbers
        return numbers.tolist() if isinstance(numbers, np.ndarray) else numbers


class TfDecoder:
    """Decodes messages, and remembers where the numbers were in earlier ones."""

    def __init__(self) -> None:
        self._layouts: dict[tuple[bytes, int], _Layout] = {}
        self._bytes = 0
        """Of the messages whose layouts these are"""

    def decode(self, cdr: bytes | memoryview, writer: bytes) -> TfBatch:
        """The transforms of a `TFMessage` of this publisher (its gid), in CDR of either byte order.

        Raises:
            RosMessageError: for bytes that are no such message, as `decode_transforms` does.
        """
        data = bytes(cdr)
        key = writer, len(data)
        layout = self._layouts.get(key)
        found = layout.read(data) if layout is not None else None
        if found is not None:
            return found
        transforms = decode_transforms(data)
        if len(transforms) >= _MANY and len(data) <= _MOST_BYTES and data[1] == _LITTLE:
            self._remember(key, _Layout(data, transforms))
        return TfBatch(
            [(one.parent, one.child) for one in transforms], [one.sec + one.nanosec * 1e-9 for one in transforms],
            [one.pose for one in transforms],
        )  # fmt: skip

    def _remember(self, key: tuple[bytes, int], layout: _Layout) -> None:
        """Instead of the oldest ones, if there are too many."""
        if self._layouts.pop(key, None) is None:
            self._bytes += key[1]
        while len(self._layouts) >= _MOST_LAYOUTS or self._bytes > _MOST_BYTES:
            oldest = next(iter(self._layouts))
            del self._layouts[oldest]
            self._bytes -= oldest[1]
        self._layouts[key] = layout


class _Layout:
    """Where in a message what is; of a message in little-endian order that was decoded."""

    def __init__(self, data: bytes, transforms: Sequence[StampedTransform]) -> None:
        self._names = [(one.parent, one.child) for one in transforms]
        stamps, poses, place = [], [], _HEADER + 4
        fixed = bytearray(len(data))
        fixed[:2], fixed[_HEADER:place] = b"\1\1", b"\1\1\1\1"
        for names in self._names:
            stamps.append(place)
            place += 8
            for name in names:
                end = place + 4 + len(name.encode()) + 1
                fixed[place:end] = b"\1" * (end - place)
                place = (end + 3) & -4
            # Numbers of 8 bytes are aligned to the message behind the header of 4.
            place = ((place - _HEADER + 7) & -8) + _HEADER
            poses.append(place)
            place += 56
        self._fixed = np.flatnonzero(np.frombuffer(fixed, np.uint8))
        """Indexes of the bytes that say how many transforms there are, and of which frames; not of those in between,
        which may be anything"""
        self._said = self._bytes_of(data)
        self._stamps = np.array(stamps) // 4
        """Indexes of the seconds, among the words of 4 bytes"""
        self._poses = (np.array(poses)[:, None] - _HEADER) // 8 + np.arange(7)
        """Indexes of the poses, among the words of 8 bytes behind the header"""

    def _bytes_of(self, data: bytes) -> bytes:
        return np.frombuffer(data, np.uint8).take(self._fixed).tobytes()

    def read(self, data: bytes) -> TfBatch | None:
        """A message of the same length; None if it is of other frames."""
        if self._bytes_of(data) != self._said:
            return None
        words = np.frombuffer(data, "<u4", len(data) // 4)
        stamps = words.take(self._stamps).view("<i4") + words.take(self._stamps + 1) * 1e-9
        numbers = np.frombuffer(data, "<f8", (len(data) - _HEADER) // 8, _HEADER).take(self._poses)
        return TfBatch(self._names, stamps.tolist(), numbers)
