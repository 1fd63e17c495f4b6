"""Corrects a pose that was adopted by few objects in sight, by objects that come into view afterwards."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.calibrate import calibrate
from agents.calibrator.solve.reporting import make_report, tell
from agents.calibrator.watch.doubt import ENOUGH, Doubt
from agents.calibrator.watch.views import Views
from dsr.frames.tree import WORLD
from dsr.math3d.tolerance import SAME_POSE, PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.timeline import Chronicle
from dsr.vocabulary.relations import grasped_things

_LASTS = 30.0  # s after the adoption
_SMALL = PoseTolerance(0.001, 0.002)  # m, rad that are not worth it


@dataclass
class _Adopted:
    views: Views
    pose: Pose
    """parent_from_camera as it was written."""
    told: frozenset[str]
    """Objects by which that was found."""
    until: float
    """s"""


class Refining:
    """Goes on looking through cameras on a stand whose pose was adopted.

    Args:
        memory: the graph.
        chronicle: gets what was put right.
        config: of the calibrator.
        log: for people.
    """

    def __init__(self, memory: Memory, chronicle: Chronicle, config: CalibratorConfig, log: logging.Logger) -> None:
        self._memory = memory
        self._chronicle = chronicle
        self._config = config
        self._log = log
        self._adopted: dict[str, _Adopted] = {}

    def add(self, doubt: Doubt, now: float) -> None:
        """Note that the pose of this doubt was adopted at time `now` (s)."""
        if doubt.parent == WORLD and doubt.written is not None:
            views = Views(self._memory, doubt.camera, now, self._config, doubt.believed(), doubt.seen.depths)
            told = frozenset(one.name for one in doubt.sightings)
            self._adopted[doubt.camera] = _Adopted(views, doubt.written, told, now + _LASTS)

    def forget(self, camera: str) -> None:
        """Somebody looks into it anew."""
        self._adopted.pop(camera, None)

    def update(self, now: float) -> None:
        """Take in what is seen at time `now` (s), and calibrate anew if there is more of it."""
        held = grasped_things(self._memory)
        for camera, adopted in list(self._adopted.items()):
            pose = self._memory.get_pose(WORLD, camera, "RT")
            if now > adopted.until or pose is None or not SAME_POSE.covers(pose, adopted.pose):
                del self._adopted[camera]
                continue
            adopted.views.stop(held & adopted.told)
            adopted.views.update()
            self._refine(camera, adopted)

    def _refine(self, camera: str, adopted: _Adopted) -> None:
        sightings = adopted.views.sightings(least=ENOUGH)
        names = frozenset(one.name for one in sightings)
        if names <= adopted.told:
            return
        new, adopted.told = names - adopted.told, adopted.told | names
        solution = calibrate(sightings, adopted.pose, self._config.method)
        is_small = _SMALL.covers(solution.before, solution.pose)
        if new & set(solution.outliers) or not solution.is_adoptable or is_small:
            return
        report = make_report(camera, WORLD, solution, adopted=True)
        self._memory.add_edge(WORLD, camera, "RT", pose=solution.pose.with_stamp(0.0))
        adopted.pose = solution.pose
        tell(self._chronicle, report)
        self._log.info("%s, as %s show too", report.text, ", ".join(sorted(new)))
