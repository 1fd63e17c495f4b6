"""The memory over real Zenoh sessions, in separate processes: joining, races, deaths, bad messages."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import dsr
from dsr.clock import WALL_CLOCK
from dsr.connecting import open_transport
from dsr.network import rendezvous
from dsr.network.zenoh_transport import ZenohTransport

ROOT = Path(__file__).parents[2]
PATIENCE = 20.0
"""s: far beyond what is expected, because machines are shared."""


class Peer:
    """A process that runs tests/dsr/peer.py."""

    def __init__(self, agent: str, graph: str = "g") -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.dsr.peer", graph, agent],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
        )  # fmt: skip
        self.hello = self._read()
        self.rid = self.hello["rid"]

    def _read(self) -> Any:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def send(self, name: str, *args: object, **arguments: object) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([name, {"args": args, **arguments}]) + "\n")
        self.process.stdin.flush()

    def do(self, name: str, *args: object, **arguments: object) -> Any:
        self.send(name, *args, **arguments)
        return self._read()

    def state(self) -> Any:
        return self.do("state")

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def peers() -> Iterator[Callable[[str], Peer]]:
    started: list[Peer] = []

    def start(agent: str) -> Peer:
        started.append(Peer(agent))
        return started[-1]

    yield start
    for peer in started:
        peer.process.send_signal(signal.SIGCONT)
        peer.kill()
        for stream in (peer.process.stdin, peer.process.stdout):
            assert stream is not None
            stream.close()


def eventually(condition: Callable[[], bool]) -> bool:
    """Whether `condition` comes true within `PATIENCE`."""
    deadline = WALL_CLOCK.monotonic() + PATIENCE
    pause = threading.Event()
    while not condition():
        if WALL_CLOCK.monotonic() > deadline:
            return False
        pause.wait(0.02)
    return True


def graph_of(peer: Peer) -> Any:
    state = peer.state()
    return state["nodes"], state["edges"]


def test_writes_reach_the_other_process_and_a_late_one_gets_all(peers: Callable[[str], Peer]) -> None:
    a, b = peers("a"), peers("b")
    a.do("add_node", "world", "world")
    a.do("many", prefix="n", count=1000)
    a.do("add_edge", "world", "n1", "RT", translation=[1, 2, 3])
    assert eventually(lambda: graph_of(b) == graph_of(a))
    late = peers("late")
    assert late.hello["joined"] and graph_of(late) == graph_of(a)
    assert a.state()["dropped"] == {}


def test_concurrent_writes_and_creations_converge(peers: Callable[[str], Peer]) -> None:
    a, b = peers("a"), peers("b")
    a.do("add_node", "world", "world")
    a.do("add_node", "cube", "cube")
    a.do("add_edge", "world", "cube", "RT", translation=[0, 0, 0])
    assert eventually(lambda: graph_of(b) == graph_of(a))
    for index in range(20):
        for offset, peer in enumerate((a, b)):
            peer.send("update_edge", "world", "cube", "RT", translation=[index, offset, 0])
            peer.send("update_node", "cube", **({"mass": index + 0.5} if offset else {"seen": index}))
            peer.send("add_node", f"n{index}", "ball" if offset else "cup")
        for peer in (a, b):
            for _ in range(3):
                peer._read()
    assert eventually(lambda: graph_of(b) == graph_of(a))
    a.send("remove_node", "n3")
    b.send("update_node", "n3", mass=1.0)
    assert a._read() is None
    b._read()  # None, or an error if it heard of the removal first
    assert eventually(lambda: graph_of(b) == graph_of(a))
    nodes, edges = graph_of(a)
    assert nodes["cube"] == ["cube", {"mass": 19.5, "seen": 19}] and "n3" not in nodes and len(nodes) == 21
    assert edges["('world', 'cube', 'RT')"][0][0] == 19


def test_the_first_process_dies_while_another_joins(peers: Callable[[str], Peer]) -> None:
    first, second = peers("first"), peers("second")
    first.do("many", prefix="n", count=300)
    assert eventually(lambda: len(second.state()["nodes"]) == 300)
    first.kill()
    third = peers("third")
    assert len(third.state()["nodes"]) == 300
    second.do("add_node", "after", "cube")
    assert eventually(lambda: "after" in third.state()["nodes"])
    assert eventually(lambda: second.state()["peers"] == [third.rid])


def test_a_stopped_process_blocks_nobody_and_catches_up(peers: Callable[[str], Peer]) -> None:
    a, b, stopped = peers("a"), peers("b"), peers("stopped")
    assert eventually(lambda: len(a.state()["peers"]) == 2)
    stopped.process.send_signal(signal.SIGSTOP)
    for index in range(5):
        a.do("many", prefix=f"n{index}_", count=200)
    assert eventually(lambda: len(b.state()["nodes"]) == 1000)
    stopped.process.send_signal(signal.SIGCONT)
    assert eventually(lambda: len(stopped.state()["nodes"]) == 1000)


@pytest.mark.parametrize("endpoint", ["bogus", "tcp/127.0.0.1", "tcp/a.b:99999", "tcp/127.0.0.1:22x", "tcp/:7447"])
def test_a_malformed_endpoint_is_told(endpoint: str) -> None:
    for listen, connect in ((endpoint, []), ("tcp/127.0.0.1:0", [endpoint])):
        with pytest.raises(dsr.ConfigError, match=f"endpoint '{endpoint}': expected PROTOCOL/HOST:PORT"):
            ZenohTransport(listen, connect)


def test_malformed_messages_on_every_key_are_dropped(peers: Callable[[str], Peer]) -> None:
    a, b = peers("a"), peers("b")
    b.do("add_node", "x", "cube")
    for key in ("d", "rt", "dig"):
        a.do("raw", key=f"dsr/v1/g/{key}/evil", payload="c1ffff")
    for key in ("blob/camera", "status/x", "log/x", "live/x/y", "truth", "nonsense"):
        a.do("raw", key=f"dsr/v1/g/{key}", payload="c1ffff")
    assert eventually(lambda: b.state()["dropped"] == {"evil": 3})
    b.do("add_node", "y", "cube")
    assert eventually(lambda: set(a.state()["nodes"]) == {"x", "y"})


def test_a_port_in_use_is_a_clear_error() -> None:
    endpoint = f"tcp/127.0.0.1:{rendezvous.free_port()}"
    first = ZenohTransport(endpoint)
    with pytest.raises(dsr.TransportError, match="in use"):
        ZenohTransport(endpoint)
    first.close()


def test_a_peer_that_listens_later_is_reached() -> None:
    endpoint, own = (f"tcp/127.0.0.1:{rendezvous.free_port()}" for _ in range(2))
    received = threading.Event()
    with contextlib.closing(ZenohTransport(own, [endpoint])) as early:
        early.subscribe("dsr/test", lambda _key, _payload: received.set())
        with contextlib.closing(ZenohTransport(endpoint)) as late:

            def arrives() -> bool:
                late.publish("dsr/test", b"x")
                return received.is_set()

            assert eventually(arrives)


def test_frames_under_a_wildcard_are_refused() -> None:
    with dsr.connect("g", agent="a") as memory, pytest.raises(dsr.TransportError, match="wildcards"):
        memory.put_frame("*", dsr.Frame(1.0, {}, {}))


def test_what_comes_on_a_pattern_is_dropped() -> None:
    """Zenoh sends on patterns and announces them. Whoever asked such a sender would ask all who match."""
    endpoint = f"tcp/127.0.0.1:{rendezvous.free_port()}"
    heard: set[str] = set()
    with (
        contextlib.closing(ZenohTransport(endpoint)) as reader,
        contextlib.closing(ZenohTransport("tcp/127.0.0.1:0", [endpoint])) as liar,
    ):
        declared = [
            reader.subscribe("g/d/*", lambda key, _payload: heard.add(key)),
            reader.watch_presence("g/live/*", lambda key, _alive: heard.add(key)),
            *(liar.announce(f"g/live/{name}") for name in ("*", "a$*", "a-1")),
        ]

        def arrive() -> bool:
            for name in ("*", "a$*"):
                liar._session.put(f"g/d/{name}", b"as many")
            liar.publish("g/d/a-1", b"as one")
            return heard >= {"g/d/a-1", "g/live/a-1"}

        assert eventually(arrive) and eventually(arrive)
        assert heard == {"g/d/a-1", "g/live/a-1"} and len(declared) == 5


def test_long_answers_are_not_given_to_a_pattern() -> None:
    """One short message would have everybody answer at length; holders and meshes are asked for by patterns."""
    endpoint = f"tcp/127.0.0.1:{rendezvous.free_port()}"
    with (
        contextlib.closing(ZenohTransport(endpoint)) as server,
        contextlib.closing(ZenohTransport("tcp/127.0.0.1:0", [endpoint])) as liar,
    ):
        served = [
            server.serve("g/sync/a-1", lambda _key, payload: payload, asker=lambda _payload: "me"),
            server.serve("g/holders/a-1", lambda _key, payload: payload),
        ]
        heard: set[str] = set()

        def ask(key: str) -> bool:
            done = threading.Event()
            liar.request(key, b"?", lambda place, _reply: heard.add(place), done.set, 5.0)
            return done.wait(5.0)

        assert eventually(lambda: ask("g/sync/a-1") and "g/sync/a-1" in heard)
        heard.clear()
        assert ask("g/sync/*") and ask("g/*/a-1") and len(served) == 2
        assert heard == {"g/holders/a-1"}, "and who asks in vain learns that at once"


def test_nothing_is_left_behind() -> None:
    with dsr.connect("tidy", agent="a") as memory:
        assert rendezvous.graphs() == ["tidy"] and memory.joined
    assert rendezvous.graphs() == [] and list(rendezvous.runtime_dir().rglob("*")) == []


def test_the_file_of_a_dead_process_is_removed(peers: Callable[[str], Peer]) -> None:
    dead = peers("a")
    assert len(rendezvous.endpoints("g")) == 1
    dead.kill()
    assert rendezvous.endpoints("g") == [] and rendezvous.graphs() == []


def test_three_that_start_at_once_find_each_other() -> None:
    """Each runs in a process of its own and adds a node; the order of their connections is a matter of luck."""
    program = (
        "import dsr, sys\nm = dsr.connect('trio', agent=sys.argv[1])\nm.add_node(sys.argv[1], 'cube')\n"
        "print('in', flush=True)\nfor c in m.watch():\n    if len(m.nodes()) == 3: break\n"
        "print('all', flush=True)\nsys.stdin.read()"
    )
    started = [
        subprocess.Popen(
            [sys.executable, "-c", program, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        for name in "abc"
    ]
    try:
        for process in started:
            assert process.stdout is not None
            assert [process.stdout.readline() for _ in range(2)] == ["in\n", "all\n"]
    finally:
        for process in started:
            process.kill()
            process.communicate()


def test_a_stopped_process_does_not_keep_others_from_joining(peers: Callable[[str], Peer]) -> None:
    a, stopped = peers("a"), peers("stopped")
    a.do("add_node", "x", "cube")
    stopped.process.send_signal(signal.SIGSTOP)
    assert set(peers("late").state()["nodes"]) == {"x"}


def test_newcomers_do_not_take_each_other_for_the_graph_while_the_elder_is_stopped(
    peers: Callable[[str], Peer],
) -> None:
    seed_peer = peers("seed_peer")
    seed_peer.do("many", count=1000, prefix="n")
    seed_peer.process.send_signal(signal.SIGSTOP)
    outcomes: list[object] = []

    def join(agent: str, timeout: float) -> None:
        try:
            with dsr.connect("g", agent, timeout=timeout) as memory:
                outcomes.append(len(memory.nodes()))
        except dsr.TransportError as error:
            outcomes.append(str(error))

    threads = [threading.Thread(target=join, args=(f"new{number}", 2.0)) for number in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(outcomes) == 2 and all(seed_peer.rid in str(outcome) for outcome in outcomes), outcomes
    patient = threading.Thread(target=join, args=("patient", PATIENCE))
    patient.start()
    patient.join(0.5)  # before Zenoh gives its first attempt to connect up, after 1 s
    seed_peer.process.send_signal(signal.SIGCONT)
    patient.join()
    assert outcomes[2:] == [1000]
    seed_peer.process.send_signal(signal.SIGSTOP)
    with dsr.connect("g", "alone", timeout=1.0, begin=True) as memory:
        assert memory.joined and not memory.nodes()


def test_a_queue_of_requests_answers_the_newest_of_each_and_ends_with_its_declaration() -> None:
    begin, go = threading.Event(), threading.Event()
    answered: list[bytes] = []
    endpoint = f"tcp/127.0.0.1:{rendezvous.free_port()}"

    def answer(key: str, payload: bytes) -> bytes:
        begin.set()
        go.wait(PATIENCE)
        answered.append(payload)
        return payload

    with contextlib.closing(ZenohTransport(endpoint)) as server, contextlib.closing(
        ZenohTransport(f"tcp/127.0.0.1:{rendezvous.free_port()}", [endpoint])
    ) as client:
        declared = server.serve("dsr/v1/g/sync/x", answer, asker=lambda payload: payload[:1].decode())
        done: list[int] = []

        def ask(payload: bytes) -> None:
            client.request("dsr/v1/g/sync/x", payload, lambda *_: None, lambda: done.append(1), 10.0)

        def begins() -> bool:
            ask(b"0")
            return begin.wait(0.1)

        assert eventually(begins)
        WALL_CLOCK.wait(threading.Event(), 0.5)
        for payload in (b"a1", b"a2", b"b1", b"a3"):
            ask(payload)
            WALL_CLOCK.wait(threading.Event(), 0.2)
        go.set()
        assert eventually(lambda: b"b1" in answered)
        assert [payload for payload in answered if payload != b"0"] == [b"a3", b"b1"]
        declared.close()


def test_a_process_without_a_memory_is_no_reason_to_wait() -> None:
    transport, registration = open_transport("g", "plant-1")
    with dsr.connect("g", agent="a", timeout=PATIENCE) as memory:
        assert memory.joined and [member.has_memory for member in rendezvous.members("g")] == [False, True]
    registration.close()
    transport.close()


def test_the_last_to_know_dies_while_another_joins() -> None:
    """It is registered, but never to be reached: then the graph begins anew."""
    registration = rendezvous.Registration("g", "dead-1", f"tcp/127.0.0.1:{rendezvous.free_port()}", has_memory=True)
    threading.Timer(0.3, registration.close).start()
    with dsr.connect("g", agent="a", timeout=PATIENCE) as memory:
        assert memory.joined and memory.peers == []


def test_an_interrupt_while_joining_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(dsr.Memory, "wait_joined", interrupt)
    with pytest.raises(KeyboardInterrupt):
        dsr.connect("g", agent="a")
    assert list(rendezvous.runtime_dir().rglob("*")) == []


def test_a_runtime_folder_that_cannot_be_used_is_a_clear_error(private_runtime_dir: Path) -> None:
    (rendezvous.runtime_dir() / "g").write_text("a file, not a folder")
    with pytest.raises(dsr.TransportError, match="runtime folder"):
        dsr.connect("g", agent="a")


def test_a_forked_child_does_not_touch_its_parents_connection() -> None:
    with dsr.connect("g", agent="a") as memory:
        child = os.fork()
        if child == 0:
            status = 1
            with contextlib.suppress(BaseException):
                try:
                    memory.add_node("x", "cube")
                except dsr.TransportError:
                    memory.close()
                    status = 0
            os._exit(status)
        assert os.waitpid(child, 0)[1] == 0
        assert [member.rid for member in rendezvous.members("g")] == [memory.rid]


@pytest.mark.parametrize("name", ["", "..", ".", "a/b", "x" * 65, "a b", "a*"])
def test_names_that_cannot_be_keys_are_refused(name: str) -> None:
    with pytest.raises(dsr.ConfigError, match="expected 1 to 64"):
        dsr.connect(name, agent="a")
    with pytest.raises(dsr.ConfigError, match="agent name"):
        dsr.connect("g", agent=name)


def test_a_program_that_forgets_to_close_ends_and_its_last_write_arrives(peers: Callable[[str], Peer]) -> None:
    a = peers("a")
    program = "import dsr; dsr.connect('g', agent='hasty').add_node('last', 'cube')"
    command = [sys.executable, "-c", program]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert eventually(lambda: "last" in a.state()["nodes"])


@pytest.mark.parametrize("routing", [False, True])
def test_what_is_declared_again_works_as_before(routing: bool) -> None:
    hub_port = rendezvous.free_port()
    hub = ZenohTransport(f"tcp/127.0.0.1:{hub_port}", routing=routing)
    other = ZenohTransport(f"tcp/127.0.0.1:{rendezvous.free_port()}", [f"tcp/127.0.0.1:{hub_port}"], routing=routing)
    heard: list[bytes] = []
    answers: list[bytes] = []
    wanted = [hub.subscribe("a/*", lambda _, payload: heard.append(payload)), hub.serve("s", lambda _, p: p + b"!")]
    for number in range(3):
        hub.renew()

        def arrives(message: bytes = b"%d" % number) -> bool:
            other.publish("a/b", message)
            other.request("s", message, lambda _, reply: answers.append(reply), lambda: None, 1.0)
            return message in heard and message + b"!" in answers

        assert eventually(arrives)
    wanted[0].close()
    hub.renew()
    assert len(wanted) == 2
    other.close()
    hub.close()
