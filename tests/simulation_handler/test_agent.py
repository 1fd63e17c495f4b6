"""The agent between a graph and its belief, in lockstep."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import numpy as np
import pytest

from dsr.crdt.delta import Add, Delta
from dsr.graph.elements import Edge
from dsr.math3d.shapes import Part, to_numbers
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.replication.wire import encode_delta
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.bodies import MOST_BODIES, MOST_PARTS
from dsr.vocabulary.calibration import IN_DOUBT, STEADY
from simulation_handler import SimulationHandler
from simulation_handler.belief import Belief
from simulation_handler.graph_io.views import obstacles
from simulation_handler.graph_io.what_if import WhatIfService
from simulation_handler.physics.rollouts.scene import RolloutScene
from tests.simulation_handler.worlds import CUBE, TABLE, SyntheticCamera, cube_at

NAME = "simulation_handler"
OVERHEAD = Pose((0.35, 0.0, 0.65), (1.0, 0.0, 0.0, 0.0))
"""world_from_camera, looking down."""


class Table:
    """A graph with a camera over a table; percepts of true poses come in at 10 Hz."""

    def __init__(self, **config: float) -> None:
        self.lockstep = Lockstep([AgentSpec(NAME, SimulationHandler, config)], strict=True)
        self.memory: Memory = self.lockstep.memory
        self.camera = SyntheticCamera(1)
        self.truths: dict[str, Pose] = {}
        self.memory.add_node("world", "world")
        self.memory.add_node("table", "table", size=TABLE)
        self.memory.add_edge("world", "table", "RT", pose=Pose((0.35, 0.0, 0.0)))
        self.memory.add_node("camera", "camera")
        self.memory.add_edge("world", "camera", "RT", pose=OVERHEAD)
        self.memory.flush()

    def add(self, name: str, truth: Pose) -> None:
        """A cube that is seen from now on."""
        self.truths[name] = truth
        self.memory.add_node(name, "cube", size=CUBE, mass=0.05)

    def run(self, seconds: float) -> None:
        """Let time pass, with percepts."""
        for _ in range(round(seconds / 0.1)):
            for name, truth in self.truths.items():
                self.perceive(name, self.camera.percept(name, truth, self.lockstep.clock.now()))
            self.lockstep.run_for(0.1)

    def perceive(self, name: str, world_pose: Pose) -> None:
        """Write a percept as the scene estimator does."""
        camera_from_cube = (OVERHEAD.inverse() @ world_pose).with_stamp(world_pose.stamp)
        self.memory.add_edge("camera", name, "RT", pose=camera_from_cube)
        self.memory.flush()

    def belief(self, name: str) -> Edge:
        """What the agent wrote of an object."""
        return self.memory.edge("world", name, "Virtual_RT")

    def error(self, name: str) -> float:
        """Distance of the belief from the truth, m."""
        return self.belief(name).pose.distance(self.truths[name])[0]

    def relations(self) -> set[tuple[str, str]]:
        """Who rests on what."""
        return {(edge.src, edge.dst) for edge in self.memory.edges("on")}


@pytest.fixture
def table() -> Iterator[Table]:
    scene = Table()
    yield scene
    scene.lockstep.close()


def test_percepts_become_a_resting_belief(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1, yaw=0.5))
    table.add("cube_2", cube_at(0.4, 0.1, 0.06))
    table.run(3.0)
    for name in ("cube_1", "cube_2"):
        assert table.error(name) < 0.001
        assert table.belief(name).pose.covariance is not None
        assert table.memory.node(name)["plausible"] is True
    assert table.relations() == {("cube_1", "table"), ("cube_2", "cube_1")}
    edge = table.memory.edge("cube_2", "cube_1", "on")
    assert edge["source"] == "contact"
    assert edge["since"] < table.lockstep.clock.now() - 2.0
    assert table.lockstep.runner(NAME).agent.degraded == ""


def test_what_has_a_tag_is_recognised_by_it(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.4, 0.2))
    table.memory.update_node("cube_2", marker_id=2)
    table.run(0.5)
    handler = table.lockstep.runner(NAME).agent
    assert isinstance(handler, SimulationHandler) and isinstance(handler.belief, Belief)
    assert [handler.belief._bodies.objects[name].tagged for name in ("cube_1", "cube_2")] == [False, True]


def test_a_resting_scene_is_quiet(table: Table) -> None:
    for index in range(4):
        table.add(f"cube_{index}", cube_at(0.3 + 0.1 * index, 0.1))
    table.run(8.0)
    watch = table.memory.watch(edge_type=["Virtual_RT", "on"], existing=False)
    written = 0
    for _ in range(50):
        table.run(0.1)
        written += len(watch.poll())
    assert 4 * 5 <= written <= 4 * 8, "about once a second and object"


def test_an_unseen_object_keeps_its_belief_and_what_moves_is_followed(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.4, -0.1))
    table.run(2.0)
    hidden = {"cube_1": table.truths.pop("cube_1")}
    table.truths["cube_2"] = cube_at(0.3, -0.1)
    table.run(2.0)
    assert table.error("cube_2") < 0.002
    table.truths |= hidden
    assert table.error("cube_1") < 0.002


def test_relations_end_when_the_object_is_put_elsewhere(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.4, 0.1, 0.06))
    table.run(2.0)
    table.truths["cube_2"] = cube_at(0.3, -0.1)
    table.run(1.0)
    assert table.relations() == {("cube_1", "table"), ("cube_2", "table")}


def test_relations_of_others_are_left_alone(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.4, -0.1))
    table.memory.add_edge("cube_1", "cube_2", "on", source="plan")
    table.run(1.0)
    assert ("cube_1", "cube_2") in table.relations()


def test_after_a_kill_the_belief_goes_on_from_the_graph(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.4, 0.1, 0.06))
    table.add("cube_3", cube_at(0.3, -0.1, 0.1))
    table.run(3.0)
    before = {name: table.belief(name).pose for name in table.truths}
    relations = table.relations()
    assert table.memory.node("cube_3")["plausible"] is False
    table.lockstep.kill(NAME)
    seen, table.truths = table.truths, {}
    table.lockstep.restart(NAME)
    watch = table.memory.watch(edge_type="on", existing=False)
    for _ in range(20):
        table.run(0.1)
        assert all(table.belief(name).pose.distance(pose)[0] < 0.0005 for name, pose in before.items())
    assert table.belief("cube_1").pose.stamp > before["cube_1"].stamp + 1.0, "alive"
    assert table.relations() == relations
    assert not [change for change in watch.poll() if change.kind != "updated"]
    table.truths = seen
    table.run(1.0)
    assert table.error("cube_2") < 0.001


def test_a_late_start_believes_the_last_percept(table: Table) -> None:
    table.lockstep.kill(NAME)
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    table.truths.clear()
    table.run(3.0)
    table.lockstep.restart(NAME)
    table.run(1.0)
    assert table.belief("cube_1").pose.translation[2] == pytest.approx(0.02, abs=0.0005)


def test_an_object_removed_from_the_graph_is_removed_from_the_belief(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.add("cube_2", cube_at(0.4, 0.1, 0.06))
    table.run(2.0)
    table.memory.remove_node("cube_1")
    table.truths = {"cube_2": cube_at(0.4, 0.1)}
    table.run(1.0)
    assert table.relations() == {("cube_2", "table")}
    assert table.error("cube_2") < 0.002
    table.add("cube_1", cube_at(0.3, -0.1))
    table.run(1.0)
    assert table.error("cube_1") < 0.003


def test_what_stands_on_a_table_that_is_removed_falls(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    table.truths.clear()
    table.memory.remove_node("table")
    table.run(2.0)
    assert table.belief("cube_1").pose.translation[2] < -0.5
    assert table.relations() == set()


@pytest.mark.parametrize(("type", "told"), [("table", "static bodies"), ("cube", "things"), ("body", "")])
def test_however_many_bodies_somebody_makes_up_few_are_simulated_and_those_of_others_stay(
    table: Table, type: str, told: str
) -> None:
    """In one place, 3000 tables of one message stopped the agent for minutes."""
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    liar, most = table.lockstep._join("liar", "liar-1", None), MOST_PARTS if type == "body" else MOST_BODIES
    for number in range(most + 9):
        liar.add_node(f"a_{number}", type, size=CUBE, bounds=(-0.1, -0.1, -0.1, 0.1, 0.1, 0.1))
        liar.add_edge("world", f"a_{number}", "RT", pose=Pose((3.0, 0.0, 0.0)))
    liar.flush()
    table.run(0.2)
    handler = table.lockstep.runner(NAME).agent
    assert isinstance(handler, SimulationHandler)
    reading, memory = handler._reading, table.memory
    assert len(reading._known) <= MOST_BODIES and len(reading._fixed) <= MOST_BODIES
    assert "cube_1" in reading._known and "table" in reading._fixed
    hiding = [solid.name for solid in obstacles(memory)]
    assert len(hiding) <= most + (type == "body") and "table" in hiding
    assert handler.degraded.startswith(f"10 {told} are passed over" if told else "")
    assert table.error("cube_1") < 0.003
    for number in range(most + 9):
        liar.remove_node(f"a_{number}")
    liar.flush()
    table.run(0.2)
    assert handler.degraded == "" and reading._known.keys() == {"cube_1"} and reading._fixed == {"table"}


def test_a_table_keeps_its_friction_until_a_possible_one_is_told(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.memory.update_node("table", friction=0.4)
    table.run(1.0)
    handler = table.lockstep.runner(NAME).agent
    assert isinstance(handler, SimulationHandler) and isinstance(handler.belief, Belief)
    bodies = handler.belief._bodies
    assert bodies.friction_of("table") == 0.4
    table.memory.update_node("table", friction=-1.0)
    table.run(1.0)
    assert "table" in handler.degraded and "friction" in handler.degraded
    assert bodies.friction_of("table") == 0.4 and table.error("cube_1") < 0.003
    table.memory.update_node("table", friction=0.3)
    table.run(0.2)
    assert handler.degraded == "" and bodies.friction_of("table") == 0.3


def test_an_object_that_turns_into_a_table_is_none_any_more(table: Table) -> None:
    """Whoever makes a node of that name under another type can do that. Before, each tick failed from then on."""
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    before, liar = set(table.memory.nodes()), ("zz-1", 1)
    delta = Delta([Add(liar, "cube_1", "table")], context=[(*liar, 1)])
    table.lockstep.network.connect("liar").publish(table.memory.keys.delta("zz-1"), encode_delta(delta))
    table.run(1.0)
    assert set(table.memory.nodes()) == before and table.memory.node("cube_1").type == "table"
    table.lockstep.network.connect("liar").publish(
        table.memory.keys.delta("zz-1"), encode_delta(Delta(removed=[liar], context=[("zz-1", 2, 2)]))
    )
    table.run(2.0)
    assert table.error("cube_1") < 0.003


def test_a_table_that_moves_and_an_object_that_changes_size(table: Table) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    table.memory.update_edge("world", "table", "RT", pose=Pose((0.35, 0.0, -0.1)))
    table.memory.update_node("cube_1", size=(0.06, 0.06, 0.06))
    table.truths["cube_1"] = cube_at(0.4, 0.1, -0.07)
    table.run(2.0)
    assert table.error("cube_1") < 0.002
    assert table.relations() == {("cube_1", "table")}


def test_a_pose_without_stamp_always_holds(table: Table) -> None:
    table.memory.add_node("box_1", "box", size=(0.1, 0.1, 0.1))
    table.memory.add_edge("world", "box_1", "RT", pose=Pose((0.3, 0.1, 0.05)))
    table.run(2.0)
    assert table.belief("box_1").pose.t == pytest.approx((0.3, 0.1, 0.05), abs=0.0005)
    assert table.relations() == {("box_1", "table")}


def bad_percept(pose: Pose, now: float, kind: str) -> Pose:
    covariance = np.diag([1e-6] * 6)
    covariance[0, 1] = covariance[1, 0] = 1e-3
    return pose.with_stamp(now + 5.0) if kind == "future" else pose.with_stamp(now).with_covariance(covariance)


@pytest.mark.parametrize("kind", ["future", "indefinite"])
def test_bad_percepts_are_skipped(table: Table, kind: str, caplog: pytest.LogCaptureFixture) -> None:
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(1.0)
    now = table.lockstep.clock.now()
    table.truths.clear()
    with caplog.at_level(logging.WARNING):
        for step in range(5):
            table.perceive("cube_1", bad_percept(cube_at(0.2, 0.1), now + 0.1 * step, kind))
            table.run(0.1)
    assert [record.getMessage() for record in caplog.records if "logged once" in record.getMessage()] != []
    assert len(caplog.records) == 1
    table.truths["cube_1"] = cube_at(0.4, 0.1)
    assert table.error("cube_1") < 0.002


@pytest.mark.parametrize(
    "attributes",
    [{}, {"size": (0.04, 0.0, 0.04)}, {"size": (0.04, -1.0, 0.04)}, {"size": CUBE, "mass": 0.0},
     {"size": CUBE, "mass": -1.0}, {"size": CUBE, "friction": -0.1},
     {"size": (0.04, 1e-300, 0.04)}, {"size": (1e9, 1e9, 1e9)}, {"size": CUBE, "mass": 1e-300},
     {"size": CUBE, "mass": 1e12}],
)  # fmt: skip
def test_bad_nodes_are_skipped_and_said_once(
    table: Table, attributes: dict[str, object], caplog: pytest.LogCaptureFixture
) -> None:
    table.memory.add_node("cube_9", "cube", **attributes)
    table.add("cube_1", cube_at(0.4, 0.1))
    with caplog.at_level(logging.WARNING):
        table.run(1.0)
    assert [record.getMessage() for record in caplog.records if "cube_9" in record.getMessage()] != []
    assert len(caplog.records) == 1
    agent = table.lockstep.runner(NAME).agent
    assert isinstance(agent, SimulationHandler)
    assert "cube_9" in agent.degraded
    assert table.error("cube_1") < 0.003
    table.memory.update_node("cube_9", size=CUBE, mass=0.05, friction=0.5)
    table.truths["cube_9"] = cube_at(0.3, -0.1)
    table.run(1.0)
    assert table.error("cube_9") < 0.003
    assert agent.degraded == ""


def test_how_easily_something_rolls_is_taken_from_its_node(table: Table, monkeypatch: pytest.MonkeyPatch) -> None:
    scenes, offer = list[RolloutScene](), WhatIfService.offer
    monkeypatch.setattr(
        WhatIfService, "offer", lambda self, scene, *more: (scenes.append(scene), offer(self, scene, *more))
    )
    size = (0.06, 0.06, 0.06)
    shape = to_numbers((Part("sphere", size),))
    table.memory.add_node("ball", "ball", size=size, shape=shape, mass=0.05, rolling_friction=0.003)
    table.memory.update_node("table", friction=0.9)
    table.truths["ball"] = Pose((0.3, 0.1, 0.03))
    table.run(0.5)
    assert [body.rolling_friction for body in scenes[-1].bodies if body.name == "ball"] == [0.003]
    assert [body.friction for body in scenes[-1].bodies if body.name == "table"] == [0.9]


@pytest.mark.parametrize(("camera", "is_explained"), [("camera", False), ("other", True)])
def test_a_camera_in_doubt_puts_only_its_own_percepts_in_doubt(table: Table, camera: str, is_explained: bool) -> None:
    table.memory.add_node("other", "camera", mount=IN_DOUBT)
    table.memory.add_edge("world", "other", "RT", pose=OVERHEAD)
    table.memory.update_node("camera", mount=IN_DOUBT if camera == "camera" else STEADY)
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(2.0)
    table.truths["cube_1"] = cube_at(0.3, 0.1)
    table.run(3.0)
    assert (table.error("cube_1") < 0.005) == is_explained


def test_percepts_of_a_camera_that_hangs_nowhere_are_skipped(table: Table) -> None:
    table.memory.add_node("stray", "camera")
    table.memory.add_node("cube_1", "cube", size=CUBE)
    table.memory.add_edge("stray", "cube_1", "RT", pose=Pose((0.0, 0.0, 0.5), stamp=table.lockstep.clock.now()))
    table.run(0.5)
    assert table.memory.get_edge("world", "cube_1", "Virtual_RT") is None
    assert "no path" in table.lockstep.runner(NAME).agent.degraded


def test_without_a_world_it_waits() -> None:
    with Lockstep([AgentSpec(NAME, SimulationHandler)], strict=True) as lockstep:
        lockstep.memory.add_node("cube_1", "cube", size=CUBE)
        lockstep.memory.flush()
        lockstep.run_for(0.5)
        assert lockstep.runner(NAME).agent.degraded == ""


def test_two_runs_are_equal_bit_for_bit() -> None:
    results = []
    for _ in range(2):
        scene = Table()
        for index in range(5):
            scene.add(f"cube_{index}", cube_at(0.3 + 0.05 * index, 0.1, yaw=0.2 * index))
        scene.run(1.0)
        scene.truths["cube_0"] = cube_at(0.4, 0.1, 0.06)
        scene.run(1.0)
        results.append([scene.belief(name).pose for name in scene.truths])
        scene.lockstep.close()
    assert results[0] == results[1]


def test_who_ends_frees_the_simulation() -> None:
    table = Table()
    table.add("cube_1", cube_at(0.4, 0.1))
    table.run(0.5)
    agent = table.lockstep.runner(NAME).agent
    assert isinstance(agent, SimulationHandler) and isinstance(agent._belief, Belief)
    simulation = agent._belief._bodies.sim
    assert "cube_1" in simulation
    table.lockstep.close()
    assert "cube_1" not in simulation
