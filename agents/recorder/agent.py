"""The recorder: writes the traffic of the graph, and the data of its sensors, to an MCAP file."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import ClassVar

import msgspec

from agents.inbox import Inbox, Message
from agents.recorder.channels import MESH, SNAPSHOT
from agents.recorder.images import pack
from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from agents.recorder.reader import FILE_NAME
from agents.segments import next_segment
from dsr.agent import Access, Agent
from dsr.errors import ConfigError, SchemaError, WireError
from dsr.geometry import mesh_hashes
from dsr.images.blobs import decode_frame, encode_frame
from dsr.memory import Memory


class MeshRecorder:
    """Asks for the meshes of all nodes, and writes them.

    Args:
        memory: where the nodes are.
        writer: of the recording.
    """

    def __init__(self, memory: Memory, writer: RecordingWriter) -> None:
        self._memory = memory
        self._writer = writer
        self._watch = memory.watch(attribute="mesh")
        self._wanted: set[str] = set()
        self._written: set[str] = set()

    def update(self, now: float) -> None:
        """Write what has come by `now` (s); what nobody has yet is asked for again, less and less often."""
        for change in self._watch.poll():
            node = self._memory.get_node(change.name) if change.element == "node" else None
            with contextlib.suppress(SchemaError):  # what it says are no hashes
                self._wanted.update({} if node is None else set(mesh_hashes(node)) - self._written)
        for hash in sorted(self._wanted):
            mesh = self._memory.get_mesh(hash)
            if mesh is not None:
                self._writer.write(RecordedMessage(now, MESH, bytes(mesh.data)))
                self._wanted.discard(hash)
                self._written.add(hash)

    def close(self) -> None:
        """Watch no more."""
        self._watch.close()


ABOUT = "agents"
"""Name of the metadata that hold the configurations of the agents of the run, as JSON by agent."""
_MOST_WAITING = 20_000
_MOST_IMAGES_WAITING = 64
RETRY = 5.0
"""s until a disk that refused is tried again: it may take a person some time to make room."""
_LARGE = 1 << 16  # bytes; larger blobs are images or meshes
_DEVICES = ("*/state", "*/command", "*/*/poses", "*/*/hands")
"""What is recorded of the traffic with devices: an arm, sensors that tell poses or hands; images come as blobs."""


class RecorderConfig(msgspec.Struct, frozen=True):
    """Which data are recorded, and where."""

    folder: str = "runs/recorder"
    """Gets `recording.mcap`, or `recording-2.mcap` if that exists, and so on."""
    frames_hz: float = 2.0
    """Camera frames a second and camera that are kept; 0 for none."""
    jpeg_quality: int = 90
    """JPEG quality of recorded colour images, 1 to 100."""
    flush_period: float = 0.4
    """s, at most so much is lost when the recorder is killed"""
    snapshot_period: float = 30.0
    """s between two messages that hold the whole graph, from which reading may begin"""
    about: dict[str, str] = {}
    """Facts about the recording that its file shall tell, such as the run's seed."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.frames_hz) and self.frames_hz >= 0):
            raise ValueError(f"frames_hz {self.frames_hz}: expected 0 or more")
        if not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality {self.jpeg_quality}: expected 1 to 100")


class Recorder(Agent):
    """Hears everything on the graph's keys and writes it down, images thinned out; writes nothing to the graph."""

    name = "recorder"
    rate_hz = 10.0
    reads: ClassVar[Access] = Access(nodes=("*",), edges=("*",), attributes=("*",))
    Config = RecorderConfig
    config: RecorderConfig
    _writer: RecordingWriter | None = None
    _meshes: MeshRecorder | None = None
    _inboxes: tuple[Inbox, ...] = ()
    _waits = ""
    """Why nothing is recorded, for people; empty while it is."""

    def setup(self) -> None:
        """Open the file and begin to listen."""
        keys = self.keys
        self._images: dict[str, Message] = {}
        self._image_stamps: dict[str, float] = {}
        self._last_flush = self._last_snapshot = -math.inf
        self._repairs = self._unwritten = 0
        self._retry_at = -math.inf
        try:
            self._begin_file()
        except OSError as error:
            raise ConfigError(f"nothing can be recorded in {self.config.folder}: {error.strerror}") from error
        wanted = (keys.delta(), keys.stream(), keys.truth(), keys.log(), keys.status(), *map(keys.device, _DEVICES))
        images = Inbox(self.bus, keys.blob("**"), self.clock, _MOST_IMAGES_WAITING)
        self._inboxes = (images, Inbox(self.bus, wanted, self.clock, _MOST_WAITING))

    def _begin_file(self) -> None:
        """Open the next file of this recording. Raises `OSError`."""
        path = next_segment(Path(self.config.folder), FILE_NAME)
        about = {**self.config.about, "graph": self.keys.graph, "root": self.keys.root, "segment": path.name}
        self._writer = RecordingWriter(path, about)
        self._meshes = MeshRecorder(self.memory, self._writer)
        self._last_snapshot = -math.inf
        self.log.info("recording to %s", path)

    def tick(self, now: float) -> None:
        """Write what arrived since the last tick, in the order of arrival; a disk that is full is waited for."""
        messages = self._take(now)
        try:
            if self._writer is None and now >= self._retry_at:
                self._begin_file()
            if self._writer is None:
                self._unwritten += len(messages)
            else:
                self._write(messages, now)
        except OSError as error:
            self._wait_for_room(error, len(messages), now)
        self._report_losses()

    def _write(self, messages: list[Message], now: float) -> None:
        """Write messages, and what is due. Raises `OSError`."""
        assert self._writer is not None and self._meshes is not None
        if self._last_snapshot == -math.inf:
            self._write_snapshot(now)
        for message in messages:
            topic = message.key.removeprefix(self.keys.root + "/")
            self._writer.write(RecordedMessage(message.stamp, topic, message.payload))
        self._meshes.update(now)
        if now - self._last_snapshot >= self.config.snapshot_period or self._repairs != self.memory.statistics.repairs:
            self._write_snapshot(now)
        if now - self._last_flush >= self.config.flush_period:
            self._writer.flush()
            self._last_flush = now
        if self._waits:
            self._writer.flush()
            self._waits = ""
            self.degraded = ""
            self.log.warning("recording again, to %s; %d messages are missing", self._writer.path, self._unwritten)

    def _wait_for_room(self, error: OSError, missed: int, now: float) -> None:
        """Close the file as it is, and try again later with the next one."""
        self._retry_at = now + RETRY
        self._unwritten += missed
        if not self._waits:
            self._waits = f"nothing is recorded ({error.strerror or error}); tried again every {RETRY:g} s"
            self.log.error("%s", self._waits)
        if self._writer is not None and self._meshes is not None:
            self._meshes.close()
            self._writer.abandon()
        self._writer = self._meshes = None

    def teardown(self) -> None:
        """Write what is left and close the file, so that it has an index."""
        for inbox in self._inboxes:
            inbox.close()
        self.tick(self.clock.now())
        if self._writer is not None and self._meshes is not None:
            self._meshes.close()
            try:
                self._writer.close()
            except OSError as error:
                self.log.error("the recording has no index (%s); it can be replayed all the same", error.strerror)

    def _write_snapshot(self, now: float) -> None:
        """Also after a repair: what it brought came in no message that is recorded."""
        if self._writer is not None and self.memory.joined:
            self._repairs = self.memory.statistics.repairs
            self._writer.write(RecordedMessage(now, SNAPSHOT, self.memory.snapshot()))
            self._last_snapshot = now

    def _take(self, now: float) -> list[Message]:
        """What arrived and is to be recorded, oldest first."""
        arrived = [message for inbox in self._inboxes for message in inbox.take()]
        small = [message for message in arrived if not self._set_aside(message)]
        return sorted([*small, *self._due_images(now)], key=lambda message: message.stamp)

    def _set_aside(self, message: Message) -> bool:
        """Keep the newest image of each stream until it is due; false for anything that is recorded at once."""
        if len(message.payload) < _LARGE or not message.key.startswith(self.keys.blob("")):
            return False
        self._images[message.key] = message
        return True

    def _due_images(self, now: float) -> list[Message]:
        if self.config.frames_hz == 0.0:
            self._images.clear()
            return []
        period = 1.0 / self.config.frames_hz
        due = [key for key in self._images if now - self._image_stamps.get(key, -math.inf) >= period - 1e-6]
        for key in due:
            self._image_stamps[key] = now
        return [self._packed(self._images.pop(key)) for key in due]

    def _packed(self, message: Message) -> Message:
        """The message with its images compressed; one that is no frame stays as it is."""
        try:
            frame = decode_frame(message.payload)
        except WireError:
            return message
        return message._replace(payload=encode_frame(pack(frame, self.config.jpeg_quality)))

    def _report_losses(self) -> None:
        dropped = sum(inbox.dropped for inbox in self._inboxes)
        if self._waits:
            self.degraded = f"{self._waits}; {self._unwritten} messages are missing"
        elif dropped:
            self.degraded = f"{dropped} messages were not recorded: they came faster than they could be written"
