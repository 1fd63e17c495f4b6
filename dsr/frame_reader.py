"""The reading end of a stream of frames: always the newest one, never a queue."""

from __future__ import annotations

import logging
from collections import deque

from dsr.blobs import Frame, decode_frame
from dsr.errors import WireError
from dsr.transport import Transport

_log = logging.getLogger("dsr.frames")


class FrameReader:
    """Holds the newest frame of one stream until it is asked for; frames nobody took are skipped."""

    def __init__(self, transport: Transport, key: str) -> None:
        self._key = key
        self._newest: deque[bytes] = deque(maxlen=1)
        self._subscription = transport.subscribe(key, self._receive, newest=1)
        self.dropped = 0
        """Malformed frames so far."""

    def latest(self) -> Frame | None:
        """The newest frame if it was not returned before, else None."""
        try:
            return decode_frame(self._newest.pop())
        except IndexError:
            return None
        except WireError as error:
            self.dropped += 1
            if self.dropped == 1:
                _log.warning("dropped a frame on %s: %s (further ones are only counted)", self._key, error)
            return None

    def close(self) -> None:
        """Stop receiving."""
        self._subscription.close()

    def _receive(self, _key: str, payload: bytes) -> None:
        self._newest.append(payload)
