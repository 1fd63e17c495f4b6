"""Names, types and units of everything the graph may hold; users register their own."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args

import msgspec
import numpy as np

from dsr.errors import RegistrationError, SchemaError, suggest
from dsr.math3d.transforms import Pose

Kind = Literal["bool", "int", "float", "str", "bytes", "vector", "pose"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""The kinds of values that attributes have."""
Value = bool | int | float | str | bytes | tuple[float, ...] | Pose

_NAME = re.compile(r"[A-Za-z0-9_.\-]{1,128}")
_NAME_TEXT = "expected 1 to 128 letters, digits, '_', '.' or '-'"
_INT_LIMIT = 1 << 63
MAX_LENGTH = 1 << 20
"""Characters, bytes or numbers in one value; what is larger does not belong in a graph (see `dsr.images.blobs`)."""
MAX_NUMBER = 1e12
"""Greatest float of a built-in attribute, in a vector or a pose, too: in m, seven times as far as the sun is. Products
of many such numbers are finite, so nobody need expect that physics overflows."""
TOLD = frozenset({"status", "explanation", "text", "outcome", "surprise"})
"""Attributes that tell people something. Who writes them puts together what others have written, however long that is.
So they are cut to what one value holds; else whoever made one text long kept others from telling anything."""
_CUT = "..."
MAX_TEXT = 1000
"""Characters of a meaning or a unit: some sentences. Every process of a graph keeps them all."""
POSE_FIELDS = ("translation", "rotation", "stamp", "covariance")
_POSE_FIELDS = frozenset(POSE_FIELDS)

WORLD_RECORD = "world_record"
"""Type of the nodes that list the worlds of a system (dsr/worlds/registry.py)."""
SCHEMA_RECORD = "schema_record"
"""Type of the nodes that describe registered names (dsr/graph/extensions.py)."""
PART_RECORD = "part_record"
"""Type of the nodes that list the parts of a graph (dsr/parts/registry.py)."""
RECORDS = {WORLD_RECORD: ".world.", SCHEMA_RECORD: ".schema.", PART_RECORD: ".part."}
"""Types of the nodes that are about the graph itself, and how the names of such nodes begin.

They are never shown among the things of the graph, and nobody else has such names.
"""
_RECORD_PREFIXES = tuple(RECORDS.values())


Registered = tuple[Literal["node", "edge", "attribute"], str]
"""What a name is registered for, and the name."""


class AttributeType(msgspec.Struct, frozen=True):
    """The meaning of an attribute, and the values that it takes."""

    kind: Kind
    """One of `KINDS`: bool, int, float, str, bytes, vector (of floats), pose."""
    unit: str = ""
    """SI unit of a number or of each component of a vector."""
    meaning: str = ""
    length: int | None = None
    """Number of components of a vector; None for any."""
    stream: bool = False
    """Written many times a second: samples may be dropped on the way, the last one never is."""

    def agrees_with(self, other: AttributeType) -> bool:
        """Whether a value means the same by both; `meaning` is only a text for people."""
        return (self.kind, self.unit, self.length) == (other.kind, other.unit, other.length)

    @property
    def described(self) -> str:
        """Kind, length and unit in words: `float in m`."""
        length = "" if self.length is None else f" of {self.length}"
        return f"{self.kind}{length}{f' in {self.unit}' if self.unit else ''}"


class Schema:
    """The vocabulary of a graph: node types, edge types and attributes."""

    def __init__(self) -> None:
        self.node_types: dict[str, str] = dict(_NODE_TYPES)
        self.edge_types: dict[str, str] = dict(_EDGE_TYPES)
        self.geometric: set[str] = {"RT", "Virtual_RT"}
        self.attributes: dict[str, AttributeType] = dict(_ATTRIBUTES)
        self.registered: list[Registered] = []
        """Each name that got a meaning which it did not have, in order."""

    def register_node_type(self, name: str, meaning: str) -> None:
        """Allow nodes of type `name`.

        Raises `RegistrationError` if name or meaning cannot be such, or if a built-in type means something else.
        """
        _checked_name("node type", name)
        agreed = _agreed("node type", name, meaning, _NODE_TYPES)
        if self.node_types.get(name) != agreed:
            self.node_types[name] = agreed
            self.registered.append(("node", name))

    def register_edge_type(self, name: str, meaning: str, *, geometric: bool = False) -> None:
        """Allow edges of type `name`; a geometric edge carries a `pose` and takes part in frame chains.

        Raises `RegistrationError` if the name or the meaning cannot be such, if the type is known and differs in that,
        or if a built-in type means something else.
        """
        _checked_name("edge type", name)
        if name in self.edge_types and (name in self.geometric) != geometric:
            raise RegistrationError(f"edge type {name!r} is already one that is {'not ' if geometric else ''}geometric")
        agreed = _agreed("edge type", name, meaning, _EDGE_TYPES)
        if self.edge_types.get(name) != agreed:
            self.edge_types[name] = agreed
            self.registered.append(("edge", name))
        if geometric:
            self.geometric.add(name)

    def register_attribute(self, name: str, attribute: AttributeType) -> None:
        """Allow attribute `name`.

        Raises `RegistrationError` if a field of it makes no sense, if the name is known with another kind, unit or
        length, or if a built-in attribute means something else.
        """
        _checked_name("attribute", name)
        _check_attribute(name, attribute)
        known = self.attributes.get(name)
        if known is not None and not known.agrees_with(attribute):
            raise RegistrationError(f"attribute {name!r} is already a {known.described}, not a {attribute.described}")
        if known is not None and known == _ATTRIBUTES.get(name):
            meaning = _agreed("attribute", name, attribute.meaning, {name: known.meaning})
            if attribute.stream != known.stream:
                said = "a stream: it cannot be none" if known.stream else "no stream: it cannot be one"
                raise RegistrationError(f"attribute {name!r} ({meaning}) is built in as {said}")
            attribute = known
        if known != attribute:
            self.attributes[name] = attribute
            self.registered.append(("attribute", name))

    def check_node(self, name: str, type: str) -> None:
        """Raise `SchemaError` unless a user may make a node `name` of `type`."""
        if not is_name(name):
            raise SchemaError(f"node name {name!r}: {_NAME_TEXT}")
        if type in RECORDS or name.startswith(_RECORD_PREFIXES):
            raise SchemaError(records_are_own(f"node {name!r} of type {type!r}"))
        if type not in self.node_types:
            raise SchemaError(f"node {name!r}: unknown node type {type!r}; {suggest(type, self.node_types)}")

    def check_edge_type(self, type: str) -> None:
        """Raise `SchemaError` for an unknown edge type."""
        if type not in self.edge_types:
            raise SchemaError(f"unknown edge type {type!r}; {suggest(type, self.edge_types)}")

    def attribute(self, name: str) -> AttributeType:
        """The type of attribute `name`. Raises `SchemaError` if there is none."""
        try:
            return self.attributes[name]
        except KeyError:
            raise SchemaError(f"unknown attribute {name!r}; {suggest(name, self.attributes)}") from None

    def to_value(self, name: str, value: Any) -> Value:
        """`value` in the form in which attribute `name` is stored. Raises `SchemaError` if it does not fit."""
        return self.to_values({name: value})[name]

    def to_values(self, attributes: Mapping[str, Any]) -> dict[str, Value]:
        """The same for several attributes at once."""
        values: dict[str, Value] = {}
        for name, value in attributes.items():
            attribute = self.attributes.get(name) or self.attribute(name)
            if name in TOLD and isinstance(value, str) and len(value) > MAX_LENGTH:
                value = value[: MAX_LENGTH - len(_CUT)] + _CUT  # noqa: PLW2901
            stored = _CONVERTERS[attribute.kind](value)
            if stored is None or (attribute.length is not None and len(stored) != attribute.length):
                raise SchemaError(f"attribute {name!r}: expected a finite {attribute.described}, got {value!r:.200}")
            if name in _BOUNDED and attribute.kind == _ATTRIBUTES[name].kind and not is_within_bounds(stored):
                raise SchemaError(f"attribute {name!r}: expected numbers up to {MAX_NUMBER:g}, got {value!r:.200}")
            values[name] = stored
        return values


def with_pose(attributes: dict[str, Any]) -> dict[str, Any]:
    """`attributes` with the parts of a pose, if they were given one by one, joined. Raises `SchemaError`."""
    if _POSE_FIELDS.isdisjoint(attributes):
        return attributes
    parts = {name: attributes[name] for name in POSE_FIELDS if name in attributes}
    others = {name: value for name, value in attributes.items() if name not in parts}
    if "pose" in others or "translation" not in parts:
        raise SchemaError(f"give either pose, or translation with rotation, not {', '.join(sorted(attributes))}")
    try:
        return {**others, "pose": Pose(**parts)}
    except ValueError as error:
        raise SchemaError(str(error)) from error


def checked_names(given: str | Iterable[str] | None, valid: Iterable[str], what: str) -> frozenset[str] | None:
    """The names asked for. Raises `SchemaError` for one that is not valid; a remote schema may know more names."""
    if given is None:
        return None
    names = frozenset([given] if isinstance(given, str) else given)
    for name in names:
        if name not in valid:
            raise SchemaError(f"unknown {what} {name!r}; {suggest(name, valid)}")
    return names


def _checked_name(what: str, name: str) -> str:
    if not is_name(name):
        raise RegistrationError(f"{what} name {name!r}: {_NAME_TEXT}")
    return name


def is_name(name: object) -> bool:
    """Whether a node, a type or an attribute can be called so."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


def is_own_name(name: str, type: str) -> bool:
    """Whether name and type of a node fit: entries about the graph itself have both, all other nodes neither.

    Else a node of any type that gets the name of an entry would hide that entry.
    """
    prefix = RECORDS.get(type)
    return not name.startswith(_RECORD_PREFIXES) if prefix is None else name.startswith(prefix)


def records_are_own(what: str) -> str:
    """The message for somebody who writes a node about the graph itself, told in `what`."""
    return (
        f"{what}: names that begin with {' or '.join(_RECORD_PREFIXES)} and types {' and '.join(RECORDS)} are the "
        "graph's own; they change with memory.schema.register_..., create_world, delete_world and create_part"
    )


def _agreed(what: str, name: str, meaning: str, builtin: Mapping[str, str]) -> str:
    """The meaning of a name that is registered: of a built-in one, its own. Raises `RegistrationError` for another."""
    _checked_text(f"meaning of {what} {name!r}", meaning)
    known = builtin.get(name)
    if known is None or meaning in ("", known):
        return known or meaning
    raise RegistrationError(
        f"{what} {name!r} is built in and means {known!r}: it cannot mean {meaning!r:.200}, too; register another name"
    )


def _checked_text(what: str, text: str) -> str:
    if not isinstance(text, str) or len(text) > MAX_TEXT:
        raise RegistrationError(f"{what}: expected a text of at most {MAX_TEXT} characters, got {text!r:.40}")
    return text


def _check_attribute(name: str, attribute: AttributeType) -> None:
    """Raise `RegistrationError` for fields of types that are not declared, which a struct takes, and senseless ones."""
    if attribute.kind not in KINDS:
        hint = suggest(str(attribute.kind), KINDS)
        raise RegistrationError(f"attribute {name!r}: unknown kind {attribute.kind!r}; {hint}")
    for field in ("unit", "meaning"):
        _checked_text(f"{field} of attribute {name!r}", getattr(attribute, field))
    length = attribute.length
    if length is not None and (attribute.kind != "vector" or type(length) is not int or not 0 < length <= MAX_LENGTH):
        raise RegistrationError(f"attribute {name!r}: length {length!r}: expected 1 to {MAX_LENGTH}, for a vector only")
    if type(attribute.stream) is not bool:
        raise RegistrationError(f"attribute {name!r}: stream {attribute.stream!r}: expected True or False")


def _bool(value: Any) -> bool | None:
    return value if value is True or value is False else bool(value) if isinstance(value, np.bool_) else None


def _int(value: Any) -> int | None:
    if type(value) is not int and (isinstance(value, bool) or not isinstance(value, int | np.integer)):
        return None
    return int(value) if -_INT_LIMIT <= value < _INT_LIMIT else None


def _float(value: Any) -> float | None:
    if type(value) is float:
        return value if math.isfinite(value) else None
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    with contextlib.suppress(OverflowError):
        number = float(value)
        return number if math.isfinite(number) else None
    return None


def _str(value: Any) -> str | None:
    """Half of a surrogate pair is no text: it could not be sent."""
    if not isinstance(value, str) or len(value) > MAX_LENGTH:
        return None
    return str(value) if value.isascii() or is_text(value) else None


def is_text(value: str) -> bool:
    """Whether `value` can be written as UTF-8: no half of a surrogate pair."""
    return not any("\ud800" <= character <= "\udfff" for character in value)


def _bytes(value: Any) -> bytes | None:
    return bytes(value) if isinstance(value, bytes | bytearray) and len(value) <= MAX_LENGTH else None


def _vector(value: Any) -> tuple[float, ...] | None:
    if isinstance(value, np.ndarray):
        value = value.tolist() if value.ndim == 1 else None
    if not isinstance(value, list | tuple) or len(value) > MAX_LENGTH:
        return None
    numbers = tuple(map(_float, value))
    return None if None in numbers else numbers  # type: ignore[return-value]


def _pose(value: Any) -> Pose | None:
    """A product of poses is not checked, and may have overflowed; peers refuse such numbers."""
    if not isinstance(value, Pose) or not math.isfinite(sum(value.t)):
        return None
    return value if value.cov is None or math.isfinite(sum(value.cov)) else None


_CONVERTERS: dict[str, Any] = {
    "bool": _bool, "int": _int, "float": _float, "str": _str, "bytes": _bytes, "vector": _vector, "pose": _pose,
}  # fmt: skip

_NODE_TYPES = {
    "world": "root of all frames",
    WORLD_RECORD: "an entry of the list of worlds, see dsr.worlds",
    SCHEMA_RECORD: "a registered name, see dsr.graph.extensions",
    PART_RECORD: "an entry of the list of parts, see dsr.parts",
    "robot": "the robot's base",
    "body": "a part of the robot's body",
    "mind": "where intentions hang",
    "arm": "base of an arm",
    "gripper": "the arm's end effector",
    "camera": "a camera; its frame is the optical one (z forward, x right, y down)",
    "table": "a table; its frame is at the centre of the top surface",
    "cube": "a cube; its frame is at the centre",
    "box": "a closed box",
    "container": "a box open at the top",
    "cup": "a cup",
    "ball": "a ball",
    "object": "what does not move by itself, in the form of its mesh",
    "group": "a frame under which the parts of something are",
    "person": "a human; the frame is between the eyes: x along the gaze, y left, z up",
    "hand": "a human hand",
    "finger": "a fingertip",
    "intention": "a goal that the robot pursues",
    "action": "a step of a plan",
    "agent": "a process that takes part",
    "timeline": "where events and situations hang, see dsr.timeline",
    "event": "something that happened at an instant",
    "situation": "something that holds, or held, for a time",
    "summary": "what is remembered of an hour, a day or a week, see dsr.timeline",
    "query": "a request for edges of spatial relations, see dsr.spatial",
    "calibration": "a request to calibrate a camera, see dsr.vocabulary.calibration",
    "zone": "a box that no arm may enter; its frame is at the centre",
    "halt": "the newest order of an emergency stop, see dsr.vocabulary.halting",
}

_EDGE_TYPES = {
    "RT": "pose of the destination in the source, perceived or measured",
    "Virtual_RT": "pose of the destination in the source, believed by the simulation",
    "has": "structure",
    "next": "plan order",
    "on": "the source rests on the destination",
    "in": "the source is inside the destination",
    "grasping": "the source holds the destination",
    "let_go": "the source held the destination last, until `since`; `handling` tells how that ended",
    "sees": "how much of the destination there is to be seen from the source, by what is believed",
    "above": "over the destination, touching or not (this and what follows: see dsr.spatial)",
    "below": "the destination is above the source",
    "on_top": "at the top of the destination, by the boxes around them; `on` is by contact",
    "inside": "the source is in the destination, by the boxes around them; `in` is by contact",
    "next_to": "beside the destination, with no room between them",
    "close_to": "within twice the size of the destination",
    "in_front_of": "nearer to the viewer than the destination",
    "behind": "farther from the viewer than the destination",
    "left_of": "on the left of the destination, as the viewer sees it",
    "right_of": "on the right of the destination, as the viewer sees it",
}


def _attributes(kind: Kind, unit: str, meanings: dict[str, str], **options: Any) -> Iterable[tuple[str, AttributeType]]:
    return [(name, AttributeType(kind, unit, meaning, **options)) for name, meaning in meanings.items()]


_ATTRIBUTES: dict[str, AttributeType] = dict([
    *_attributes("pose", "m, rad", {"pose": "the geometry of an RT or Virtual_RT edge"}, stream=True),
    *_attributes("pose", "m, rad", {"target_pose": "where the tool point shall go, in the world frame",
                                    "held_at": "gripper_from_object of what a gripper holds, or hand_from_object",
                                    "seen_at": "world_from_object where somebody last saw it"}),
    *_attributes("vector", "m", {"size": "extent along x, y, z",
                                 "size_sigma": "standard deviation of each of them"}, length=3),
    *_attributes("vector", "m", {"bounds": "box around a part, in its frame: least, then greatest x, y, z"}, length=6),
    *_attributes("vector", "", {"color": "red, green, blue from 0 to 1"}, length=3),
    *_attributes("vector", "m", {"way": "boxes of an arm's parts on its way: pose and edges of each, row by row"}),
    *_attributes("vector", "s", {"way_times": "when an arm passes through the rows of its `way`"}),
    *_attributes("float", "s", {"way_since": "when an arm first wanted to go where it goes or waits to go"}),
    *_attributes("str", "", {"waits_for": "arm that is in the way of this one"}),
    *_attributes("vector", "m", {"shape": "parts of a body that is no box: 11 numbers each, see dsr.math3d.shapes"}),
    *_attributes("vector", "rad", {"fov": "field of view of a camera or a person: horizontal, vertical"}, length=2),
    *_attributes("vector", "", {"distortion": "coefficients of `distortion_model` in the order of OpenCV"}),
    *_attributes("str", "", {"distortion_model": "how a lens distorts, see dsr.vocabulary.intrinsics"}),
    *_attributes("vector", "rad", {"target_joints": "where the joints shall go"}),
    *_attributes("vector", "rad", {"joint_positions": "measured"}, stream=True),
    *_attributes("vector", "rad/s", {"joint_velocities": "measured"}, stream=True),
    *_attributes("float", "kg", {"mass": "mass"}),
    *_attributes("float", "", {"friction": "Coulomb coefficient", "target_speed": "0 to 1 of the limits"}),
    *_attributes("float", "m", {"rolling_friction": "lever arm of the resistance to rolling"}),
    *_attributes("float", "m", {"target_opening": "wanted distance between the finger pads"}),
    *_attributes("float", "m", {"opening": "distance between the finger pads"}, stream=True),
    *_attributes("float", "s", {"since": "when it began", "time": "when it happened", "begin": "when a situation began",
                                "end": "when a situation ended; absent while it lasts"}),
    *_attributes("float", "", {"confidence": "that it is so, 0 to 1",
                               "probability": "that it is so by the weighted worlds of the belief, 0 to 1",
                               "weight": "of a world `belief_...`, its probability, 0 to 1"}),
    *_attributes("float", "nats", {"nats": "how improbable what was seen lately is under the whole belief"}),
    *_attributes("str", "", {"kind": "of an event", "participants": "comma-separated nodes that an event is about"}),
    *_attributes("float", "", {"share": "of the image that it would have alone, how much is seen from there, 0 to 1",
                               "detectable": "share of what a camera recognises it by (tag or colour), 0 to 1",
                               "score": "how badly an explanation fits: minus its log-likelihood, up to a constant"}),
    *_attributes("float", "", {"confidence": "how sure it is that it is so, 0 to 1"}),
    *_attributes("float", "s", {"last_seen": "when a camera, or whoever has this view, last saw it"}, stream=True),
    *_attributes("float", "px", {"fx": "focal length", "fy": "focal length", "cx": "principal point",
                                 "cy": "principal point"}),
    *_attributes("int", "px", {"width": "of the image", "height": "of the image"}),
    *_attributes("int", "", {"marker_id": "AprilTag 36h11 id", "seen": "how many", "pid": "process id",
                             "priority": "greater is more urgent", "order": "position in a plan",
                             "replans": "how often a new plan was made",
                             "views": "from how many poses of its parent a camera is to look"}),
    *_attributes("bool", "", {"perceived": "a camera sees it now", "plausible": "the percept obeys physics",
                              "surprising": "percept and belief disagree", "contact": "both pads touch something",
                              "visible": "enough of it (`share`) is there to be seen",
                              "present": "believed to be in the scene",
                              "maintain": "the goal is watched after it was reached",
                              "hopeless": "the action will fail again while what is believed stays as it is",
                              "forced": "it shall be done whatever speaks against it",
                              "moves_arm": "an arm shall be moved for it",
                              "halted": "motion is forbidden until somebody releases it",
                              "undo": "the pose from before the last calibration shall be taken back"}),
    *_attributes("str", "", {"status": "what it is doing", "explanation": "why", "stream": "name of a blob stream",
                             "source": "what says so", "model": "which product", "joint_names": "comma-separated",
                             "goal": "what is wanted", "target": "what the action is about",
                             "destination": "where an action puts its target",
                             "arm": "which arm is to carry out an action; the first one if it is not told",
                             "controller": "agent that moves an arm", "gripper": "node of an arm's gripper",
                             "skill": "of the arm: pick, place, move, look, observe or stop",
                             "request": "what the planner asks of an action: run or halt",
                             "surprise": "why it is surprising",
                             "handling": "what a hand has to do with it, see dsr.vocabulary.handling",
                             "side": "of the body: left, right or unknown",
                             "hidden_by": "what hides most of it from there",
                             "covered_by": "what hides most of what a camera recognises it by",
                             "policy": "which method explained it",
                             "alternatives": "explanations that were rejected, with their scores",
                             "changes": "what happened by an explanation, JSON, see dsr.vocabulary.explained",
                             "deeds": "what was done with it last, JSON, see dsr.vocabulary.observed_actions",
                             "whereabouts": "where a thing may be, JSON, see dsr.believing",
                             "kind": "of an event or a situation", "participants": "names, comma-separated",
                             "text": "in a line, for people", "outcome": "how it ended",
                             "relations": "wanted edge types, comma-separated", "things": "names, comma-separated",
                             "others": "names, comma-separated", "viewpoint": "the frame from which it is so",
                             "method": "by which a camera is calibrated",
                             "mount": "of a camera, whether it is where it was: see dsr.vocabulary.calibration",
                             "report": "what came of a calibration, JSON, see dsr.vocabulary.calibration",
                             "mesh": "hashes of its meshes, comma-separated, see dsr.geometry",
                             "via": "worlds through which it came, comma-separated, see dsr.worlds",
                             "record": "what is known of a world or a name, JSON, see dsr.worlds",
                             "content": "what a summary holds, compressed JSON, see dsr.timeline",
                             "halt_id": "tells an order of an emergency stop from all others",
                             "note": "free text"}),
])  # fmt: skip

BUILT_IN: Mapping[str, AttributeType] = _ATTRIBUTES
"""The attributes that every process knows."""
_BOUNDED = {name for name, attribute in BUILT_IN.items() if attribute.kind in ("float", "vector", "pose")}


def is_within_bounds(value: Any) -> bool:
    """Whether the numbers of a float, a vector or a pose are no greater than `MAX_NUMBER`."""
    if isinstance(value, Pose):
        x, y, z = value.t
        near = min(x, y, z, value.stamp) >= -MAX_NUMBER and max(x, y, z, value.stamp) <= MAX_NUMBER
        return near and (value.cov is None or is_within_bounds(tuple(value.cov)))
    if isinstance(value, tuple):
        return not value or (min(value) >= -MAX_NUMBER and max(value) <= MAX_NUMBER)
    return bool(-MAX_NUMBER <= value <= MAX_NUMBER)
