"""Sessions of the whole system with a camera that is bumped, or cubes that are moved; with what the calibrator used."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.urdf import load_robot
from agents.calibrator import Calibrator
from agents.calibrator.solve.problem import ObjectSighting
from agents.calibrator.watch.doubt import Doubt
from agents.plant.config import PlantConfig
from agents.plant.reality import Reality
from agents.scenario.format.model import RobotSpec
from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.result import Result
from agents.scenario.run.runner import run_system
from agents.scenario.run.staging import Sensor, make_run, staged_system, without
from dsr.math3d.transforms import Array, Pose
from dsr.runtime.system import AgentSpec, System
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.tags import TAG_RATIO

SIZE = 0.04
"""m, of the cubes"""
EVENT_AT = 4.0
"""s, when something happens"""
SETTLE = 3.0
_ROOT = Path(__file__).resolve().parents[1]
_MARGIN = 25.0  # px between tags and the edge of the image


class Session(NamedTuple):
    """What came of one run."""

    result: Result
    sightings: list[ObjectSighting]
    """What the calibrator had when it decided last; none if it never came to that."""
    before: Pose | None
    """parent_from_camera as it was believed then."""
    views: list[int]
    """From how many places, the first one included, it looked for the decision of each doubt."""


class Observed(Calibrator):
    """The calibrator, looked over its shoulder."""

    decided: ClassVar[list[Doubt]] = []

    def tick(self, now: float) -> None:
        """Keep the doubts of this tick that came to a decision."""
        doubts = () if self._watch is None else self._watch.doubts
        super().tick(now)
        Observed.decided += [doubt for doubt in doubts if doubt.sightings and doubt not in Observed.decided]


def play(text: str, *, seed: int, sensor: Sensor, more: Sequence[AgentSpec] = (), **calibrator: object) -> Session:
    """Play a scenario, given as TOML, in lockstep; `more` agents take part, and the calibrator may be configured."""
    with tempfile.TemporaryDirectory(prefix="dsr-calibration-") as folder:
        file = Path(folder) / "session.toml"
        file.write_text(text, encoding="utf-8")
        run = make_run(file, seed=seed, sensor=sensor)
        Observed.decided = []
        result = run_system(run, _observed(staged_system(run).with_config("calibrator", **calibrator), more))
        decided = Observed.decided
        sightings, before = (decided[-1].sightings, decided[-1].before) if decided else ([], None)
        return Session(result, sightings, before, [doubt.views for doubt in decided])


def _observed(system: System, more: Sequence[AgentSpec]) -> System:
    agents = tuple(replace(spec, kind=Observed) if spec.kind is Calibrator else spec for spec in system.agents)
    return without(replace(system, agents=(*agents, *more)), "action_inference", "spatial_relations", "chronicler")


def scene(cubes: Sequence[Pose], events: Sequence[str], *, duration: float, camera: str = "wrist") -> str:
    """A scenario with cubes (world_from_cube) and events, as TOML."""
    head = f'name = "session"\ntitle = "A session of calibration"\nduration = {duration}\nsettle = {SETTLE}\n'
    objects = [
        f'[[object]]\nname = "{name_of(number)}"\nmarker_id = {number}\nposition = {_list(cube.t)}\n'
        f"yaw = {_yaw(cube):.6f}"
        for number, cube in enumerate(cubes)
    ]
    checks = [f'[[expect]]\ncheck = "{check}"' for check in ("camera_error", "belief_error", "calibrations")]
    return "\n\n".join([f'{head}camera = "{camera}"', *objects, *events, *checks]) + "\n"


def name_of(number: int) -> str:
    """Of a cube."""
    return f"cube_{number}"


def bump(displacement: Pose, at: float = EVENT_AT) -> str:
    """The event that moves the camera, in its own frame."""
    turn = _list(displacement.rotvec)
    return f'[[event]]\nat = {at}\ndo = "camera_bump"\ntranslation = {_list(displacement.t)}\nrotation = {turn}'


def put(number: int, there: Pose, at: float = EVENT_AT) -> str:
    """The event that moves a cube, at once."""
    place = f"position = {_list(there.t)}\nyaw = {_yaw(there):.6f}"
    return f'[[event]]\nat = {at}\ndo = "place"\nobject = "{name_of(number)}"\n{place}'


def flip(number: int, turn: Array, frames: int, at: float = EVENT_AT) -> str:
    """The event that shows a cube with a wrong rotation for some frames."""
    what = f'do = "false_percept"\nobject = "{name_of(number)}"'
    return f"[[event]]\nat = {at}\n{what}\nframes = {frames}\nrotation = {_list(turn)}"


def observing() -> Pose:
    """world_from_camera of the camera at the gripper, where the arm starts."""
    robot = load_robot(_ROOT / "etc/robots/gen3.urdf")
    chain = JointChain(robot.between("base_link", "camera_wrist_link"))
    return chain.forward(np.array(RobotSpec().start))


def in_view(cubes: Sequence[Pose], world_from_camera: Pose) -> bool:
    """Whether all tags are well within the image."""
    plant, half = PlantConfig(), 0.5 * TAG_RATIO * SIZE
    intrinsics = Intrinsics.from_fov(plant.width, plant.height, plant.fov)
    corners = np.array([(x, y, 0.5 * SIZE) for x in (-half, half) for y in (-half, half)])
    points = world_from_camera.inverse().apply(np.concatenate([cube.apply(corners) for cube in cubes]))
    pixels = intrinsics.project(points)
    far = (intrinsics.width - 1 - _MARGIN, intrinsics.height - 1 - _MARGIN)
    return bool((points[:, 2] > 0.1).all() and (pixels >= _MARGIN).all() and (pixels <= far).all())


def bumped_in_view(cubes: Sequence[Pose], draw: Callable[[], Pose]) -> Pose:
    """The first displacement of the camera, of those drawn, through which it still sees all cubes past the gripper."""
    start = observing()
    scenario = parse_scenario(scene(cubes, [], duration=10.0))
    reality = Reality(scenario, PlantConfig(sensor="poses"), 0)
    try:
        while True:
            moved = draw()
            if in_view(cubes, start @ moved):
                reality.camera.bump(moved)
                seen = reality.readings(0.0).readings
                reality.camera.bump(moved.inverse())
                if len(seen) == len(cubes):
                    return moved
    finally:
        reality.close()


def on_table(x: float, y: float, yaw: float) -> Pose:
    """world_from_cube of one that stands there."""
    return Pose.from_rotvec((x, y, 0.5 * SIZE), (0.0, 0.0, yaw))


def spread(names: Mapping[str, Pose] | Sequence[Pose], least: float) -> bool:
    """Whether all are that far (m) from one another, along x or y."""
    places = [pose.translation[:2] for pose in (names.values() if isinstance(names, Mapping) else names)]
    return all(np.abs(a - b).max() >= least for i, a in enumerate(places) for b in places[:i])


def _yaw(pose: Pose) -> float:
    matrix = pose.rotation_matrix
    return math.atan2(matrix[1, 0], matrix[0, 0])


def _list(values: Sequence[float] | Array) -> str:
    return "[" + ", ".join(f"{float(value):.6f}" for value in values) + "]"
