"""Objects without tags, found by depth: those seen steadily become nodes, and keep their names wherever they go."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.blocks.block import Block, BlockKind
from agents.scene_estimator.blocks.clusters import Cluster
from agents.scene_estimator.blocks.explained import KnownVolume, known_volumes, supports, unexplained
from agents.scene_estimator.blocks.finder import BlockFinder, BlockSighting
from agents.scene_estimator.blocks.levelling import LevelledView, levelled
from agents.scene_estimator.blocks.touching import has_share, parted
from agents.scene_estimator.blocks.tracks import BlockTrack, assigned
from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.fitting import FrameView
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.shapes import to_numbers
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.perceived import BY_DEPTH
from dsr.vocabulary.relations import THINGS

AS_BEFORE = 0.003
"""m, by which extents must have changed for the node to be told: whoever simulates the object makes it anew"""
_PREFIXES = {"box": "box", "cube": "plain_cube", "cylinder": "cylinder"}
"""Of the names of nodes, by kind of block; `cube_7` is the cube with tag 7"""
_NEAR = 0.02  # m around where a block was in which it is looked for first


@dataclass
class _Candidate:
    """A block that nobody knows yet."""

    track: BlockTrack
    frames: int = 1
    """In a row in which it was seen."""


class SeenBlocks(NamedTuple):
    """The blocks of one exposure."""

    levelled: LevelledView
    """By which camera they are seen, as its image tells its tilt"""
    sightings: list[BlockSighting]
    """In the world frame, if the camera is tilted like that"""


class UntaggedObjects:
    """The working memory's objects that were found by depth.

    Args:
        memory: read and written.
        config: of the scene estimator.
        log: is told of new objects.
    """

    def __init__(self, memory: Memory, config: SceneEstimatorConfig, log: logging.Logger) -> None:
        self._memory, self._config, self._log = memory, config, log
        self._finder = BlockFinder(config.noise)
        self._watch = memory.watch(attribute="source")
        self._tracks: dict[str, BlockTrack] = {}
        self._candidates: dict[str, list[_Candidate]] = {}
        self._written: dict[str, tuple[float, ...]] = {}

    def update(self) -> None:
        """Take note of nodes that were removed, and of those that an earlier run has left."""
        if self._watch.poll():
            nodes = {node.name: node for node in self._memory.nodes(THINGS) if node.get("source") == BY_DEPTH}
            self._tracks = {name: track for name, track in self._tracks.items() if name in nodes}
            for name, node in nodes.items():
                if name not in self._tracks and (track := self._recalled(node)) is not None:
                    self._tracks[name] = track

    def read(
        self, view: FrameView, color: NDArray[np.uint8], stamp: float, now: float, seen: list[KnownVolume]
    ) -> SeenBlocks:
        """The blocks of an exposure that nothing else explains.

        Args:
            view: depth and camera.
            color: (h, w, 3) RGB image, 0 to 255.
            stamp: s, of the exposure.
            now: s
            seen: where things are that the same exposure shows by their tags, in the frame of the camera.
        """
        tables = supports(self._memory, stamp)
        level = levelled(view, tables)
        view = level.view
        clusters = self._finder.clusters(view, color, tables)
        tagged = [one._replace(frame_from_box=view.world_from_camera @ one.frame_from_box) for one in seen]
        explaining = [*tagged, *known_volumes(self._memory, now, stamp)] if clusters else []
        found: list[BlockSighting] = []
        for cluster in unexplained(clusters, explaining):
            found += self._fit_touching(view, cluster) or self._fit(view, cluster)
        return SeenBlocks(level, found)

    def _fit_touching(self, view: FrameView, cluster: Cluster) -> list[BlockSighting]:
        """The known blocks of one colour that share a piece; none if it is not that of several."""
        several = [track for track in self._alike(cluster) if has_share(cluster, track.block)]
        parts = parted(view, cluster, [track.block for track in several]) if len(several) > 1 else None
        if parts is None:
            return []
        fits = [self._finder.fit_unchanged(view, part, track.known) for track, part in zip(several, parts, strict=True)]
        found = [sighting for sighting in fits if sighting is not None]
        return found if len(found) == len(several) else []

    def _alike(self, cluster: Cluster) -> list[BlockTrack]:
        """The known blocks that have its colour."""
        color = cluster.color.tolist()
        return [track for track in self._tracks.values() if track.unlike_color(color) <= 1.0]

    def _fit(self, view: FrameView, cluster: Cluster) -> list[BlockSighting]:
        """The block of a piece, or the two; none if it is neither."""
        x, y = cluster.points[:, :2].mean(axis=0).tolist()
        candidates = (one.track for several in self._candidates.values() for one in several)
        near = [track for track in (*self._tracks.values(), *candidates) if _is_at(track.block, x, y)]
        for track in sorted(near, key=lambda track: math.dist((x, y), track.block.centre[:2])):
            sighting = self._finder.fit(view, cluster, track.known)
            if sighting is not None and not sighting.strained and assigned([track], [sighting])[0] is track:
                return [sighting]
        return self._finder.most_likely(view, cluster, [track.known for track in self._alike(cluster)])

    def consider(self, camera: str, seen: SeenBlocks, stamp: float) -> list[tuple[str, Pose]]:
        """Tell which objects were seen by a camera, and where: camera_from_object with covariance.

        What is seen steadily and nobody knows becomes a node.
        """
        sightings = seen.sightings
        tracks = assigned(list(self._tracks.values()), sightings)
        unknown = [one for one, track in zip(sightings, tracks, strict=True) if track is None]
        found = [(track, one) for one, track in zip(sightings, tracks, strict=True) if track is not None]
        for track, sighting in found:
            track.take(sighting)
            self._tell(track)
        self._consider_unknown(camera, unknown)
        return [(track.name, _pose(track, sighting, seen.levelled, stamp)) for track, sighting in found]

    def _consider_unknown(self, camera: str, sightings: list[BlockSighting]) -> None:
        """Count the frames in a row that show them, with all of their extents."""
        before = {id(one.track): one for one in self._candidates.get(camera, [])}
        whole = [sighting for sighting in sightings if sighting.size_sigma.max() <= self._config.blocks_sure]
        candidates = []
        for sighting, track in zip(whole, assigned([one.track for one in before.values()], whole), strict=True):
            last = None if track is None else before[id(track)]
            if last is None or _moved(last.track.block, sighting.block) > self._config.insert_within:
                last = _Candidate(BlockTrack("", sighting.block, sighting.size_sigma, sighting.color), 0)
            else:
                last.track.take(sighting)
            last.frames += 1
            if last.frames > self._config.blocks_after:
                self._insert(last.track)
            else:
                candidates.append(last)
        self._candidates[camera] = candidates

    def _insert(self, track: BlockTrack) -> None:
        block = track.block
        track.name = next(name for k in count(1) if (name := f"{_PREFIXES[block.kind]}_{k}") not in self._memory)
        self._log.info(
            "%s is new: %s of %s m", track.name, block.kind, " x ".join(f"{edge:.3f}" for edge in block.size)
        )
        shape = {"shape": to_numbers(block.shape)} if block.shape else {}
        type_ = "cube" if block.kind == "cube" else "box"
        self._memory.add_node(
            track.name, type_, size=block.size, size_sigma=track.known.sigma, color=track.color, source=BY_DEPTH,
            perceived=True, **shape,
        )  # fmt: skip
        self._tracks[track.name] = track
        self._written[track.name] = block.size

    def _tell(self, track: BlockTrack) -> None:
        """Write extents that are known better now."""
        size, written = track.block.size, self._written.get(track.name, (math.inf,) * 3)
        if track.name in self._memory and max(abs(a - b) for a, b in zip(size, written, strict=True)) > AS_BEFORE:
            shape = {"shape": to_numbers(track.block.shape)} if track.block.shape else {}
            self._memory.update_node(track.name, size=size, size_sigma=track.known.sigma, **shape)
            self._written[track.name] = size

    def _recalled(self, node: Node) -> BlockTrack | None:
        """The track of an object that an earlier run has found; None if its node does not tell enough."""
        size, sigma, color = (node.get(name) for name in ("size", "size_sigma", "color"))
        pose = self._memory.get_transform(WORLD, node.name)
        if size is None or sigma is None or color is None or pose is None or min(*size, *sigma) <= 0.0:
            return None
        x, y, z = pose.t
        yaw = math.atan2(pose.rotation_matrix[1, 0], pose.rotation_matrix[0, 0])
        kind: BlockKind = "cylinder" if "shape" in node else "cube" if node.type == "cube" else "box"
        block = Block(kind, x, y, yaw, size, z - 0.5 * size[2])
        self._written[node.name] = size
        return BlockTrack(node.name, block, np.array(sigma), color)

    def close(self) -> None:
        """Stop watching."""
        self._watch.close()


def _is_at(block: Block, x: float, y: float) -> bool:
    return math.dist((x, y), block.centre[:2]) < 0.5 * math.hypot(*block.size[:2]) + _NEAR


def _moved(before: Block, now: Block) -> float:
    return math.dist(before.centre, now.centre)


def _pose(track: BlockTrack, sighting: BlockSighting, seen: LevelledView, stamp: float) -> Pose:
    """camera_from_object, with its axes named as they were at first: it is as upright as the support that is seen."""
    block = track.block
    world_from_object = Pose.from_rotvec(block.centre, (0.0, 0.0, block.yaw))
    turn = world_from_object.rotation_matrix
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = turn.T @ sighting.covariance[:3, :3] @ turn
    tilt = sighting.leaning**2 + seen.tilt_sigma**2
    covariance[3:, 3:] = np.diag([tilt, tilt, min(sighting.covariance[3, 3], math.pi**2)])
    camera_from_object = seen.view.world_from_camera.inverse() @ world_from_object
    return camera_from_object.with_stamp(stamp).with_covariance(0.5 * (covariance + covariance.T))
