"""Numbers over time: how far percepts, beliefs and, where it is known, the truth are apart; the agents' rates."""

from __future__ import annotations

import logging
import math

import msgspec
import rerun as rr

from agents.inbox import Message
from agents.viewer import palette
from agents.viewer.model import DrawnScene, DrawnSolid, Vector
from agents.viewer.palette import Color
from agents.viewer.texts import drawable
from dsr import WireError
from dsr.network.decoding import decoded
from dsr.runtime.status import decode_status

DISTANCES = "series/percept_to_belief_mm"
ERRORS = "series/error_mm"
RATES = "series/rate_hz"


class _Truth(msgspec.Struct, frozen=True):
    """The part of a truth message that is looked at."""

    objects: dict[str, tuple[float, float, float, float, float, float, float]]


_truth_decoder = msgspec.msgpack.Decoder(_Truth)


class SeriesView:
    """Logs scalars; malformed messages are counted and left out."""

    def __init__(self, recording: rr.RecordingStream, log: logging.Logger) -> None:
        self.malformed = 0
        self._recording = recording
        self._log = log
        self._named: set[str] = set()
        self._truth: dict[str, Vector] = {}

    @property
    def knows_truth(self) -> bool:
        """Whether the truth is published."""
        return bool(self._truth)

    def begin_anew(self) -> None:
        """Log the names and colours of curves again."""
        self._named.clear()

    def draw_distances(self, scene: DrawnScene) -> None:
        """Log the distance of each object's percept to its belief, and of both to the truth if it is published."""
        percepts = {solid.name: solid for solid in scene.percepts if solid.seen}
        beliefs = {solid.name: solid for solid in scene.beliefs}
        for name in sorted(percepts.keys() & beliefs.keys()):
            apart = math.dist(percepts[name].place.translation, beliefs[name].place.translation)
            self._log_scalar(f"{DISTANCES}/{name}", name, apart * 1e3)
        self._draw_errors("percept", percepts, palette.PERCEPT)
        self._draw_errors("belief", beliefs, palette.BELIEF)

    def draw_status(self, message: Message) -> None:
        """Log the rate in an agent's status."""
        try:
            status = decode_status(message.payload)
        except WireError as error:
            self._drop(message, error)
        else:
            self._log_scalar(f"{RATES}/{rr.escape_entity_path_part(status.agent)}", status.agent, status.rate_hz)

    def note_truth(self, message: Message) -> None:
        """Remember where the objects are in truth, from a simulated reality."""
        try:
            truth = decoded(message.payload, "truth", _truth_decoder.decode)
        except WireError as error:
            self._drop(message, error)
        else:
            self._truth = {name: seven[:3] for name, seven in truth.objects.items()}

    def _draw_errors(self, what: str, solids: dict[str, DrawnSolid], color: Color) -> None:
        for name in sorted(solids.keys() & self._truth.keys()):
            error = math.dist(solids[name].place.translation, self._truth[name])
            self._log_scalar(f"{ERRORS}/{what}/{name}", what, error * 1e3, color)

    def _log_scalar(self, entity: str, name: str, value: float, color: Color | None = None) -> None:
        if entity not in self._named:
            self._named.add(entity)
            colors = None if color is None else [color]
            self._recording.log(
                entity, rr.SeriesLines(names=[drawable(name)], colors=colors, widths=[1.2]), static=True
            )
        self._recording.log(entity, rr.Scalars(value))

    def _drop(self, message: Message, error: Exception) -> None:
        self.malformed += 1
        if self.malformed == 1:
            self._log.warning("dropped a message on %s: %s (logged once)", message.key, error)
