"""Events, in which the experimenter changes the true world: one struct per move, told apart by `do`.

Each event starts `at` a time (s after the start) or once the condition `when` has come true, plus `delay`
seconds. The plant carries out all moves but `kill`, which is the runner's; it tells the runner of its condition.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, get_args

import msgspec
from msgspec import Meta

from agents.scenario.format.conditions import Condition, parse_condition
from agents.scenario.format.units import (
    Impulse3,
    Length,
    Metres,
    Radians,
    Rotation,
    Seconds,
    Speed,
    Vector2,
    Vector3,
    Velocity2,
    Velocity3,
)

HandNumber = Annotated[int, Meta(ge=0, le=1)]
"""Number of a human hand: 0 is a right one, 1 a left one."""


class EventBase(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="do"):
    """The start of an event: `at` or `when`, exactly one of them."""

    by_runner: ClassVar[bool] = False
    """Whether the runner carries the event out, and not the plant."""

    at: Seconds | None = None
    """s after the start"""
    when: str | None = None
    """Condition on the true world, e.g. `built(cube_3, cube_4) and resting(cube_6)`."""
    delay: Seconds = 0.0
    """s after `at`, or after `when` came true"""

    @property
    def condition(self) -> Condition | None:
        """The parsed `when`."""
        return None if self.when is None else parse_condition(self.when)

    @property
    def named_objects(self) -> dict[str, str]:
        """Names of the objects that the event mentions, by field."""
        return {}


class ObjectEvent(EventBase, frozen=True, kw_only=True):
    """An event that acts on one object."""

    object: str

    @property
    def named_objects(self) -> dict[str, str]:
        """The object acted on."""
        return {"object": self.object}


class PlaceEvent(ObjectEvent, frozen=True, kw_only=True, tag="place"):
    """Put the object down somewhere else at once: at `position`, or on top of the object `onto`."""

    position: Vector3 | None = None
    """m, centre, world"""
    onto: str | None = None
    """Object on whose present true pose it is centred."""
    offset: Vector2 = (0.0, 0.0)
    """m, along world x and y from the centre of `onto`"""
    yaw: Radians | None = None
    """rad; default: as before"""
    contents: bool = False
    """Everything on or in it comes along rigidly."""

    @property
    def named_objects(self) -> dict[str, str]:
        """The object acted on and the one below."""
        return {"object": self.object} | ({} if self.onto is None else {"onto": self.onto})


class MovedByHand(ObjectEvent, frozen=True, kw_only=True):
    """A move that nobody is seen to make, or that a hand makes."""

    hand: HandNumber | None = None
    """This hand comes, takes the object and moves it; default: it moves by itself."""
    contents: bool | None = None
    """Everything on it comes along rigidly; default: without a hand. What is in it or under it moves by physics."""

    @property
    def moves_contents(self) -> bool:
        """Whether everything on or in the object comes along rigidly."""
        return self.hand is None if self.contents is None else self.contents


class Slide(MovedByHand, frozen=True, kw_only=True, tag="slide"):
    """Push the object over its support in a straight line."""

    to: Vector2 | None = None
    """m, x and y of the centre at the end, world"""
    by: Vector2 | None = None
    """m, along world x and y from where it is, instead of `to`"""
    yaw: Radians | None = None
    """rad at the end; default: as before"""
    turn: Radians = 0.0
    """rad from its yaw before, instead of `yaw`"""
    pushes: tuple[str, ...] = ()
    """Names of the objects in the way that are meant to be pushed along or aside, by contact."""
    speed: Speed = 0.1
    """m/s, speed of the object"""


class Carry(MovedByHand, frozen=True, kw_only=True, tag="carry"):
    """Lift the object by `height`, move it over `to`, put it down there."""

    to: Vector3
    """m, centre at the end, world"""
    yaw: Radians | None = None
    """rad at the end; default: as before"""
    height: Length = 0.15
    """m above the higher one of start and end"""
    speed: Speed = 0.2
    """m/s, speed of the object"""


class Lift(MovedByHand, frozen=True, kw_only=True, tag="lift"):
    """Raise the object and hold it in the air until `drop`, `place`, `carry` or `slide`."""

    height: Length
    """m above where it is"""
    speed: Speed = 0.2
    """m/s, speed of the object"""


class Tilt(ObjectEvent, frozen=True, kw_only=True, tag="tilt"):
    """Turn the object about its centre and hold it so until `drop`, `place`, `carry` or `slide`."""

    angle: Radians
    """rad about `axis`"""
    axis: Vector3 = (1.0, 0.0, 0.0)
    """Direction of the axis, world."""
    speed: Speed = 1.0
    """rad/s, speed of the rotation"""
    hand: HandNumber | None = None
    """This hand comes, takes the object and turns it; default: it turns by itself."""


class Drop(ObjectEvent, frozen=True, kw_only=True, tag="drop"):
    """Let go of an object that `lift` or `tilt` holds."""


class Remove(ObjectEvent, frozen=True, kw_only=True, tag="remove"):
    """Take the object out of the scene altogether."""


class Swap(ObjectEvent, frozen=True, kw_only=True, tag="swap"):
    """The object and `other` take each other's place at once; each keeps its yaw."""

    other: str
    contents: bool = False
    """Everything on or in both comes along rigidly."""

    @property
    def named_objects(self) -> dict[str, str]:
        """Both objects."""
        return {"object": self.object, "other": self.other}


class Topple(ObjectEvent, frozen=True, kw_only=True, tag="topple"):
    """Push the object over the edge of what it stands on, then let it fall."""

    direction: Vector2 = (1.0, 0.0)
    """Direction of the push along world x and y; its length does not matter."""
    speed: Speed = 0.5
    """m/s, speed of the push"""
    hand: HandNumber | None = None
    """This hand comes and pushes with two fingertips; default: nobody is seen."""


class SetInMotion(ObjectEvent, frozen=True, kw_only=True):
    """An event that gives the object a velocity once, and leaves all that follows to physics."""

    hand: HandNumber | None = None
    """This hand comes from behind and gives it with two fingertips; default: nobody is seen."""

    @property
    def along(self) -> Vector3:
        """Direction of the velocity along world x, y and z; its length does not matter."""
        raise NotImplementedError


class Push(SetInMotion, frozen=True, kw_only=True, tag="push"):
    """Give the object a velocity, or an impulse at its centre; it slides, rolls, tips over or falls by itself."""

    velocity: Velocity3 | None = None
    """m/s, of its centre, world; how it turns stays as it is"""
    impulse: Impulse3 | None = None
    """N s, world, instead of `velocity`: its velocity changes by that over its mass"""

    @property
    def along(self) -> Vector3:
        """The direction of the velocity or impulse."""
        return self.velocity or self.impulse or (0.0, 0.0, 0.0)


class Roll(SetInMotion, frozen=True, kw_only=True, tag="roll"):
    """Let a ball roll away, without slipping; friction slows it down, and it falls off an edge."""

    velocity: Velocity2
    """m/s, along world x and y"""

    @property
    def along(self) -> Vector3:
        """The direction of the velocity."""
        return (*self.velocity, 0.0)


class FalsePercept(ObjectEvent, frozen=True, kw_only=True, tag="false_percept"):
    """The camera sees the object elsewhere for some frames; the object stays where it is."""

    frames: Annotated[int, Meta(ge=1, le=1000)] = 1
    """Number of camera frames."""
    translation: Vector3 = (0.0, 0.0, 0.0)
    """m, displacement of the percept in the world"""
    rotation: Rotation = (0.0, 0.0, 0.0)
    """Rotation vector, rad, world, about the object's centre."""


class ArmError(EventBase, frozen=True, kw_only=True, tag="arm_error"):
    """The joint sensors tell positions at which the tool would be elsewhere; the arm itself moves as it should."""

    translation: Vector3
    """m, world: where the tool seems to be, minus where it is"""
    duration: Seconds
    """The error grows from nothing and vanishes again within 0.2 s each."""


class CameraBump(EventBase, frozen=True, kw_only=True, tag="camera_bump"):
    """Move the true camera; the working memory is not told."""

    translation: Vector3 = (0.0, 0.0, 0.0)
    """m, in the camera's optical frame (x right, y down, z forward)"""
    rotation: Rotation = (0.0, 0.0, 0.0)
    """Rotation vector, rad, in the camera's optical frame."""
    camera: Literal["overhead", "wrist", "fixed"] | None = None
    """Default: the scenario's camera."""


class CameraCover(EventBase, frozen=True, kw_only=True, tag="camera_cover"):
    """Cover the lens: the image is black and the depth unknown for `duration` seconds."""

    duration: Seconds
    camera: Literal["overhead", "wrist", "fixed"] | None = None
    """Default: the scenario's camera."""


class HandEvent(EventBase, frozen=True, kw_only=True):
    """An event of a human hand."""

    hand: HandNumber = 0
    """0 is a right hand, 1 a left one."""


class HandEnter(HandEvent, frozen=True, kw_only=True, tag="hand_enter"):
    """A hand comes into the scene, open, its fingers pointing away from where it comes from and a bit down."""

    position: Vector3
    """m, where its palm goes, world"""
    side: Vector2 = (1.0, 0.0)
    """Along world x and y: where it comes from."""
    speed: Speed = 0.4
    """m/s, speed of the hand"""


class HandGraspEvent(HandEvent, frozen=True, kw_only=True, tag="hand_grasp"):
    """A hand, entering if it must, goes to an object and lays fingertips on it."""

    object: str
    style: Literal["pinch", "touch"] = "pinch"
    """`pinch`: thumb and index finger on opposite sides, it is held. `touch`: two fingertips on one side only."""
    side: Vector2 = (1.0, 0.0)
    """Along world x and y: from which side of the object the hand comes."""
    above: Metres | None = None
    """m, of the fingertips over the object's centre; default: a fifth of its height, at a ball none"""
    speed: Speed = 0.4
    """m/s, speed of the hand"""

    @property
    def named_objects(self) -> dict[str, str]:
        """The object that the hand grasps."""
        return {"object": self.object}


class HandMove(HandEvent, frozen=True, kw_only=True, tag="hand_move"):
    """A hand goes somewhere, with what it grasps or touches."""

    to: Vector3 | None = None
    """m, where the palm goes, or if it holds something the centre of that, world"""
    by: Vector3 | None = None
    """m, along world x, y and z from where it is, instead of `to`"""
    turn: Radians = 0.0
    """rad about the vertical, on the way"""
    speed: Speed = 0.2
    """m/s, speed of the hand"""


class HandRelease(HandEvent, frozen=True, kw_only=True, tag="hand_release"):
    """A hand opens and draws back a little; what it held falls if nothing is beneath."""


class HandLeave(HandEvent, frozen=True, kw_only=True, tag="hand_leave"):
    """A hand lets go and leaves the scene."""

    side: Vector2 | None = None
    """Along world x and y: where to; default: where it came from."""
    speed: Speed = 0.4
    """m/s, speed of the hand"""


class PersonEvent(EventBase, frozen=True, kw_only=True):
    """An event of a person, of whom only the eyes count: where they are, and where they look."""

    person: str


class PersonEnter(PersonEvent, frozen=True, kw_only=True, tag="person_enter"):
    """A person comes into the scene, at once, and looks."""

    position: Vector3 | None = None
    """m, between the eyes, world; default: as the file's `[[person]]` says"""
    look_at: Vector3 | None = None
    """m, world; default: likewise"""


class PersonTurn(PersonEvent, frozen=True, kw_only=True, tag="person_turn"):
    """A person turns the head."""

    look_at: Vector3
    """m, point in the world that the person looks at then"""
    speed: Speed = 2.0
    """rad/s, speed of the head's rotation"""


class PersonWalk(PersonEvent, frozen=True, kw_only=True, tag="person_walk"):
    """A person goes somewhere in a straight line, turning the head on the way."""

    to: Vector3
    """m, between the eyes, world"""
    look_at: Vector3 | None = None
    """m, world, at the end; default: the same direction as before"""
    speed: Speed = 1.0
    """m/s, speed of the person"""


class PersonLeave(PersonEvent, frozen=True, kw_only=True, tag="person_leave"):
    """A person is gone, at once, and sees nothing until `person_enter`."""


class Kill(EventBase, frozen=True, kw_only=True, tag="kill"):
    """Kill an agent's process without warning (SIGKILL); the launcher restarts it, unless it shall stay away.

    In lockstep the agent is dropped and made anew after a back-off. The plant tells when its `when` has come true.
    """

    by_runner: ClassVar[bool] = True

    agent: str
    restart: bool = True
    """Whether it is started again."""


Event = (
    PlaceEvent
    | Swap
    | Slide
    | Carry
    | Lift
    | Tilt
    | Drop
    | Topple
    | Push
    | Roll
    | Remove
    | FalsePercept
    | ArmError
    | CameraBump
    | CameraCover
    | HandEnter
    | HandGraspEvent
    | HandMove
    | HandRelease
    | HandLeave
    | PersonEnter
    | PersonTurn
    | PersonWalk
    | PersonLeave
    | Kill
)
EVENTS: dict[str, type[Event]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Event)}
"""The kinds of event by their `do`."""
