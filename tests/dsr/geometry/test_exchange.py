"""Meshes between replicas: asked for when wanted, from whoever has them, verified; on an in-memory network and live."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import dsr
from dsr import Faults, LocalNetwork, ManualClock, Memory, MeshError, MeshNotFoundError
from dsr.errors import WireError
from dsr.geometry import Mesh
from dsr.geometry.exchange import MOST_KEPT
from dsr.geometry.mesh import MOST_BYTES
from dsr.geometry.messages import MOST_ASKED, AskForMesh, Offer, decode_ask, decode_offer, encode_ask, encode_offer
from dsr.geometry.shared import SharedBytes, SharedPlace, read_in_place
from dsr.geometry.store import MeshStore
from dsr.geometry.transfer import PATIENCE
from dsr.network.keys import Keys
from tests.dsr.geometry.shapes import block, cloud

LARGE = 120_000  # vertices: several pieces
HOLDER = """
import sys, dsr
from tests.dsr.geometry.shapes import cloud
with dsr.connect("g", "holder") as memory:
    print(memory.put_mesh(cloud(int(sys.argv[1]))), flush=True)
    sys.stdin.read()
    print(memory.meshes.statistics.sent, flush=True)
"""


class Net:
    """Memories in lockstep."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock, seed=3)
        self.memories: list[Memory] = []

    def join(self, name: str) -> Memory:
        memory = Memory("g", name, transport=self.network.connect(name), clock=self.clock, rid=name)
        self.memories.append(memory)
        return memory

    def pump(self, seconds: float = 0.5) -> None:
        for _ in range(round(seconds / 0.05)):
            self.clock.advance(0.05)
            self.network.deliver()
            for memory in self.memories:
                memory.poll()

    def liar(self, name: str, answer: Callable[[AskForMesh], bytes | None]) -> None:
        """Somebody who answers for meshes as he likes."""
        self.network.connect(name).serve(Keys("g").mesh(name), lambda _, payload: answer(decode_ask(payload)))

    def pull(self, memory: Memory, hash: str, seconds: float = 20.0) -> Mesh | None:
        for _ in range(round(seconds / 0.5)):
            if (mesh := memory.get_mesh(hash)) is not None:
                return mesh
            self.pump()
        return None


@pytest.fixture
def net() -> Net:
    return Net()


class TestInLockstep:
    def test_nothing_is_sent_before_somebody_asks_and_then_once(self, net: Net) -> None:
        holder, *readers = (net.join(name) for name in ("holder", "r1", "r2", "r3"))
        mesh = cloud(LARGE)
        hash = holder.put_mesh(mesh)
        net.pump()
        assert holder.meshes.statistics.sent == 0
        for count, reader in enumerate(readers[:2], start=1):
            assert net.pull(reader, hash) == mesh
            assert net.pull(reader, hash) is reader.get_mesh(hash)
            sent = sum(memory.meshes.statistics.sent for memory in net.memories)
            assert sent == count * mesh.nbytes == sum(memory.meshes.statistics.received for memory in readers)
        assert holder.put_mesh(cloud(LARGE)) == hash
        assert net.pull(readers[0], hash) == mesh
        assert sum(memory.meshes.statistics.sent for memory in net.memories) == 2 * mesh.nbytes

    def test_it_comes_from_another_who_has_it_when_the_first_has_left(self, net: Net) -> None:
        first, second = net.join("first"), net.join("second")
        hash = first.put_mesh(block())
        assert net.pull(second, hash) == block()
        first.close()
        first.transport.close()
        net.memories.remove(first)
        assert net.pull(net.join("third"), hash) == block()
        assert second.meshes.statistics.sent == block().nbytes

    def test_a_source_that_leaves_half_way_is_replaced(self, net: Net) -> None:
        mesh = cloud(LARGE)
        pieces = []

        def stop_after_one(ask: AskForMesh) -> bytes | None:
            if ask.length == 0:
                return encode_offer(Offer(mesh.nbytes))
            pieces.append(ask.offset)
            return bytes(mesh.data[ask.offset : ask.offset + ask.length]) if len(pieces) == 1 else None

        net.liar("a", stop_after_one)
        net.join("b").put_mesh(mesh)
        reader = net.join("reader")
        assert net.pull(reader, mesh.hash) == mesh
        assert pieces and reader.meshes.statistics.received == mesh.nbytes + MOST_ASKED

    def test_a_source_that_falls_silent_is_counted(self, net: Net) -> None:
        mesh = block()
        net.liar("a", lambda ask: encode_offer(Offer(mesh.nbytes)) if ask.length == 0 else None)
        reader = net.join("reader")
        assert net.pull(reader, mesh.hash) is None
        assert reader.meshes.statistics.silent >= 1

    def test_sources_that_never_answer_hold_nobody_up(self, net: Net) -> None:
        mesh = block()
        for number in range(10):
            net.liar(f"a-{number}", lambda ask: encode_offer(Offer(MOST_BYTES)) if ask.length == 0 else None)
        net.join("b-0").put_mesh(mesh)
        reader = net.join("reader")
        begin = net.clock.monotonic()
        assert net.pull(reader, mesh.hash) == mesh
        assert net.clock.monotonic() - begin <= 8 * PATIENCE + 1.0

    def test_what_others_want_kept_holds_up_nobody_here(self, net: Net) -> None:
        mesh, reader = block(), net.join("reader")
        net.liar("a", lambda ask: None)
        asker = net.network.connect("b")
        for number in range(2 * MOST_KEPT):
            payload = encode_ask(AskForMesh(f"{number:064x}", keep=True))
            asker.request(Keys("g").mesh("reader"), payload, lambda *_: None, lambda: None, 1.0)
        net.pump()
        assert len(reader.meshes._transfers) == MOST_KEPT
        net.join("holder").put_mesh(mesh)
        assert net.pull(reader, mesh.hash, seconds=3.0) == mesh

    @pytest.mark.parametrize("wrong", ["other bytes", "short", "nonsense", "huge"])
    def test_wrong_bytes_are_dropped_and_counted_and_another_is_asked(self, net: Net, wrong: str) -> None:
        mesh, other = block(), block(2.0)

        def lie(ask: AskForMesh) -> bytes | None:
            if wrong == "nonsense":
                return b"\xc1nonsense"
            if ask.length == 0:
                return encode_offer(Offer(1 << 40 if wrong == "huge" else mesh.nbytes))
            return bytes(other.data) if wrong == "other bytes" else b"short"

        net.liar("a", lie)
        net.join("b").put_mesh(mesh)
        reader = net.join("reader")
        assert net.pull(reader, mesh.hash) == mesh
        statistics = reader.meshes.statistics
        assert (statistics.mismatched, statistics.malformed) == ((1, 0) if wrong == "other bytes" else (0, 1))

    def test_from_liars_alone_nothing_comes_and_it_is_had_when_somebody_honest_joins(self, net: Net) -> None:
        for name in ("a", "b"):
            net.liar(name, lambda ask: bytes(ask.length) or encode_offer(Offer(block().nbytes)))
        reader = net.join("reader")
        assert net.pull(reader, block().hash) is None
        assert reader.meshes.statistics.mismatched >= 2
        net.join("honest").put_mesh(block())
        assert net.pull(reader, block().hash) == block()

    def test_losses_are_made_up_for(self, net: Net) -> None:
        mesh = cloud(LARGE)
        net.join("holder").put_mesh(mesh)
        reader = net.join("reader")
        net.network.faults = Faults(loss=0.05, duplication=0.2, delay=(0.0, 0.1))
        assert net.pull(reader, mesh.hash, 200.0) == mesh

    def test_without_threads_waiting_tells_at_once(self, net: Net) -> None:
        net.join("holder").put_mesh(block())
        reader = net.join("reader")
        with pytest.raises(MeshNotFoundError, match=block().hash):
            reader.mesh(block().hash)
        net.pump()
        assert reader.mesh(block().hash) == block()

    @pytest.mark.parametrize("text", ["", "../../etc/passwd", "0" * 63, "G" * 64])
    def test_what_is_no_hash_is_refused(self, net: Net, text: str) -> None:
        memory = net.join("m")
        for get in (memory.mesh, memory.get_mesh):
            with pytest.raises(MeshError, match="no hash"):
                get(text)

    def test_what_nobody_has_is_asked_for_less_and_less(self, net: Net) -> None:
        asked: list[float] = []
        net.liar("a", lambda ask: asked.append(net.clock.now()))
        reader = net.join("reader")
        for _ in range(120):
            assert reader.get_mesh("0" * 64) is None
            net.pump()
        pauses = [after - before for before, after in itertools.pairwise(asked)]
        assert len(asked) <= 10 and max(pauses) <= 14.0 and pauses[-1] > pauses[0]
        net.join("late").put_mesh(block())
        assert net.pull(reader, block().hash) == block()

    def test_endless_names_of_meshes_are_not_all_asked_for(self, net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("dsr.geometry.exchange.MOST_WANTED", 20)
        reader = net.join("reader")
        for number in range(200):
            assert reader.get_mesh(f"{number:064x}") is None
            assert len(reader.meshes._transfers) <= 20
        net.join("holder").put_mesh(block())
        assert net.pull(reader, block().hash, 200.0) == block()

    def test_requests_that_make_no_sense_are_counted(self, net: Net) -> None:
        holder = net.join("holder")
        holder.put_mesh(block())
        other = net.network.connect("other")
        replies: list[bytes] = []
        for payload in (b"", b"\xc1", encode_ask(AskForMesh("x")), encode_ask(AskForMesh(block().hash, -1, 5)),
                        encode_ask(AskForMesh(block().hash, 0, MOST_ASKED + 1))):  # fmt: skip
            other.request(holder.keys.mesh("holder"), payload, lambda _, r: replies.append(r), lambda: None, 1.0)
        net.pump()
        assert replies == [] and holder.meshes.statistics.malformed == 5

    def test_two_runs_are_equal(self) -> None:
        def run() -> list[object]:
            net = Net()
            net.join("holder").put_mesh(cloud(1000))
            readers = [net.join(f"r{k}") for k in range(3)]
            net.network.faults = Faults(loss=0.2, delay=(0.0, 0.2))
            for _ in range(50):
                for reader in readers:
                    reader.get_mesh(cloud(1000).hash)
                net.pump()
            return [reader.meshes.statistics for reader in readers]

        assert run() == run()


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "mine"))
    return tmp_path / "mine"


@contextlib.contextmanager
def holder(vertices: int, cache: Path) -> Iterator[subprocess.Popen[str]]:
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(Path(__file__).parents[3])}
    command = [sys.executable, "-c", HOLDER, str(vertices)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, env=environment, **pipes) as process:  # type: ignore[call-overload]
        try:
            assert process.stdout.readline().strip() == cloud(vertices).hash
            yield process
        finally:
            process.kill()


class TestLive:
    def test_it_is_read_in_the_memory_of_its_holder(self, own_cache: Path, tmp_path: Path) -> None:
        mesh = cloud(LARGE)
        with holder(LARGE, tmp_path / "theirs") as process, dsr.connect("g", "reader") as memory:
            assert memory.mesh(mesh.hash, 20.0) == mesh
            assert memory.meshes.statistics.in_place == mesh.nbytes and memory.meshes.statistics.received == 0
            assert process.communicate("")[0].strip() == "0"
            assert memory.mesh(mesh.hash) == mesh

    def test_it_comes_in_pieces_where_memory_is_not_shared(
        self, own_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def elsewhere(place: SharedPlace) -> memoryview:
            raise OSError("another machine")

        monkeypatch.setattr("dsr.geometry.transfer.read_in_place", elsewhere)
        mesh = cloud(LARGE)
        with holder(LARGE, tmp_path / "theirs") as process, dsr.connect("g", "reader") as memory:
            assert memory.mesh(mesh.hash, 20.0) == mesh
            assert memory.meshes.statistics.received == mesh.nbytes
            assert process.communicate("")[0].strip() == str(mesh.nbytes)
        with dsr.connect("g", "later") as memory:
            assert memory.mesh(mesh.hash, 0.0) == mesh  # from disk
            assert memory.meshes.statistics.received == 0

    def test_nobody_has_it(self, own_cache: Path) -> None:
        with dsr.connect("g", "reader") as memory, pytest.raises(MeshNotFoundError, match="within"):
            memory.mesh("0" * 64, 0.7)

    def test_it_is_had_as_soon_as_somebody_has_it(self, own_cache: Path, tmp_path: Path) -> None:
        with dsr.connect("g", "reader") as memory:
            assert memory.get_mesh(cloud(10).hash) is None
            with holder(10, tmp_path / "theirs"):
                assert memory.mesh(cloud(10).hash, 20.0) == cloud(10)

    def test_who_leaves_sees_to_it_that_somebody_has_it(self, own_cache: Path) -> None:
        with dsr.connect("g", "stays") as stays:
            stays.meshes.store.disk = None
            with dsr.connect("g", "leaves") as leaves:
                leaves.meshes.store.disk = None
                hash = leaves.put_mesh(cloud(10))
                leaves.meshes.hand_over([hash], leaves.peers, 20.0)
                with pytest.raises(MeshNotFoundError, match="nobody else took"):
                    leaves.meshes.hand_over([leaves.put_mesh(block())], [], 0.0)
            assert stays.mesh(hash, 0.0) == cloud(10)


class TestSharedBytes:
    def test_they_outlive_their_holder(self) -> None:
        shared = SharedBytes(b"content")
        view = read_in_place(shared.place)
        del shared
        assert view == b"content" and view.readonly

    @pytest.mark.parametrize("place", [(1, 0, 7), (os.getpid(), 1 << 30, 7), (-1, -1, 7), (1 << 40, 0, 7)])
    def test_elsewhere_is_nothing(self, place: tuple[int, int, int]) -> None:
        with pytest.raises(OSError, match=r".+"):
            read_in_place(SharedPlace(*place))

    def test_another_file_or_length_is_refused(self, tmp_path: Path) -> None:
        with (tmp_path / "secret").open("w") as file, pytest.raises(OSError, match="no shared bytes"):
            read_in_place(SharedPlace(os.getpid(), file.fileno(), 1))
        shared = SharedBytes(b"content")
        for length in (0, -1, 6, 8):
            with pytest.raises(OSError, match="has not"):
                read_in_place(SharedPlace(os.getpid(), shared.place.descriptor, length))

    def test_what_could_change_is_refused(self) -> None:
        descriptor = os.memfd_create("dsr-blob", os.MFD_CLOEXEC)
        os.write(descriptor, b"content")
        with pytest.raises(OSError, match="could change"):
            read_in_place(SharedPlace(os.getpid(), descriptor, 7))
        os.close(descriptor)


def test_messages_survive_the_wire() -> None:
    ask, offer = AskForMesh("0" * 64, 3, 5, True), Offer(7, SharedPlace(1, 2, 7))
    assert decode_ask(encode_ask(ask)) == ask and decode_offer(encode_offer(offer)) == offer
    with pytest.raises(WireError):
        decode_offer(b"\x91\xff")


def test_a_store_may_be_given(net: Net) -> None:
    from dsr.geometry.exchange import MeshExchange

    store = MeshStore()
    store.put(block())
    transport = net.network.connect("x")
    exchange = MeshExchange(transport, Keys("g"), "x", net.clock, threaded=False, store=store)
    assert net.pull(net.join("reader"), block().hash) == block()
    exchange.close()
