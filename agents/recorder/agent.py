"""The recorder: writes the traffic of the graph, and the data of its sensors, to MCAP files."""

from __future__ import annotations

import errno
import math
from collections import deque
from pathlib import Path
from typing import ClassVar

from agents.inbox import Inbox, Message
from agents.packed_images import check_opencv
from agents.recorder.blobs import BlobInbox
from agents.recorder.channels import SNAPSHOT
from agents.recorder.config import RecorderConfig
from agents.recorder.files import FileLimits, RecordingFiles
from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from agents.recorder.meshes import MeshRecorder
from agents.recorder.selection import DATA, GRAPH, IMAGES, MESHES, RecordSelection
from agents.recorder.thinning import Image, ImageThinner
from dsr.agent import Access, Agent
from dsr.errors import ConfigError
from dsr.network.keys import ALL, without_part

ABOUT = "agents"
"""Name of the metadata that hold the configurations of the agents of the run, as JSON by agent."""
_MOST_WAITING = 20_000
RETRY = 5.0
"""s until a disk that refused is tried again: it may take a person some time to make room."""
LAG = 1.0
"""s by which the recorder's own graph, of which snapshots are made, may be behind what it records. The changes of so
long before are repeated in the next file: it is complete without the one before.
"""
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


class Recorder(Agent):
    """Hears everything on the graph's keys and writes it down, images thinned out; writes nothing to the graph."""

    name = "recorder"
    rate_hz = 10.0
    reads: ClassVar[Access] = Access(nodes=("*",), edges=("*",), attributes=("*",))
    interest = (ALL,)
    Config = RecorderConfig
    config: RecorderConfig
    _writer: RecordingWriter | None = None
    _meshes: MeshRecorder | None = None
    _inbox: Inbox | None = None
    _blobs: BlobInbox | None = None
    _waits = ""
    """Why nothing is recorded, for people; empty while it is."""

    def setup(self) -> None:
        """Open the file and begin to listen. Raises `ConfigError` if nothing, or no images, can be recorded."""
        keys, config = self.keys, self.config
        self._selection = RecordSelection(config.only, config.without)
        if self._selection.may_include(IMAGES):
            check_opencv()
        self._images = ImageThinner(config.frames_hz, config.still_hz, None if config.lossless else config.jpeg_quality)
        self._recent: deque[RecordedMessage] = deque()
        self._repeated: list[RecordedMessage] = []
        self._last_flush = self._last_snapshot = -math.inf
        self._repairs = self._unwritten = self._told_removed = 0
        self._retry_at = -math.inf
        about = {**config.about, "graph": keys.graph, "root": keys.root}
        self._files = RecordingFiles(Path(config.folder), FileLimits.of(config), about)
        while self._writer is None:
            try:
                self._begin_file(self.clock.now())
            except OSError as error:
                if error.errno not in _NO_ROOM or not self._files.drop_oldest():
                    raise ConfigError(f"nothing can be recorded in {config.folder}: {error.strerror}") from error
        if any(map(self._selection.may_include, (IMAGES, DATA))):
            self._blobs = BlobInbox(self.bus, keys.blob("**"), self.clock, _MOST_WAITING)
        self._inbox = Inbox(self.bus, self._selection.keys(keys), self.clock, _MOST_WAITING)

    @property
    def missing(self) -> int:
        """Number of messages that were lost until now: no room, or they came faster than they could be written."""
        return self._unwritten + self._dropped

    @property
    def _dropped(self) -> int:
        return sum(inbox.dropped for inbox in self._inboxes)

    @property
    def _inboxes(self) -> list[Inbox | BlobInbox]:
        return [inbox for inbox in (self._blobs, self._inbox) if inbox is not None]

    def _begin_file(self, now: float) -> RecordingWriter:
        """Open the next file of this recording. Raises `OSError`."""
        self._writer = writer = self._files.begin(now)
        self._meshes = MeshRecorder(self.memory, writer) if self._selection.may_include(MESHES) else None
        self._last_snapshot = -math.inf
        self._repeated = list(self._recent)
        self._images.begin_again()
        self.log.info("recording to %s", writer.path)
        return writer

    def tick(self, now: float) -> None:
        """Write what arrived since the last tick, in the order of arrival; a disk that is full is waited for."""
        self._record(now, ends=False)

    def _record(self, now: float, *, ends: bool) -> None:
        """The same; a recording that ends begins no further file."""
        messages = [self._as_record(message) for message in self._take(now)]
        unwritten = deque(messages)
        try:
            writer = self._writer
            if writer is None and not ends and now >= self._retry_at:
                writer = self._begin_file(now)
            elif writer is not None and not ends and self._files.is_full(now):
                writer = self._rotate(writer, now)
            if writer is None:
                self._unwritten += len(unwritten)
            else:
                self._write(writer, unwritten, now)
        except OSError as error:
            self._wait_for_room(error, len(unwritten), now)
        self._recent += [record for record in messages if record.topic.startswith(("d/", "rt/"))]
        while self._recent and self._recent[0].stamp < now - LAG:
            self._recent.popleft()
        self._report_losses()

    def _as_record(self, message: Message) -> RecordedMessage:
        return RecordedMessage(message.stamp, self._topic(message.key), message.payload)

    def _topic(self, key: str) -> str:
        return without_part(key.removeprefix(self.keys.root + "/"))

    def _rotate(self, writer: RecordingWriter, now: float) -> RecordingWriter:
        """End the file and begin the next one. Raises `OSError`."""
        if self._meshes is not None:
            self._meshes.close()
        writer.close()
        self._writer = self._meshes = None
        return self._begin_file(now)

    def _write(self, writer: RecordingWriter, records: deque[RecordedMessage], now: float) -> None:
        """Write records, each taken out of `records`, and what is due. Raises `OSError`."""
        if self._last_snapshot == -math.inf:
            self._write_snapshot(writer, now)
            while self._repeated:
                writer.write(self._repeated.pop(0))
        while records:
            writer.write(records.popleft())
        if self._meshes is not None:
            self._meshes.update(now)
        if now - self._last_snapshot >= self.config.snapshot_period or self._repairs != self.memory.statistics.repairs:
            self._write_snapshot(writer, now)
        if now - self._last_flush >= self.config.flush_period:
            writer.flush()
            self._last_flush = now
            if self._last_snapshot > -math.inf or not self._selection.may_include(GRAPH):
                self._files.note_beginning()
            self._files.keep_limits()
            self._tell_removed()
        if self._waits:
            writer.flush()
            self._waits = ""
            self.degraded = ""
            self.log.warning("recording again, to %s; %d messages are missing", writer.path, self._unwritten)

    def _wait_for_room(self, error: OSError, missed: int, now: float) -> None:
        """Close the file as it is, and go on with the next one: at once in place of the oldest, or else later."""
        if self._writer is not None:
            missed += self._writer.unflushed
            self._writer.abandon()
        if self._meshes is not None:
            self._meshes.close()
        self._writer = self._meshes = None
        self._unwritten += missed
        said = error.strerror or str(error)
        if error.errno in _NO_ROOM and self._files.drop_oldest():
            self.log.warning("%s: the oldest file was removed; %d messages are missing", said, self._unwritten)
            return
        self._retry_at = now + RETRY
        if not self._waits:
            self._waits = f"nothing is recorded ({said}); tried again every {RETRY:g} s"
            self.log.error("%s", self._waits)

    def teardown(self) -> None:
        """Write what is left and close the file, so that it has an index."""
        for inbox in self._inboxes:
            inbox.close()
        self._record(self.clock.now(), ends=True)
        if self._waits:
            self.log.error("there was no room for the end of the recording; %d messages are missing", self._unwritten)
        for missing in self._selection.unheard:
            self.log.warning("%s", missing)
        if self._meshes is not None:
            self._meshes.close()
        if self._writer is not None:
            try:
                self._writer.close()
            except OSError as error:
                self.log.error("the recording has no index (%s); it can be replayed all the same", error.strerror)

    def _write_snapshot(self, writer: RecordingWriter, now: float) -> None:
        """Also after a repair: what it brought came in no message that is recorded."""
        if self.memory.joined and self._selection.may_include(GRAPH):
            self._repairs = self.memory.statistics.repairs
            writer.write(RecordedMessage(now, SNAPSHOT, self.memory.snapshot()))
            self._last_snapshot = now
            self._images.begin_again()

    def _take(self, now: float) -> list[Message]:
        """What arrived and is to be recorded, oldest first."""
        small = [message for inbox in self._inboxes for message in inbox.take() if self._is_wanted(message)]
        for image in self._blobs.take_images() if self._blobs is not None else ():
            if self._is_wanted(image):
                self._images.put(image)
        return sorted([*small, *self._images.due(now)], key=lambda message: message.stamp)

    def _is_wanted(self, message: Message | Image) -> bool:
        return self._selection.includes(self._topic(message.key), len(message.payload))

    def _tell_removed(self) -> None:
        if self._files.removed > self._told_removed:
            self._told_removed = self._files.removed
            self.log.info(
                "the oldest files were removed to keep %s: %d until now", self._files.limits, self._told_removed
            )

    def _report_losses(self) -> None:
        if self._waits:
            self.degraded = f"{self._waits}; {self._unwritten} messages are missing"
        elif self._dropped:
            self.degraded = f"{self._dropped} messages were not recorded: they came faster than they could be written"
