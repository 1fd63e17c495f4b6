"""The lines that a run tells, from a memory that is written by hand."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from agents.scenario.format.events import CameraBump, Event, Kill, Slide, Swap
from agents.scenario.format.scenario import load_scenario, scenario_files
from agents.scenario.run.report import ProgressBar, story_line
from agents.scenario.run.story import Line, Story, Topic, describe
from dsr import LocalNetwork, ManualClock, Memory

GOAL = "on(cube_3, cube_4)"


@pytest.fixture
def memory() -> Memory:
    network = LocalNetwork(clock := ManualClock())
    memory = Memory("tabletop", "writer", transport=network.connect("writer"), clock=clock)
    join(network, memory, "planner")
    memory.add_node("mind", "mind")
    memory.add_node("cube_3", "cube")
    return memory


def join(network: LocalNetwork, memory: Memory, agent: str) -> Memory:
    """Another process of the same graph, known to `memory`."""
    other = Memory("tabletop", agent, transport=network.connect(agent), clock=memory.clock)
    for _ in range(20):
        network.clock.advance(0.05)
        for one in (memory, other):
            one.flush()
        network.deliver()
        for one in (memory, other):
            one.poll()
    return other


def write_plan(memory: Memory, first: int = 0) -> None:
    for order, skill in enumerate(("pick", "place"), first):
        destination = "cube_4" if skill == "place" else ""
        values = {"order": order, "skill": skill, "target": "cube_3", "destination": destination, "status": "planned"}
        memory.add_node(f"action_0_{order}", "action", **values)


def texts(story: Story) -> list[tuple[str, str]]:
    return [(line.topic.value, line.text) for line in story.news(())]


def test_a_mission_is_told_from_beginning_to_end(memory: Memory) -> None:
    story = Story(memory, [])
    memory.add_node("intention_0", "intention", goal=GOAL, maintain=True, status="wanted", replans=0)
    assert texts(story) == [("mission", f"{GOAL} (and keep it so)")]
    memory.update_node("intention_0", status="executing", explanation="action 1 of 2")
    write_plan(memory)
    assert texts(story) == [("plan", "pick cube_3; place cube_3 on cube_4")]
    memory.update_node("action_0_0", status="running")
    assert texts(story) == [("action", "1 of 2: pick cube_3")]
    memory.update_node("action_0_0", status="done")
    memory.update_node("action_0_1", status="running")
    memory.update_node("intention_0", explanation="action 2 of 2")
    assert texts(story) == [("action", "2 of 2: place cube_3 on cube_4")]
    memory.update_node("intention_0", status="maintained", explanation="")
    assert texts(story) == [("mission", "maintained")]
    assert texts(story) == []


def test_a_setback_is_told_with_its_reason(memory: Memory) -> None:
    story = Story(memory, [])
    memory.add_node("intention_0", "intention", goal=GOAL, status="executing", replans=0)
    write_plan(memory)
    story.news(())
    memory.update_node("action_0_0", status="failed", explanation="nothing between the pads")
    memory.update_node("intention_0", status="waiting", explanation="pick cube_3: nothing between the pads")
    lines = story.news(())
    assert [(line.topic, line.good) for line in lines] == [(Topic.MISSION, False), (Topic.ACTION, False)]
    assert lines[1].text == "pick cube_3 failed: nothing between the pads"
    memory.update_node("intention_0", status="planning", replans=1)
    assert story.news(()) == [Line(Topic.MISSION, "planning again: pick cube_3: nothing between the pads", False)]
    for order in range(2):
        memory.remove_node(f"action_0_{order}")
    write_plan(memory, first=2)
    assert texts(story) == [("plan", "pick cube_3; place cube_3 on cube_4")]


def test_what_is_waited_for_is_told_at_once_and_the_failure_with_its_reason(memory: Memory) -> None:
    story = Story(memory, [])
    waits = "never seen: cube_9; gives up after 10 s"
    memory.add_node("intention_0", "intention", goal=GOAL, status="waiting", explanation=waits, replans=0)
    assert story.news(()) == [Line(Topic.MISSION, GOAL), Line(Topic.MISSION, f"waiting: {waits}")]  # none is a failure
    memory.update_node("intention_0", status="failed", explanation="never seen: cube_9; waited 10 s")
    assert texts(story) == [("mission", "failed: never seen: cube_9; waited 10 s")]


def test_an_outcome_is_told_once_however_often_it_is_tried_again(memory: Memory) -> None:
    story = Story(memory, [])
    memory.add_node("intention_0", "intention", goal=GOAL, status="unsolvable", explanation="why", replans=0)
    assert texts(story) == [("mission", GOAL), ("mission", "unsolvable: why")]
    for _ in range(2):
        for status, why in (("wanted", "trying again"), ("planning", ""), ("unsolvable", "why")):
            memory.update_node("intention_0", status=status, explanation=why)
            assert texts(story) == []
    memory.update_node("intention_0", explanation="another reason")
    assert texts(story) == [("mission", "unsolvable: another reason")]
    memory.update_node("intention_0", status="maintained", explanation="")
    assert texts(story) == [("mission", "maintained")]
    memory.update_node("intention_0", status="unsolvable", explanation="another reason")
    assert texts(story) == [("mission", "unsolvable: another reason")]


def test_without_a_planner_that_is_told_once() -> None:
    memory = Memory("tabletop", "writer", transport=LocalNetwork(clock := ManualClock()).connect("writer"), clock=clock)
    story = Story(memory, [])
    assert texts(story) == []
    memory.add_node("intention_0", "intention", goal=GOAL, status="wanted")
    nobody = "no agent 'planner' runs, which would pursue it"
    assert texts(story) == [("mission", GOAL), ("mission", nobody)]
    assert texts(story) == []
    memory.update_node("intention_0", status="reached")
    assert texts(story) == [("mission", "reached")]


def test_a_plan_that_was_told_is_not_told_again_when_the_arm_goes_out_of_the_way(memory: Memory) -> None:
    story = Story(memory, [])
    write_plan(memory)
    assert texts(story) == [("plan", "pick cube_3; place cube_3 on cube_4")]
    memory.update_node("action_0_0", status="failed", explanation="out of reach")
    memory.add_node("action_0_2", "action", order=2, skill="observe", status="planned")
    assert texts(story) == [("action", "pick cube_3 failed: out of reach")]
    memory.add_node("action_0_3", "action", order=3, skill="look", target="camera", status="planned")
    assert texts(story) == []
    write_plan(memory, first=4)
    assert texts(story) == [("plan", "pick cube_3; place cube_3 on cube_4")]


def test_surprises_and_explanations_are_told_once(memory: Memory) -> None:
    story = Story(memory, [])
    memory.update_node("cube_3", surprising=True, surprise="seen 38 mm beside its belief")
    assert texts(story) == [("surprise", "cube_3: seen 38 mm beside its belief")]
    rejected = "9.5 moved_alone(cube_3)\n12.0 false_percept(cube_3)"
    memory.add_node("event_0", "event", time=1.0, explanation="turned(cube_3)", score=8.51, alternatives=rejected)
    told = "cube_3 turned (score 8.5). Rejected: cube_3 moved (9.5), and 1 more"
    assert texts(story) == [("explanation", told)]
    memory.update_node("cube_3", surprising=False)
    assert texts(story) == []
    memory.update_node("cube_3", surprising=True)
    assert texts(story) == [("surprise", "cube_3: seen 38 mm beside its belief")]


def test_many_surprises_make_one_short_line(memory: Memory) -> None:
    for number in range(30, 50):
        memory.add_node(f"cube_{number}", "cube", surprising=True, surprise="unseen")
    (line,) = Story(memory, []).news(())
    assert line.text == "cube_30: unseen; cube_31: unseen; cube_32: unseen and 17 more"


def test_moves_of_the_experimenter_are_told_when_they_begin(memory: Memory) -> None:
    story = Story(memory, [Slide(at=1.0, object="cube_4", by=(0.1, 0.04)), Swap(at=2.0, object="a", other="b")])
    assert story.news({2: (0.1, None)}) == [Line(Topic.MOVE, "swap a other b")]
    assert story.news({1: (0.5, 0.7), 2: (0.1, 0.2), 9: (1.0, None)}) == [Line(Topic.MOVE, "slide cube_4 by 0.1, 0.04")]
    assert not story.news({1: (0.5, 0.7), 2: (0.1, 0.2)})


@pytest.mark.parametrize(
    ("event", "told"),
    [
        (Slide(at=1.0, object="cube_4", to=(0.1, 0.2)), "slide cube_4 to 0.1, 0.2"),
        (Swap(when="idle()", object="cube_4", other="cube_5"), "swap cube_4 other cube_5"),
        (CameraBump(at=1.0, rotation=(0.0, 0.0, 0.1)), "camera bump rotation 0, 0, 0.1"),
        (Kill(at=1.0, agent="planner"), "kill agent planner"),
        (Slide(at=1.0, object="a", by=(0.1, 0.0), pushes=("b", "c")), "slide a by 0.1, 0, pushes b, c"),
    ],
)
def test_events_are_described(event: Event, told: str) -> None:
    assert describe(event) == told


@pytest.mark.parametrize("name", scenario_files())
def test_every_event_of_the_scenarios_can_be_told(name: str) -> None:
    assert all(describe(event) for event in load_scenario(name).events)


def test_hostile_texts_are_shown_as_text(memory: Memory) -> None:
    memory.add_node("intention_0", "intention", goal="[red]\x1b[2J\non(a,b)" + "x" * 1000)
    (line,) = Story(memory, []).news(())
    assert line.text.startswith(r"[red]\x1b[2J on(a,b)xxx") and len(line.text) < 210
    assert "[red]" in story_line(1.0, line).plain


def test_lines_appear_on_the_console() -> None:
    console = Console(file=StringIO(), width=80)
    with ProgressBar(load_scenario("towers"), console) as bar:
        bar.happened(-0.2, Line(Topic.MISSION, GOAL))
        bar.happened(21.25, Line(Topic.MOVE, "slide cube_4 " + "far " * 30))
    output = console.file.getvalue()  # type: ignore[attr-defined]
    assert f"   0.0 s  mission      {GOAL}\n" in output
    assert f"  21.2 s  experimenter slide cube_4 {'far ' * 30}".rstrip() in output


def test_a_camera_in_doubt_and_where_it_was_found(memory: Memory) -> None:
    story = Story(memory, [])
    memory.add_node("camera", "camera", mount="steady")
    assert texts(story) == []
    memory.update_node("camera", mount="in doubt", explanation="may have moved")
    assert texts(story) == [("camera", "camera in doubt: may have moved")]
    memory.add_node("event_0", "event", kind="calibrated", text="camera is 20 mm elsewhere")
    memory.update_node("camera", mount="steady", explanation="")
    assert texts(story) == [("camera", "camera is 20 mm elsewhere")]
    assert texts(story) == []
