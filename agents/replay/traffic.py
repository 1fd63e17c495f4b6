"""Publishes the traffic of a recording besides the graph again: images, statuses, logs, truth, devices."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

from msgspec.structs import replace

from agents.recorder.images import unpack
from agents.recorder.index import TimedRecord
from dsr.clock import Clock
from dsr.config.extras import MissingExtraError
from dsr.errors import WireError
from dsr.images.blobs import decode_frame, frame_chunks
from dsr.network.keys import Keys, is_key
from dsr.network.transport import Chunks, Qos, Transport
from dsr.runtime.status import decode_status, encode_status

_log = logging.getLogger("dsr.replay")
_PLAIN = ("log/", "truth", "device/")
"""Topics that are published as they were."""


def unpacked(payload: bytes) -> Chunks:
    """A recorded blob as it was published, in pieces: images are unpacked; what is no frame stays as it is.

    Raises `MissingExtraError` without the library that unpacks images.
    """
    try:
        return frame_chunks(unpack(decode_frame(payload)))
    except WireError:
        return [payload]


class Traffic:
    """Publishes records under the keys of another graph."""

    def __init__(self, bus: Transport, keys: Keys, clock: Clock) -> None:
        self._bus = bus
        self._keys = keys
        self._clock = clock
        self.malformed = 0
        """Records that could not be published."""
        self._complained = False

    def publish(self, record: TimedRecord) -> None:
        """Publish a record, unless it is a change of the graph."""
        for publish in self.later(record).values():
            publish()

    def later(self, record: TimedRecord) -> dict[str, Callable[[], None]]:
        """How to publish a record, by its topic; empty for a change of the graph."""
        topic = record.topic
        if not is_key(topic):
            self.malformed += 1
            return {}
        if topic.startswith("blob/"):
            return {topic: partial(self._publish_blob, record)}
        if topic.startswith("status/"):
            return {topic: partial(self._publish_status, record)}
        if topic.startswith(_PLAIN):
            return {topic: partial(self._bus.publish, self._key(topic), record.payload, Qos.STREAM)}
        return {}

    def _key(self, topic: str) -> str:
        return f"{self._keys.root}/{topic}"

    def _publish_blob(self, record: TimedRecord) -> None:
        """An image that cannot be unpacked here, for want of a library, is left out, which is logged once."""
        try:
            chunks = unpacked(record.payload)
        except MissingExtraError as error:
            if not self._complained:
                _log.warning("images are left out: %s", error)
            self._complained = True
            return
        self._bus.publish_bulk(self._key(record.topic), chunks)

    def _publish_status(self, record: TimedRecord) -> None:
        """With the present time: its readers ask how old it is. The process is none of today."""
        try:
            status = replace(decode_status(record.payload), stamp=self._clock.now(), pid=0)
        except WireError:
            self.malformed += 1
            return
        self._bus.publish(self._key(record.topic), encode_status(status), Qos.STREAM)
