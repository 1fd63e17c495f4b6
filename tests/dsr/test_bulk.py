"""Large messages in shared memory: never torn, never left behind, and never in a reader's or writer's way."""

from __future__ import annotations

import fcntl
import gc
import mmap
import os
import signal
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest

import dsr
from dsr.clock import WALL_CLOCK
from dsr.errors import WireError
from dsr.images.blobs import frame_chunks
from dsr.images.frame_reader import FrameReader
from dsr.network.bulk import MOST_EARLY, MOST_STREAMS, BulkReader, BulkSubscription, BulkWriter, Handler
from dsr.network.keys import Keys, descriptor_key
from dsr.network.rendezvous import free_port
from dsr.network.shared_ring import MOST_BYTES, SLOTS, Ring, RingReader, SlotDescriptor
from dsr.network.transport import MessageHandler, Qos, Subscription
from dsr.network.zenoh_transport import ZenohTransport

PATIENCE = 20.0  # s
HOLDER = """
import sys, msgspec
from dsr.network.shared_ring import RingReader, SlotDescriptor
descriptor = msgspec.msgpack.decode(bytes.fromhex(sys.argv[1]), type=SlotDescriptor)
held = RingReader(descriptor).view(descriptor)
print(held[:5].tobytes().decode(), flush=True)
sys.stdin.read()
"""
WRITER = """
import sys, msgspec
from dsr.network.shared_ring import Ring
ring = Ring(100)
print(msgspec.msgpack.encode(ring.write([b"hello"])).hex(), flush=True)
sys.stdin.read()
"""


def descriptor_of(ring: Ring, message: bytes) -> SlotDescriptor:
    descriptor = ring.write([message])
    assert descriptor is not None
    return descriptor


def run(program: str, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def told(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


class TestRing:
    def test_a_message_in_pieces_is_read_in_place(self) -> None:
        ring = Ring(10)
        descriptor = ring.write([b"he", memoryview(b"llo"), b""])
        assert descriptor is not None
        found = RingReader(descriptor).view(descriptor)
        assert found is not None and found == b"hello" and found.readonly

    def test_what_is_held_stays_however_much_is_written(self) -> None:
        ring = Ring(10)
        first = descriptor_of(ring, b"first")
        reader = RingReader(first)
        held = reader.view(first)
        for i in range(5 * SLOTS):
            descriptor = descriptor_of(ring, b"%d" % i)
            assert reader.view(descriptor) == b"%d" % i
        assert held == b"first"

    def test_what_nobody_holds_is_overwritten_and_then_refused(self) -> None:
        ring = Ring(10)
        descriptors = [descriptor_of(ring, b"%d" % i) for i in range(9)]
        reader = RingReader(descriptors[0])
        assert [reader.view(descriptor) for descriptor in descriptors[:4]] == [None] * 4
        assert [reader.view(descriptor) for descriptor in descriptors[-2:]] == [b"7", b"8"]
        assert len({descriptor.slot for descriptor in descriptors}) <= 5  # no more memory than needed

    def test_one_reader_holds_few_and_gets_copies_of_more(self) -> None:
        ring = Ring(1000)
        reader = RingReader(descriptor_of(ring, b"x"))
        held = [reader.view(descriptor_of(ring, b"%d" % i)) for i in range(3 * SLOTS)]
        assert held == [b"%d" % i for i in range(3 * SLOTS)]

    def test_when_readers_hold_all_there_is_no_descriptor_until_one_lets_go(self) -> None:
        ring = Ring(10)
        held = []
        for _ in range(SLOTS):
            descriptor = descriptor_of(ring, b"held")
            held.append(RingReader(descriptor).view(descriptor))
        assert ring.write([b"one too many"]) is None
        del held[: SLOTS - 3]
        assert ring.write([b"welcome"]) is not None
        assert held == [b"held"] * 3

    def test_a_part_keeps_the_whole_in_place(self) -> None:
        ring = Ring(100)
        descriptor = descriptor_of(ring, bytes(range(100)))
        reader = RingReader(descriptor)
        view = reader.view(descriptor)
        assert view is not None
        part = np.frombuffer(view, np.uint8)[10:20].reshape(2, 5)
        del view, reader
        for _ in range(3 * SLOTS):
            ring.write([b"\xff" * 100])
        assert part.ravel().tolist() == list(range(10, 20))

    @pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM])
    def test_the_death_of_a_reader_frees_what_it_held(self, ending: signal.Signals) -> None:
        ring = Ring(10)
        descriptor = descriptor_of(ring, b"hello")
        with run(HOLDER, msgspec.msgpack.encode(descriptor).hex()) as holder:
            assert told(holder) == "hello"
            for _ in range(SLOTS):
                assert descriptor_of(ring, b"other").slot != descriptor.slot
            os.kill(holder.pid, signal.SIGSTOP)  # a stopped one goes on holding it
            for _ in range(SLOTS):
                assert descriptor_of(ring, b"other").slot != descriptor.slot
            os.kill(holder.pid, signal.SIGCONT)
            os.kill(holder.pid, ending)
        assert descriptor.slot in {descriptor_of(ring, b"other").slot for _ in range(SLOTS)}

    def test_what_a_dead_writer_wrote_can_be_read_on_and_nothing_is_left_behind(self) -> None:
        before = set(Path("/dev/shm").iterdir())
        with run(WRITER) as writer:
            descriptor = msgspec.msgpack.decode(bytes.fromhex(told(writer)), type=SlotDescriptor)
            reader = RingReader(descriptor)
            writer.kill()
        assert reader.view(descriptor) == b"hello"
        assert {file for file in Path("/dev/shm").iterdir() if not file.name.endswith(".zenoh")} <= before
        with pytest.raises(OSError):
            RingReader(descriptor)

    def test_a_message_that_its_writer_did_not_finish_is_not_read(self) -> None:
        class DeathError(Exception):
            pass

        class Deadly:
            def __len__(self) -> int:
                raise DeathError

        ring = Ring(10)
        descriptors = [descriptor_of(ring, b"old") for _ in range(4)]
        with pytest.raises(DeathError):
            ring.write([b"new", Deadly()])  # type: ignore[list-item]
        assert RingReader(descriptors[0]).view(descriptors[0]) is None

    def test_a_forked_child_gives_nothing_back(self) -> None:
        ring = Ring(10)
        descriptor = descriptor_of(ring, b"hello")
        held = RingReader(descriptor).view(descriptor)
        child = os.fork()
        if child == 0:
            del held
            gc.collect()
            os._exit(0)
        os.waitpid(child, 0)
        assert descriptor.slot not in {descriptor_of(ring, b"other").slot for _ in range(SLOTS)}
        assert held == b"hello"

    @pytest.mark.parametrize("change", [{"slot": SLOTS}, {"slot": -1}, {"length": 1 << 40}, {"length": -1}])
    def test_impossible_places_are_malformed(self, change: dict[str, int]) -> None:
        ring = Ring(10)
        descriptor = descriptor_of(ring, b"hello")
        reader = RingReader(descriptor)
        with pytest.raises(WireError, match="slots"):
            reader.view(msgspec.structs.replace(descriptor, **change))

    def test_only_rings_are_opened(self, tmp_path: Path) -> None:
        ring = Ring(10)
        descriptor = descriptor_of(ring, b"hello")
        read_end, write_end = os.pipe()
        with (tmp_path / "file").open("wb") as file, os.fdopen(read_end), os.fdopen(write_end, "w"):
            file.truncate(os.fstat(descriptor.file_descriptor).st_size)
            other = os.memfd_create("other", os.MFD_ALLOW_SEALING)
            os.ftruncate(other, os.fstat(descriptor.file_descriptor).st_size)
            os.write(other, descriptor.ring)
            fcntl.fcntl(other, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
            for number in (file.fileno(), other, read_end, -1, 1 << 40):
                with pytest.raises(OSError):
                    RingReader(msgspec.structs.replace(descriptor, file_descriptor=number))
            os.close(other)
        for change in ({"ring": b"\0" * 16}, {"slot_size": 1 << 50}, {"slot_size": -1}, {"process": 1 << 40}):
            with pytest.raises(OSError):
                RingReader(msgspec.structs.replace(descriptor, **change))


class Line:
    """An outlet and all subscriptions to it."""

    def __init__(self) -> None:
        self.handlers: list[Handler] = []
        self.sent = 0

    @property
    def wanted(self) -> bool:
        return bool(self.handlers)

    def put(self, payload: bytes) -> None:
        self.sent += 1
        for handler in self.handlers:
            handler(payload)

    def listen(self, handler: Handler) -> Subscription:
        self.handlers.append(handler)
        line = self

        class Listening:
            def close(self) -> None:
                line.handlers.remove(handler)

        return Listening()


class Pair:
    """A writer and its readers."""

    def __init__(self) -> None:
        self.descriptors, self.plain = Line(), Line()
        self.writer = BulkWriter(self.descriptors, self.plain)
        self.arrivals = 0

    def reader(self) -> BulkReader:
        return BulkReader(self.descriptors.listen, self.plain.listen, self._count)

    def _count(self) -> None:
        self.arrivals += 1


@pytest.fixture
def pair() -> Pair:
    return Pair()


class TestBulk:
    def test_nobody_costs_nothing(self, pair: Pair) -> None:
        pair.writer.put([b"x"])
        assert (pair.descriptors.sent, pair.plain.sent) == (0, 0)

    def test_a_reader_that_shares_memory_wants_no_bytes_any_more(self, pair: Pair) -> None:
        reader = pair.reader()
        for i in range(5):
            pair.writer.put([b"%d" % i])
            assert pair.arrivals > i
            assert reader.take() == b"%d" % i and reader.take() is None
        assert pair.plain.sent == 1

    def test_only_the_newest_is_taken(self, pair: Pair) -> None:
        reader = pair.reader()
        for i in range(2 * SLOTS):
            pair.writer.put([b"%d" % i])
        assert reader.take() == b"%d" % (2 * SLOTS - 1) and reader.take() is None

    def test_messages_grow(self, pair: Pair) -> None:
        reader = pair.reader()
        held = []
        for size in (0, 10, 10_000, 10, 1_000_000):
            pair.writer.put([b"x" * size])
            held.append(reader.take())
        assert [len(message or b"") for message in held] == [0, 10, 10_000, 10, 1_000_000]

    def test_without_shared_memory_bytes_come(self, pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delattr(os, "memfd_create")
        reader = pair.reader()
        for i in range(3):
            pair.writer.put([b"a", b"%d" % i])
            assert reader.take() == b"a%d" % i
        assert pair.writer.unshared == 3

    def test_a_reader_elsewhere_gets_bytes(self, pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
        def elsewhere(descriptor: SlotDescriptor) -> None:
            raise PermissionError

        here, there = pair.reader(), pair.reader()
        for i in range(3):
            pair.writer.put([b"%d" % i])
            assert here.take() == b"%d" % i
            with monkeypatch.context() as patch:
                patch.setattr("dsr.network.bulk.RingReader", elsewhere)
                assert there.take() == b"%d" % i

    def test_readers_that_hoard_make_the_others_wait_for_copies_and_not_the_writer(self, pair: Pair) -> None:
        hoarders = [pair.reader() for _ in range(SLOTS // 4)]
        reader = pair.reader()
        hoard, taken = [], []
        for i in range(10):
            pair.writer.put([b"%d" % i])
            hoard += [(i, hoarder.take()) for hoarder in hoarders]
            taken.append(reader.take())
        assert taken[-1] == b"9"
        assert all(message in (None, b"%d" % i) for i, message in hoard)
        del hoard
        for i in range(3):
            pair.writer.put([b"%d" % i])
            assert reader.take() == b"%d" % i

    def test_a_hoarder_cannot_use_up_the_rings_of_writers_that_take_turns(self, pair: Pair) -> None:
        reader, other = pair.reader(), BulkWriter(pair.descriptors, pair.plain)
        hoard = []
        for i in range(2 * SLOTS):
            for writer in (pair.writer, other):
                writer.put([b"%d" % i])
                hoard.append(reader.take())
        assert hoard == [b"%d" % (i // 2) for i in range(4 * SLOTS)]
        assert pair.writer.unshared == other.unshared == 0

    def test_malformed_descriptors_are_told_and_do_no_harm(self, pair: Pair) -> None:
        reader = pair.reader()
        for payload in (b"", b"garbage", msgspec.msgpack.encode([1, 2, 3])):
            pair.descriptors.put(payload)
            with pytest.raises(WireError, match="descriptor"):
                reader.take()
        pair.writer.put([b"x"])
        assert reader.take() == b"x"

    def test_after_closing_nothing_is_subscribed(self, pair: Pair) -> None:
        reader = pair.reader()
        reader.close()
        assert not pair.descriptors.wanted and not pair.plain.wanted


class Streams:
    """Writers of several streams, and who subscribes to all of them."""

    def __init__(self) -> None:
        self.lines: dict[str, list[MessageHandler]] = {}
        self.writers: dict[str, BulkWriter] = {}
        self.got: list[tuple[str, bytes | memoryview]] = []
        self.bytes_sent = 0

    def subscribe(self, key: str, handler: MessageHandler) -> Subscription:
        handlers = self.lines.setdefault(key, [])
        handlers.append(handler)

        class Listening:
            def close(self) -> None:
                if handler in handlers:
                    handlers.remove(handler)

        return Listening()

    def listen(self) -> BulkSubscription:
        return BulkSubscription(self.subscribe, "**", lambda key, payload: self.got.append((key, payload)))

    def put(self, stream: str, message: bytes) -> None:
        streams = self

        class Way:
            def __init__(self, pattern: str, key: str) -> None:
                self.pattern, self.key = pattern, key

            @property
            def wanted(self) -> bool:
                return bool(streams.lines.get(self.pattern))

            def put(self, payload: bytes) -> None:
                streams.bytes_sent += len(payload) * (self.pattern == "**")
                for handler in list(streams.lines[self.pattern]):
                    handler(self.key, payload)

        if stream not in self.writers:
            self.writers[stream] = BulkWriter(Way(descriptor_key("**"), descriptor_key(stream)), Way("**", stream))
        self.writers[stream].put([message])


class TestBulkSubscription:
    def test_every_message_of_every_stream_comes_once_and_in_place(self) -> None:
        streams = Streams()
        streams.listen()
        sent = [(f"camera_{i % 3}", b"%d" % i) for i in range(12)]
        for stream, message in sent:
            streams.put(stream, message)
        assert streams.got == sent
        assert all(isinstance(payload, memoryview) and payload.readonly for _, payload in streams.got)
        assert streams.bytes_sent == 0

    def test_streams_from_elsewhere_come_as_bytes_beside_those_in_place(self, monkeypatch: pytest.MonkeyPatch) -> None:
        streams = Streams()
        streams.put("elsewhere", b"nobody hears it")
        subscription = streams.listen()
        with monkeypatch.context() as patch:
            patch.delattr(os, "memfd_create")
            for i in range(3):
                streams.put("elsewhere", b"%d" % i)
        for i in range(3):
            streams.put("here", b"%d" % i)
            streams.put("elsewhere", b"again %d" % i)  # its writer can share by now
        assert streams.got[:3] == [("elsewhere", b"%d" % i) for i in range(3)]
        assert [message for stream, message in streams.got if stream == "here"] == [b"0", b"1", b"2"]
        assert [message for stream, message in streams.got[3:] if stream == "elsewhere"] == [
            b"again %d" % i for i in range(3)
        ]
        subscription.close()
        streams.put("here", b"too late")
        assert len(streams.got) == 9

    def test_bytes_that_overtake_their_descriptor_are_not_lost_and_not_doubled(self) -> None:
        streams = Streams()
        streams.listen()
        (plain,), (descriptors,) = streams.lines["**"], streams.lines[descriptor_key("**")]
        shared = msgspec.msgpack.encode(descriptor_of(ring := Ring(10), b"shared"))
        plain("here", b"shared")
        descriptors("here/@shm", shared)
        plain("there", b"copied")
        descriptors("there/@shm", msgspec.msgpack.encode(None))
        assert streams.got == [("here", b"shared"), ("there", b"copied")]
        assert ring.slot_size

    def test_malformed_descriptors_are_counted_and_do_no_harm(self) -> None:
        streams = Streams()
        subscription = streams.listen()
        for handler in streams.lines[descriptor_key("**")]:
            handler("here/@shm", b"nonsense")
        streams.put("here", b"good")
        assert streams.got == [("here", b"good")] and subscription.malformed == 1

    @pytest.mark.parametrize("length", [0, 1, 15, 17, 1 << 22])
    def test_an_identity_of_a_ring_that_no_ring_has_is_malformed(self, length: int) -> None:
        """Of 256 streams each kept one of any length. A part of one opened that ring anew."""
        streams, ring = Streams(), Ring(10)
        subscription = streams.listen()
        descriptor = descriptor_of(ring, b"x")
        told = descriptor.ring[:length].ljust(length, b"x")
        for handler in streams.lines[descriptor_key("**")]:
            handler("liar/@shm", msgspec.msgpack.encode(msgspec.structs.replace(descriptor, ring=told)))
        assert subscription.malformed == 1 and not streams.got
        assert not subscription._sources and not subscription._opened

    @pytest.mark.parametrize("turns", ["writers", "streams", "nothing shared"])
    def test_what_is_kept_holds_up_no_writer_whatever_comes_in_turns(self, turns: str) -> None:
        streams = Streams()
        streams.listen()
        (descriptors,) = streams.lines[descriptor_key("**")]
        rings = [Ring(10) for _ in range(2 if turns == "writers" else 1)]
        for i in range(2 * SLOTS):
            for ring in rings:
                name = f"camera_{i % 10 if turns == 'streams' else 0}/@shm"
                descriptors(name, msgspec.msgpack.encode(descriptor_of(ring, b"%d" % i)))
                if turns == "nothing shared":
                    descriptors(name, msgspec.msgpack.encode(None))
        assert [payload for _, payload in streams.got] == [b"%d" % i for i in range(2 * SLOTS) for _ in rings]

    def test_made_up_streams_take_no_memory_and_cost_no_other_stream_a_message(self) -> None:
        streams = Streams()
        subscription = streams.listen()
        (plain,), (descriptors,) = streams.lines["**"], streams.lines[descriptor_key("**")]
        streams.put("here", b"first")
        for i in range(10 * MOST_STREAMS):
            plain(f"made_up_{i}", b"never described")
            descriptors(f"empty_{i}/@shm", msgspec.msgpack.encode(None))
        assert (len(subscription._early), len(subscription._sources)) == (MOST_EARLY, MOST_STREAMS)
        streams.put("here", b"second")
        assert streams.got == [("here", b"first"), ("here", b"second")]

    def test_that_a_stream_cannot_be_shared_is_said_once(
        self, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        def elsewhere(descriptor: SlotDescriptor) -> None:
            raise PermissionError

        monkeypatch.setattr("dsr.network.bulk.RingReader", elsewhere)
        caplog.set_level("INFO")
        streams = Streams()
        streams.listen()
        for i in range(5):
            streams.put("there", b"%d" % i)
        assert [payload for _, payload in streams.got] == [b"%d" % i for i in range(5)]
        assert caplog.text.count("come by copies") == 1

    def test_what_is_kept_stays_and_holds_up_nobody(self) -> None:
        streams = Streams()
        streams.listen()
        for i in range(SLOTS):
            streams.put("here", b"%d" % i)
        assert [payload for _, payload in streams.got] == [b"%d" % i for i in range(SLOTS)]


def picture(stamp: float) -> dsr.Frame:
    color = np.full((480, 640, 3), int(stamp) % 251, np.uint8)
    return dsr.Frame(stamp, {"color": color, "depth": np.full((480, 640), stamp, np.float32)}, {})


@pytest.fixture
def link() -> Iterator[tuple[ZenohTransport, ZenohTransport]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        closing(ZenohTransport(endpoint)) as writer,
        closing(ZenohTransport(f"tcp/127.0.0.1:{free_port()}", [endpoint])) as reader,
    ):
        yield writer, reader


def test_frames_of_another_session_are_not_copied(link: tuple[ZenohTransport, ZenohTransport]) -> None:
    """The arrays lie in the mapped ring, own nothing, and take no memory of their own."""
    key = Keys("g").blob("camera")
    reader = FrameReader(link[1], key)
    stamp = 0.0

    def send() -> dsr.Frame:
        nonlocal stamp
        deadline = WALL_CLOCK.monotonic() + PATIENCE
        while WALL_CLOCK.monotonic() < deadline:
            stamp += 1.0
            link[0].publish_bulk(key, frame_chunks(picture(stamp)))
            frame = reader.wait(0.2)
            if frame is not None and frame.stamp == stamp:
                return frame
        raise AssertionError("no frame came")

    send()
    while reader._mailbox._plain is not None:  # type: ignore[attr-defined]
        send()
    frames = [send() for _ in range(3)]
    ring = np.frombuffer(reader._mailbox._source._ring._map, np.uint8)  # type: ignore[attr-defined]
    for frame in frames:
        for array in frame.arrays.values():
            assert np.shares_memory(array, ring) and not array.flags.owndata and not array.flags.writeable
            assert (array == array.flat[0]).all()
    sent = frame_chunks(picture(9e9))
    tracemalloc.start()
    link[0].publish_bulk(key, sent)
    frame = reader.wait(PATIENCE)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert frame is not None and frame.stamp == 9e9 and peak < 100_000
    reader.close()
    assert frames[0].arrays["color"].max() == frames[0].arrays["color"].min() == int(frames[0].stamp) % 251


def memfd(size: int, identity: bytes) -> int:
    descriptor = os.memfd_create("dsr-ring", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(descriptor, size)
    if size:
        os.pwrite(descriptor, identity, 0)
    fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
    return descriptor


@pytest.mark.parametrize("slot_size", [-mmap.PAGESIZE // SLOTS, 0, -1, MOST_BYTES + 1, 1 << 40], ids=str)
def test_rings_of_impossible_sizes_are_not_opened(slot_size: int) -> None:
    descriptor = memfd(mmap.PAGESIZE + SLOTS * slot_size, b"i" * 16)
    with pytest.raises(OSError, match="slots of"):
        RingReader(SlotDescriptor(os.getpid(), descriptor, b"i" * 16, slot_size, 0, 1, 0))
    os.close(descriptor)


def test_a_message_too_large_to_share_goes_by_copies() -> None:
    with pytest.raises(OSError, match="at most"):
        Ring(MOST_BYTES + 1)


def test_a_subscription_to_all_frames_shares_memory_with_another_session(
    link: tuple[ZenohTransport, ZenohTransport],
) -> None:
    """After the first frames none is sent as bytes, whatever its stream is."""
    keys, got = Keys("g"), list[tuple[str, int]]()
    subscription = link[1].subscribe_bulk(keys.blob("**"), lambda key, payload: got.append((key, len(payload))))
    cameras = [keys.blob("camera"), keys.blob("wrist/detections")]
    deadline, number = WALL_CLOCK.monotonic() + PATIENCE, 0
    while subscription._plain is not None or {key for key, _ in got} != set(cameras):
        assert WALL_CLOCK.monotonic() < deadline
        for key in cameras:
            link[0].publish_bulk(key, frame_chunks(picture(float(number))))
        number += 1
        WALL_CLOCK.wait(threading.Event(), 0.05)
    assert {length for _, length in got} == {sum(map(len, frame_chunks(picture(0.0))))}
    while any(link[0].is_heard(key, Qos.BULK) for key in cameras):
        assert WALL_CLOCK.monotonic() < deadline
        WALL_CLOCK.wait(threading.Event(), 0.05)
    subscription.close()
