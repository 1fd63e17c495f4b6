"""Persons in the 3D view: head and trunk, as they hide things, and where they look."""

from __future__ import annotations

import msgspec
import numpy as np
import rerun as rr

from agents.viewer import palette
from agents.viewer.model import BELIEF_FIRST, WORLD, Place, Solid, moved, place_of
from agents.viewer.scene import ENTITY
from dsr import Memory, TransformError
from dsr.math3d.transforms import Pose
from dsr.visibility import PERSON
from dsr.visibility.persons import HEAD, TRUNK, upright
from dsr.vocabulary.perceived import is_perceived

PERSONS = f"{ENTITY}/persons"
_GAZE = 0.3  # m
_ROUNDED = 3  # digits of m, and of quaternions: heads are never still


class Shown(msgspec.Struct, frozen=True):
    """A person who is there."""

    name: str
    eyes: Place
    body: tuple[Solid, ...]


class PersonView:
    """Logs all persons who are there, when something has changed."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._shown: list[Shown] = []

    def draw(self, memory: Memory) -> None:
        """Log them if they are not as they were."""
        persons = read_persons(memory)
        if persons == self._shown:
            return
        self._shown = persons
        boxes = [solid for person in persons for solid in person.body]
        self._recording.log(
            PERSONS,
            rr.Boxes3D(
                centers=np.array([solid.place.translation for solid in boxes]).reshape(-1, 3),
                sizes=np.array([solid.size for solid in boxes]).reshape(-1, 3),
                quaternions=np.array([solid.place.rotation for solid in boxes]).reshape(-1, 4),
                labels=[solid.name for solid in boxes],
                colors=[palette.of_node(PERSON)] * len(boxes),
                radii=[0.002] * len(boxes),
                fill_mode="majorwireframe",
            ),
        )
        gazes = [moved(person.eyes, (_GAZE, 0.0, 0.0)).translation for person in persons]
        eyes = np.array([person.eyes.translation for person in persons]).reshape(-1, 3)
        self._recording.log(
            f"{PERSONS}/gazes",
            rr.Arrows3D(
                origins=eyes,
                vectors=np.array(gazes).reshape(-1, 3) - eyes,
                colors=[palette.of_node(PERSON)] * len(persons),
                radii=[0.004] * len(persons),
            ),
        )


def read_persons(memory: Memory) -> list[Shown]:
    """Those who are perceived now and of whom it is known where, by name."""
    found = []
    for node in sorted(memory.nodes(PERSON), key=lambda node: node.name):
        if not is_perceived(node, memory.clock.now()):
            continue
        try:
            pose = memory.transform(WORLD, node.name, types=BELIEF_FIRST)
        except TransformError:
            continue
        eyes = _rounded(pose)
        shoulders = _rounded(Pose.from_matrix(upright(pose.matrix)))
        frames = ((eyes, HEAD, node.name), (shoulders, TRUNK, ""))
        body = (
            Solid(name, PERSON, moved(frame, part.position), part.size)
            for frame, shape, name in frames
            for part in shape
        )
        found.append(Shown(node.name, eyes, tuple(body)))
    return found


def _rounded(pose: Pose) -> Place:
    x, y, z = (round(number, _ROUNDED) for number in pose.t)
    a, b, c, d = (round(number, _ROUNDED) for number in pose.q)
    return place_of(Pose((x, y, z), (a, b, c, d)))
