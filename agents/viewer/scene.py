"""The 3D view: frames, table, robot and cameras; percepts and beliefs drawn apart."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from typing import Any

import msgspec
import numpy as np
import rerun as rr

from agents.viewer import palette
from agents.viewer.model import DrawnCamera, DrawnPlace, DrawnScene, DrawnSolid, Gripper, Vector, moved, place_of
from agents.viewer.palette import Color
from dsr import Change, Memory, Mesh, Node, Pose, SchemaError, TransformError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.geometry import mesh_hashes
from dsr.visibility import PERSON
from dsr.visibility.persons import HEAD, TRUNK, upright
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.perceived import is_perceived
from dsr.vocabulary.relations import nodes_by_name

ENTITY = "world"
NAMES = "names"
"""Below that, of the objects. Names stand close enough to be read from nearby only."""
_LINK_RADIUS = 0.038  # m, as all lengths below
_LEAST_LINK = 0.01
_AXIS = 0.08
_PALM = ((0.0, 0.0, 0.04), (0.09, 0.05, 0.08))  # centre and size in the gripper's frame, z forward
_FINGER = (0.012, 0.022, 0.055)
_FINGER_AHEAD = 0.1075
_FRUSTUM = 0.12
_ASIDE = (0.035, 0.055)  # along world x and y: to the right as the views look
_LINGER = 1.5  # s for which a mark stays
_FAINTEST, _STRONGEST = 0.15, 0.6  # opacity of alternatives
_MARK = 1.35  # times the size of what is marked


def camera_entity(camera: str) -> str:
    """The entity of a camera's images; the one above it is the camera's frame."""
    return f"{ENTITY}/cameras/{camera}/image"


class SceneView:
    """Logs scenes, each part only when it changed."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._shown: dict[str, Any] = {}
        self._marks: dict[str, float] = {}
        recording.log(ENTITY, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def draw(self, scene: DrawnScene, now: float, meshed: Collection[str] = ()) -> None:
        """Log what is not at time `now` (s) as it was before; what is shown as its mesh gets no box for its belief."""
        self._update("table", [table for table in scene.tables if table.name not in meshed], _tables)
        self._update("robot/links", scene.links, _links)
        self._update("robot/grippers", scene.grippers, _grippers)
        self._update("frames", scene.frames, _axes)
        self._update("robot/bounds", scene.parts, _parts)
        self._update("percepts", scene.ghosts, _percepts)
        self._update("beliefs", [solid for solid in scene.beliefs if solid.name not in meshed], _beliefs)
        self._update("alternatives", scene.alternatives, _alternatives)
        self._update("surprising", self._marked(scene, now), _surprising)
        self._update(NAMES, list({solid.name: solid for solid in scene.percepts + scene.beliefs}.values()), _names)
        for camera in scene.cameras:
            self._draw_camera(camera)

    def _marked(self, scene: DrawnScene, now: float) -> list[DrawnSolid]:
        """What is surprising, or was a moment ago: explanations come faster than eyes."""
        self._marks |= {solid.name: now + _LINGER for solid in scene.surprising}
        known = {solid.name: solid for solid in [*scene.percepts, *scene.beliefs]}
        self._marks = {name: until for name, until in self._marks.items() if now < until and name in known}
        return [known[name] for name in sorted(self._marks)]

    def _update(self, entity: str, content: Any, draw: Callable[[Any], Any]) -> None:
        if self._shown.get(entity) != content:
            self._shown[entity] = content
            self._recording.log(f"{ENTITY}/{entity}", draw(content))

    def _draw_camera(self, camera: DrawnCamera) -> None:
        if camera.place is not None:
            self._update(f"cameras/{camera.name}", camera.place, transform)
        if camera.intrinsics is not None:
            self._update(f"cameras/{camera.name}/image", camera.intrinsics, pinhole)


def transform(place: DrawnPlace) -> rr.Transform3D:
    """Puts an entity there."""
    return rr.Transform3D(translation=place.translation, quaternion=rr.Quaternion(xyzw=place.rotation))


def pinhole(intrinsics: Intrinsics, color: Color = palette.CAMERA) -> rr.Pinhole:
    """The frustum of a camera."""
    return rr.Pinhole(
        image_from_camera=[[intrinsics.fx, 0.0, intrinsics.cx], [0.0, intrinsics.fy, intrinsics.cy], [0.0, 0.0, 1.0]],
        resolution=(intrinsics.width, intrinsics.height),
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=_FRUSTUM,
        color=color,
        line_width=0.002,
    )


def _boxes(solids: list[DrawnSolid], **style: Any) -> rr.Boxes3D:
    return rr.Boxes3D(
        centers=np.array([solid.place.translation for solid in solids]).reshape(-1, 3),
        sizes=np.array([solid.size for solid in solids]).reshape(-1, 3),
        quaternions=np.array([solid.place.rotation for solid in solids]).reshape(-1, 4),
        **style,
    )


def _percepts(percepts: list[DrawnSolid]) -> rr.Boxes3D:
    colors = [palette.PERCEPT if solid.seen else palette.UNSEEN_PERCEPT for solid in percepts]
    return _boxes(percepts, colors=colors, fill_mode="majorwireframe", radii=[0.0012] * len(percepts))


def _beliefs(beliefs: list[DrawnSolid]) -> rr.Boxes3D:
    colors = [palette.HELD if solid.held else palette.BELIEF for solid in beliefs]
    return _boxes(beliefs, colors=colors, fill_mode="solid")


def _alternatives(solids: list[DrawnSolid]) -> rr.Boxes3D:
    """Where things could be otherwise: the less probable, the fainter, with the probability beside them."""
    return _boxes(
        solids, colors=[(*palette.ALTERNATIVE, _alpha(solid.opacity)) for solid in solids], fill_mode="solid",
        labels=[f"{solid.name} {100.0 * solid.opacity:.0f} %" for solid in solids], show_labels=True,
    )  # fmt: skip


def _alpha(probability: float) -> int:
    """How much of what is behind an alternative it hides, 0 to 255; even an improbable one can be made out."""
    return round(255.0 * (_FAINTEST + (_STRONGEST - _FAINTEST) * probability))


def _surprising(solids: list[DrawnSolid]) -> rr.Boxes3D:
    """A frame around each."""
    marks = [msgspec.structs.replace(solid, size=_larger(solid.size)) for solid in solids]
    count = len(solids)
    return _boxes(marks, colors=[palette.SURPRISE] * count, fill_mode="majorwireframe", radii=[0.003] * count)


def _larger(size: Vector) -> Vector:
    return _MARK * size[0], _MARK * size[1], _MARK * size[2]


def _parts(parts: list[DrawnSolid]) -> rr.Boxes3D:
    return _boxes(parts, colors=[palette.JOINT] * len(parts), fill_mode="majorwireframe", radii=[0.0008] * len(parts))


def _names(known: list[DrawnSolid]) -> rr.Points3D:
    """A name beside each object, where it does not hide what is above; all but invisible points carry them.

    Fingers have none: that of the hand is enough.
    """
    x, y = _ASIDE
    solids = [solid for solid in known if solid.type != "finger"]
    beside = [(at[0] + x, at[1] + y, at[2]) for solid in solids for at in [solid.place.translation]]
    return rr.Points3D(
        np.array(beside).reshape(-1, 3),
        labels=[solid.name for solid in solids],
        show_labels=True,
        radii=[0.0001] * len(solids),
        colors=[palette.NAME] * len(solids),
    )


def _tables(tables: list[DrawnSolid]) -> rr.Boxes3D:
    """A table's frame is in the middle of its top surface."""
    centres = [moved(table.place, (0.0, 0.0, -table.size[2] / 2)) for table in tables]
    lowered = [msgspec.structs.replace(table, place=centre) for table, centre in zip(tables, centres, strict=True)]
    return _boxes(lowered, colors=[palette.TABLE] * len(lowered), fill_mode="solid")


def _links(links: list[tuple[Vector, Vector]]) -> rr.Capsules3D:
    long = [(start, end) for start, end in links if math.dist(start, end) > _LEAST_LINK]
    return rr.Capsules3D(
        lengths=[math.dist(start, end) for start, end in long],
        radii=[_LINK_RADIUS - 0.001 * (index % 2) for index in range(len(long))],
        translations=np.array([start for start, _ in long]).reshape(-1, 3),
        quaternions=np.array([_along_z(start, end) for start, end in long]).reshape(-1, 4),
        colors=[palette.ROBOT if index % 2 == 0 else palette.JOINT for index in range(len(long))],
        fill_mode="solid",
    )


def _along_z(start: Vector, end: Vector) -> tuple[float, float, float, float]:
    """The shortest rotation that turns the z axis into the direction from `start` to `end`, as (x, y, z, w)."""
    x, y, z = (np.array(end) - np.array(start)) / math.dist(start, end)
    if z < -0.999999:
        return 1.0, 0.0, 0.0, 0.0
    norm = math.sqrt(2.0 * (1.0 + z))
    return -y / norm, x / norm, 0.0, (1.0 + z) / norm


def _grippers(grippers: list[Gripper]) -> rr.Boxes3D:
    """A palm and two fingers each, which move along x."""
    parts = [part for gripper in grippers for part in _gripper_parts(gripper)]
    return _boxes(parts, colors=[palette.JOINT] * len(parts), fill_mode="solid")


def _gripper_parts(gripper: Gripper) -> list[DrawnSolid]:
    parts = [DrawnSolid("palm", "gripper", moved(gripper.place, _PALM[0]), _PALM[1])]
    for side in (-1.0, 1.0):
        offset = side * (gripper.opening + _FINGER[0]) / 2
        parts.append(DrawnSolid("finger", "gripper", moved(gripper.place, (offset, 0.0, _FINGER_AHEAD)), _FINGER))
    return parts


def _axes(frames: list[DrawnPlace]) -> rr.Arrows3D:
    """x, y, z of each frame in red, green and blue."""
    rotations = [Pose.unchecked(frame.translation, frame.rotation).rotation_matrix for frame in frames]
    return rr.Arrows3D(
        origins=np.repeat(np.array([frame.translation for frame in frames]).reshape(-1, 3), 3, axis=0),
        vectors=_AXIS * np.array([matrix.T for matrix in rotations]).reshape(-1, 3),
        colors=list(palette.AXES) * len(frames),
        radii=[0.0015] * (3 * len(frames)),
    )


PERSONS = f"{ENTITY}/persons"
_GAZE = 0.3  # m
_ROUNDED = 3  # digits of m, and of quaternions: heads are never still


class Shown(msgspec.Struct, frozen=True):
    """A person who is there."""

    name: str
    eyes: DrawnPlace
    body: tuple[DrawnSolid, ...]


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
    """List the persons that are perceived now and whose place is known, by name."""
    found = []
    for node in nodes_by_name(memory, PERSON):
        pose = memory.get_transform(WORLD, node.name, types=BELIEVED)
        if pose is None or not is_perceived(node, memory.clock.now()):
            continue
        eyes = _rounded(pose)
        shoulders = _rounded(Pose.from_matrix(upright(pose.matrix)))
        frames = ((eyes, HEAD, node.name), (shoulders, TRUNK, ""))
        body = (
            DrawnSolid(name, PERSON, moved(frame, part.position), part.size)
            for frame, shape, name in frames
            for part in shape
        )
        found.append(Shown(node.name, eyes, tuple(body)))
    return found


def _rounded(pose: Pose) -> DrawnPlace:
    x, y, z = (round(number, _ROUNDED) for number in pose.t)
    a, b, c, d = (round(number, _ROUNDED) for number in pose.q)
    return place_of(Pose((x, y, z), (a, b, c, d)))


MESHES = f"{ENTITY}/meshes"


class MeshView:
    """Logs the meshes of nodes as soon as they are here."""

    def __init__(self, recording: rr.RecordingStream, memory: Memory) -> None:
        self._recording = recording
        self._memory = memory
        self._names: set[str] = set()
        self._drawn: dict[str, tuple[tuple[str, ...], Color]] = {}
        self._places: dict[str, DrawnPlace] = {}

    def draw(self, changes: Iterable[Change]) -> set[str]:
        """Log what is not as it was before; returns the names of the nodes whose meshes are shown."""
        for name in {change.name for change in changes if change.element == "node"}:
            node = self._memory.get_node(name)
            if node is not None and "mesh" in node:
                self._names.add(name)
            else:
                self._names.discard(name)
        for name in sorted(self._drawn.keys() - self._names):
            self._clear(name)
        for name in sorted(self._names):
            self._draw(self._memory.get_node(name))
        return set(self._places)

    def _draw(self, node: Node | None) -> None:
        if node is None:
            return
        try:
            place = place_of(self._memory.transform(WORLD, node.name, types=BELIEVED))
            hashes = mesh_hashes(node)
        except (SchemaError, TransformError):
            self._clear(node.name)
            return
        look = (hashes, _color(node))
        if look != self._drawn.get(node.name):
            meshes = [mesh for hash in hashes if (mesh := self._memory.get_mesh(hash)) is not None]
            if len(meshes) < len(hashes):
                return
            self._clear(node.name)
            for number, mesh in enumerate(meshes):
                self._recording.log(f"{MESHES}/{node.name}/{number}", drawing(mesh, look[1]))
            self._drawn[node.name] = look
        if self._places.get(node.name) != place:
            self._places[node.name] = place
            self._recording.log(f"{MESHES}/{node.name}", transform(place))

    def _clear(self, name: str) -> None:
        if self._drawn.pop(name, None) is not None:
            self._recording.log(f"{MESHES}/{name}", rr.Clear(recursive=True))
        self._places.pop(name, None)


def drawing(mesh: Mesh, color: Color) -> rr.Mesh3D:
    """A mesh in one colour, shaded by the way its triangles face."""
    return rr.Mesh3D(vertex_positions=mesh.vertices, triangle_indices=mesh.triangles, albedo_factor=color)


def _color(node: Node) -> Color:
    color = node.get("color")
    if isinstance(color, tuple) and len(color) == 3:
        red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in color)
        return red, green, blue
    return palette.of_node(node.type)
