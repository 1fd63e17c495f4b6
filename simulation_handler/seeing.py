"""From the belief to the graph: what each camera should see of each object, as edges `sees`."""

from __future__ import annotations

import contextlib
import math

import numpy as np

from dsr.errors import DsrError
from dsr.memory import Memory
from simulation_handler.explaining import Look
from simulation_handler.meshes import Forms
from simulation_handler.reasoner import Reasoner
from simulation_handler.sight import Glance, Sight
from simulation_handler.views import by_color, hands, modelled, obstacles, views

SEEN = ("share", "visible", "hidden_by")
"""Attributes of the edges."""
HALF = 0.5
"""Share of a tag from which an object counts as visible."""
ALL, NOTHING = 0.95, 0.05
"""Shares from which, and up to which, an object should be seen surely, and surely not: news at any step."""

_PERIOD = 0.1  # s between two looks
_SLACK = 1e-3  # s by which a tick may be early
_STEP = 0.1  # of the share, that is news


class Seeing:
    """Keeps edges `sees` from cameras to objects in step with a belief: `share`, `visible` and `hidden_by`."""

    def __init__(self, memory: Memory, belief: Reasoner, forms: Forms | None = None) -> None:
        self._forms = forms or Forms(memory)
        self._memory = memory
        self._belief = belief
        self._last = -math.inf
        self.look: Look | None = None
        """What the cameras should see by the last look; None without a camera."""

    def update(self, now: float) -> None:
        """Look with each camera at the belief of time `now` (s), at most ten times a second, and write what is news."""
        if self._last <= now < self._last + _PERIOD - _SLACK:
            return
        self._last = now
        with contextlib.suppress(np.linalg.LinAlgError):
            cameras = views(self._memory)
            hiding = [*obstacles(self._memory), *modelled(self._memory, self._forms), *hands(self._memory, now)]
            sight = Sight(cameras, hiding, by_color(self._memory))
            self.look = sight.glances if cameras else None
            self._write(sight.glances(self._belief.solids()))

    def _write(self, glances: dict[tuple[str, str], Glance]) -> None:
        cameras = {node.name for node in self._memory.nodes("camera")}
        for edge in self._memory.edges("sees"):
            if edge.src in cameras and (edge.src, edge.dst) not in glances:
                self._memory.remove_edge(edge.src, edge.dst, "sees")
        for (camera, name), glance in glances.items():
            if self._is_news(camera, name, glance):
                values = {"share": glance.share, "visible": glance.share >= HALF, "hidden_by": glance.hidden_by}
                with contextlib.suppress(DsrError):  # an end may be gone meanwhile
                    self._memory.add_edge(camera, name, "sees", **values)

    def _is_news(self, camera: str, name: str, glance: Glance) -> bool:
        written = self._memory.get_edge(camera, name, "sees")
        before = None if written is None else written.get("share")
        if written is None or before is None or written.get("hidden_by") != glance.hidden_by:
            return True
        return abs(glance.share - before) > _STEP or any(
            (glance.share >= limit) != (before >= limit) for limit in (NOTHING, HALF, ALL)
        )
