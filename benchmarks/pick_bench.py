"""An arm in front of a table with boxes, cylinders, balls and cups, in lockstep, with the plant's truth as belief."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from agents.arm_controller import ArmController
from agents.plant import Plant
from agents.plant.messages import Truth
from agents.scene_setup import SceneSetup
from dsr.clock import ManualClock
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec

CUBE = 0.04
"""m"""
_PATIENCE = 30.0  # s for one action


BlockForm = Literal["box", "cylinder", "ball", "cup"]
_WALL = 0.003  # m, of a cup
_SIDES = 12  # of a cup: as many as one body has parts, with its bottom


@dataclass(frozen=True)
class Block:
    """Something that stands on the table."""

    name: str
    place: tuple[float, float, float]
    """x, y (m, world) of its centre, and yaw (rad)"""
    size: Vector3 = (CUBE, CUBE, CUBE)
    """m, along its own axes"""
    mass: float = 0.05
    """kg"""
    form: BlockForm = "box"
    """Balls have the diameter size[0]; so have cylinders and cups, which stand."""
    above: float = 0.0
    """m between the table and its bottom at the start"""


def cubes(places: Sequence[tuple[float, float, float]]) -> list[Block]:
    """Cubes `cube_3`, `cube_4`, ... at x, y (m) and yaw (rad)."""
    return [Block(f"cube_{number}", place) for number, place in enumerate(places, start=3)]


class Bench:
    """An arm in front of a table with boxes, in lockstep, with the truth as its belief. A context manager.

    Args:
        blocks: what stands on the table.
        seed: of the run.
        noise: m, standard deviation of the constant error of each object's believed x and y.
        arm: configuration of the arm controller.
        robot: name of a description in `etc/robots`.
        clock: of the run, for devices that need it; a new one if None.
    """

    def __init__(
        self,
        blocks: Sequence[Block],
        *,
        seed: int = 0,
        noise: float = 0.0,
        arm: Mapping[str, Any] | None = None,
        robot: str = "gen3",
        clock: ManualClock | None = None,
    ) -> None:
        rng = np.random.default_rng(seed)
        self._errors: dict[str, tuple[float, float, float]] = {
            block.name: (*rng.normal(0.0, noise, 2).tolist(), 0.0) for block in blocks
        }
        with tempfile.TemporaryDirectory(prefix="dsr-pick-") as folder:
            file = Path(folder) / "blocks.toml"
            file.write_text(_scenario(blocks), encoding="utf-8")
            for block in blocks:
                if block.form != "box":
                    (file.parent / f"{block.name}.urdf").write_text(_model(block), encoding="utf-8")
            self.lockstep = Lockstep(
                [
                    AgentSpec("plant", Plant, {"scenario": str(file), "sensor": "poses", "robot": robot}),
                    AgentSpec("scene_setup", SceneSetup, {"scenario": str(file)}),
                    AgentSpec("arm_controller", ArmController, {"urdf": f"etc/robots/{robot}.urdf", **(arm or {})}),
                ],
                clock=clock,
                seed=seed,
                strict=True,
            )
        self.memory = self.lockstep.memory
        self.truth: Truth | None = None
        self.lockstep.bus.subscribe(self.lockstep.keys.truth(), self._believe)
        self._actions = 0
        self.memory.add_node("mind", "mind")
        self.run(1.0)

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.lockstep.close()

    def run(self, seconds: float) -> None:
        """Let time pass."""
        self.lockstep.run_for(seconds)

    def request(self, skill: str, **attributes: Any) -> str:
        """Ask for an action; returns the name of its node."""
        self._actions += 1
        name = f"action_1_{self._actions}"
        self.memory.add_node(name, "action", skill=skill, status="planned", request="run", **attributes)
        return name

    def act(self, skill: str, **attributes: Any) -> str:
        """Ask for an action and wait for its end; returns how that went: status, and why."""
        name = self.request(skill, **attributes)
        end = self.lockstep.clock.now() + _PATIENCE
        while self.lockstep.clock.now() < end:
            self.run(0.1)
            node = self.memory.node(name)
            if node.get("status") not in ("planned", "running"):
                return f"{node['status']} {node.get('explanation', '')}".strip()
        return "still running"

    def pose(self, name: str) -> Pose:
        """Where the object truly is, in the world."""
        assert self.truth is not None
        seven = self.truth.objects[name]
        return Pose(seven[:3], seven[3:])

    def lower(self, name: str, by: float) -> None:
        """Let the object be believed `by` m too low."""
        x, y, z = self._errors[name]
        self._errors[name] = (x, y, z - by)

    def _believe(self, key: str, payload: bytes) -> None:
        self.truth = msgspec.msgpack.decode(payload, type=Truth)
        for name, seven in self.truth.objects.items():
            pose = Pose(seven[:3], seven[3:], self.truth.stamp)
            if name in self.memory:
                believed = Pose(tuple(np.add(pose.t, self._errors[name])), pose.q, pose.stamp)
                self.memory.add_edge("world", name, "Virtual_RT", pose=believed)


def _scenario(blocks: Sequence[Block]) -> str:
    """A scenario file with these blocks."""
    objects = "".join(
        f'\n[[object]]\nname = "{block.name}"\n{_kind(block, number)}known = true\nmass = {block.mass}\n'
        f"position = [{x}, {y}, {block.above + block.size[2] / 2}]\nyaw = {yaw}\n"
        for number, block in enumerate(blocks, start=3)
        for x, y, yaw in [block.place]
    )
    return f'name = "blocks"\ntitle = "Boxes to pick"\nduration = 3600.0\n{objects}'


def _kind(block: Block, number: int) -> str:
    """What kind of object it is, as lines of a scenario file."""
    if block.form == "box":
        return f'type = "box"\nmarker_id = {number}\nsize = {list(block.size)}\n'
    kind = {"cylinder": "box"}.get(block.form, block.form)
    return f'type = "{kind}"\nmodel = "{block.name}.urdf"\ncolor = [0.9, {0.02 * number:.2f}, 0.1]\n'


def _model(block: Block) -> str:
    """The description of a round block."""
    wide, _, high = block.size
    if block.form == "ball":
        parts = [_part(f'<sphere radius="{wide / 2}"/>')]
    elif block.form == "cylinder":
        parts = [_part(f'<cylinder radius="{wide / 2}" length="{high}"/>')]
    else:
        parts = [_part(f'<cylinder radius="{wide / 2}" length="{_WALL}"/>', (0.0, 0.0, (_WALL - high) / 2))]
        away, length = (wide - _WALL) / 2, wide * math.tan(math.pi / _SIDES)
        for turn in (2.0 * math.pi * k / _SIDES for k in range(_SIDES)):
            at = (away * math.cos(turn), away * math.sin(turn), _WALL / 2)
            parts.append(_part(f'<box size="{_WALL} {length} {high - _WALL}"/>', at, turn))
    kind = {"cylinder": "box"}.get(block.form, block.form)
    contact = '<contact><lateral_friction value="0.6"/><rolling_friction value="0.002"/></contact>'
    inertia = f'<inertial><mass value="{block.mass}"/></inertial>'
    return f'<robot name="{block.name}"><link name="{kind}">{inertia}{contact}{"".join(parts)}</link></robot>'


def _part(geometry: str, at: Vector3 = (0.0, 0.0, 0.0), yaw: float = 0.0) -> str:
    x, y, z = at
    place = f'<origin xyz="{x} {y} {z}" rpy="0 0 {yaw}"/>'
    return f"<collision>{place}<geometry>{geometry}</geometry></collision>"
