"""The timeline in the viewer: bars of situations at their own times, events in the log."""

from __future__ import annotations

from typing import Any

import pytest

from dsr.timeline import Chronicle


def states(shown: Any, lane: str) -> list[tuple[str, ...]]:
    return [tuple(value) for value in shown.values(f"/timeline/{lane}", "StateChange:state")]


def test_situations_are_bars_that_begin_and_end(stage: Any) -> None:
    stage.start_viewer()
    chronicle, begun = Chronicle(stage.memory), stage.clock.now()
    first = chronicle.begin("on", ("a", "table"), begun)
    chronicle.begin("on", ("a", "b"), begun + 1.0)
    chronicle.begin("serving", (), begun, text="serves\x07 tea")
    stage.run(2.0)
    chronicle.end(first, begun + 1.5)
    stage.run(1.0)
    chronicle.resume(first)
    stage.run(1.0)
    shown = stage.finish()
    assert states(shown, "on/a") == [("table",), ("b",), ("b",), ("table",)]
    assert states(shown, "serving/\\?") == [("serves? tea",)]


def test_an_end_clears_the_bar_and_stands_at_its_time(stage: Any) -> None:
    stage.start_viewer()
    chronicle, begun = Chronicle(stage.memory), stage.clock.now()
    name = chronicle.begin("surprising", ("a",), begun - 5.0, text="beside")
    chronicle.end(name, begun - 2.0)
    stage.run(1.0)
    assert states(stage.finish(), "surprising/a") == [("beside",), ("",)]


def test_actions_share_a_lane_and_agents_have_none(stage: Any) -> None:
    stage.start_viewer()
    chronicle, begun = Chronicle(stage.memory), stage.clock.now()
    for index in range(2):
        name = chronicle.begin("action", (f"action_{index}", "a"), begun + index, text=f"step {index}")
        chronicle.end(name, begun + index + 0.5)
    chronicle.begin("agent", ("plant", "plant-1"), begun)
    stage.run(1.0)
    shown = stage.finish()
    assert states(shown, "action/arm") == [("step 0",), ("",), ("step 1",), ("",)]
    assert not any(entity.startswith("/timeline/agent") for entity in shown.entities)


def test_lanes_are_bounded(stage: Any) -> None:
    stage.start_viewer()
    chronicle = Chronicle(stage.memory)
    for index in range(100):
        chronicle.begin("present", (f"cube_{index}",))
    stage.run(1.0)
    assert len([entity for entity in stage.finish().entities if entity.startswith("/timeline/present")]) == 60


@pytest.mark.parametrize(
    ("kind", "expected"), [("Pick", ["waiter: Pick a, hand (0.90)"]), ("explained", None), ("intention", [])]
)
def test_events_of_agents_are_in_the_log(stage: Any, kind: str, expected: list[str] | None) -> None:
    stage.start_viewer()
    Chronicle(stage.memory, "waiter").happened(kind, ("a", "hand"), confidence=0.9)
    stage.run(1.0)
    shown = stage.finish()
    if expected is None:
        assert len(shown.texts("/log/explained")) == 1
    else:
        assert shown.texts("/log/waiter") == expected
    assert not any("event_" in text or "situation_" in text for text in shown.texts())
