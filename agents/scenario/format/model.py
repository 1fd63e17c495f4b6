"""The parts of a scenario file as structs; lengths in metres, angles in radians, times in seconds."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from agents.object_models import HEAVIEST, LIGHTEST
from agents.scenario.format.events import Event
from agents.scenario.format.expectations import Check
from agents.scenario.format.units import Bias, Noise, Radians, Rotation, Seconds, Size, Vector3
from agents.xacro_file import Value
from dsr.math3d.quaternions import from_rotvec, product
from dsr.math3d.shapes import Shape
from dsr.math3d.transforms import Pose, looking_at
from dsr.vocabulary import tags
from dsr.vocabulary.arms import ARM

GEN3 = "gen3"
"""The model of the robot of most scenarios."""
NO_ROBOT = "none"
"""The model of a robot that is not there."""

Share = Annotated[float, Meta(ge=0, le=1)]
Angle = Annotated[float, Meta(gt=0, lt=math.pi)]
Color = tuple[Share, Share, Share]


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file; unknown fields are refused."""


class RobotSpec(Section, frozen=True, kw_only=True):
    """The arm."""

    model: str = GEN3
    """`etc/robots/<model>.urdf`, or the path of a URDF file beside the scenario file; `"none"`: there is no arm"""
    args: dict[str, Value] = {}
    """Arguments of the macros (xacro) of this file, by name"""
    start: tuple[Radians, ...] = (0.0, 0.0, 3.14159, -0.96, 0.0, -2.1, 1.5708)
    """rad, joint positions at the start; default: the observe pose of the Gen3, and the home posture of other models"""
    position: Vector3 = (0.0, 0.0, 0.0)
    """m, of the foot of the arm, world"""
    yaw: Radians = 0.0
    """rad, by which the arm is turned about the vertical"""

    @property
    def chosen_start(self) -> tuple[float, ...]:
        """Joint positions (rad) at the start; empty for the home posture of the model."""
        return () if self.model != GEN3 and self.start == RobotSpec().start else self.start

    @property
    def base(self) -> Pose:
        """world_from_base"""
        return Pose.from_rotvec(self.position, (0.0, 0.0, self.yaw))

    @property
    def exists(self) -> bool:
        """Whether there is an arm."""
        return self.model != NO_ROBOT


class ArmSpec(RobotSpec, frozen=True, kw_only=True):
    """Another arm, beside that of `[robot]`."""

    name: str
    """Name of the arm's node, by which it is told apart from the first one, `arm`"""


class CameraSpec(Section, frozen=True, kw_only=True):
    """A camera on a stand, upright."""

    position: Vector3
    """m, of its optical centre, world"""
    look_at: Vector3
    """m, what is in the middle of its image, world"""

    @property
    def pose(self) -> Pose:
        """world_from_camera, the optical frame: z forward, x right and level, y down.

        Of one that looks straight down or up the image's upper side is world +x.
        """
        return looking_at(self.position, self.look_at)


class TableSpec(Section, frozen=True, kw_only=True):
    """The table."""

    size: Size = (1.2, 1.2, 0.04)
    """m, edge lengths along the world's x, y and z"""
    position: Vector3 = (0.35, 0.0, 0.0)
    """m, centre of the top surface, world"""
    friction: Annotated[float, Meta(ge=0, le=5)] = 1.0
    """1, Coulomb coefficient"""


class SensorSpec(Section, frozen=True, kw_only=True):
    """Errors of the camera on top of those that its measuring principle has anyway."""

    depth_bias: tuple[Bias, Bias] = (0.0, 0.0)
    """m, bounds of the constant depth error of each object, drawn uniformly; positive is towards the camera"""
    depth_jitter: Noise = 0.0
    """m, standard deviation per object and frame"""
    grey_noise: Annotated[float, Meta(ge=0, le=100)] = 2.0
    """grey levels, standard deviation"""


class RandomSpec(Section, frozen=True, kw_only=True):
    """Differences between seeds: the start poses of the objects (see `start_poses`)."""

    position: Noise = 0.0
    """m, uniform +- on x and y"""
    yaw: Radians = 0.0
    """rad, uniform +-"""


class ObjectSpec(Section, frozen=True, kw_only=True):
    """An object of the true world."""

    name: str
    model: str | None = None
    """`etc/objects/<model>.urdf`, or a path beside the scenario file: gives what of the following is not given here"""
    type: Literal["cube", "box", "container", "cup", "ball"] = "cube"
    marker_id: Annotated[int, Meta(ge=0, lt=tags.COUNT)] | None = None
    """AprilTag 36h11 on the +z face; without one it can only be recognised by its colour"""
    size: Size = (0.04, 0.04, 0.04)
    """m, along its own x, y and z"""
    shape: Shape = ()
    """Parts of the shape, moved so that their bounding box is centred; without any the object is a solid box"""
    mass: Annotated[float, Meta(ge=LIGHTEST, le=HEAVIEST)] = 0.05
    """kg, mass of the object"""
    friction: Annotated[float, Meta(ge=0, le=5)] = 0.6
    """Coulomb coefficient"""
    rolling_friction: Annotated[float, Meta(ge=0, le=5)] = 0.0
    """m, lever arm of the resistance to rolling"""
    color: Color | None = None
    """Red, green, blue, 0 to 1; default: by the plant"""
    position: Vector3
    """m, centre, world"""
    yaw: Radians = 0.0
    """rad about world z"""
    lean: Rotation = (0.0, 0.0, 0.0)
    """Rotation vector, rad, about world axes, by which it leans or lies before it is turned by `yaw`"""
    known: bool = False
    """The working memory starts with a node of this object (size, shape, mass, marker, colour), without a pose."""

    @property
    def pose(self) -> Pose:
        """world_from_object at the start"""
        turned = from_rotvec((0.0, 0.0, self.yaw))
        return Pose(self.position, product(turned, from_rotvec(self.lean)) if any(self.lean) else turned)

    @property
    def by_color(self) -> bool:
        """Whether it can be recognised by its colour: it has one and no marker, and the working memory knows it."""
        return self.known and self.marker_id is None and self.color is not None

    @property
    def by_depth(self) -> bool:
        """Whether it can only be found by its shape: a box or a cylinder that the working memory does not know."""
        is_block = not self.shape or (len(self.shape) == 1 and self.shape[0].kind == "cylinder")
        return not self.known and self.marker_id is None and is_block


class PersonSpec(Section, frozen=True, kw_only=True):
    """A person, of whom only the eyes count; the hands are events of their own."""

    name: str
    position: Vector3
    """m, between the eyes, world"""
    look_at: Vector3
    """m, point in the world that the person looks at"""
    fov: tuple[Angle, Angle] = (1.745, 1.396)
    """rad, horizontal and vertical: what they see at once"""
    present: bool = True
    """Whether the person is in the scene from the beginning; else from a `person_enter` on."""


class MissionSpec(Section, frozen=True, kw_only=True):
    """The goal that the robot is given."""

    goal: str
    """E.g. `on(cube_3, cube_4) & on(cube_6, cube_5)`."""
    maintain: bool = False
    """Watch the goal after it was reached, and reach it again."""
    priority: int = 0
    """Greater is more urgent."""


class PlanSpec(Section, frozen=True, kw_only=True):
    """A plan that the robot considers, beside others."""

    name: str
    goal: str
    """The goal that the plan serves, as the goal of a mission."""
    steps: Annotated[tuple[str, ...], Meta(min_length=1)]
    """E.g. `place cube_3 on cube_4`."""


class Scenario(Section, frozen=True, kw_only=True):
    """One scenario file, checked."""

    name: str
    title: str
    system: str = "tabletop"
    """`etc/systems/<system>.toml`, or a path ending in `.toml`, relative to the scenario's file"""
    duration: Annotated[float, Meta(gt=0, le=3600)]
    """s, from when all agents are ready"""
    settle: Seconds = 4.0
    """s after the start from when on the belief is judged: the default window of checks and metrics"""
    linger: Annotated[float, Meta(gt=0, le=3600)] | None = None
    """s after all events are over and the mission, if any, is at rest, after which the run ends before `duration`;
    None: the run always lasts `duration`"""
    camera: Literal["overhead", "wrist"] | CameraSpec = "overhead"
    """The camera that sees the objects; a table for one on a stand."""
    robot: RobotSpec = RobotSpec()
    more_arms: list[ArmSpec] = msgspec.field(name="arm", default_factory=list)
    """Those beside that of `robot`."""
    table: TableSpec = TableSpec()
    sensor: SensorSpec = SensorSpec()
    random: RandomSpec = RandomSpec()
    mission: MissionSpec | None = None
    """Default: nobody wants anything."""
    persons: list[PersonSpec] = msgspec.field(name="person", default_factory=list)
    plans: list[PlanSpec] = msgspec.field(name="plan", default_factory=list)
    """Plans whose outcomes are imagined; the best is adopted."""
    objects: list[ObjectSpec] = msgspec.field(name="object", default_factory=list)
    events: list[Event] = msgspec.field(name="event", default_factory=list)
    expectations: list[Check] = msgspec.field(name="expect", default_factory=list)

    @property
    def arms(self) -> dict[str, RobotSpec]:
        """All arms by name, the first one first."""
        first = {ARM: self.robot} if self.robot.exists else {}
        return {**first, **{spec.name: spec for spec in self.more_arms}}

    @property
    def camera_name(self) -> str:
        """Name of the camera in the plant: `overhead`, `wrist` or `fixed`."""
        return self.camera if isinstance(self.camera, str) else "fixed"

    def object(self, name: str) -> ObjectSpec:
        """The object called `name`; KeyError if there is none."""
        for spec in self.objects:
            if spec.name == name:
                return spec
        raise KeyError(name)
