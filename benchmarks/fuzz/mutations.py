"""Makes wrong messages of right ones, knowing how MessagePack is built."""

from __future__ import annotations

import copy
import json
import math
import struct
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import msgpack
import numpy as np

LONGEST = 1 << 16
"""Bytes of a mutated message."""
_HUGE_HEADERS = (b"\xdd\xff\xff\xff\xff", b"\xdf\x7f\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc6\x40\x00\x00\x00",
                 b"\xc9\xff\xff\xff\xff\x01", b"\xdc\xff\xff", b"\xc1")  # fmt: skip
"""Lengths that the message does not hold, and a byte that MessagePack never uses."""
_ODD: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 127, 1 << 20, (1 << 53) - 1, 1 << 53, (1 << 53) + 1, (1 << 63) - 1, 1 << 63,
    (1 << 64) - 1, -(1 << 63), 0.5, math.nan, math.inf, -math.inf, 1e308, 5e-324, "", "a", "\0", "../../etc/passwd",
    "x" * 300, "*", "\U0001f600", b"", b"\xff" * 40, [], {}, [[]], {"a": 1}, [1.0, 2.0], [math.nan],
    msgpack.ExtType(1, b""), msgpack.ExtType(1, b"\0" * 64), msgpack.ExtType(1, b"\xff" * 352),
    msgpack.ExtType(9, b"abc"),
)  # fmt: skip

T = TypeVar("T")
Step = Callable[[bytes], bytes]
Load = Callable[[bytes], Any]
Dump = Callable[[Any], bytes]
_FRAME_LENGTH = struct.Struct("<I")


def load_messagepack(payload: bytes) -> Any:
    """A message as lists and maps."""
    return msgpack.unpackb(payload, strict_map_key=False)


def load_frame(payload: bytes) -> Any:
    """A frame as its header and what follows it."""
    (length,) = _FRAME_LENGTH.unpack_from(payload)
    return [load_messagepack(payload[4 : 4 + length]), payload[4 + length :]]


def dump_frame(tree: Any) -> bytes:
    """The frame again; only if it still has two parts."""
    header, body = msgpack.packb(tree[0]), tree[1]
    if not isinstance(body, bytes):
        raise TypeError("the second part must stay bytes")
    return b"".join((_FRAME_LENGTH.pack(len(header)), header, body))


def dump_json(tree: Any) -> bytes:
    """Values as JSON; those that JSON does not know as text."""
    return json.dumps(tree, default=str).encode()


class Dice:
    """Random choices, the same for the same seed."""

    def __init__(self, seed: int) -> None:
        self._generator = np.random.default_rng(seed)

    def below(self, end: int) -> int:
        """A number from 0 up to but not including `end`."""
        return int(self._generator.integers(end))

    def pick(self, items: Sequence[T]) -> T:
        """One of `items`."""
        return items[self.below(len(items))]

    def happens(self, probability: float) -> bool:
        """Whether something of that probability happens."""
        return bool(self._generator.random() < probability)

    def bytes(self, length: int) -> bytes:
        """So many random bytes."""
        return self._generator.bytes(length)


class Mutator:
    """Mutates messages of one kind; the same seed gives the same messages.

    Args:
        corpus: right messages.
        seed: of all choices.
        load: the tree of lists, maps and values that a message is.
        dump: the message of a tree.
    """

    def __init__(
        self, corpus: Sequence[bytes], seed: int, load: Load = load_messagepack, dump: Dump = msgpack.packb
    ) -> None:
        self._corpus = corpus
        self._dice = Dice(seed)
        self._load, self._dump = load, dump
        structured = [payload for payload in corpus if self._tree(payload) is not None]
        raw: list[Step] = [
            self._flip, self._truncate, self._splice, self._repeat, self._blow_up, self._nest, self._break_text,
            self._noise,
        ]  # fmt: skip
        self._steps = raw + [self._change_tree] * (2 * len(raw) if structured else 0)

    def __call__(self) -> bytes:
        """The next message: a right one with one or more things changed."""
        payload = self._dice.pick(self._corpus)
        for _ in range(self._dice.pick((1, 1, 1, 2, 3))):
            payload = self._dice.pick(self._steps)(payload)[:LONGEST]
        return payload

    # ---- bytes

    def _flip(self, payload: bytes) -> bytes:
        data = bytearray(payload or b"\0")
        for _ in range(1 + self._dice.below(8)):
            data[self._dice.below(len(data))] ^= 1 << self._dice.below(8)
        return bytes(data)

    def _truncate(self, payload: bytes) -> bytes:
        return payload[: self._place(payload)]

    def _splice(self, payload: bytes) -> bytes:
        other = self._dice.pick(self._corpus)
        return payload[: self._place(payload)] + other[self._place(other) :]

    def _repeat(self, payload: bytes) -> bytes:
        start = self._place(payload)
        piece = payload[start : start + 1 + self._dice.below(64)]
        return payload[:start] + piece * self._dice.pick((2, 3, 50)) + payload[start:]

    def _blow_up(self, payload: bytes) -> bytes:
        place = self._place(payload)
        return payload[:place] + self._dice.pick(_HUGE_HEADERS) + payload[place + self._dice.below(7) :]

    def _nest(self, payload: bytes) -> bytes:
        place = self._place(payload)
        opener = self._dice.pick((b"\x91", b"\x81\xa1a", b"[", b'{"a":', b"\xdc\x00\x01"))
        return payload[:place] + opener * self._dice.pick((3, 100, 5000)) + payload[place:]

    def _break_text(self, payload: bytes) -> bytes:
        letters = [place for place, byte in enumerate(payload) if 97 <= byte < 123]
        if not letters:
            return payload
        place = self._dice.pick(letters)
        return payload[:place] + self._dice.pick((b"\xff", b"\xc3", b"\xed")) + payload[place + 1 :]

    def _noise(self, payload: bytes) -> bytes:
        return self._dice.bytes(self._dice.pick((0, 1, 5, 60)))

    def _place(self, payload: bytes) -> int:
        return self._dice.below(len(payload) + 1)

    # ---- values

    def _change_tree(self, payload: bytes) -> bytes:
        """Another value, one more, one less, or many, somewhere in valid MessagePack."""
        tree = self._tree(payload)
        if tree is None:
            return self._flip(payload)
        holder = [copy.deepcopy(tree)]
        self._change(holder)
        try:
            return self._dump(holder[0])
        except (ValueError, OverflowError, TypeError, IndexError, KeyError):
            return payload

    def _change(self, holder: Any) -> None:
        """Walk down to some place and change what is there."""
        while True:
            keys: Sequence[Any] = list(holder) if isinstance(holder, dict) else range(len(holder))
            key = self._dice.pick(keys)
            inner = holder[key]
            if not isinstance(inner, list | dict) or not inner or self._dice.happens(0.2):
                break
            holder = inner
        action = self._dice.below(8)
        if action == 0:
            del holder[key]
        elif action == 1 and isinstance(holder, list):
            holder[key:key] = [inner] * self._dice.pick((1, 1, 3, 500))
        elif action == 2:
            other = self._dice.pick(keys)
            holder[key], holder[other] = holder[other], holder[key]
        elif action == 3 and isinstance(inner, int) and not isinstance(inner, bool):
            holder[key] = inner + self._dice.pick((-1, 1, 2, 1000, 1 << 40))
        elif action == 4:
            holder[key] = [inner]
        else:
            holder[key] = self._dice.pick(_ODD)
        if not holder and isinstance(holder, list) and self._dice.happens(0.5):
            holder.append(self._dice.pick(_ODD))

    def _tree(self, payload: bytes) -> Any:
        """The message as lists and maps; None if it is damaged already, or only a single value."""
        try:
            tree = self._load(payload)
        except (ValueError, msgpack.UnpackException, RecursionError, struct.error, TypeError):
            return None
        return tree if isinstance(tree, list | dict) and tree else None
