"""Whether what nodes say of being perceived still counts."""

from __future__ import annotations

import pytest

from dsr.vocabulary.perceived import is_perceived
from tests.dsr.conftest import Net


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ({}, True),
        ({"perceived": False, "last_seen": 10.0}, False),
        ({"perceived": True, "last_seen": 9.5}, True),
        ({"perceived": True, "last_seen": 8.0}, False),
        ({"perceived": True, "last_seen": 10.3}, True),
        ({"perceived": True, "last_seen": 11.0}, False),
        ({"perceived": True, "last_seen": 1e12}, False),
    ],
)
def test_it_must_have_been_said_lately(net: Net, attributes: dict[str, object], expected: bool) -> None:
    memory = net.join("m")
    memory.add_node("human_hand_0", "hand", **attributes)
    assert is_perceived(memory.node("human_hand_0"), 10.0) is expected
