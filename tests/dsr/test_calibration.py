"""Requests for calibrations as nodes, and the reports that answer them."""

from __future__ import annotations

import msgspec
import pytest

from dsr import LocalNetwork, ManualClock, Memory
from dsr.calibration import Report, read_report, request_calibration, request_undo
from dsr.errors import ConfigError
from dsr.intentions import MIND


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock()
    return Memory("g", "asker", transport=LocalNetwork(clock).connect("asker"), clock=clock)


def test_a_request_hangs_below_the_mind_and_two_are_two(memory: Memory) -> None:
    names = [request_calibration(memory, "camera", force=True, views=3), request_calibration(memory)]
    assert len(set(names)) == 2 and {edge.dst for edge in memory.edges("has", src=MIND)} == set(names)
    assert memory.node(names[0]).attributes == {"target": "camera", "method": "robust", "forced": True, "views": 3}
    assert memory.node(request_calibration(memory, views=2, move=True))["moves_arm"] is True
    assert memory.node(request_undo(memory, "camera"))["undo"] is True


def test_wrong_requests(memory: Memory) -> None:
    with pytest.raises(ConfigError, match="did you mean 'robust'"):
        request_calibration(memory, method="robst")
    with pytest.raises(ConfigError, match="1 or more"):
        request_calibration(memory, views=0)
    assert MIND not in memory


def test_a_report_comes_back_as_it_was_and_nonsense_is_none(memory: Memory) -> None:
    name = request_calibration(memory)
    assert read_report(memory, name) is None and read_report(memory, "nobody") is None
    report = Report("c", "world", "robust", False, "why", (1.0,) * 7, (2.0,) * 7, (), 0.1, 0.2, -1.0, True, 1, 2, 3, ())
    memory.update_node(name, report=msgspec.json.encode(report).decode())
    assert read_report(memory, name) == report
    memory.update_node(name, report='{"camera": 3}')
    assert read_report(memory, name) is None
