"""A table with cubes in a graph, and an arm that carries out actions by editing relations: a world without physics."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec

from dsr import Access, Agent, GraphError, Memory, Pose
from dsr.believing.distribution import ATTRIBUTE, Alternative, Whereabouts, encoded
from dsr.graph.elements import Node
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.arms import arm_of_action, gripper_of
from dsr.vocabulary.intentions import add_intention
from planner import Planner

SIDE = 0.04
SIGHT = 0.15
"""m about the place below a camera that looks straight down, which it shows"""
PLACES = {
    "cube_3": (0.42, 0.08),
    "cube_4": (0.30, 0.08),
    "cube_5": (0.30, -0.08),
    "cube_6": (0.42, -0.08),
}
COVERED = (0.30, 0.08)
"""Place of what comes to light when a cover is lifted"""
TOWERS = "on(cube_3,cube_4) & on(cube_6,cube_5)"


def set_table(memory: Memory, places: Mapping[str, tuple[float, float]] = PLACES) -> None:
    """A table, a gripper, and cubes on the table."""
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=(1.2, 0.8, 0.03))
    memory.add_edge("world", "table", "RT", pose=Pose((0.4, 0.0, 0.0)))
    memory.add_node("gripper", "gripper")
    for cube, (x, y) in places.items():
        add_cube(memory, cube, x, y)


def add_cube(memory: Memory, cube: str, x: float, y: float, z: float = SIDE / 2, support: str = "table") -> None:
    memory.add_node(cube, "cube", size=(SIDE, SIDE, SIDE))
    memory.add_edge("world", cube, "Virtual_RT", pose=Pose((x, y, z)))
    memory.add_edge(cube, support, "on", source="contact")


def add_camera(memory: Memory, camera: str, parent: str, pose: Pose) -> None:
    """A camera that sends images; from 0.3 m above it shows 0.16 m about the middle, and more along its longer side."""
    memory.add_node(camera, "camera", fx=600.0, fy=600.0, cx=479.5, cy=359.5, width=960, height=720)
    memory.add_edge(parent, camera, "RT", pose=pose)


def move(memory: Memory, cube: str, support: str, place: tuple[float, float] | None = None) -> None:
    """Put a cube somewhere else, relation and pose: what is believed after somebody did so."""
    for edge in memory.edges("on", src=cube):
        memory.remove_edge(cube, edge.dst, "on")
    if place is None:
        x, y, z = memory.transform("world", support, types=("Virtual_RT", "RT")).t
        pose = Pose((x, y, z + SIDE)) if support != "table" else Pose((0.5, 0.2, SIDE / 2))
    else:
        pose = Pose((*place, SIDE / 2))
    memory.add_edge("world", cube, "Virtual_RT", pose=pose)
    memory.add_edge(cube, support, "on", source="contact")


def supports(memory: Memory) -> dict[str, str]:
    return {edge.src: edge.dst for edge in memory.edges("on")}


@dataclass
class _Task:
    node: Node
    begun: float
    moved: bool = False


class FakeArm(Agent):
    """Takes 1 s for each action and moves things in the middle of it."""

    name = "arm_controller"
    arm = "arm"
    rate_hz = 20.0
    writes = Access(
        nodes=("action", "cube"),
        edges=("on", "grasping", "Virtual_RT"),
        attributes=("status", "explanation", "hopeless", "source", "since", "size", ATTRIBUTE),
    )

    def setup(self) -> None:
        self.task: _Task | None = None
        self.done: list[str] = []
        self.failing: list[str] = []
        """Skills of which the next ones fail before anything has moved."""
        self.hopeless = False
        """Whether those say that they would fail again."""
        self.dropping = 0
        """How many places lose the cube on the way."""
        self.stuck = False
        self.looks: list[Pose] = []
        """world_from_camera of every look."""
        self.hidden: dict[str, tuple[float, float]] = {}
        """Cubes, with their places (m), that are seen only from right above."""
        self.on_look = lambda: None
        """What a look brings to light besides."""
        self.covered: dict[str, str] = {}
        """Cubes of which it shows only when a cover (by name) is lifted that they are under it."""
        for node in self.memory.nodes("action"):
            if node.get("status") == "running" and arm_of_action(self.memory, node) == self.arm:
                self.end(node, "failed", "the arm controller was started again")

    def tick(self, now: float) -> None:
        if self.task is None:
            self.find(now)
        if self.task is not None:
            self.go_on(self.task, now)

    def find(self, now: float) -> None:
        for node in sorted(self.memory.nodes("action"), key=lambda node: node.name):
            if arm_of_action(self.memory, node) != self.arm:
                continue
            if node.get("status") == "planned" and node.get("request") == "run" and not self.stuck:
                self.memory.update_node(node.name, status="running")
                self.task = _Task(node, now)
                return
            if node.get("status") == "planned" and node.get("request") == "halt":
                self.end(node, "halted", "never begun")

    def go_on(self, task: _Task, now: float) -> None:
        node = task.node
        if node.name not in self.memory:
            self.task = None
        elif node.get("request") == "halt":
            self.end(node, "halted", "as asked")
        elif node["skill"] in self.failing:
            self.failing.remove(node["skill"])
            self.memory.update_node(node.name, hopeless=self.hopeless)
            self.end(node, "failed", "out of reach")
        elif not task.moved and now - task.begun >= 0.5:
            task.moved = True
            problem = self.act(node)
            if problem:
                self.end(node, "failed", problem)
        elif now - task.begun >= 1.0:
            self.end(node, "done", "")

    def end(self, node: Node, status: str, explanation: str) -> None:
        with contextlib.suppress(GraphError):
            self.memory.update_node(node.name, status=status, explanation=explanation)
            words = (node["skill"], node.get("target"), node.get("destination"), status)
            self.done.append(" ".join(word for word in words if word))
        self.task = None

    def act(self, node: Node) -> str:
        memory, cube, goal = self.memory, node.get("target", ""), node.get("destination", "")
        gripper = gripper_of(self.arm)
        held = [edge.dst for edge in memory.edges("grasping", src=gripper)]
        if node["skill"] == "pick":
            if held or any(edge.dst == cube for edge in memory.edges("on")):
                return f"{cube} cannot be grasped"
            for edge in memory.edges("on", src=cube):
                memory.remove_edge(cube, edge.dst, "on")
            memory.add_edge(gripper, cube, "grasping", source="gripper")
            memory.add_edge("world", cube, "Virtual_RT", pose=Pose((0.3, 0.0, 0.4)))
        elif node["skill"] == "look":
            self.looks.append(node["target_pose"])
            self.on_look()
            x, y, _ = node["target_pose"].t
            for name in [name for name, place in self.hidden.items() if math.dist(place, (x, y)) <= SIGHT]:
                self.show(name, self.hidden.pop(name))
            for name in self.hidden:
                rule_out(memory, name, (x, y))
        elif node["skill"] == "place":
            if held != [cube]:
                return f"{cube} is not held"
            memory.remove_edge(gripper, cube, "grasping")
            if self.dropping:
                self.dropping -= 1
                move(memory, cube, "table", (0.5, 0.25))
                return f"{cube} was lost on the way"
            pose = node.get("target_pose")
            move(memory, cube, goal, None if pose is None else pose.t[:2])
            for name in [name for name, cover in self.covered.items() if cover == cube]:
                self.show(name, COVERED)
        return ""

    def show(self, name: str, place: tuple[float, float]) -> None:
        """Let a cube be believed where it is now seen to be."""
        if name not in self.memory:
            add_cube(self.memory, name, *place)
            return
        self.memory.add_edge("world", name, "Virtual_RT", pose=Pose((*place, SIDE / 2)))
        self.memory.update_node(name, **{ATTRIBUTE: ""})


def believe(memory: Memory, name: str, *alternatives: Alternative) -> None:
    """Let the belief of a thing be this distribution; the first alternative is what the graph shows."""
    if alternatives[0].pose is not None:
        memory.add_edge("world", name, "Virtual_RT", pose=alternatives[0].pose)
    memory.update_node(name, **{ATTRIBUTE: encoded(Whereabouts(name, alternatives))})


def rule_out(memory: Memory, name: str, place: tuple[float, float]) -> None:
    """Let nobody believe any more that a thing is where a look has not shown it."""
    where = memory.belief(name) if name in memory else None
    if where is None:
        return
    left = [one for one in where.alternatives if one.pose is None or math.dist(one.pose.t[:2], place) > SIGHT]
    total = sum(one.weight for one in left)
    believe(memory, name, *(msgspec.structs.replace(one, weight=one.weight / total) for one in left))


class Run:
    """A planner and an arm in lockstep."""

    def __init__(
        self,
        places: Mapping[str, tuple[float, float]] = PLACES,
        agents_too: Sequence[AgentSpec] = (),
        **config: object,
    ) -> None:
        config = {"what_if_patience": 0.0, "belief_agents": (), **config}
        agents = [AgentSpec("arm_controller", FakeArm), AgentSpec("planner", Planner, config), *agents_too]
        self.lockstep = Lockstep(agents, strict=True)
        self.memory = self.lockstep.memory
        self.history: list[str] = []
        """Statuses of intention_0, as they followed each other."""
        set_table(self.memory, places)

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.lockstep.close()

    @property
    def arm(self) -> FakeArm:
        agent = self.lockstep.runner("arm_controller").agent
        assert isinstance(agent, FakeArm)
        return agent

    @property
    def status(self) -> str:
        node = self.memory.get_node("intention_0")
        return "" if node is None else node["status"]

    @property
    def explanation(self) -> str:
        return self.memory.node("intention_0").get("explanation", "")

    @property
    def replans(self) -> int:
        return self.memory.node("intention_0").get("replans", 0)

    def want(self, goal: str = TOWERS, **options: object) -> str:
        return add_intention(self.memory, goal, **options)  # type: ignore[arg-type]

    def go(self, seconds: float) -> None:
        self.until(lambda: False, seconds, fail=False)

    def until(self, condition: object, seconds: float = 60.0, *, fail: bool = True) -> None:
        """Run until `condition()`, or a status of intention_0."""

        def look(_: float) -> bool:
            if not self.history or self.history[-1] != self.status:
                self.history.append(self.status)
            return self.status == condition if isinstance(condition, str) else bool(condition())  # type: ignore[operator]

        found = self.lockstep.run_for(seconds, look)
        if fail:
            explanation = "" if "intention_0" not in self.memory else self.explanation
            assert found, f"{self.history}; {explanation}; {self.arm.done}; {supports(self.memory)}"

    def until_running(self, skill: str, target: str, after: float = 0.0) -> str:
        """Run until the arm does this, and `after` s more; returns the name of the action."""
        names: list[str] = []

        def running() -> bool:
            names[:] = [
                node.name
                for node in self.memory.nodes("action")
                if (node["skill"], node.get("target"), node["status"]) == (skill, target, "running")
            ]
            return bool(names)

        self.until(running)
        self.go(after)
        return names[0]
