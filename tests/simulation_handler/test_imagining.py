"""Imagining: things put somewhere by a relation, and plans carried out, in forks; checked by the what-if service."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, TypeVar

import pytest

from dsr import ConfigError, ImaginationError, LocalNetwork, ManualClock, Memory, Pose
from dsr.imagining import (
    Outcome,
    Step,
    Thinking,
    Thought,
    best,
    carried_out,
    differences,
    parse_step,
    placed,
    think,
)
from dsr.math3d.shapes import Part
from dsr.network.keys import Keys
from dsr.spatial import View, margin, read_scene
from dsr.timeline import query
from dsr.vocabulary.what_if import Question, Supposed, WhatIf, encode_question
from simulation_handler.graph_io.what_if import WhatIfService
from simulation_handler.physics.rollouts.scene import RolloutBody
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld
from tests.simulation_handler.rollouts.scenes import cube, scene_of

T = TypeVar("T")
CUBES = {"cube_1": (0.3, 0.0), "cube_2": (0.3, 0.2), "cube_3": (-0.2, -0.2)}
BALL = (Part("sphere", (0.06, 0.06, 0.06)),)


class Room:
    """A table with three cubes and a ball, as it is believed to be, and the service that simulates that."""

    def __init__(self) -> None:
        self.clock = ManualClock(1000.0)
        self.network = LocalNetwork(self.clock)
        self.memory = memory = Memory("g", "thinker", transport=self.network.connect("a"), clock=self.clock)
        memory.replica.synchroniser.nobody_there()
        memory.add_node("world", "world")
        memory.add_node("table", "table", size=(1.0, 1.0, 0.05))
        memory.add_edge("world", "table", "RT", pose=Pose())
        ball = RolloutBody("ball", (0.06, 0.06, 0.06), (-0.2, 0.2, 0.03), mass=0.05, friction=0.5, shape=BALL)
        bodies = [*(cube(name, x, y) for name, (x, y) in CUBES.items()), ball]
        for body in bodies:
            kind = "ball" if body.shape else "cube"
            memory.add_node(body.name, kind, size=body.size, mass=body.mass)
            memory.add_edge("world", body.name, "Virtual_RT", pose=Pose(body.position))
            memory.add_edge(body.name, "table", "on")
        memory.add_node("human_1", "person")
        memory.add_edge("world", "human_1", "RT", pose=Pose((0.9, 0.0, 0.6), (0.0, 0.0, 1.0, 0.0)))
        self.service = WhatIfService(self.network.connect("handler"), memory.keys, self.clock)
        self.scene = scene_of(*bodies)
        self.service.offer(self.scene, (), 999.0)
        self.asked: list[Question] = []

    def fork(self) -> Memory:
        return self.memory.fork("idea")

    def think(self, thought: Thought[T]) -> T:
        """Its outcome, with each question answered at once."""
        try:
            question = next(thought)
            while True:
                self.asked.append(question)
                question = thought.send(self.service.answer(encode_question(question)))
        except StopIteration as stop:
            result: T = stop.value
            return result


@pytest.fixture
def room() -> Iterator[Room]:
    room = Room()
    yield room
    room.service.close()
    room.memory.close()


# ---- what is different


def test_a_fork_is_no_different_from_what_is_believed(room: Room) -> None:
    assert differences(room.memory, room.fork()) == ()


def test_what_is_elsewhere_gone_and_new_in_a_world(room: Room) -> None:
    idea = room.fork()
    idea.add_edge("world", "cube_1", "Virtual_RT", pose=Pose((0.0, 0.0, 0.02)))
    idea.update_node("cube_2", present=False)
    idea.add_node("cone", "cup", size=(0.1, 0.1, 0.1), mass=0.2)
    idea.add_edge("world", "cone", "RT", pose=Pose((0.0, 0.3, 0.05)))
    assert differences(room.memory, idea, held=["ball"]) == (
        Supposed.hold("ball", Pose((-0.2, 0.2, 0.03))),
        Supposed.add("cone", Pose((0.0, 0.3, 0.05)), (0.1, 0.1, 0.1), mass=0.2),
        Supposed.place("cube_1", Pose((0.0, 0.0, 0.02))),
        Supposed.remove("cube_2"),
    )


# ---- one more object in a question


def ask(room: Room, *changes: Supposed) -> Any:
    return room.service.answer(encode_question(Question(1.0, changes)))


def test_what_is_added_is_simulated_and_forgotten(room: Room) -> None:
    answer = ask(room, Supposed.add("crate", Pose((0.0, 0.0, 0.2)), (0.1, 0.1, 0.1)))
    assert answer.rests_on["crate"] == ("table",)
    assert "crate" not in ask(room).poses


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (Supposed.add("cube_1", Pose(), (0.1, 0.1, 0.1)), "there already"),
        (Supposed.add("crate", Pose((0.3, 0.0, 0.05)), (0.1, 0.1, 0.1)), "inside"),
        (Supposed.add("crate", Pose((0.0, 0.0, 1.0)), (0.1, 0.0, 0.1)), "size"),
        (Supposed.add("crate", Pose((0.0, 0.0, 1.0)), (0.1, 0.1, 0.1), mass=-1.0), "mass"),
        (Supposed("crate", "add", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.1, 0.1, 0.1), (1.0, 2.0)), "shape"),
        (Supposed("crate", "add"), "takes a pose and a size"),
    ],
)
def test_what_cannot_be_added_is_refused(room: Room, change: Supposed, why: str) -> None:
    assert why in ask(room, change).refused


# ---- by a relation


@pytest.mark.parametrize("relation", ["in_front_of", "behind", "left_of", "right_of"])
def test_a_thing_is_put_as_a_person_sees_it(room: Room, relation: str) -> None:
    idea = room.fork()
    pose = room.think(placed(room.memory, idea, "cube_3", relation, "cube_1", "human_1"))
    boxes = read_scene(idea).boxes
    assert margin(relation, boxes["cube_3"], boxes["cube_1"], View((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))) >= 0.0
    assert idea.edge("world", "cube_3", "Virtual_RT").pose == pose
    assert room.memory.edge("world", "cube_3", "Virtual_RT").pose.t == (-0.2, -0.2, 0.02)


@pytest.mark.parametrize("relation", ["next_to", "above", "on_top"])
def test_a_thing_is_put_as_everybody_sees_it(room: Room, relation: str) -> None:
    idea = room.fork()
    room.think(placed(room.memory, idea, "cube_3", relation, "cube_1"))
    boxes = read_scene(idea).boxes
    assert margin(relation, boxes["cube_3"], boxes["cube_1"]) >= 0.0
    below = "table" if relation == "next_to" else "cube_1"
    assert [edge.dst for edge in idea.edges("on", src="cube_3")] == [below]


def test_a_balloon_that_nobody_has_seen_lies_behind_a_person(room: Room) -> None:
    idea = room.fork()
    idea.add_node("balloon", "ball", size=(0.2, 0.2, 0.2), color=(1.0, 0.0, 0.0), mass=0.01)
    pose = room.think(placed(room.memory, idea, "balloon", "behind", "human_1"))
    assert pose.t[0] > 0.9 + 0.1 and pose.t[2] == pytest.approx(-0.6, abs=0.01), "on the floor, behind the back"
    assert "balloon" not in room.memory


def test_nothing_is_imagined_in_what_is_believed(room: Room) -> None:
    with pytest.raises(ConfigError, match="'base' would be believed there: give a fork"):
        room.think(placed(room.memory, room.memory, "cube_3", "behind", "cube_1", "human_1"))


def test_what_would_fall_down_is_not_put_there(room: Room) -> None:
    with pytest.raises(ImaginationError, match="nowhere to put 'cube_3' on_top 'ball'"):
        room.think(placed(room.memory, room.fork(), "cube_3", "on_top", "ball"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("cube_3", "behind", "cube_1"), "expected a viewpoint"),
        (("cube_3", "beneath", "cube_1"), "nothing can be placed 'beneath'"),
        (("human_1", "behind", "cube_1", "human_1"), "does not tell its size"),
    ],
)
def test_wrong_wishes_are_refused(room: Room, arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        room.think(placed(room.memory, room.fork(), *arguments))


# ---- plans


def carry_out(room: Room, *steps: str, world: Memory | None = None) -> Outcome:
    return room.think(carried_out(room.memory, world or room.fork(), [parse_step(step) for step in steps]))


def test_a_plan_leaves_its_outcome_as_a_world(room: Room) -> None:
    idea = room.fork()
    outcome = carry_out(room, "pick cube_3", "place cube_3 on cube_1", "place cube_2 on cube_3", world=idea)
    assert outcome.steps == 3 and not outcome.failed and not outcome.moved and not outcome.fallen
    assert {(edge.src, edge.dst) for edge in idea.edges("on")} == {
        ("cube_3", "cube_1"), ("cube_2", "cube_3"), ("cube_1", "table"), ("ball", "table"),
    }  # fmt: skip
    assert [entry.text for entry in query(idea, kind="imagined")][-1] == "place cube_2 on cube_3"
    assert len(room.memory.edges("on", dst="table")) == 4 and not query(room.memory)


def test_what_stays_is_kept_in_the_middle_however_high_the_tower(room: Room) -> None:
    idea = room.fork()
    assert not carry_out(room, "place cube_3 on cube_1", "place cube_2 on cube_3", world=idea).failed
    assert idea.edge("world", "cube_2", "Virtual_RT").pose.t == pytest.approx((0.3, 0.0, 0.1), abs=1e-3)
    other = room.memory.fork("other")
    pose = room.think(placed(room.memory, other, "cube_3", "on_top", "cube_1"))
    assert pose.t == pytest.approx((0.3, 0.0, 0.06), abs=1e-3)


def test_a_plan_that_cannot_be_carried_out_says_why(room: Room) -> None:
    assert "would not stay on ball" in carry_out(room, "place cube_3 on ball", "place cube_2 on cube_3").failed


def test_what_falls_and_what_is_disturbed_counts(room: Room) -> None:
    idea = room.fork()
    carry_out(room, "place cube_3 on cube_1", world=idea)
    outcome = carry_out(room, "pick cube_1", world=idea)
    assert outcome.moved["cube_3"] > 0.03
    idea.delete_world("idea")
    assert "would fall to the floor" in carry_out(room, "place cube_1 at 0.515, 0, 0.0205").failed


def test_a_plan_is_as_probable_as_the_worlds_in_which_it_succeeds(room: Room) -> None:
    """One world has the support elsewhere, so that what is put down there falls; the plan is tried in both."""
    here, beside = (ObjectState(Pose(place)) for place in ((0.3, 0.2, 0.02), (0.35, 0.2, 0.02)))
    worlds = WeightedWorld(0.7, {"cube_2": here}), WeightedWorld(0.3, {"cube_2": beside})
    room.service.offer(room.scene, [Island(("cube_2",), worlds)], 999.0)
    steps = [parse_step("pick cube_1"), parse_step("place cube_1 on cube_2")]
    outcome = room.think(carried_out(room.memory, room.fork(), steps))
    assert outcome.steps == 2 and outcome.probability == pytest.approx(0.7)
    assert str(outcome) == "2 steps; 70 % probable"
    sure = Outcome(2, "", (), {"cube_3": 0.02})
    assert best({"doubtful": outcome, "sure": sure}) == "sure"


def test_the_best_plan_is_carried_out_and_disturbs_least() -> None:
    good, rough = Outcome(3, "", (), {}), Outcome(2, "", (), {"cube": 0.1})
    failed = Outcome(1, "it falls", (), {})
    assert best({"failed": failed, "rough": rough, "good": good}) == "good"
    with pytest.raises(ValueError, match="it falls"):
        best({"failed": failed})


@pytest.mark.parametrize("text", ["place cube_1", "take cube_1", "place cube_1 at here", "pick"])
def test_steps_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="expected"):
        parse_step(text)


def test_steps_are_read_from_texts_and_action_nodes(room: Room) -> None:
    assert parse_step("place cube_1 at 0.1, 0.2, 0.3") == Step("place", "cube_1", pose=Pose((0.1, 0.2, 0.3)))
    action = room.memory.add_node("action_0_0", "action", skill="place", target="cube_1", destination="cube_2")
    assert Step.of(action) == parse_step(str(Step.of(action))) == Step("place", "cube_1", "cube_2")


# ---- who asks


def test_an_agent_thinks_without_waiting(room: Room) -> None:
    what_if = WhatIf(room.memory.transport, Keys("g"), room.clock)
    thinking = Thinking(placed(room.memory, room.fork(), "cube_3", "on_top", "cube_1"), what_if)
    for _ in range(20):
        if thinking.poll():
            break
        room.network.deliver()
        room.clock.advance(0.1)
    assert thinking.result is not None and thinking.result.t[2] == pytest.approx(0.06, abs=1e-3)
    failing = Thinking(placed(room.memory, room.memory.fork("other"), "cube_3", "behind", "cube_1"), what_if)
    assert failing.poll() and "viewpoint" in failing.failed


def test_without_anybody_who_answers_nothing_is_imagined() -> None:
    clock = ManualClock()
    with Memory("g", "a", transport=LocalNetwork(clock).connect("a"), clock=clock) as memory:
        memory.replica.synchroniser.nobody_there()
        for name in ("world", "cube"):
            memory.add_node(name, name, size=(0.04, 0.04, 0.04))
        memory.add_edge("world", "cube", "RT", pose=Pose((0.0, 0.0, math.pi)))
        idea = memory.fork("idea")
        idea.add_node("other", "cube", size=(0.04, 0.04, 0.04))
        with pytest.raises(ImaginationError, match=r"nobody answered|no answer"):
            think(placed(memory, idea, "other", "on_top", "cube"), WhatIf(memory.transport, memory.keys, clock, 0.1))
