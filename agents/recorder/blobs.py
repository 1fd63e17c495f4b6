"""Blobs on the bus: small ones wait for the recorder's next tick, and of images the newest of each stream."""

from __future__ import annotations

from collections import deque

from agents.inbox import Message
from agents.recorder.selection import IMAGE
from agents.recorder.thinning import Image
from dsr.clock import Clock
from dsr.network.transport import Transport

_MOST_IMAGES = 64
"""Images of so many streams wait, more than the cameras of a graph: made-up names must take no memory."""


class BlobInbox:
    """Collects blobs until they are taken; beyond `most`, the oldest small ones are dropped and counted.

    An image stays where its writer shares it, so that what is not recorded is never copied.
    """

    def __init__(self, bus: Transport, key: str, clock: Clock, most: int) -> None:
        self.dropped = 0
        """Messages lost because nobody took them in time."""
        self._clock = clock
        self._waiting: deque[Message] = deque(maxlen=most)
        self._images: dict[str, Image] = {}
        self._subscription = bus.subscribe_bulk(key, self._receive)

    def take(self) -> list[Message]:
        """Return all small messages since the last call, in the order in which they came."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def take_images(self) -> list[Image]:
        """Return the newest image of each stream that has sent one since the last call."""
        return [self._images.pop(key) for key in list(self._images)]

    def close(self) -> None:
        """Stop collecting."""
        self._subscription.close()

    def _receive(self, key: str, payload: bytes | memoryview) -> None:
        if len(payload) >= IMAGE:
            self._keep(Image(self._clock.now(), key, payload))
            return
        if len(self._waiting) == self._waiting.maxlen:
            self.dropped += 1
        self._waiting.append(Message(self._clock.now(), key, bytes(payload)))

    def _keep(self, image: Image) -> None:
        if len(self._images) >= _MOST_IMAGES and image.key not in self._images:
            self.dropped += 1
            return
        self._images[image.key] = image
