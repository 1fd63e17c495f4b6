"""Two arms at one table in lockstep: they plan around each other, wait, step back, and stop before they meet."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.arm_controller import ArmController
from agents.arm_controller.model.arm_model import load_arm
from agents.arm_controller.motion.others import OtherArms
from agents.plant import Plant
from agents.plant.messages import Truth
from agents.scene_setup import SceneSetup
from dsr import Pose
from dsr.files.built_in import ETC
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.halting import HaltOrder, send_order

KEPT = 0.02
"""m that arms keep apart"""
SPACE = 0.95
"""m between the arms' bases"""
OVER = (1.0, 0.0, 0.0, 0.0)
"""world_from_tool of a tool that points down"""
ABOVE = Pose((SPACE / 2, 0.0, 0.2), OVER)
"""Over the middle of the table, within reach of both."""
REST = (0.0, 0.0, np.pi, -0.96, 0.0, -2.09, np.pi / 2)
STRETCHED = (0.0, 0.9, np.pi, -1.3, 0.0, -0.8, np.pi / 2)
"""Far into the place of an arm that does the same on the other side."""


class Table:
    """Two arms that face each other, with cubes whose truth is believed."""

    def __init__(self, places: dict[str, tuple[float, float]], seed: int = 0, model: str = "gen3") -> None:
        cubes = "".join(
            f'[[object]]\nname = "{name}"\nposition = [{x}, {y}, 0.02]\nmarker_id = {number}\n'
            for number, (name, (x, y)) in enumerate(places.items())
        )
        arm = f'[[arm]]\nname = "arm_2"\nmodel = "{model}"\nposition = [{SPACE}, 0.0, 0.0]\nyaw = {np.pi}\n'
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "table.toml"
            head = 'name = "table"\ntitle = ""\nduration = 60.0\nsystem = "two_arms"\n'
            file.write_text(f"{head}[table]\nposition = [{SPACE / 2}, 0.0, 0.0]\n{arm}{cubes}")
            mount = {"translation": (SPACE, 0.0, 0.0), "rotation": (0.0, 0.0, 1.0, 0.0)}
            urdf = f"etc/robots/{model}.urdf"
            self.lockstep = Lockstep(
                [
                    AgentSpec("plant", Plant, {"scenario": str(file), "sensor": "none"}),
                    AgentSpec("scene_setup", SceneSetup, {"scenario": str(file)}),
                    AgentSpec("arm_controller", ArmController, {"observe_joints": REST}),
                    AgentSpec("arm_2_controller", ArmController, {"arm": "arm_2", "arm_mount": mount, "urdf": urdf}),
                ],
                seed=seed,
                strict=True,
            )
        self.memory = self.lockstep.memory
        self.apart: list[float] = []
        self.truth: Truth
        self.seen: set[str] = set()
        """Arms that anybody has waited for."""
        self.lockstep.bus.subscribe(self.lockstep.keys.truth(), self._believe)
        self.memory.add_node("mind", "mind")
        self.run(1.0)

    def run(self, seconds: float) -> None:
        def look(_: float) -> bool:
            self.seen |= {node["waits_for"] for node in self.memory.nodes("arm") if node.get("waits_for")}
            return False

        self.lockstep.run_for(seconds, look)

    def ask(self, arm: str, skill: str, **values: Any) -> str:
        name = f"action_1_{len(self.memory.nodes('action'))}"
        values = {"skill": skill, "status": "planned", "request": "run", "arm": arm, **values}
        self.memory.add_node(name, "action", **values)
        return name

    def ends(self, *names: str, within: float = 40.0) -> list[str]:
        """Run until the actions have ended; how they ended, with why if they failed."""
        until = self.lockstep.clock.now() + within
        nodes = [self.memory.node(name) for name in names]
        while self.lockstep.clock.now() < until and not all(n["status"] in ("done", "failed", "halted") for n in nodes):
            self.run(0.1)
            nodes = [self.memory.node(name) for name in names]
        return [n["status"] if n["status"] == "done" else f"{n['status']} {n.get('explanation', '')}" for n in nodes]

    def _believe(self, key: str, payload: bytes) -> None:
        self.truth = msgspec.msgpack.decode(payload, type=Truth)
        if self.truth.apart is not None:
            self.apart.append(self.truth.apart)
        for name, seven in self.truth.objects.items():
            if name not in self.memory:
                self.memory.add_node(name, "cube", size=(0.04, 0.04, 0.04))
            self.memory.add_edge("world", name, "Virtual_RT", pose=Pose(seven[:3], seven[3:]))


@pytest.fixture
def table() -> Iterator[Callable[..., Table]]:
    made: list[Table] = []

    def make(*arguments: Any, **options: Any) -> Table:
        made.append(Table(*arguments, **options))
        return made[-1]

    yield make
    for one in made:
        one.lockstep.close()


def test_two_arms_that_pick_beside_each_other_at_once_both_do_and_never_meet(table: Callable[..., Table]) -> None:
    both = table({"cube_3": (0.44, 0.03), "cube_4": (0.51, -0.03)})
    picks = [both.ask("arm", "pick", target="cube_3"), both.ask("arm_2", "pick", target="cube_4")]
    both.run(3.0)
    assert both.ends(picks[0]) == ["done"]
    away = both.ask("arm", "observe")
    assert both.ends(picks[1], away) == ["done", "done"]
    assert both.seen, "one had to wait for the other"
    assert min(both.apart) >= KEPT
    assert (both.truth.held, both.truth.arms["arm_2"].held) == ("cube_3", "cube_4")


def test_an_idle_arm_in_the_way_steps_back(table: Callable[..., Table]) -> None:
    both = table({"cube_3": (SPACE / 2, 0.0)})
    assert both.ends(both.ask("arm", "move", target_pose=ABOVE)) == ["done"]
    assert both.ends(both.ask("arm_2", "pick", target="cube_3")) == ["done"]
    assert both.seen == {"arm"} and min(both.apart) >= KEPT
    assert both.truth.robot == pytest.approx(REST, abs=0.05), "back at its rest"
    both.run(0.2)
    assert not any(name in both.memory.node("arm_2") for name in ("way", "way_since", "waits_for"))


def test_arms_that_wait_for_each_other_find_a_way(table: Callable[..., Table]) -> None:
    both = table({})
    near, far = Pose((0.395, 0.0, 0.12), OVER), Pose((0.555, 0.0, 0.12), OVER)
    apart = [both.ask("arm", "move", target_pose=near), both.ask("arm_2", "move", target_pose=far)]
    assert both.ends(*apart) == ["done", "done"]
    swapped = [both.ask("arm", "move", target_pose=far), both.ask("arm_2", "move", target_pose=near)]
    assert both.ends(*swapped) == ["done", "done"]
    assert both.seen == {"arm", "arm_2"}, "each was in the way of the other"
    assert min(both.apart) >= KEPT


def test_of_two_targets_by_hand_in_the_same_place_the_second_waits_until_the_first_steps_back(
    table: Callable[..., Table],
) -> None:
    both = table({})
    for arm in ("arm", "arm_2"):
        both.memory.update_node(arm, target_joints=STRETCHED)
    stretched, told = 0.0, set()
    for _ in range(120):
        both.run(0.1)
        one, other = both.memory.node("arm"), both.memory.node("arm_2")
        stretched = max(stretched, one["joint_positions"][1])
        told.add((other["status"], other.get("explanation", "")))
        if other["status"] == "reached":
            break
    assert stretched == pytest.approx(STRETCHED[1], abs=0.01), "the first one was there, and has stepped back"
    assert ("moving", "stands still: arm is near") in told and other["status"] == "reached"
    assert min(both.apart) >= KEPT


def test_an_arm_whose_controller_died_on_its_way_is_passed_at_a_distance(table: Callable[..., Table]) -> None:
    both = table({"cube_3": (0.62, -0.25)})
    both.ask("arm", "move", target_pose=ABOVE)
    both.run(0.8)
    both.lockstep.kill("arm_controller")
    both.run(1.0)
    assert both.ends(both.ask("arm_2", "pick", target="cube_3")) == ["done"]
    assert min(both.apart) >= KEPT


@pytest.mark.parametrize("after", [0.0, 0.1])
def test_an_arm_that_was_halted_and_died_is_passed_at_a_distance_where_it_rests(
    table: Callable[..., Table], after: float
) -> None:
    both = table({"cube_3": (0.62, -0.25)})
    both.ask("arm", "move", target_pose=ABOVE)
    both.run(0.8)
    order = HaltOrder("1", True, "anna", "", both.lockstep.clock.now(), "arm")
    send_order(both.lockstep.bus, both.lockstep.keys, order)
    both.run(0.04 + after)
    both.lockstep.kill("arm_controller")
    assert both.memory.node("arm")["way"], "it braked"
    both.run(1.0)
    parts = np.array([box.pose.t for box in OtherArms(both.memory, "arm_2").obstacles(both.lockstep.clock.now())])
    tip = load_arm(ETC / "robots" / "gen3.urdf").chain.forward(both.truth.robot).t
    assert np.linalg.norm(parts - tip, axis=1).min() < 0.1, "its gripper is believed to be there, too"
    assert both.ends(both.ask("arm_2", "pick", target="cube_3")) == ["done"]
    assert min(both.apart) >= KEPT


def test_an_arm_of_another_model_is_minded_too(table: Callable[..., Table]) -> None:
    both = table({"cube_3": (SPACE / 2, 0.0)}, model="panda")
    assert both.ends(both.ask("arm_2", "move", target_pose=ABOVE)) == ["done"]
    assert both.ends(both.ask("arm", "pick", target="cube_3")) == ["done"]
    assert both.seen == {"arm_2"} and min(both.apart) >= KEPT
