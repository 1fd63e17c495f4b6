"""Objects that were explained as moved, one after the other: a camera that moved while most was hidden looks like that.

What such an object looks like from then on is compared with where it was believed before; once there are enough of
them, and one motion of the camera explains them all better than each by itself, the camera is in doubt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.calibrate import calibrate
from agents.calibrator.watch.decision import bumped, decide, told_turns
from agents.calibrator.watch.depths import DepthError
from agents.calibrator.watch.doubt import ENOUGH
from agents.calibrator.watch.steps import carried_things
from agents.calibrator.watch.views import Views
from dsr.frames.tree import WORLD
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.consensus import agree_beyond_chance
from dsr.vocabulary.relations import grasped_things

LOOKBACK = 0.3
"""s before an explanation, from when beliefs are taken: it has changed them since"""
_LASTS = 60.0  # s within which what was displaced may belong together
_SETTLES = 1.0  # s after which what was put down is believed where it is


@dataclass
class _Series:
    """What one camera has shown of them."""

    views: Views
    began: float
    """s"""
    names: set[str] = field(default_factory=set)
    told: frozenset[str] = frozenset()
    """Those by which it was last asked whether the camera moved."""


class Displaced:
    """Keeps them for each camera on a stand; one that an arm carries sees everything again and again anyway.

    Args:
        memory: what is seen, believed and held.
        config: of the calibrator.
    """

    def __init__(self, memory: Memory, config: CalibratorConfig) -> None:
        self._memory = memory
        self._config = config
        self._series: dict[str, _Series] = {}
        self._held: dict[str, float] = {}  # s, when something last held it

    def update(self, now: float) -> None:
        """Take note of what is held at time `now` (s); what was moved on purpose tells nothing any more."""
        held = grasped_things(self._memory)
        self._held |= dict.fromkeys(held, now)
        for camera, series in list(self._series.items()):
            if now - series.began > _LASTS or camera not in self._memory:
                del self._series[camera]
                continue
            series.views.stop(held & series.names)
            series.views.update()

    def add(self, camera: str, name: str, before: Pose | None, depths: Mapping[str, DepthError], now: float) -> None:
        """Note an object that `camera` sees, and that was explained as moved by itself; `before` is its earlier
        believed pose (world).
        """
        if before is None or now - self._held.get(name, -_SETTLES) < _SETTLES:
            return
        series = self._series.get(camera)
        if series is None:
            if [edge.src for edge in self._memory.edges("RT", dst=camera)] != [WORLD]:
                return  # something carries it, or nobody knows what
            views = Views(self._memory, camera, now, self._config, depths=depths)
            series = self._series[camera] = _Series(views, now)
        if name not in series.names:
            series.names.add(name)
            series.views.expect(name, before)

    def doubts(self, camera: str) -> Views | None:
        """Return the kept views of a camera if they tell now that it moved, and forget them; None otherwise."""
        series = self._series.get(camera)
        if series is None:
            return None
        told = series.views.steady(ENOUGH) & series.names
        if told <= series.told:
            return None
        if not agree_beyond_chance(told_turns(series.views.sightings(least=ENOUGH, of=told), told)):
            return None
        sightings = series.views.sightings(least=ENOUGH)
        series.told, before = told, self._memory.get_pose(WORLD, camera, "RT")
        if before is None:
            return None
        solution = calibrate(sightings, before, self._config.method, bumped(before))
        parent = series.views.parents()[sightings[0].view]
        if not decide(sightings, before, solution, parent, carried_things(self._memory)).moved:
            return None
        return self._series.pop(camera).views

    def forget(self, camera: str) -> None:
        """Forget the views of a camera, because its pose is known, or somebody looks into it."""
        self._series.pop(camera, None)
