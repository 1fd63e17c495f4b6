"""Commands to the plant: malformed ones are refused."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from agents.plant.messages import MOST_POINTS, Follow, MoveGripper, Stop, decode_command
from dsr.errors import WireError

TWO = ((0.1, 0.2), (0.3, 0.4))


@pytest.mark.parametrize(
    "command",
    [Follow((0.0, 1.5), TWO), MoveGripper(0.04), Stop()],
)
def test_commands_survive_the_wire(command: Any) -> None:
    assert decode_command(msgspec.msgpack.encode(command), joints=2) == command


@pytest.mark.parametrize(
    "command",
    [
        Follow((0.5,), ((0.1,),)),
        Follow((0.5,), ((0.1, float("nan")),)),
        Follow((), ()),
        Follow((0.0, 0.0), TWO),
        Follow((0.0, float("nan")), TWO),
        Follow((-1.0, 1.0), TWO),
        Follow((0.0,), TWO),
        Follow((0.0, 1.0), ((0.1, 0.2), (0.3,))),
        Follow((0.0, 1.0), ((0.1, 0.2), (0.3, float("inf")))),
        Follow(tuple(map(float, range(MOST_POINTS + 1))), ((0.1, 0.2),) * (MOST_POINTS + 1)),
        MoveGripper(float("nan")),
        MoveGripper(-0.1),
        {"type": "dance"},
        {"type": "follow"},
        {"type": "follow", "times": [0.5], "positions": "0.1 0.2"},
        [1, 2],
        None,
    ],
)
def test_wrong_commands_are_refused(command: Any) -> None:
    with pytest.raises(WireError, match="arm command"):
        decode_command(msgspec.msgpack.encode(command), joints=2)


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"{}"])
def test_noise_is_refused(payload: bytes) -> None:
    with pytest.raises(WireError, match="arm command"):
        decode_command(payload, joints=2)
