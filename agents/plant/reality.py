"""The simulated reality as a whole, without network and clock: steps of physics in, sensor samples out."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from agents.drivers import ArmState, HandReadings, PersonReadings, TagReadings
from agents.plant.arm import SimulatedArm, displaced
from agents.plant.bullet import Bullet
from agents.plant.camera import Exposure, SimulatedCamera
from agents.plant.config import PlantConfig
from agents.plant.experimenter import Experimenter
from agents.plant.guard import ArmGuard
from agents.plant.hand_sensor import read_hands
from agents.plant.hands import Hands
from agents.plant.messages import ArmTruth, Command, Point, Truth, seven
from agents.plant.no_arm import NoArm
from agents.plant.noise import SensorModel
from agents.plant.persons import Persons
from agents.plant.poses import read_tags, recognisable
from agents.plant.renderer import Renderer
from agents.plant.separation import ArmSeparation
from agents.plant.stage import Stage
from agents.plant.world import STEP, World
from agents.scenario.format.scenario import CameraSpec, RobotSpec, Scenario, start_poses
from agents.urdf_files import find_robot
from dsr.errors import ConfigError, suggest
from dsr.images.blobs import Frame
from dsr.math3d.transforms import Pose
from dsr.vocabulary.arms import ARM
from dsr.vocabulary.intrinsics import Intrinsics


class Reality:
    """World, arms, cameras and experimenter of one scenario; objects lie still when it is made.

    Args:
        scenario: what there is and what happens.
        config: cameras and renderer.
        seed: of the objects' places and the sensors' errors: the same seed gives the same run.

    Raises:
        ConfigError: for a scenario that cannot be played, for example if objects do not come to rest.
    """

    def __init__(self, scenario: Scenario, config: PlantConfig, seed: int) -> None:
        with contextlib.ExitStack() as resources:
            self._build(scenario, config, seed, resources)
            self._resources = resources.pop_all()

    def step(self, elapsed: float | None) -> None:
        """Advance physics by one step, `elapsed` s after the start of the scenario (None: before it)."""
        for guard in self._guards.values():
            guard.step()
        for arm in self.arms.values():
            arm.step()
        if elapsed is not None:
            self.experimenter.step(elapsed)
        self.world.step()
        self._separation.step()

    def obey(self, command: Command, arm: str = ARM) -> None:
        """Do what a driver asks of an arm, if the arm's own guard lets it."""
        if arm in self._guards:
            self._guards[arm].obey(command)

    def forbid(self, reason: str, arm: str = ARM) -> None:
        """Stop an arm and keep it from moving for this reason; with none, it may move again."""
        if arm in self._guards:
            self._guards[arm].forbid(reason)

    def is_moving(self, arm: str = ARM) -> bool:
        """Whether an arm is on its way."""
        return arm in self.arms and self.arms[arm].is_driven

    def arm_state(self, stamp: float, name: str = ARM) -> ArmState | None:
        """Read an arm's sensors; None without that arm."""
        arm = self.arms.get(name)
        if arm is None:
            return None
        positions = arm.positions
        if arm is self.arm and any(self._stage.arm_error):
            positions = displaced(arm, self._stage.arm_error)
        velocities, fault = arm.velocities, self._guards[name].fault
        gripper = arm.opening, arm.contact
        return ArmState(stamp, arm.names, positions, velocities, *gripper, fault, arm.efforts, arm.pressing)

    def truth(self, stamp: float) -> Truth:
        """The true state of the world: poses of all things, and the moves of the experimenter."""
        return Truth(
            stamp=stamp,
            objects={name: seven(pose) for name, pose in self.world.poses().items()},
            robot=self.arm.positions,
            gripper=self.arm.opening,
            held=self.arm.held,
            camera={self.camera.name: seven(self.camera.pose)},
            moving=tuple(name for name in self.world if not self.world.is_still(name)),
            in_view=tuple(self.camera.in_view),
            grasped=self._stage.grasped(),
            moves=dict(self.experimenter.spans),
            given_up=dict(self.experimenter.given_up),
            hands={hand.number: _points(hand.landmarks) for hand in self.hands.present},
            touched=dict(self.hands.holding("touch")),
            pinched={hand.name: hand.held for hand in self.hands.present if hand.held and hand.style == "pinch"},
            persons={person.name: seven(person.pose) for person in self.persons.present},
            arms={
                name: ArmTruth(arm.positions, arm.opening, arm.held)
                for name, arm in self.arms.items()
                if arm is not self.arm
            },
            apart=self._separation.take(),
        )

    def frame(self, stamp: float, camera: SimulatedCamera | None = None) -> Frame:
        """The images of a camera, by default the scenario's; only with the sensor `pixels`."""
        return self.expose(stamp, camera or self.camera)()

    def expose(self, stamp: float, camera: SimulatedCamera) -> Exposure:
        """Draw what a camera sees now; only with the sensor `pixels`."""
        assert self._renderer is not None
        if camera is self.camera:  # the truth tells of no other one
            camera.in_view = recognisable(camera, self.world, self.hands)
        self.hands.draw()
        return camera.expose(self.world, self._renderer, stamp)

    def readings(self, stamp: float, camera: SimulatedCamera | None = None) -> TagReadings:
        """Simulate a camera's readings of objects, as poses; by default those of the scenario's camera."""
        return read_tags(camera or self.camera, self.world, self.hands, stamp)

    def hand_readings(self, stamp: float, camera: SimulatedCamera | None = None) -> HandReadings | None:
        """Simulate a camera's readings of hands, as landmarks; None in a scenario without hands."""
        if not self.has_hands:
            return None
        return read_hands(camera or self.camera, self.world, self.hands, self._hand_noise, stamp)

    def person_readings(self, stamp: float) -> PersonReadings | None:
        """Simulate the readings of the tracker of persons; None in a scenario without persons."""
        return self.persons.read(self._person_noise, stamp) if self.persons else None

    def close(self) -> None:
        """Free the physics engine; harmless when repeated."""
        self._resources.close()

    def _build(self, scenario: Scenario, config: PlantConfig, seed: int, resources: contextlib.ExitStack) -> None:
        children = np.random.SeedSequence(seed).spawn(6)  # more of them leave the first ones as they are
        layout, overhead, wrist, self._hand_noise, fixed, self._person_noise = map(np.random.default_rng, children)
        bullet = Bullet()
        resources.callback(bullet.close)
        self._renderer = Renderer(bullet, config.renderer) if config.sensor == "pixels" else None
        if self._renderer is not None:
            resources.callback(self._renderer.close)
        self.world = World(bullet, scenario.table, start_poses(scenario, layout))
        self.world.settle()
        self.arms = {name: _make_arm(self.world, name, spec, config) for name, spec in scenario.arms.items()}
        """By name, the first one first."""
        self.arm = self.arms.get(ARM) or NoArm()
        """The first one."""
        self._guards = {name: ArmGuard(arm, config.deadman, STEP) for name, arm in self.arms.items()}
        self._separation = ArmSeparation(self.world, tuple(self.arms.values()))
        cameras = self._make_cameras(scenario, config, {"overhead": overhead, "wrist": wrist, "fixed": fixed})
        self.camera = cameras[scenario.camera_name]
        """The one that the scenario uses."""
        more = (_camera(cameras, name) for name in config.more_cameras if name != self.camera.name)
        self.delivering = (self.camera, *more)
        """All that deliver, that one first."""
        numbers = {number for event in scenario.events if (number := getattr(event, "hand", None)) is not None}
        self.has_hands = bool(numbers)
        """Whether hands can come into the scene."""
        self.hands = Hands(bullet, numbers, seen=self._renderer is not None)
        """Those that can come."""
        self.persons = Persons(scenario.persons)
        """Those who may be in the scene."""
        self._stage = Stage(self.world, self.arms, cameras, scenario.camera_name, self.hands, self.persons)
        self.experimenter = Experimenter(scenario.events, self._stage)

    def _make_cameras(
        self, scenario: Scenario, config: PlantConfig, rngs: Mapping[str, np.random.Generator]
    ) -> dict[str, SimulatedCamera]:
        overhead = Pose(config.overhead[:3], config.overhead[3:])
        ideal = Intrinsics.from_fov(config.width, config.height, config.fov)
        intrinsics = replace(ideal, distortion=config.distortion)
        mounts: dict[str, Callable[[], Pose]] = {"overhead": lambda: overhead}
        if isinstance(self.arm, SimulatedArm) and self.arm.has_camera:
            mounts["wrist"] = self.arm.camera_pose
        if isinstance(scenario.camera, CameraSpec):
            fixed = scenario.camera.pose
            mounts["fixed"] = lambda: fixed
        return {
            name: SimulatedCamera(name, intrinsics, mount, SensorModel(scenario.sensor, self.world.specs, rngs[name]))
            for name, mount in mounts.items()
        }


def _camera(cameras: Mapping[str, SimulatedCamera], name: str) -> SimulatedCamera:
    if name not in cameras:
        raise ConfigError(f"more_cameras: no camera {name!r}; {suggest(name, cameras)}")
    return cameras[name]


def _make_arm(world: World, name: str, robot: RobotSpec, config: PlantConfig) -> SimulatedArm:
    """An arm of the scenario; in place of the first the one that the configuration names, at its home posture."""
    if config.robot and name == ARM:
        return SimulatedArm(world, find_robot(config.robot, Path()), base=robot.base)
    folder = Path(config.scenario).parent
    return SimulatedArm(world, find_robot(robot.model, folder), robot.chosen_start, robot.base, robot.args)


def _points(points: NDArray[np.float64]) -> tuple[Point, ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in points)
