"""Beliefs of the memory as markers and as `vision_msgs`, in the world's frame."""

from __future__ import annotations

from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.bridge.throttle import Throttle
from agents.ros_bridge.mapping.detections import DETECTIONS, Believed, to_detections
from agents.ros_bridge.mapping.markers import GREY, MARKERS, Drawn, MarkerNumbers
from dsr.errors import SchemaError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.math3d.shapes import Shape, box, from_numbers
from dsr.vocabulary.relations import SURFACES, nodes_by_name, present_things

_THICKNESS = 0.02
"""m, of a table whose node tells none: its frame is at the top"""


class BeliefsOut:
    """Publishes what is believed to be where, while somebody listens."""

    def __init__(self, core: BridgeCore, config: Send) -> None:
        self._core = core
        self._throttle = Throttle(core.clock, config.beliefs_hz)
        self._numbers = MarkerNumbers()
        self._markers = core.outlet(config.markers, MARKERS) if config.markers else None
        self._beliefs = core.outlet(config.beliefs, DETECTIONS) if config.beliefs else None

    def update(self) -> None:
        """Publish if it is time."""
        if not self._throttle.take():
            return
        core, types = self._core, self._core.types
        stamp, frame = core.times.to_ros(core.times.now()), core.names.frame(WORLD)
        if self._beliefs is not None and self._beliefs.wanted:
            self._beliefs.send(lambda: to_detections(types, stamp, frame, self._believed()))
        if self._markers is not None and self._markers.wanted:
            self._markers.send(lambda: self._numbers.message(types, stamp, frame, self._drawn()))

    def _believed(self) -> list[Believed]:
        found = []
        for node in sorted(present_things(self._core.memory), key=lambda node: node.name):
            pose = self._core.memory.get_transform(WORLD, node.name, types=BELIEVED)
            if pose is not None and self._core.wants((node.name,)):
                size = node.get("size")
                found.append(Believed(node.name, node.type, pose, size, float(node.get("confidence", 1.0))))
        return found

    def _drawn(self) -> list[Drawn]:
        memory = self._core.memory
        nodes = [*nodes_by_name(memory, SURFACES), *sorted(present_things(memory), key=lambda node: node.name)]
        found = []
        for node in nodes:
            pose = memory.get_transform(WORLD, node.name, types=BELIEVED)
            shape = self._shape(node)
            if pose is not None and shape is not None and self._core.wants((node.name,)):
                found.append(Drawn(node.name, pose, shape, node.get("color", GREY)))
        return found

    def _shape(self, node: Node) -> Shape | None:
        try:
            if "shape" in node:
                return from_numbers(node["shape"])
        except SchemaError as error:
            self._core.tally.tell("not drawn", node.name, f"{node.name!r} is drawn as a box: {error}")
        size = node.get("size")
        if size is None or min(size) < 0.0:
            return None
        x, y, z = size
        if node.type in SURFACES:
            part = box((x, y, z or _THICKNESS))[0]
            return (part._replace(position=(0.0, 0.0, -0.5 * part.size[2])),)
        return box((x, y, z)) if min(size) > 0.0 else None
