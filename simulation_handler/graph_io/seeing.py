"""From the belief to the graph: how much each camera should see of each object, as edges `sees`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from dsr.errors import DsrError
from dsr.graph.elements import Edge
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.noise import NOTHING_SEEN
from dsr.perception.scales import FRAME
from dsr.visibility import LEAST_SHARE, is_enough
from dsr.vocabulary.perceived import CAMERA_SPEED, CAMERA_TURN
from simulation_handler.explaining import VisibilityQuery
from simulation_handler.graph_io.views import by_color, hands, modelled, obstacles, persons, views
from simulation_handler.hands.state import HALF
from simulation_handler.perception.visibility import CameraView, ExpectedVisibility, RayVisibility, are_at
from simulation_handler.reasoner import Reasoner
from simulation_handler.scales import TICK_SLACK
from simulation_handler.shapes.geometry import Solid
from simulation_handler.shapes.meshes import Forms

SEEN = ("share", "visible", "hidden_by", "detectable", "covered_by")
"""Attributes of the edges."""
_NEWS_STEP = 0.1  # of a share or probability, that is news
_NOTHING = ExpectedVisibility(0.0, "")


class Seeing:
    """Keeps edges `sees` from cameras to objects in step with a belief.

    `share`, `visible` and `hidden_by` are about the whole image of an object, as in all edges `sees`; `detectable` and
    `covered_by` are about what it is recognised by, of which only this agent tells. A camera that moves recognises
    nothing, since what it shows meanwhile is not used: that it does not show an object is no evidence.
    """

    def __init__(self, memory: Memory, belief: Reasoner, forms: Forms | None = None) -> None:
        self._forms = forms or Forms(memory)
        self._memory = memory
        self._belief = belief
        self._last = -math.inf
        self._poses: dict[str, Pose] = {}
        """world_from_camera at the last look"""
        self._judged: dict[tuple[str, str], tuple[ExpectedVisibility, ExpectedVisibility, tuple[Any, ...]]] = {}
        """Of what each edge was judged last, and what it said"""
        self._rays = _Rays()
        self.visibility: VisibilityQuery | None = None
        """What the cameras should see by the last look; None without a camera."""

    def update(self, now: float) -> None:
        """Look with each camera at the belief of time `now` (s), at most ten times a second, and write the changes."""
        if self._last <= now < self._last + FRAME - TICK_SLACK:
            return
        elapsed, self._last = now - self._last, now
        with contextlib.suppress(np.linalg.LinAlgError):
            cameras, memory = views(self._memory), self._memory
            hiding = [*obstacles(memory), *modelled(memory, self._forms), *hands(memory, now), *persons(memory, now)]
            standing = self._standing(cameras, elapsed)
            self._rays = rays = self._rays.seen_from(cameras, standing, hiding, by_color(memory))
            self.visibility = rays.recognised.look_for if cameras else None
            solids = self._belief.solids()
            recognised = rays.recognised.visibilities(solids)
            whole = rays.whole.visibilities(solids)
            self._write({key: (visible, recognised.get(key, _NOTHING)) for key, visible in whole.items()})

    def _standing(self, cameras: Sequence[CameraView], elapsed: float) -> frozenset[str]:
        """Names of the cameras that have stood still since the last look, `elapsed` s ago."""
        before, self._poses = self._poses, {view.camera: view.world_from_camera for view in cameras}
        if not 0.0 < elapsed < math.inf:
            return frozenset(self._poses)
        still = PoseTolerance(CAMERA_SPEED, CAMERA_TURN).scaled(elapsed)
        return frozenset(name for name, pose in self._poses.items() if still.covers(before.get(name, pose), pose))

    def _write(self, visibilities: Mapping[tuple[str, str], tuple[ExpectedVisibility, ExpectedVisibility]]) -> None:
        """Of the whole of each object, and of what it is recognised by."""
        cameras = {node.name for node in self._memory.nodes("camera")}
        for edge in self._memory.edges("sees"):
            if edge.src in cameras and "detectable" in edge and (edge.src, edge.dst) not in visibilities:
                self._memory.remove_edge(edge.src, edge.dst, "sees")
        before, self._judged = self._judged, {}
        for (camera, name), (whole, tag) in visibilities.items():
            written = self._memory.get_edge(camera, name, "sees")
            if written is not None:
                judged = self._judged[camera, name] = whole, tag, tuple(map(written.get, SEEN))
                if before.get((camera, name)) == judged:
                    continue
            values = {
                "share": whole.share,
                "visible": is_enough(whole.share, written is not None and written.get("visible") is True),
                "hidden_by": whole.hidden_by,
                "detectable": tag.share,
                "covered_by": tag.hidden_by,
            }
            if written is None or _is_news(written, values, tag):
                with contextlib.suppress(DsrError):  # an end may be gone meanwhile
                    self._memory.add_edge(camera, name, "sees", **values)


class _Rays:
    """What cameras should see, as long as they, what hides, and what has a colour are as they are."""

    def __init__(
        self,
        cameras: Sequence[CameraView] = (),
        standing: Collection[str] = (),
        hiding: Sequence[Solid] = (),
        by_color: Collection[str] = (),
    ) -> None:
        self._asked = list(cameras), set(standing), list(hiding), set(by_color)
        self.recognised = RayVisibility([view for view in cameras if view.camera in standing], hiding, by_color)
        """Of what objects are recognised by"""
        self.whole = RayVisibility(cameras, hiding, whole=True)
        """Of the whole of each object"""

    def seen_from(
        self,
        cameras: Sequence[CameraView],
        standing: Collection[str],
        hiding: Sequence[Solid],
        by_color: Collection[str],
    ) -> _Rays:
        """These rays, if all is as it was, but for less than counts; or else other ones."""
        seeing, stood, hid, colored = self._asked
        is_same = (set(standing), set(by_color), len(cameras)) == (stood, colored, len(seeing)) and are_at(hiding, hid)
        if is_same and all(one.is_as(other) for one, other in zip(cameras, seeing, strict=True)):
            return self
        return _Rays(cameras, standing, hiding, by_color)


def _is_news(written: Edge, values: Mapping[str, Any], tag: ExpectedVisibility) -> bool:
    """Whether it is seen otherwise than was written, or has become more or less likely to be recognised."""
    if any(written.get(name) != values[name] for name in ("visible", "hidden_by", "covered_by")):
        return True
    share, detectable = written.get("share"), written.get("detectable")
    if share is None or detectable is None or _differs(share, values["share"], LEAST_SHARE):
        return True
    changed = tag.recognised - tag._replace(share=detectable).recognised
    return abs(changed) > _NEWS_STEP or any(_differs(detectable, tag.share, limit) for limit in (NOTHING_SEEN, HALF))


def _differs(before: float, share: float, limit: float) -> bool:
    """Whether a share is another one than before, or on the other side of a limit."""
    return abs(share - before) > _NEWS_STEP or (share >= limit) != (before >= limit)
