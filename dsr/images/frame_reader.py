"""The reading end of a stream of frames: always the newest one, never a queue."""

from __future__ import annotations

import logging
import threading

from dsr.clock import WALL_CLOCK
from dsr.errors import WireError
from dsr.images.blobs import Frame, decode_frame
from dsr.network.transport import Transport

_log = logging.getLogger("dsr.frames.tree")


class FrameReader:
    """Holds the newest frame of one stream until it is asked for; frames nobody took are skipped.

    The arrays of a frame from the same machine lie in memory that its sender shares, and are not copied. That
    memory is kept as they are for as long as anything refers to them, so keep few: while four frames of a
    stream are kept, further ones are copies.
    """

    def __init__(self, transport: Transport, key: str) -> None:
        self._key = key
        self._arrived = threading.Event()
        self._mailbox = transport.newest(key, self._arrived.set)
        self.dropped = 0
        """Malformed frames so far."""

    def latest(self) -> Frame | None:
        """The newest frame if it was not returned before, else None."""
        self._arrived.clear()
        try:
            payload = self._mailbox.take()
            return None if payload is None else decode_frame(payload)
        except WireError as error:
            self.dropped += 1
            if self.dropped == 1:
                _log.warning("dropped a frame on %s: %s (further ones are only counted)", self._key, error)
            return None

    def wait(self, timeout: float) -> Frame | None:
        """The next frame, as soon as it is there; None after `timeout` s. Not for agents in lockstep."""
        deadline = WALL_CLOCK.monotonic() + timeout
        while (frame := self.latest()) is None:
            if not WALL_CLOCK.wait(self._arrived, max(0.0, deadline - WALL_CLOCK.monotonic())):
                return None
        return frame

    def close(self) -> None:
        """Stop receiving; frames that were returned stay."""
        self._mailbox.close()
