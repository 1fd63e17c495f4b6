"""What-if questions to the simulation handler: in lockstep, live over Zenoh, secured; nothing disturbs the belief."""

from __future__ import annotations

import json
import logging
import math
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

import dsr
from benchmarks.fuzz import corpus
from benchmarks.fuzz.mutations import Mutator
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.agent import Agent
from dsr.cli.common import console
from dsr.cli.main import app
from dsr.clock import WALL_CLOCK
from dsr.connecting import SECURITY
from dsr.errors import ConfigError, TransportError
from dsr.math3d.shapes import Part
from dsr.network.keys import Keys
from dsr.runtime.launcher import Launcher
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec, System
from dsr.security.authority import SecurityFolder
from dsr.security.policy import Grant, checked, grant_for, standard_grants, write_policy
from dsr.vocabulary.what_if import (
    LONGEST,
    Answer,
    Pending,
    Question,
    Supposed,
    WhatIf,
    decode_answer,
    encode_answer,
    encode_question,
)
from simulation_handler import SimulationHandler
from simulation_handler.graph_io.what_if import WhatIfService
from simulation_handler.physics.rollouts.engine import Engine
from simulation_handler.physics.rollouts.scene import RolloutScene
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld
from tests.simulation_handler.rollouts.scenes import cube, scene_of

STACK = scene_of(cube("cube_1", 0.3, 0.0), cube("cube_2", 0.3, 0.0, 0.06), cube("cube_3", 0.0, 0.2))
DOCUMENT = Path(__file__).parents[2] / "docs/how-to/what_if.md"
ABOVE_3 = Pose((0.0, 0.2, 0.0601))


@pytest.fixture
def service() -> Iterator[WhatIfService]:
    """Serves the scene with a stack of two cubes, and one beside."""
    clock = ManualClock(1000.0)
    service = WhatIfService(LocalNetwork(clock).connect("handler"), Keys("g"), clock)
    service.offer(STACK, (), 990.0)
    yield service
    service.close()


def ask(service: WhatIfService, seconds: float, *changes: Supposed) -> Answer:
    return service.answer(encode_question(Question(seconds, changes)))


def test_without_changes_everything_stays_as_it_is(service: WhatIfService) -> None:
    answer = ask(service, 1.0)
    assert answer.refused == "" and answer.at_rest and answer.stamp == 990.0 and answer.seconds < 1.0
    assert answer.rests_on == {"cube_1": ("table",), "cube_2": ("cube_1",), "cube_3": ("table",)}
    assert answer.touches == (("cube_1", "cube_2"), ("cube_1", "table"), ("cube_3", "table"))
    assert set(answer.moved) == set(answer.turned) == set(answer.poses) == {"cube_1", "cube_2", "cube_3"}
    assert max(answer.moved.values()) < 5e-4 and max(answer.turned.values()) < 0.01


def in_worlds(*worlds: tuple[float, dict[str, ObjectState]]) -> Island:
    found = tuple(WeightedWorld(weight, objects) for weight, objects in worlds)
    return Island(tuple(sorted(found[0].objects)), found)


def test_a_question_is_tried_in_the_most_probable_worlds(service: WhatIfService) -> None:
    here, beside, gone = (ObjectState(pose) for pose in (Pose((0.3, 0.0, 0.02)), Pose((0.3, 0.1, 0.02)), None))
    third = ObjectState(Pose((0.0, 0.2, 0.02)))
    service.offer(
        STACK, [
            in_worlds((0.6, {"cube_1": here}), (0.3, {"cube_1": beside}), (0.1, {"cube_1": gone})),
            in_worlds((0.9, {"cube_3": third}), (0.1, {"cube_3": ObjectState(third.pose, hand="hand_0")})),
        ], 990.0,
    )  # fmt: skip
    answer = service.answer(encode_question(Question(1.0, worlds=4)))
    assert [(round(one.weight, 2), one.otherwise) for one in answer.outcomes] == [
        (0.54, ()), (0.27, ("cube_1",)), (0.09, ("cube_1",)), (0.06, ("cube_3",)),
    ]  # fmt: skip
    assert answer.moved["cube_2"] < 5e-4 and answer.others[0].moved["cube_2"] == pytest.approx(0.04, abs=0.002)
    assert "cube_1" not in answer.others[1].poses and answer.others[1].rests_on["cube_2"] == ("table",)
    assert answer.probability(lambda one: one.moved["cube_2"] < 0.01) == pytest.approx(0.6 / 0.96)
    alone = msgspec.structs.replace(answer, others=(), weight=1.0)
    assert service.answer(encode_question(Question(1.0))) == alone


def test_a_world_in_which_there_is_no_room_is_one_of_the_outcomes(service: WhatIfService) -> None:
    elsewhere = ObjectState(Pose((0.0, 0.2, 0.06)))
    island = in_worlds((0.7, {"cube_1": ObjectState(Pose((0.3, 0.0, 0.02)))}), (0.3, {"cube_1": elsewhere}))
    service.offer(STACK, [island], 990.0)
    question = Question(1.0, (Supposed.place("cube_2", ABOVE_3),), worlds=2)
    answer = service.answer(encode_question(question))
    assert answer.refused == "" and answer.others[0].refused == "'cube_2' would be 40 mm inside 'cube_1' there"
    assert answer.probability(lambda one: not one.refused) == pytest.approx(0.7)


def test_a_world_that_refuses_keeps_no_other_from_answering(service: WhatIfService) -> None:
    """The cube is there in the less probable world alone: where it is gone, nothing can be changed about it."""
    island = in_worlds((0.7, {"cube_1": ObjectState(None)}), (0.3, {"cube_1": ObjectState(Pose((0.3, 0.0, 0.02)))}))
    service.offer(STACK, [island], 990.0)
    answer = service.answer(encode_question(Question(1.0, (Supposed.hold("cube_1"),), worlds=2)))
    assert [(one.weight, bool(one.refused)) for one in answer.outcomes] == [(0.3, False), (0.7, True)]
    blocked = Supposed.place("cube_2", ABOVE_3)
    shown = STACK.moved({"cube_1": ((0.0, 0.2, 0.06), (0.0, 0.0, 0.0, 1.0))})
    there, away = ObjectState(Pose((0.0, 0.2, 0.06))), ObjectState(Pose((0.3, 0.0, 0.02)))
    service.offer(shown, [in_worlds((0.7, {"cube_1": there}), (0.3, {"cube_1": away}))], 990.0)
    answer = service.answer(encode_question(Question(1.0, (blocked,), worlds=2)))
    assert answer.refused == "'cube_2' would be 40 mm inside 'cube_1' there" and answer.failed == ""
    [other] = answer.others
    assert answer.weight == 0.7 and other.refused == "" and other.rests_on["cube_2"] == ("cube_3",)
    assert answer.probability(lambda one: not one.refused) == pytest.approx(0.3)
    nowhere = service.answer(encode_question(Question(1.0, (Supposed.remove("cube_9"),), worlds=2)))
    assert nowhere.failed == nowhere.refused and "no object 'cube_9'" in nowhere.failed
    assert [one.weight for one in nowhere.outcomes] == [0.7, 0.3]


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[RolloutScene]:
    """The scenes that are simulated."""
    scenes: list[RolloutScene] = []
    run = Engine.run

    def noting(self: Engine, scene: RolloutScene, *given: Any) -> Any:
        scenes.append(scene)
        return run(self, scene, *given)

    monkeypatch.setattr(Engine, "run", noting)
    return scenes


def test_what_moves_anyway_is_no_effect_of_the_changes(service: WhatIfService, runs: list[RolloutScene]) -> None:
    """In one world a cube is in the air: it falls, whatever is put elsewhere."""
    resting, falling = ObjectState(Pose((0.3, 0.0, 0.06))), ObjectState(Pose((0.3, 0.2, 0.12)))
    service.offer(STACK, [in_worlds((0.8, {"cube_2": resting}), (0.2, {"cube_2": falling}))], 990.0)
    away = Supposed.place("cube_3", Pose((-0.2, -0.2, 0.02)))
    answer = service.answer(encode_question(Question(1.0, (away,), worlds=2)))
    [other] = answer.others
    assert answer.anyway == {} and answer.effect("cube_2")[0] == answer.moved["cube_2"] < 1e-3
    assert other.moved["cube_2"] == pytest.approx(0.1, abs=0.002) and other.anyway.keys() == {"cube_2"}
    assert other.effect("cube_2") == pytest.approx((0.0, 0.0), abs=1e-3)
    assert other.effects == pytest.approx({"cube_1": 0.0, "cube_2": 0.0, "cube_3": 0.0}, abs=1e-3)
    assert len(runs) == 3, "the world without the change is simulated only where something moves"


def test_what_the_changes_do_to_what_moves_anyway_is_an_effect(service: WhatIfService) -> None:
    falling = Supposed.place("cube_2", Pose((0.0, -0.2, 0.2)))
    service.offer(STACK.moved({"cube_2": ((0.0, -0.2, 0.2), (0.0, 0.0, 0.0, 1.0))}), (), 990.0)
    caught = ask(service, 1.0, Supposed.place("cube_3", Pose((0.0, -0.2, 0.02))))
    assert caught.rests_on["cube_2"] == ("cube_3",) and caught.effect("cube_2")[0] == pytest.approx(0.04, abs=2e-3)
    assert ask(service, 1.0).anyway == {}, "without changes nothing is compared"
    assert ask(service, 1.0, falling).effect("cube_2")[0] == pytest.approx(0.18, abs=2e-3), "what a change is about"


def test_worlds_are_not_tried_any_more_once_nobody_waits(
    service: WhatIfService, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, run = service._clock, Engine.run
    assert isinstance(clock, ManualClock)

    def slow(self: Engine, scene: RolloutScene, *given: Any) -> Any:
        clock.advance(0.4)
        return run(self, scene, *given)

    monkeypatch.setattr(Engine, "run", slow)
    here = ObjectState(Pose((0.0, 0.2, 0.02)))
    others = [(0.1, {"cube_3": ObjectState(Pose((0.0, 0.2 + 0.1 * number, 0.02)))}) for number in range(1, 6)]
    service.offer(STACK, [in_worlds((0.5, {"cube_3": here}), *others)], 990.0)
    question = Question(0.1, worlds=6, expires=1001.0)
    assert len(service.answer(encode_question(question)).outcomes) == 3
    later = Question(0.1, worlds=6, expires=clock.now() + 60.0)
    assert len(service.answer(encode_question(later)).outcomes) == 6


def test_worlds_of_equal_weight_have_one_order(service: WhatIfService) -> None:
    def halves(name: str, x: float, y: float, z: float) -> Island:
        places = [ObjectState(Pose((x, y, z))), ObjectState(Pose((x, y + 0.1, z)))]
        return in_worlds(*((0.5, {name: place}) for place in places))

    islands = [halves("cube_1", 0.3, 0.0, 0.02), halves("cube_2", 0.3, 0.0, 0.06), halves("cube_3", 0.0, 0.2, 0.02)]
    found = []
    for order in (islands, islands[::-1]):
        service.offer(STACK, order, 990.0)
        answer = service.answer(encode_question(Question(0.1, worlds=5)))
        assert [one.weight for one in answer.outcomes] == [0.125] * 5 and answer.otherwise == ()
        found.append([one.otherwise for one in answer.outcomes])
        assert service.answer(encode_question(Question(0.1, worlds=5))) == answer
    assert found[0] == found[1]


class Passing(ManualClock):
    """Some time passes with each look at it."""

    def monotonic(self) -> float:
        self.advance(0.2)
        return super().monotonic()


@pytest.fixture
def worked() -> Iterator[tuple[WhatIfService, Passing]]:
    """Serves the stack, and time passes while it works."""
    clock = Passing(1000.0)
    service = WhatIfService(LocalNetwork(clock).connect("handler"), Keys("g"), clock)
    service.offer(STACK, (), 990.0)
    yield service, clock
    service.close()


def crowd(count: int, parts: int) -> tuple[Supposed, ...]:
    """Bodies that fall."""
    shape = [Part("box", (0.01, 0.01, 0.01), (0.001 * number, 0.0, 0.0)) for number in range(parts)]
    places = [Pose((0.5 + 0.1 * number, 0.0, 50.0)) for number in range(count)]
    adds = (Supposed.add(f"n{number}", pose, (0.03, 0.03, 0.03), tuple(shape)) for number, pose in enumerate(places))
    return tuple(adds)


@pytest.mark.parametrize(("changes", "said"), [(crowd(50, 16), "there is room"), (crowd(1, 1), "of a simulation")])
@pytest.mark.parametrize("expires", [0.0, 1e9, 1005.0])
def test_a_question_that_takes_too_long_is_given_up(
    worked: tuple[WhatIfService, Passing], changes: tuple[Supposed, ...], said: str, expires: float
) -> None:
    """It would hold up the belief and all others who ask: a thousand bodies of 16 parts take hours."""
    service, clock = worked
    refused = service.answer(encode_question(Question(10.0, changes, expires)))
    assert said in refused.refused and refused.poses == {}
    assert clock.now() - 1000.0 < (min(expires - 1000.0, LONGEST) if expires else LONGEST) + 1.0
    assert service.answer(encode_question(Question(0.0))).refused == ""


@pytest.mark.parametrize("worlds", [0, 17, "2"])
def test_no_worlds_or_too_many_are_refused(service: WhatIfService, worlds: object) -> None:
    payload = msgspec.msgpack.encode({"seconds": 1.0, "worlds": worlds})
    assert "malformed what-if question" in service.answer(payload).refused


def test_what_is_placed_well_stays_there(service: WhatIfService) -> None:
    answer = ask(service, 1.0, Supposed.place("cube_2", ABOVE_3))
    assert answer.rests_on["cube_2"] == ("cube_3",) and answer.moved["cube_2"] < 1e-3


def test_what_is_placed_badly_topples(service: WhatIfService) -> None:
    answer = ask(service, 2.0, Supposed.place("cube_2", Pose((0.025, 0.2, 0.0601))))
    assert answer.rests_on["cube_2"] == ("table",)
    assert answer.moved["cube_2"] > 0.03 and answer.turned["cube_2"] > 1.0


def test_what_carried_it_is_taken_away_or_is_held(service: WhatIfService) -> None:
    assert ask(service, 1.0, Supposed.remove("cube_1")).rests_on == {"cube_2": ("table",), "cube_3": ("table",)}
    held = ask(service, 1.0, Supposed.hold("cube_2"), Supposed.remove("cube_1"))
    assert held.poses["cube_2"][2] == 0.06 and held.rests_on["cube_2"] == ()
    lifted = ask(
        service, 1.0, Supposed.hold("cube_1", Pose((0.3, 0.0, 0.5))), Supposed.place("cube_2", Pose((0.3, 0.0, 0.55)))
    )
    assert lifted.rests_on["cube_2"] == ("cube_1",) and lifted.moved["cube_1"] == 0.0


def test_changes_are_made_in_order_and_placing_lets_go(service: WhatIfService) -> None:
    answer = ask(service, 1.0, Supposed.hold("cube_3", Pose((0.0, 0.2, 0.5))), Supposed.place("cube_3", ABOVE_3))
    assert answer.moved["cube_3"] == pytest.approx(0.04, abs=2e-3)


def test_fixtures_can_be_changed_too_and_what_falls_is_on_the_floor(service: WhatIfService) -> None:
    answer = ask(service, 3.0, Supposed.remove("table"))
    assert answer.on_floor == ("cube_1", "cube_3") and answer.rests_on["cube_1"] == ()
    assert answer.rests_on["cube_2"] == ("cube_1",) and answer.touches == (("cube_1", "cube_2"),)


@pytest.mark.parametrize(
    "payload, message",
    [
        (encode_question(Question(1.0, (Supposed.remove("cubee_3"),))), "no object 'cubee_3'.*did you mean 'cube_3'"),
        (encode_question(Question(1.0, (Supposed.remove("_floor"),))), "no object '_floor'"),
        (encode_question(Question(1.0, (Supposed("cube_1", "place"),))), "to place it needs a pose"),
        (
            encode_question(Question(1.0, (Supposed("cube_1", "place", (math.nan, *[0.0] * 5, 1.0)),))),
            "pose of 'cube_1'",
        ),
        (encode_question(Question(1.0, (Supposed("cube_1", "hold", (0.0,) * 7),))), "pose of 'cube_1'"),
        (
            encode_question(Question(1.0, (Supposed.place("cube_1", Pose((1e9, 0.0, 0.0))),))),
            "1e\\+09 m from the world",
        ),
        (encode_question(Question(1.0, (Supposed.remove("cube_1"), Supposed.hold("cube_1")))), "no object 'cube_1'"),
        (encode_question(Question(1.0, (Supposed.place("cube_3", Pose((0.3, 0.01, 0.05))),))), "10 mm inside 'cube_1'"),
        (encode_question(Question(1.0, expires=998.5)), "nobody waits for this answer any more, for 1.5 s"),
        (encode_question(Question(11.0)), "10"),
        (msgspec.msgpack.encode({"seconds": "long"}), "malformed"),
        (b"", "malformed"),
    ],
)
def test_what_makes_no_sense_is_refused_with_a_reason(service: WhatIfService, payload: bytes, message: str) -> None:
    answer = service.answer(payload)
    assert re.search(message, answer.refused), answer.refused
    assert answer.failed == answer.refused
    assert msgspec.structs.replace(answer, refused="", stamp=0.0, weight=1.0) == Answer()
    assert ask(service, 0.1).refused == ""


def test_a_failure_of_ours_is_an_answer_too(
    service: WhatIfService, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("oops")

    monkeypatch.setattr(Engine, "run", fail)
    assert "the simulation handler failed: RuntimeError('oops')" in ask(service, 0.1).refused
    assert [record.levelno for record in caplog.records] == [logging.ERROR]


def test_before_the_first_scene_and_after_the_end_it_says_so() -> None:
    clock = ManualClock()
    service = WhatIfService(LocalNetwork(clock).connect("handler"), Keys("g"), clock)
    assert "holds no scene" in ask(service, 0.1).refused
    service.offer(RolloutScene(()), (), 1.0)
    assert ask(service, 0.1).at_rest
    service.close()
    service.close()
    assert "holds no scene" in ask(service, 0.1).refused


def test_too_many_at_once_are_refused(service: WhatIfService, monkeypatch: pytest.MonkeyPatch) -> None:
    go, run = threading.Event(), Engine.run

    def slow(self: Engine, scene: RolloutScene, *given: Any) -> Any:
        go.wait(20)
        return run(self, scene, *given)

    monkeypatch.setattr(Engine, "run", slow)
    answers: list[Answer] = []
    threads = [threading.Thread(target=lambda: answers.append(ask(service, 0.1))) for _ in range(20)]
    for thread in threads:
        thread.start()
    assert eventually(lambda: len(answers) == 4)
    assert {answer.refused for answer in answers} == {"16 questions wait already; ask again later"}
    go.set()
    for thread in threads:
        thread.join()
    assert sum(answer.refused == "" for answer in answers) == 16


def eventually(is_true: Callable[[], bool], timeout: float = 20.0) -> bool:
    end = WALL_CLOCK.monotonic() + timeout
    while not is_true() and WALL_CLOCK.monotonic() < end:
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return is_true()


# ---- through the agents


class Asker(Agent):
    """Asks in one tick and has the answer in a later one."""

    name = "asker"
    uses_memory = False

    def setup(self) -> None:
        self.what_if = WhatIf(self.bus, self.keys, self.clock)
        self.pending: Pending | None = None
        self.answers: list[Answer] = []

    def tick(self, now: float) -> None:
        if self.pending is None:
            self.pending = self.what_if.ask(Question(1.0, (Supposed.remove("cube_1"),)))
        elif self.pending.done:
            assert self.pending.answer is not None, self.pending.failed
            self.answers.append(self.pending.answer)
            self.pending = None


def set_scene(memory: Memory) -> None:
    """A table with a stack of two cubes, as if it had been believed before."""
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
    memory.add_edge("world", "table", "RT", pose=Pose())
    for name, height in (("cube_1", 0.02), ("cube_2", 0.06)):
        memory.add_node(name, "cube", size=(0.04, 0.04, 0.04), mass=0.05)
        memory.add_edge("world", name, "Virtual_RT", pose=Pose((0.3, 0.0, height)))


def run_lockstep(agents: list[AgentSpec]) -> tuple[Lockstep, dict[str, Pose]]:
    lockstep = Lockstep(agents, seed=3, strict=True)
    set_scene(lockstep.memory)
    lockstep.memory.flush()
    lockstep.run_for(1.5)
    return lockstep, {edge.dst: edge["pose"] for edge in lockstep.memory.edges("Virtual_RT")}


def test_in_lockstep_agents_get_answers_and_the_belief_is_not_disturbed() -> None:
    handler = AgentSpec("simulation_handler", SimulationHandler)
    lockstep, undisturbed = run_lockstep([handler])
    lockstep.close()
    runs = [run_lockstep([handler, AgentSpec("asker", Asker)]) for _ in range(2)]
    answers = [lockstep.runner("asker").agent.answers for lockstep, _ in runs]
    for lockstep, _ in runs:
        lockstep.close()
    assert [poses for _, poses in runs] == [undisturbed] * 2
    assert answers[0] == answers[1] and len(answers[0]) >= 5
    assert answers[0][-1].rests_on == {"cube_2": ("table",)}


def secure(folder: Path) -> None:
    """Certificates for the simulation handler as it declares itself, for us who set the scene, and for readers."""
    security = SecurityFolder(folder)
    security.create(WALL_CLOCK.now())
    scene = Grant(("*",), ("*",), ("*",))
    grants = {"simulation_handler": grant_for(SimulationHandler), "scene": scene, **standard_grants()}
    for name in grants:
        security.issue(name, WALL_CLOCK.now())
    write_policy(security.policy, checked(grants))


@pytest.fixture(params=["open", "secured"])
def live(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Any]]:
    """The simulation handler as a process; runs `dsr what-if --json` or without."""
    (tmp_path / "runtime").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.delenv(SECURITY, raising=False)
    monkeypatch.setattr(console, "width", 160)
    folder = tmp_path / "keys" if request.param == "secured" else None
    if folder is not None:
        secure(folder)
        monkeypatch.setenv(SECURITY, str(folder))
    system = System(
        "what_if", (AgentSpec("simulation_handler", SimulationHandler, program="simulation_handler:SimulationHandler"),)
    )

    def run(*arguments: str) -> Any:
        return CliRunner().invoke(app, ["what-if", *arguments])

    with (
        Launcher(system, tmp_path / "run", security=folder) as launcher,
        dsr.connect("what_if", agent="scene") as memory,
    ):
        set_scene(memory)
        launcher.wait_ready()
        assert eventually(lambda: not run("--hold", "cube_2", "--seconds", "0").exception)
        yield run


def test_live_the_command_tells_what_would_be(live: Callable[..., Any]) -> None:
    answer = json.loads(live("--place", "cube_2=0.1,0.1,0.0201", "--seconds", "1", "--json").output)
    assert answer["rests_on"] == {"cube_1": ["table"], "cube_2": ["table"]}
    assert answer["poses"]["cube_2"][:2] == pytest.approx([0.1, 0.1], abs=1e-3)
    text = live("--remove", "cube_1", "--hold", "cube_2").output
    assert "cube_2" in text and "0.0600" in text and "all at rest" in text and "cube_1" not in text
    result = live("--remove", "cubee_1")
    assert isinstance(result.exception, ConfigError) and "did you mean 'cube_1'" in str(result.exception)


def test_live_many_questions_at_once_are_all_answered(live: Callable[..., Any]) -> None:
    with dsr.connect("what_if", agent="dsr") as memory:
        what_if = WhatIf(memory.transport, memory.keys, memory.clock)
        asked = [what_if.ask(Question(0.5, (Supposed.place("cube_2", Pose((0.01 * k, 0.1, 0.3))),))) for k in range(30)]
        assert eventually(lambda: all(pending.done for pending in asked))
        assert [pending.failed for pending in asked] == [""] * 30
        x = [pending.answer.poses["cube_2"][0] for pending in asked if pending.answer]
        assert x == pytest.approx([0.01 * k for k in range(30)], abs=2e-3)


def test_live_nobody_there_is_said_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with dsr.connect("empty", agent="script") as memory:
        what_if = WhatIf(memory.transport, memory.keys, memory.clock, timeout=1.0)
        with pytest.raises(TransportError, match="does the simulation handler run"):
            what_if.ask_and_wait(Question(0.5))


@pytest.mark.parametrize(
    "text", ["cube_1", "=1,2,3", "cube_1=1,2", "cube_1=1,2,x", "cube_1=0,0,0,0,0,0,0", "a=nan,0,0"]
)
def test_a_malformed_place_is_an_error_of_the_command(text: str) -> None:
    result = CliRunner().invoke(app, ["what-if", "--place", text])
    assert isinstance(result.exception, ConfigError) and "--place" in str(result.exception)


def test_nonsense_is_always_answered(service: WhatIfService, caplog: pytest.LogCaptureFixture) -> None:
    mutate = Mutator([*corpus.questions(), encode_question(Question(0.1, (Supposed.place("cube_2", ABOVE_3),)))], 1)
    answers = [decode_answer(encode_answer(service.answer(mutate()))) for _ in range(400)]
    assert sum(answer.refused != "" for answer in answers) > 200
    assert caplog.records == [], "no failure of ours"
    assert ask(service, 0.1).refused == ""


@pytest.mark.parametrize("live", ["open"], indirect=True)
def test_the_example_of_the_document_works(live: Callable[..., Any]) -> None:
    (code,) = re.findall(r"`would_it_stand.py`:\n```python\n(.*?)^```$", DOCUMENT.read_text(), re.DOTALL | re.MULTILINE)
    code = code.replace("tabletop", "what_if").replace("cube_3", "cube_2").replace("cube_4", "cube_1")
    outputs = [
        subprocess.run([sys.executable, "-c", version], capture_output=True, text=True, check=True, timeout=60).stdout
        for version in (code, code.replace("0.015", "0.025"))
    ]
    assert outputs[0].startswith("stands") and outputs[1].startswith("falls")
