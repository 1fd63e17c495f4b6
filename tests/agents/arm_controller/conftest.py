"""An arm controller in lockstep with fake devices, on a manual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.arm_controller import ArmController
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.urdf import load_robot
from agents.drivers import ArmState
from dsr import Frame, LocalNetwork, ManualClock, Memory, Pose
from dsr.agent import make_agent
from dsr.graph.access import WriteGuard
from dsr.network.keys import Keys
from dsr.runtime.runner import Runner

CUBE = (0.04, 0.04, 0.04)
PLACES = {"cube_3": (0.42, 0.08), "cube_4": (0.30, 0.08), "cube_5": (0.30, -0.08)}
DOWN = (1.0, 0.0, 0.0, 0.0)
PERIOD = 0.02
GEN3 = Path(__file__).parents[3] / "etc" / "robots" / "gen3.urdf"
HOME = (0.0, 0.0, np.pi, -0.96, 0.0, -2.05, np.pi / 2)
"""Looking down at the table."""


class FakeArm:
    """Is where its trajectory is, a sample per `advance`; its fingers take one. Lists what it was told."""

    def __init__(self) -> None:
        self.names = tuple(f"joint_{number}" for number in range(1, 8))
        self.positions = np.array(HOME)
        self.velocities = np.zeros(7)
        self.opening = 0.085
        self.obstacle = 0.0
        self.efforts: tuple[float, ...] = ()
        self.stiffness = 0.0
        """N/m of the fingers, which tell how hard they press; 0: they tell nothing"""
        self.wanted = self.opening
        self.stuck = False
        self.drift = 0.0
        self.pace = 1.0
        self.present: ArmState | None = None
        self.told: list[tuple[Any, ...]] = []
        self.closed = False
        self.alive_at = -1.0
        self._trajectory: tuple[np.ndarray, np.ndarray] | None = None
        self._began = self._now = 0.0

    def advance(self, now: float) -> None:
        self._now = now
        if self._trajectory is not None and not self.stuck:
            times, rows = self._trajectory
            here = np.array([np.interp((now - self._began) * self.pace, times, joint) for joint in rows.T])
            self.velocities, self.positions = (here - self.positions) / PERIOD, here
            self.present = self.sample(now)
            return
        self.velocities = np.zeros(7) + self.drift
        self.present = self.sample(now)

    def sample(self, now: float) -> ArmState:
        contact = 0 < self.opening == self.obstacle
        measured = tuple(self.positions), tuple(self.velocities), self.opening, contact
        pressing = self.stiffness * max(self.opening - self.wanted, 0.0) if self.stiffness else None
        return ArmState(now, self.names, *measured, efforts=self.efforts, gripper_effort=pressing)

    def state(self) -> ArmState | None:
        return self.present

    def follow(self, times: tuple[float, ...], positions: tuple[tuple[float, ...], ...]) -> None:
        self.told.append(("follow", times, positions))
        self._trajectory, self._began = (np.array(times), np.array(positions)), self._now

    def move_gripper(self, opening: float) -> None:
        self.told.append(("move_gripper", opening))
        self.wanted, self.opening = opening, max(opening, self.obstacle)

    def stop(self) -> None:
        self.told.append(("stop",))
        self._trajectory = None

    def keep_alive(self) -> None:
        self.alive_at = self._now

    def close(self) -> None:
        self.closed = True


class FakeCamera:
    """Returns the frame it was given, once."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.next: Frame | None = None
        self.closed = False

    def frame(self) -> Frame | None:
        frame, self.next = self.next, None
        return frame

    def close(self) -> None:
        self.closed = True


class Bench:
    """One arm controller, its devices, and the memory of another agent that talks to it."""

    def __init__(self, config: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("agents.arm_controller.agent.make_driver", self.driver)
        monkeypatch.setattr("agents.arm_controller.agent.has_option", lambda name, option: False)
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.arm = FakeArm()
        self.cameras: dict[str, FakeCamera] = {}
        self.config = config
        self.memory = self.connect("mission")
        self.start()

    def connect(self, agent: str) -> Memory:
        guard = WriteGuard(agent, ArmController.writes) if agent == "arm_controller" else None
        return Memory("test", agent, transport=self.network.connect(agent), clock=self.clock, guard=guard)

    def start(self, joining: float = 0.0) -> None:
        """Start the controller, or another one in its place, which first joins the graph for so many s."""
        self.own = self.connect("arm_controller")
        self.exchange(0.0)
        self.exchange(joining)
        self.agent = make_agent(
            ArmController,
            name="arm_controller",
            config=self.config,
            bus=self.own.transport,
            keys=Keys("test"),
            clock=self.clock,
            memory=self.own,
        )
        self.runner = Runner(self.agent, rid=self.own.rid)
        self.runner.setup()
        self.exchange(0.0)

    def driver(self, name: str, bus: object, keys: object, /, **options: Any) -> Any:
        """Stands in for `make_driver`."""
        if name == "fake:Arm":
            return self.arm
        return self.cameras.setdefault(options["name"], FakeCamera(options["name"]))

    def run(self, seconds: float, *, silent: bool = False) -> None:
        """Let time pass; a silent arm gives no new samples."""
        for _ in range(round(seconds / PERIOD)):
            self.exchange(PERIOD)
            if not silent:
                self.arm.advance(self.clock.now())
            self.runner.tick(self.clock.now())
            assert self.runner.status().last_error in ("", self.agent.degraded)
        self.exchange(0.0)

    def exchange(self, seconds: float) -> None:
        memories = (self.memory, self.own)
        self.clock.advance(seconds)
        for _ in range(3):
            for memory in memories:
                memory.flush()
            self.network.deliver()
            for memory in memories:
                memory.poll()

    @property
    def status(self) -> str:
        return str(self.memory.node("arm").get("status", ""))


@pytest.fixture
def make_bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    benches: list[Bench] = []

    def make(kind: type[Bench] = Bench, **config: Any) -> Bench:
        benches.append(kind({"driver": "fake:Arm", **config}, monkeypatch))
        return benches[-1]

    yield make
    for bench in benches:
        bench.runner.teardown()
        bench.own.close()
        bench.memory.close()


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench()


@pytest.fixture
def tool() -> JointChain:
    """The Gen3 up to the tool point."""
    return JointChain(load_robot(GEN3).between("base_link", "tool_link"))


class Table(Bench):
    """An arm at a table with believed cubes; a cube lies between the pads whenever they close."""

    actions = 0

    def lay(self) -> None:
        self.memory.add_node("world", "world")
        self.memory.add_node("table", "table", size=(1.2, 1.2, 0.04))
        self.memory.add_edge("world", "table", "RT", pose=Pose((0.35, 0.0, 0.0)))
        for name, (x, y) in PLACES.items():
            self.believe(name, Pose((x, y, 0.02)))
        self.arm.obstacle = 0.04
        self.run(0.1)

    def believe(self, name: str, pose: Pose, size: tuple[float, float, float] = CUBE) -> None:
        self.memory.add_node(name, "cube", size=size)
        self.memory.add_edge("world", name, "Virtual_RT", pose=pose)

    def request(self, skill: str, **attributes: Any) -> str:
        self.actions += 1
        name = f"action_1_{self.actions}"
        self.memory.add_node(name, "action", skill=skill, status="planned", request="run", **attributes)
        return name

    def finish(self, name: str, seconds: float = 20.0) -> tuple[str, str]:
        """Run until the action has ended; its status and explanation."""
        for _ in range(round(seconds / 0.1)):
            self.run(0.1)
            if self.said(name)[0] not in ("planned", "running"):
                break
        return self.said(name)

    def said(self, name: str) -> tuple[str, str]:
        node = self.memory.node(name)
        return node["status"], node.get("explanation", "")

    def act(self, skill: str, **attributes: Any) -> tuple[str, str]:
        return self.finish(self.request(skill, **attributes))

    def run_to(self, step: str, seconds: float = 15.0) -> None:
        """Run until the action under way is at that step."""
        for _ in range(round(seconds / PERIOD)):
            self.run(PERIOD)
            if self.step == step:
                return
        raise AssertionError(f"the action never came to {step!r}")

    @property
    def step(self) -> str:
        actions = self.agent._actions  # type: ignore[attr-defined]
        return str(actions.step)

    @property
    def grasped(self) -> list[str]:
        return [edge.dst for edge in self.memory.edges("grasping")]

    def tool_pose(self, tool: JointChain) -> Pose:
        return tool.forward(self.arm.positions)


@pytest.fixture
def table(make_bench: Callable[..., Any]) -> Table:
    bench: Table = make_bench(Table)
    bench.lay()
    return bench


def pick(table: Table, name: str = "cube_3") -> None:
    assert table.act("pick", target=name) == ("done", "")
    hold(table, name)


def hold(table: Table, name: str) -> None:
    """Let the belief have the object in the gripper."""
    chain = table.agent._chain  # type: ignore[attr-defined]
    pose = chain.forward(table.arm.positions)
    table.believe(name, pose)
    table.run(0.1)
