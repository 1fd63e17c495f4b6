"""Mutated ROS 2 messages, tokens and attachments against what decodes them, besides `decoders`.

python -m benchmarks.fuzz.ros --messages 100000 --seed 1
"""

from __future__ import annotations

import argparse
import struct
from collections.abc import Callable, Iterator
from typing import Any

from rich.console import Console

from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.link.zenoh.tokens import Entity, attachment, read_attachment, read_token
from agents.ros_bridge.messages.tf_batches import TfDecoder
from agents.ros_bridge.messages.transforms import TF_MESSAGE, StampedTransform, decode_transforms, encode_transforms
from agents.ros_bridge.messages.types import types_of
from benchmarks.fuzz.decoders import Target, fuzz_decoder
from benchmarks.fuzz.tally import Tally

_TYPES = types_of("jazzy")
_HEADER = 4
_BASE, _NAME, _ARRAY = 1, 2, 3
"""Kinds of fields, as `rosbags` numbers them"""
_ELEMENTS = 2
"""Of each sequence in a right message"""
_SHARES = {
    "ROS message": 0.7, "ROS transforms": 0.1, "ROS transforms by layout": 0.1, "ROS token": 0.05,
    "ROS attachment": 0.05,
}  # fmt: skip
"""of all messages"""


def ros_targets() -> list[Target]:
    """All decoders of what comes from ROS."""
    messages = [f"{name}\0".encode() + _TYPES.encode(name, filled(name)) for name in _TYPES]
    pose = (0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    transforms = [StampedTransform(1, 2, "world", f"link_{number}", pose) for number in range(4)]
    many = [StampedTransform(1, 2, "world", f"link_{number}", pose) for number in range(12)]
    repeated = [encode_transforms(many[:number]) for number in (8, 12)]
    entity = Entity("publisher", 0, "f0c1", 0, 3, "/arm/driver", "/tf", TF_MESSAGE, _TYPES.hash(TF_MESSAGE), Qos())
    tokens = [entity.token().encode(), Entity("node", 0, "f0c1", 0, 0, "/arm/driver").token().encode()]
    return [
        Target("ROS message", _decode, messages, _SHARES["ROS message"], _load, _dump),
        Target("ROS transforms", decode_transforms, [encode_transforms(transforms[:number]) for number in range(5)],
               _SHARES["ROS transforms"], _load, _dump),
        Target("ROS transforms by layout", _by_layout(repeated), repeated, _SHARES["ROS transforms by layout"], _load,
               _dump),
        Target("ROS token", lambda token: read_token(token.decode("utf-8", "replace")), tokens, _SHARES["ROS token"]),
        Target("ROS attachment", read_attachment, [attachment(1, 10**18, bytes(16))], _SHARES["ROS attachment"]),
    ]  # fmt: skip


def fuzz_ros(messages: int, seed: int) -> Iterator[Tally]:
    """All of them; gives a tally now and then, each at least once when it is complete."""
    for target in ros_targets():
        yield from fuzz_decoder(target, round(messages * target.share), seed)


def filled(type: str) -> Any:
    """A message with something in each of its fields."""
    return _TYPES.new(type, **{name: _value(kind) for name, kind in _TYPES.fields(type)})


def _value(kind: Any) -> Any:
    node, inner = kind
    if node == _NAME:
        return filled(inner)
    if node == _BASE:
        return "link_1" if inner[0] == "string" else 1.0 if "float" in inner[0] else 1
    of, length = inner
    number = length if node == _ARRAY else min(length, _ELEMENTS) if length else _ELEMENTS
    return [_value(of) for _ in range(number)]


def _decode(payload: bytes) -> Any:
    """A message behind the name of its type; one that is accepted can be sent on, and says the same then."""
    name, _, cdr = payload.partition(b"\0")
    type = name.decode("ascii", "replace")
    message = _TYPES.decode(type, cdr)
    sent = _TYPES.encode(type, message)
    if _TYPES.encode(type, _TYPES.decode(type, sent)) != sent:
        raise AssertionError(f"an accepted {type} changes when it is sent on")
    return message


def _by_layout(messages: list[bytes]) -> Callable[[bytes], Any]:
    """Decodes what comes after these messages of the same publisher; it says the same as if it had come alone."""
    decoder = TfDecoder()
    for cdr in messages:
        decoder.decode(cdr, b"writer")

    def decode(payload: bytes) -> Any:
        found = decoder.decode(payload, b"writer")
        alone = decode_transforms(payload)
        if repr([tuple(seven) for seven in found.numbers]) != repr([one.pose for one in alone]):
            raise AssertionError("the layout of an earlier message gave other numbers")
        if list(found.names) != [(one.parent, one.child) for one in alone]:
            raise AssertionError("the layout of an earlier message gave other names")
        return alone

    return decode


def _load(payload: bytes) -> Any:
    """A message as what stands before its body, and the body in words of 32 bits: most of them are lengths."""
    place = payload.find(b"\0\x01\0\0")
    if place < 0:
        raise ValueError("no encapsulation")
    begin = place + _HEADER
    words = (len(payload) - begin) // 4
    return [payload[:begin], list(struct.unpack_from(f"<{words}I", payload, begin)), payload[begin + 4 * words :]]


def _dump(tree: Any) -> bytes:
    """The message again; only if it still has its parts."""
    head, words, tail = tree
    return b"".join((head, *(struct.pack("<I", int(word) & 0xFFFFFFFF) for word in words), tail))


def main() -> None:
    """Fuzz as the command line asks and print a line for each decoder; exit 1 if something went wrong."""
    parser = argparse.ArgumentParser("python -m benchmarks.fuzz.ros", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--messages", type=int, default=100_000, help="how many (default: 100000)")
    parser.add_argument("--seed", type=int, default=1, help="of the mutations (default: 1)")
    options = parser.parse_args()
    tallies = {tally.name: tally for tally in fuzz_ros(options.messages, options.seed)}
    for tally in tallies.values():
        state = "ok" if tally.passed else "FAILED"
        counts = f"{tally.messages} messages, {tally.refused} refused, {tally.accepted} accepted"
        Console().print(f"{tally.name}: {counts}, {tally.exceptions} raised, {tally.growth / 1e6:.1f} MB, {state}")
        for example in tally.examples:
            Console().print(example, markup=False)
    raise SystemExit(0 if all(tally.passed for tally in tallies.values()) else 1)


if __name__ == "__main__":
    main()
