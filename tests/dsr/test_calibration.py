"""Requests for calibrations as nodes, and the reports that answer them."""

from __future__ import annotations

import msgspec
import pytest

from dsr import LocalNetwork, ManualClock, Memory
from dsr.errors import ConfigError
from dsr.vocabulary.calibration import (
    CONFIRMED,
    PROVISIONAL,
    STEADY,
    SURPRISE,
    Report,
    pose_of,
    provisional,
    read_report,
    request_calibration,
    request_undo,
)
from dsr.vocabulary.intentions import MIND

BEFORE, AFTER = (0.3, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0), (0.3, 0.1, 0.5, 0.0, 0.0, 0.0, 1.0)
SURE = Report("camera", "world", "robust", True, "why", BEFORE, AFTER, (), 0.1, 0.0, 9.0, False, 1, 4, 4, ())
REPORT = msgspec.structs.replace(SURE, provisional=True)


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
    memory.update_node(name, report=encoded(REPORT))
    assert read_report(memory, name) == REPORT
    broken = [encoded(REPORT).replace(old, new) for old, new in (("[0.3,", "["), ("1.0]", "2.0]"))]
    for text in ('{"camera": 3}', *broken):
        memory.update_node(name, report=text)
        assert text != encoded(REPORT) and read_report(memory, name) is None


def test_a_provisional_pose_is_told_until_it_is_sure_or_another_is_written(memory: Memory) -> None:
    memory.add_node("world", "world")
    memory.add_node("camera", "camera", mount=PROVISIONAL)
    memory.add_edge("world", "camera", "RT", pose=pose_of(REPORT.after))
    memory.update_node(asked := request_calibration(memory, "camera"), report=encoded(REPORT))
    assert provisional(memory, "camera") is None and provisional(memory, "nobody") is None
    memory.update_node(name := request_calibration(memory, "camera"), report=encoded(SURE), source=SURPRISE)
    assert name != asked and provisional(memory, "camera") is None
    memory.update_node(name, report=encoded(REPORT))
    assert provisional(memory, "camera") == (name, REPORT)
    memory.update_node("camera", mount=CONFIRMED)  # while beliefs are led back
    assert provisional(memory, "camera") == (name, REPORT)
    memory.update_node("camera", mount=STEADY)
    assert provisional(memory, "camera") is None
    memory.update_node("camera", mount=PROVISIONAL)
    memory.add_edge("world", "camera", "RT", pose=pose_of(REPORT.before))
    assert provisional(memory, "camera") is None
    memory.remove_attribute(memory.edge("world", "camera", "RT"), "pose")
    assert provisional(memory, "camera") is None


def encoded(report: Report) -> str:
    return msgspec.json.encode(report).decode()
