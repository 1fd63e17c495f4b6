"""From the graph to the belief: the objects that there are, and their percepts since the last look."""

from __future__ import annotations

import contextlib
import logging
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from dsr.errors import DsrError, SchemaError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import MOST_PARTS, Shape, bounds, from_numbers
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.percepts import Percept, PerceptReader
from dsr.perception.reach import FARTHEST, near
from dsr.perception.scales import RESOLUTION
from dsr.vocabulary.bodies import MOST_BODIES, bodies_beyond, bodies_by_name
from dsr.vocabulary.calibration import CONFIRMED, IN_DOUBT
from dsr.vocabulary.intentions import RUNNING
from dsr.vocabulary.perceived import is_perceived
from dsr.vocabulary.relations import SURFACES, THINGS
from simulation_handler.graph_io.hand_nodes import hand_nodes
from simulation_handler.graph_io.recalling import Recalling
from simulation_handler.hands.state import HandPercept
from simulation_handler.motion.holding import GripperGrasp
from simulation_handler.perception.percepts import SeenObject
from simulation_handler.reasoner import Reasoner
from simulation_handler.scales import GAP
from simulation_handler.shapes.meshes import Forms

MODELLED = "object"
"""Node type of static bodies in the form of their mesh."""
FIXTURES = (*SURFACES, MODELLED)
"""Node types of static bodies."""
OBJECTS = THINGS
"""Node types of the objects that the belief follows."""
MASSES = (1e-6, 1e6)
"""kg that an object may have: beyond, physics divides by what is as good as zero"""

Properties = tuple[Vector3, float | None, float | None, float | None, Shape, bool]
"""Size (m), mass (kg), friction, rolling friction (m) and shape of an object, None where its node does not say; and
whether it has a tag."""


class GraphReader:
    """Keeps a belief in step with the graph's nodes and percepts. Unusable ones are counted, and logged once."""

    def __init__(self, memory: Memory, belief: Reasoner, log: logging.Logger, forms: Forms | None = None) -> None:
        self._memory = memory
        self._belief = belief
        self._log = log
        self._forms = forms or Forms(memory)
        self._known: dict[str, Properties] = {}
        self._fixed: set[str] = set()
        self._percepts = PerceptReader(memory)
        self._recalling: Recalling | None = None
        self._recalled: dict[str, float] = {}  # object -> s, until when an earlier run has taken in its percepts
        self.skipped: Counter[str] = Counter()
        """How often something of a node could not be used, by its name."""
        self.problems: dict[str, str] = {}
        """Why, in the last update."""

    def update(self, now: float) -> None:
        """Take in the content of the graph at time `now` (s)."""
        self.problems.clear()
        if self._recalling is None:
            self._recalling = Recalling(self._memory, self._belief, now)
            self._recalling.recall_explanations(now)
        fixtures, present = self._bodies("static bodies", FIXTURES), self._bodies("things", OBJECTS)
        for name in sorted((self._known.keys() - present.keys()) | (self._fixed - fixtures.keys())):
            self._forget(name)
        for name, node in fixtures.items():
            with self._skipping(name):
                self._note_fixture(node)
        for name, node in present.items():
            with self._skipping(name):
                self._note_object(node, now)
        self._note_percepts(self._percepts.new(now, self._known))
        self._belief.flag({name for name in self._known if present[name].get("surprising") is True})
        mounts = {node.name: node.get("mount") for node in self._memory.nodes("camera")}
        in_doubt, standing = ({n for n, mount in mounts.items() if mount == word} for word in (IN_DOUBT, CONFIRMED))
        self._belief.doubt_cameras(in_doubt, standing=standing)
        self._belief.plan(self._planned())
        self._belief.hold(self._grasps())
        self._belief.touch(self._hands(now))

    def _bodies(self, what: str, types: tuple[str, ...]) -> dict[str, Node]:
        """The nodes of these types that are simulated; if some are not, that is told."""
        if beyond := bodies_beyond(self._memory, types):
            self._skip(what, f"{beyond} {what} are passed over: {MOST_BODIES} others are simulated")
        return {node.name: node for node in bodies_by_name(self._memory, types)}

    def _planned(self) -> set[tuple[str, str]]:
        """(object, support) of what an arm is putting down now."""
        actions = (node for node in self._memory.nodes("action") if node.get("skill") == "place")
        return {
            (node.get("target", ""), node.get("destination", "")) for node in actions if node.get("status") == RUNNING
        }

    def _grasps(self) -> dict[str, GripperGrasp]:
        """The objects that are held, and how."""
        grasps = {}
        for edge in self._memory.edges("grasping"):
            gripper = self._memory.get_node(edge.src)
            if edge.dst in self._known and gripper is not None and gripper.type == "gripper":
                with self._skipping(edge.src):
                    world_from_gripper = near(gripper, self._memory.transform(WORLD, edge.src))
                    held_at = edge.get("held_at")
                    held_at = None if held_at is None else near(gripper, held_at)
                    grasps[edge.dst] = GripperGrasp(edge.src, world_from_gripper, held_at)
        return grasps

    def _hands(self, now: float) -> dict[str, HandPercept]:
        """The human hands whose place is known."""
        hands: dict[str, HandPercept] = {}
        for node, fingers in hand_nodes(self._memory, now):
            with self._skipping(node.name):
                pose = self._placed(node)
                tips = {finger.name: tip for finger in fingers if (tip := self._placed(finger)) is not None}
                if pose is not None:
                    hands[node.name] = HandPercept(pose, tips, is_perceived(node, now))
        return hands

    def _placed(self, node: Node) -> Pose | None:
        """Where a part of a hand was when it was last seen, with stamp; None if that is not known."""
        edge = self._memory.get_edge(WORLD, node.name, "RT")
        pose = None if edge is None else edge.get("pose")
        if pose is None or (node.type == "finger" and node.get("perceived") is False):
            return None
        return near(node, pose)

    def _note_fixture(self, node: Node) -> None:
        """Put a table where its node says: the frame is at the centre of its top; what has a mesh once that is here."""
        if node.type == MODELLED:
            self._note_modelled(node)
            return
        size = _size(node)
        top = self._memory.transform(WORLD, node.name)
        self._belief.set_fixture(
            node.name, size, top @ Pose((0.0, 0.0, -0.5 * size[2])), friction=_number(node, "friction")
        )
        self._fixed.add(node.name)

    def _note_modelled(self, node: Node) -> None:
        form = self._forms.of(node)
        if form is None:
            return
        if not form.is_true:
            raise SchemaError(f"{node}: its mesh is too hollow for {MOST_PARTS} convex parts; give it as several nodes")
        pose = self._memory.transform(WORLD, node.name) @ Pose(form.centre)
        self._belief.set_fixture(node.name, form.size, pose, form.shape, _number(node, "friction"))
        self._fixed.add(node.name)

    def _note_object(self, node: Node, now: float) -> None:
        """Let an object take part in the belief, or change what it is like."""
        name, properties = node.name, _properties(node, self._forms)
        known = self._known.get(name)
        if properties == known:
            return
        pose = self._belief.pose(name) if known else None
        if known:
            self._belief.remove(name)
        size, mass, friction, rolling_friction, shape, tagged = properties
        self._belief.add_object(
            name, size,
            mass=mass, friction=friction, rolling_friction=rolling_friction, shape=shape, tagged=tagged,
        )  # fmt: skip
        self._known[name] = properties
        if pose is not None:
            self._belief.recall(name, pose)
        elif not known and self._recalling is not None:
            self._recalled[name] = self._recalling.recall(node, now)

    def _note_percepts(self, percepts: Iterable[Percept]) -> None:
        """Take in percepts. Of those that an earlier run has taken in, only the objects and their cameras are known."""
        sights = []
        for percept in percepts:
            camera, name, stamp, _, _ = percept
            with self._skipping(name):
                pose = percept.pose
                if stamp <= self._recalled.get(name, -math.inf):
                    self._belief.recall_seen(name, pose, stamp, camera)
                else:
                    sights.append(SeenObject(name, pose, stamp, percept.eye, camera))
        for name, why in (*self._belief.observe(sights).items(), *self._percepts.problems.items()):
            self._skip(name, why)

    def _forget(self, name: str) -> None:
        self._belief.remove(name)
        self._known.pop(name, None)
        self._recalled.pop(name, None)
        self._fixed.discard(name)

    @contextlib.contextmanager
    def _skipping(self, name: str) -> Iterator[None]:
        """Skip what cannot be used of the node `name`."""
        try:
            yield
        except (DsrError, ValueError, np.linalg.LinAlgError) as error:
            self._skip(name, str(error))

    def _skip(self, name: str, why: str) -> None:
        self.problems[name] = why
        self.skipped[name] += 1
        if self.skipped[name] == 1:
            self._log.warning("%s cannot be used (logged once): %s", name, why)


def _properties(node: Node, forms: Forms) -> Properties:
    mass, friction = _number(node, "mass"), _number(node, "friction")
    if mass is not None and not MASSES[0] <= mass <= MASSES[1]:
        raise SchemaError(f"{node}: mass {mass} kg; expected from {MASSES[0]:g} to {MASSES[1]:g}")
    size = _size(node)
    rolling_friction, shape = _number(node, "rolling_friction"), _shape(node, size, forms)
    return size, mass, friction, rolling_friction, shape, "marker_id" in node


def _size(node: Node) -> Vector3:
    size: Any = node.get("size")
    if not isinstance(size, tuple) or len(size) != 3 or not all(GAP <= edge <= 2.0 * FARTHEST for edge in size):
        raise SchemaError(f"{node}: size {size}; expected three lengths from {GAP:g} to {2.0 * FARTHEST:g} m")
    return size


def _shape(node: Node, size: Vector3, forms: Forms) -> Shape:
    """Its pieces, within a box of that size; none if it is a box, or its mesh is not here yet."""
    numbers: Any = node.get("shape")
    if numbers is not None:
        shape = from_numbers(numbers)
    elif (form := forms.of(node)) is not None:
        shape = form.shape
    else:
        return ()
    if any(
        abs(edge + sign * 2.0 * end) > 2.0 * RESOLUTION
        for sign, ends in zip((1.0, -1.0), bounds(shape), strict=True)
        for edge, end in zip(size, ends, strict=True)
    ):
        raise SchemaError(f"{node}: shape from {bounds(shape)[0]} to {bounds(shape)[1]} m; its size is {size}")
    return shape


def _number(node: Node, attribute: str) -> float | None:
    """A value that cannot be negative; None if the node has none."""
    value: float | None = node.get(attribute)
    if value is not None and not 0.0 <= value < math.inf:
        raise SchemaError(f"{node}: {attribute} {value}; expected a number of at least 0")
    return value
