"""Messages between the plant and its drivers, as MessagePack maps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated

import msgspec
from msgspec import Meta

from agents.drivers import ArmState, HandReadings, PersonReadings, TagReadings
from dsr.errors import WireError
from dsr.math3d.transforms import Pose
from dsr.network.decoding import decoded
from dsr.network.keys import Keys
from dsr.vocabulary.arms import ARM
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.perceived import MOST_HANDS, MOST_PERSONS

LANDMARKS = 21
"""Number of landmarks of one hand."""
MOST_POINTS = 5000
"""Points that one trajectory may have."""
Point = tuple[float, float, float]
"""m"""
Seven = tuple[float, float, float, float, float, float, float]
"""A pose: translation (m), then a quaternion (x, y, z, w)."""


class Follow(msgspec.Struct, frozen=True, tag="follow"):
    """Pass through joint positions at given times."""

    times: Annotated[tuple[float, ...], Meta(min_length=1, max_length=MOST_POINTS)]
    """s since the command arrived, increasing"""
    positions: tuple[tuple[float, ...], ...]
    """rad, for each of the times"""


class MoveGripper(msgspec.Struct, frozen=True, tag="move_gripper"):
    """Open or close the gripper."""

    opening: Annotated[float, Meta(ge=0)]
    """Wanted distance between the pads, m."""


class Stop(msgspec.Struct, frozen=True, tag="stop"):
    """Come to rest, and stay."""


class KeepAlive(msgspec.Struct, frozen=True, tag="keep_alive"):
    """A sign of life of whoever commands the arm: the present motion shall go on."""


Command = Follow | MoveGripper | Stop | KeepAlive


class ArmTruth(msgspec.Struct, frozen=True):
    """One instant of an arm beside the first one."""

    positions: tuple[float, ...]
    """rad, joint positions"""
    gripper: float
    """m between the pads"""
    held: str | None
    """Object in the gripper."""


class Truth(msgspec.Struct, frozen=True):
    """One instant of the true world: for judges and recordings, never for agents."""

    stamp: float
    """Time of the instant, s."""
    objects: dict[str, Seven]
    """world_from_object by name, at the centre; removed objects are not there."""
    robot: tuple[float, ...]
    """rad, joint positions of the first arm"""
    gripper: float
    """m between its pads"""
    held: str | None
    """Object in its gripper."""
    camera: dict[str, Seven]
    """world_from_camera (optical frame) by name, of the cameras in use"""
    moving: tuple[str, ...] = ()
    """Objects that do not lie still."""
    in_view: tuple[str, ...] = ()
    """Objects whose tag, or enough of whose colour, the camera could see in its last frame."""
    grasped: dict[str, str] = {}
    """Objects that are held, and by what: the node of a gripper or a hand, or `unknown` for the experimenter."""
    moves: dict[int, tuple[float, float | None]] = {}
    """Begin and end (s after the start) of the moves that the experimenter has begun, by the event's number in the file
    (from 1)
    """
    given_up: dict[int, str] = {}
    """Reasons why moves could not be carried out, by the event's number."""
    hands: dict[int, tuple[Point, ...]] = {}
    """21 landmarks (m, world) of each hand in the scene, by number: centres of the joints, as in MediaPipe's order"""
    touched: dict[str, str] = {}
    """Objects on which fingertips of a human hand just lie, and the node of the hand."""
    pinched: dict[str, str] = {}
    """What each human hand grasps, by the node of the hand: two hands may grasp one object."""
    persons: dict[str, Seven] = {}
    """world_from_person of those in the scene, by name: between the eyes, x along the gaze, y left"""
    arms: dict[str, ArmTruth] = {}
    """Arms beside the first one, by name."""
    apart: float | None = None
    """m, the least distance between two arms, with what they hold, since the instant before; negative where one is in
    the other. None if they were farther apart than is measured, or there is one arm.
    """


_arm_state_decoder = msgspec.msgpack.Decoder(ArmState)
_hands_decoder = msgspec.msgpack.Decoder(HandReadings)
_persons_decoder = msgspec.msgpack.Decoder(PersonReadings)
_readings_decoder = msgspec.msgpack.Decoder(TagReadings)
_command_decoder: msgspec.msgpack.Decoder[Command] = msgspec.msgpack.Decoder(Command)


def decode_command(payload: bytes, joints: int) -> Command:
    """Decode a command for an arm with `joints` joints; raises `WireError` for anything else."""
    command = decoded(payload, "arm command", _command_decoder.decode)
    if not all(map(math.isfinite, _numbers(command))):
        raise WireError(f"arm command {command!s:.200}: expected finite numbers")
    if isinstance(command, Follow):
        for positions in command.positions:
            if len(positions) != joints:
                raise WireError(f"arm command with {len(positions)} positions: expected {joints}")
        if not _is_timed(command):
            raise WireError(
                "arm command with a trajectory: expected increasing times from 0 on, and positions for each of them"
            )
    return command


def _numbers(command: Command) -> Iterator[float]:
    if isinstance(command, Follow):
        yield from command.times
        for positions in command.positions:
            yield from positions
    elif isinstance(command, MoveGripper):
        yield command.opening


def _is_timed(command: Follow) -> bool:
    increasing = all(early < late for early, late in pairwise(command.times))
    return increasing and command.times[0] >= 0.0 and len(command.times) == len(command.positions)


def decode_arm_state(payload: bytes) -> ArmState:
    """A sample of the arm with one finite number for each joint; raises `WireError` for anything else."""
    return decoded(payload, "arm state", _read_arm_state)


def _read_arm_state(payload: bytes) -> ArmState:
    state = _arm_state_decoder.decode(payload)
    if not len(state.names) == len(state.positions) == len(state.velocities):
        raise ValueError(f"{len(state.positions)} positions and {len(state.velocities)} velocities of {state.names}")
    if len(state.efforts) not in (0, len(state.names)):
        raise ValueError(f"{len(state.efforts)} efforts of {state.names}")
    _check_finite(state.stamp, state.gripper_opening, state.gripper_effort or 0.0)
    _check_finite(*state.positions, *state.velocities, *state.efforts)
    return state


def decode_tag_readings(payload: bytes) -> TagReadings:
    """Readings with poses that are rotations and translations; raises `WireError` for anything else."""
    return decoded(payload, "tag readings", _read_tag_readings)


def _read_tag_readings(payload: bytes) -> TagReadings:
    seen = _readings_decoder.decode(payload)
    _check_finite(seen.stamp)
    for reading in seen.readings:
        Pose(reading.pose[:3], reading.pose[3:])
        _check_finite(reading.sigma_translation, reading.sigma_rotation)
        if min(reading.sigma_translation, reading.sigma_rotation) < 0.0:
            raise ValueError(f"a negative standard deviation of marker {reading.marker_id}")
    for colored in seen.colors:
        _check_finite(*colored.color, *colored.position, colored.sigma)
        if colored.sigma < 0.0:
            raise ValueError(f"a negative standard deviation of colour {colored.color}")
    if seen.intrinsics is not None:
        _check_intrinsics(seen.intrinsics)
    return seen


def decode_hand_readings(payload: bytes) -> HandReadings:
    """Readings with 21 finite landmarks for each hand; raises `WireError` for anything else."""
    return decoded(payload, "hand readings", _read_hand_readings)


def _read_hand_readings(payload: bytes) -> HandReadings:
    seen = _hands_decoder.decode(payload)
    _check_finite(seen.stamp)
    if len(seen.hands) > MOST_HANDS:
        raise ValueError(f"{len(seen.hands)} hands; expected at most {MOST_HANDS}")
    for hand in seen.hands:
        if not len(hand.landmarks) == len(hand.visible) == LANDMARKS:
            raise ValueError(f"{len(hand.landmarks)} landmarks with {len(hand.visible)} flags; expected {LANDMARKS}")
        _check_finite(hand.sigma, *(number for point in hand.landmarks for number in point))
        if hand.sigma < 0.0:
            raise ValueError("a negative standard deviation of landmarks")
    if seen.intrinsics is not None:
        _check_intrinsics(seen.intrinsics)
    return seen


def decode_person_readings(payload: bytes) -> PersonReadings:
    """Readings with a pose and possible deviations for each person; raises `WireError` for anything else."""
    return decoded(payload, "person readings", _read_person_readings)


def _read_person_readings(payload: bytes) -> PersonReadings:
    seen = _persons_decoder.decode(payload)
    _check_finite(seen.stamp)
    if len(seen.persons) > MOST_PERSONS:
        raise ValueError(f"{len(seen.persons)} persons; expected at most {MOST_PERSONS}")
    for person in seen.persons:
        Pose(person.pose[:3], person.pose[3:])
        _check_finite(person.sigma_translation, person.sigma_rotation, *(person.fov or ()))
        if min(person.sigma_translation, person.sigma_rotation, *(person.fov or ())) < 0.0:
            raise ValueError(f"a negative deviation or field of view of {person.name!r}")
    return seen


def _check_intrinsics(intrinsics: Intrinsics) -> None:
    _check_finite(intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
    if min(intrinsics.fx, intrinsics.fy, intrinsics.width, intrinsics.height) <= 0:
        raise ValueError(f"{intrinsics}: focal lengths and image size must be positive")


def _check_finite(*numbers: float) -> None:
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a number that is not finite")


def seven(pose: Pose) -> Seven:
    """The seven numbers of a pose."""
    return (*pose.t, *pose.q)


def arm_state_key(keys: Keys, arm: str = ARM) -> str:
    """Key on which an arm sends its state (`agents.drivers.ArmState`)."""
    return keys.device(f"{arm}/state")


def arm_command_key(keys: Keys, arm: str = ARM) -> str:
    """Key on which an arm takes commands (`Command`)."""
    return keys.device(f"{arm}/command")


def frame_key(keys: Keys, camera: str) -> str:
    """Key on which a camera sends frames (`dsr.images.blobs.Frame`)."""
    return keys.device(f"camera/{camera}")


def readings_key(keys: Keys, camera: str) -> str:
    """Key on which a camera sends `TagReadings` instead of frames."""
    return keys.device(f"camera/{camera}/poses")


def hands_key(keys: Keys, camera: str) -> str:
    """Key on which a camera sends `HandReadings` instead of frames."""
    return keys.device(f"camera/{camera}/hands")


def persons_key(keys: Keys) -> str:
    """Key on which the tracker of persons sends `PersonReadings`."""
    return keys.device("persons")
