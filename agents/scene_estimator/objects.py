"""Which node carries which tag; tags seen steadily that nobody knows become new cubes."""

from __future__ import annotations

import logging

from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.sighting import Sighting, Size
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.relations import THINGS
from dsr.vocabulary.tags import name_of


class TaggedObjects:
    """The working memory's objects by marker id."""

    def __init__(self, memory: Memory, config: SceneEstimatorConfig, log: logging.Logger) -> None:
        self._memory = memory
        self._config = config
        self._log = log
        self._watch = memory.watch(attribute="marker_id")
        self._names: dict[int, str] = {}
        self._candidates: dict[tuple[str, int], list[Pose]] = {}
        self._refused: set[str] = set()

    def update(self) -> None:
        """Take note of tags that were written to or removed from nodes."""
        if self._watch.poll():
            tagged = [node for node in self._memory.nodes() if isinstance(node.get("marker_id"), int)]
            self._names = {node["marker_id"]: node.name for node in sorted(tagged, key=lambda node: node.name)}

    def find(self, marker_id: int) -> Node | None:
        """The object that carries the tag, or None."""
        node = self._memory.get_node(self._names.get(marker_id, ""))
        return node if node is not None and node.type in THINGS else None

    def size(self, marker_id: int) -> Size:
        """Extent along x, y, z of the object that carries the tag, m; an unknown one is a cube of default size."""
        node = self.find(marker_id)
        size = None if node is None else node.get("size")
        if isinstance(size, tuple) and len(size) == 3 and min(size) > 0.0:
            return size
        return (self._config.default_size,) * 3

    def consider(self, camera: str, sightings: list[Sighting]) -> None:
        """Count how steadily a camera sees unknown tags; those seen often enough become nodes."""
        unknown = [sighting for sighting in sightings if sighting.marker_id not in self._names]
        seen = {(camera, sighting.marker_id): sighting.pose for sighting in unknown}
        for key in [key for key in self._candidates if key[0] == camera and key not in seen]:
            del self._candidates[key]
        for key, pose in seen.items():
            if self._is_steady(key, pose):
                self._insert(key[1])

    def _is_steady(self, key: tuple[str, int], pose: Pose) -> bool:
        before = self._candidates.get(key, [])
        steady = all(pose.distance(other)[0] <= self._config.insert_within for other in before)
        poses = [*before, pose] if steady else [pose]
        self._candidates[key] = poses[-self._config.insert_after - 1 :]
        return len(poses) > self._config.insert_after

    def _insert(self, marker_id: int) -> None:
        name = name_of(marker_id)
        if name in self._memory:
            if name not in self._refused:
                self._log.warning("tag %d is seen, but %s is known to carry another one or none", marker_id, name)
                self._refused.add(name)
            return
        self._log.info("tag %d is new: inserting %s", marker_id, name)
        edge = self._config.default_size
        self._memory.add_node(name, "cube", marker_id=marker_id, size=(edge, edge, edge), perceived=True)
        self._names[marker_id] = name

    def close(self) -> None:
        """Stop watching."""
        self._watch.close()
