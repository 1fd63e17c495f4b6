"""Events are read off the changes of a graph: each once, in order, with what the graph says about it."""

from __future__ import annotations

import pytest

from dsr import Memory
from dsr.clock import ManualClock
from dsr.network.local_transport import LocalNetwork
from dsr.runtime.status import State, Status
from dsr.timeline import Event, Timeline

CLOCK_START = 1e9


class Scene:
    def __init__(self) -> None:
        self.clock = ManualClock(CLOCK_START)
        self.memory = Memory("a", "a", transport=LocalNetwork(self.clock).connect("a"), clock=self.clock)
        self.timeline = Timeline()
        self.watch = self.memory.watch()
        for name, kind in (("world", "world"), ("mind", "mind"), ("table", "table"), ("cube_3", "cube")):
            self.memory.add_node(name, kind)
        self.look()

    def look(self, seconds: float = 1.0) -> list[Event]:
        """The events since the last look; then `seconds` pass."""
        events = self.timeline.note(self.watch.poll(), self.memory, self.clock.now())
        self.clock.advance(seconds)
        return events

    def texts(self) -> list[str]:
        return [event.text for event in self.look()]


@pytest.fixture
def scene() -> Scene:
    return Scene()


def test_relations_begin_and_end_with_their_source_and_their_own_time(scene: Scene) -> None:
    since = CLOCK_START + 0.25
    scene.memory.add_edge("cube_3", "table", "on", source="contact", since=since)
    scene.memory.add_edge("world", "cube_3", "Virtual_RT", translation=(0, 0, 0))
    (event,) = scene.look()
    assert event == Event(since, "began", "cube_3 on table", "cube_3 on table (contact)", {"source": "contact"})
    scene.memory.update_edge("cube_3", "table", "on", since=since + 0.1)
    assert scene.look() == []
    now = scene.clock.now()
    scene.memory.remove_edge("cube_3", "table", "on")
    assert scene.look() == [Event(now, "ended", "cube_3 on table", "no more cube_3 on table", {"source": "contact"})]


def test_a_time_from_the_future_is_not_believed(scene: Scene) -> None:
    now = scene.clock.now()
    scene.memory.add_edge("cube_3", "table", "in", since=now + 50.0)
    assert [event.time for event in scene.look()] == [now]


def test_a_relation_that_goes_with_its_node_ends_too(scene: Scene) -> None:
    scene.memory.add_edge("cube_3", "table", "on")
    scene.look()
    scene.memory.remove_node("cube_3")
    assert sorted(scene.texts()) == ["cube_3 gone", "no more cube_3 on table"]


def test_a_surprise_is_told_once_with_why_and_so_is_its_end(scene: Scene) -> None:
    scene.memory.update_node("cube_3", surprising=False)
    assert scene.look() == []
    scene.memory.update_node("cube_3", surprising=True, surprise="seen 12 mm beside")
    (event,) = scene.look()
    assert (event.kind, event.subject) == ("surprised", "cube_3") and "12 mm" in event.text
    scene.memory.update_node("cube_3", surprising=True, surprise="seen 13 mm beside")
    assert scene.look() == []
    scene.memory.remove_attribute("cube_3", "surprising")
    assert [event.kind for event in scene.look()] == ["calmed"]


def test_who_is_removed_surprises_no_more(scene: Scene) -> None:
    scene.memory.update_node("cube_3", surprising=True)
    scene.look()
    scene.memory.remove_node("cube_3")
    assert sorted(event.kind for event in scene.look()) == ["calmed", "gone"]


def test_an_explanation_is_told_with_its_rivals(scene: Scene) -> None:
    time = CLOCK_START + 0.5
    scene.memory.add_node(
        "event_0", "event", time=time, explanation="fell(cube_3)", score=4.0, policy="hypotheses", target="cube_3",
        alternatives="5.0 moved_alone(cube_3)",
    )  # fmt: skip
    (event,) = scene.look()
    assert event.time == time and event.kind == "explained" and event.subject == "cube_3"
    assert event.text == "cube_3 fell (hypotheses, score 4.00)"
    assert event.details["alternatives"] == "5.0 moved_alone(cube_3)"
    scene.memory.update_node("event_0", note="x")
    assert scene.look() == []
    scene.memory.remove_node("event_0")
    assert scene.look() == []


def test_objects_come_and_go_by_node_and_by_belief(scene: Scene) -> None:
    scene.memory.add_node("cube_4", "cube")
    assert scene.texts() == ["cube_4 appeared"]
    scene.memory.update_node("cube_4", present=False)
    assert scene.texts() == ["cube_4 gone"]
    scene.memory.update_node("cube_4", present=True)
    assert scene.texts() == ["cube_4 appeared"]
    scene.memory.update_node("cube_4", present=False)
    scene.look()
    scene.memory.remove_node("cube_4")
    assert scene.texts() == []


def test_intentions_and_actions_tell_their_status(scene: Scene) -> None:
    scene.memory.add_node("intention_0", "intention", goal="on(cube_3,cube_4)", status="wanted")
    assert scene.texts() == ["intention_0 (on(cube_3,cube_4)) wanted"]
    scene.memory.add_node("action_0_0", "action", skill="pick", target="cube_3", status="planned")
    assert scene.texts() == ["action_0_0 (pick cube_3) planned"]
    scene.memory.update_node("action_0_0", status="failed", explanation="unreachable")
    (event,) = scene.look()
    assert event.text == "action_0_0 (pick cube_3) failed: unreachable"
    assert event.details == {"skill": "pick", "target": "cube_3", "status": "failed", "explanation": "unreachable"}
    scene.memory.update_node("action_0_0", order=3)
    assert scene.look() == []
    scene.memory.remove_node("action_0_0")
    assert scene.texts() == ["action_0_0 removed"]


def status(agent: str, rid: str, state: State = State.READY, error: str = "") -> Status:
    return Status(agent=agent, rid=rid, pid=1, state=state, last_error=error)


def test_agents_start_fail_fall_silent_and_come_back() -> None:
    timeline = Timeline()

    def texts(events: list[Event]) -> list[str]:
        return [event.text for event in events]

    assert texts(timeline.note_status(status("x", "x-1", State.STARTING), 0.0)) == ["x started"]
    assert texts(timeline.note_status(status("x", "x-1"), 1.0)) == []
    assert texts(timeline.note_silence(3.9)) == []
    assert texts(timeline.note_silence(4.1)) == ["x silent for 3 s"]
    assert texts(timeline.note_silence(5.0)) == []
    assert texts(timeline.note_status(status("x", "x-1"), 6.0)) == ["x is heard again"]
    assert texts(timeline.note_status(status("x", "x-2"), 7.0)) == ["x started again"]
    assert texts(timeline.note_status(status("x", "x-2", State.FAILED, "boom"), 8.0)) == ["x failed: boom"]
    assert texts(timeline.note_status(status("x", "x-2", State.FAILED, "boom"), 8.5)) == []
    assert texts(timeline.note_silence(20.0)) == []
    assert texts(timeline.note_status(status("y", "y-1", State.STOPPED), 21.0)) == ["y stopped"]
    assert texts(timeline.note_status(status("z", "z-1"), 22.0)) == ["z is at work"]


def test_events_of_one_look_are_in_the_order_of_their_times(scene: Scene) -> None:
    for index in range(5, 0, -1):
        scene.memory.add_node(f"event_{index}", "event", time=CLOCK_START + 0.1 * index, explanation=f"x{index}")
    assert [event.details["explanation"] for event in scene.look()] == ["x1", "x2", "x3", "x4", "x5"]
