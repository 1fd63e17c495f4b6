"""Refusals over real connections: no certificate, a wrong one, one that may not write, another agent's keys."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dsr
from dsr import AgentError, ConfigError, Frame, Memory, Mesh, MeshNotFoundError, TransportError
from dsr.clock import WALL_CLOCK
from dsr.connecting import open_transport
from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import START
from dsr.graph.graph import Graph
from dsr.network import rendezvous
from dsr.network.keys import Keys, descriptor_key
from dsr.network.transport import Transport
from dsr.network.zenoh_transport import ZenohTransport
from dsr.replication.piece_wire import Request, encode_request
from dsr.replication.wire import Digest, encode_delta, encode_digest
from dsr.runtime.status import State, Status, StatusBoard, encode_status
from dsr.security.authority import SecurityFolder
from dsr.security.configuration import zenoh_settings
from dsr.security.policy import AccessPolicy
from tests.dsr.security.conftest import DAY, make_folder

KEYS = Keys("g")
PATIENCE = 20.0
"""s: far beyond what is expected, because machines are shared."""
A_WHILE = 1.0
"""s in which a message that gets through arrives many times over."""


def eventually(condition: Callable[[], object]) -> bool:
    deadline = WALL_CLOCK.monotonic() + PATIENCE
    while not (holds := condition()) and WALL_CLOCK.monotonic() < deadline:
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return bool(holds)


def wait(seconds: float = A_WHILE) -> None:
    WALL_CLOCK.wait(threading.Event(), seconds)


@pytest.fixture
def join(keys: SecurityFolder) -> Iterator[Callable[..., Memory]]:
    memories: list[Memory] = []

    def start(agent: str) -> Memory:
        memories.append(dsr.connect("g", agent=agent, security=keys.path, timeout=PATIENCE))
        return memories[-1]

    yield start
    for memory in reversed(memories):
        memory.close()


class Intruder:
    """Listens to everything and tries everything, over a raw session that checks nothing itself.

    `agent` is who it says it is; what it is certified for is in `settings`.
    """

    def __init__(self, agent: str, settings: dict[str, Any], protocol: str = "tls") -> None:
        seed_peers = rendezvous.endpoints("g")
        own = {key: value for key, value in settings.items() if key != "access_control"}
        self.rid = f"{agent}-0badc0de"
        self.transport = ZenohTransport(f"{protocol}/127.0.0.1:{rendezvous.free_port()}", seed_peers, own)
        self.seen: set[str] = set()
        self.asked = threading.Event()
        self.declared = [
            self.transport.subscribe(f"{KEYS.root}/**", self._hear),
            self.transport.watch_presence(KEYS.live(), self._hear),
            self.transport.announce(KEYS.live(agent, self.rid)),
            self.transport.serve(KEYS.sync(self.rid), self._answer),
        ]

    def _hear(self, key: str, _: object) -> None:
        if self.rid not in key:
            self.seen.add(key)

    def _answer(self, _key: str, _payload: bytes) -> bytes:
        self.asked.set()
        return b"?"

    def write(self, *, rid: str | None = None) -> None:
        """A delta that adds a table, an arm and a cube."""
        graph = Graph(rid or self.rid)
        for type in ("table", "arm", "cube"):
            delta = graph.add_node(f"forged_{type}", type, {}, WALL_CLOCK.now())
            self.transport.publish(KEYS.delta(graph.rid), encode_delta(delta))

    def ask(self, replica: str) -> list[bytes]:
        """The answers of `replica` to a request for everything."""
        answers: list[bytes] = []
        done = threading.Event()
        request = encode_request(Request(self.rid, CausalContext(), START, insists=True))
        self.transport.request(
            KEYS.sync(replica), request, lambda _, reply: answers.append(reply), done.set, 2 * A_WHILE
        )
        assert done.wait(PATIENCE)
        return answers


@pytest.fixture
def intrude(policy: AccessPolicy) -> Iterator[Callable[..., Intruder]]:
    started: list[Transport] = []

    def start(agent: str, folder: SecurityFolder | None, **options: Any) -> Intruder:
        settings = zenoh_settings(folder, policy, agent) if folder else {}
        intruder = Intruder(agent, {**settings, **options.pop("settings", {})}, **options)
        started.append(intruder.transport)
        return intruder

    yield start
    for transport in started:
        transport.close()


Join = Callable[[str], Memory]
Intrude = Callable[..., Intruder]


def test_certified_agents_meet_write_and_leave(join: Join, keys: SecurityFolder) -> None:
    launcher, arm, scene = join("launcher"), join("arm"), join("scene")
    arm.add_node("gen3", "arm", status="idle")
    scene.add_node("cube", "cube", size=(1.0, 1.0, 1.0))
    everything = {"gen3", "cube"}
    for memory in (launcher, arm, scene):
        assert eventually(lambda memory=memory: {node.name for node in memory.nodes()} == everything)
    assert all(entry.startswith("tls/127.0.0.1:") for entry in rendezvous.endpoints("g"))
    arm.close()
    again = join("arm")
    assert {node.name for node in again.nodes()} == everything
    again.update_node("gen3", status="back")
    assert eventually(lambda: scene.node("gen3").get("status") == "back")


def test_frames_travel_through_shared_memory_as_without_security(join: Join) -> None:
    arm, reader = join("arm"), join("dsr")
    descriptors: list[str] = []
    reader.transport.subscribe(descriptor_key(KEYS.blob("camera")), lambda key, _: descriptors.append(key))
    frames = reader.frames("camera")
    image = np.full((480, 640, 3), 7, np.uint8)

    def arrives() -> bool:
        arm.put_frame("camera", Frame(1.0, {"color": image}, {}))
        frame = frames.latest()
        return frame is not None and bool((frame.arrays["color"] == image).all())

    assert eventually(arrives)
    assert eventually(lambda: descriptors)
    frames.close()


def test_meshes_are_had_from_whoever_has_them_also_by_readers(join: Join) -> None:
    arm, scene, reader = join("arm"), join("scene"), join("dsr")
    for memory in (arm, scene, reader):
        memory.meshes.store.disk = None
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    assert reader.mesh(arm.put_mesh(mesh), PATIENCE) == mesh
    with pytest.raises(MeshNotFoundError):  # what only a reader has, nobody has
        scene.mesh(reader.put_mesh(Mesh(mesh.vertices + 1, mesh.triangles)), A_WHILE)


# ---- no certificate, no entry


def no_certificate(keys: SecurityFolder, tmp_path: Path) -> dict[str, Any]:
    settings: dict[str, Any] = {"transport/link/tls": {"root_ca_certificate": str(keys.authority)}}
    other = make_folder(tmp_path / "other")  # it must have something to listen with
    settings["transport/link/tls"] |= {
        "listen_certificate": str(other.certificate("arm")), "listen_private_key": str(other.key("arm")),
    }  # fmt: skip
    return {"settings": settings}


def another_authority(keys: SecurityFolder, tmp_path: Path) -> dict[str, Any]:
    return {"folder": make_folder(tmp_path / "other")}


def another_authority_that_knows_ours(keys: SecurityFolder, tmp_path: Path) -> dict[str, Any]:
    other = make_folder(tmp_path / "other")
    shutil.copy(keys.authority, other.authority)
    return {"folder": other}


def expired(keys: SecurityFolder, tmp_path: Path) -> dict[str, Any]:
    shutil.copytree(keys.path, tmp_path / "old")
    old = SecurityFolder(tmp_path / "old")
    old.issue("arm", WALL_CLOCK.now() - 9 * DAY, days=8)
    return {"folder": old}


def plain_tcp(keys: SecurityFolder, tmp_path: Path) -> dict[str, Any]:
    return {"protocol": "tcp"}


def tell_and_look(launcher: Memory, intruder: Intruder) -> tuple[bool, bool]:
    """Whether the intruder gets something to know, and whether it changes something."""
    wait()
    launcher.transport.publish(KEYS.status("launcher"), b"")
    intruder.write()
    wait()
    knows = bool(intruder.seen or intruder.ask(launcher.rid))
    return knows, bool(launcher.nodes() or intruder.rid in launcher.peers or intruder.asked.is_set())


@pytest.mark.parametrize(
    "bring", [no_certificate, another_authority, another_authority_that_knows_ours, expired, plain_tcp]
)
def test_without_a_valid_certificate_nobody_sees_or_changes_anything(
    join: Join, intrude: Intrude, keys: SecurityFolder, tmp_path: Path, bring: Callable[..., dict[str, Any]]
) -> None:
    launcher = join("launcher")
    brought = bring(keys, tmp_path)
    assert tell_and_look(launcher, intrude("arm", brought.pop("folder", None), **brought)) == (False, False)


def test_with_a_valid_certificate_the_same_attempt_succeeds(join: Join, intrude: Intrude, keys: SecurityFolder) -> None:
    launcher = join("launcher")
    assert tell_and_look(launcher, intrude("arm", keys)) == (True, True)
    assert [node.name for node in launcher.nodes()] == ["forged_arm"]


def test_a_process_without_security_is_told_what_it_lacks(join: Join, monkeypatch: pytest.MonkeyPatch) -> None:
    join("launcher")
    with pytest.raises(ConfigError, match=r"graph 'g' is secured .* DSR_SECURITY"):
        dsr.connect("g", agent="arm")
    assert len(rendezvous.members("g")) == 1


def test_a_secured_process_does_not_join_a_graph_that_is_not(keys: SecurityFolder) -> None:
    with dsr.connect("g", agent="arm"), pytest.raises(ConfigError, match="is not secured"):
        dsr.connect("g", agent="scene", security=keys.path)


def test_unusable_certificates_are_refused_before_anything_is_opened(own_keys: SecurityFolder) -> None:
    own_keys.issue("arm", WALL_CLOCK.now() - 9 * DAY, days=8)
    with pytest.raises(ConfigError, match=r"arm\.pem expired on"):
        dsr.connect("g", agent="arm", security=own_keys.path)
    with pytest.raises(ConfigError, match=r"'stranger' has no certificate.*dsr security add"):
        dsr.connect("g", agent="stranger", security=own_keys.path)
    with pytest.raises(ConfigError, match="dsr security init"):
        dsr.connect("g", agent="arm", security=own_keys.path / "nothing")
    assert rendezvous.members("g") == []


def test_the_environment_names_the_folder(keys: SecurityFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DSR_SECURITY", str(keys.path))
    with dsr.connect("g", agent="arm"):
        assert rendezvous.endpoints("g")[0].startswith("tls/")


# ---- a reader cannot write


def test_a_reader_sees_everything_and_is_refused_every_write(join: Join) -> None:
    launcher, scene, reader = join("launcher"), join("scene"), join("dsr")
    scene.add_node("cube", "cube", mass=1.0)
    assert eventually(lambda: "cube" in reader)
    for write in (
        lambda: reader.add_node("mine", "cube"),
        lambda: reader.update_node("cube", mass=2.0),
        lambda: reader.remove_node("cube"),
        lambda: reader.add_edge("cube", "cube", "on"),
    ):
        with pytest.raises(AgentError, match="certificate of 'dsr' is read-only"):
            write()
    with pytest.raises(TransportError, match="read-only"):
        reader.put_frame("camera", Frame(0.0, {}, {}))
    with pytest.raises(TransportError, match="read-only"):
        reader.transport.publish(KEYS.device("arm/command"), b"go")
    wait(2 * A_WHILE)
    assert launcher.peers == [scene.rid] and reader.node("cube")["mass"] == 1.0


def test_a_reader_that_goes_around_the_library_changes_nothing(
    join: Join, intrude: Intrude, keys: SecurityFolder
) -> None:
    launcher, scene = join("launcher"), join("scene")
    devices: list[str] = []
    scene.transport.subscribe(KEYS.device("**"), lambda key, _: devices.append(key))
    reader = intrude("dsr", keys)
    scene.add_node("cube", "cube")
    assert eventually(lambda: KEYS.delta(scene.rid) in reader.seen and "cube" in launcher)
    reader.write()
    reader.write(rid="scene-0badc0de")
    reader.write(rid=scene.rid)
    reader.transport.publish(KEYS.device("arm/command"), b"go")
    digest = Digest(reader.rid, 1e12, CausalContext().summary(), 0, ())
    reader.transport.publish(KEYS.digest(reader.rid), encode_digest(digest))
    wait(2 * A_WHILE)
    for memory in (launcher, scene):
        assert [node.name for node in memory.nodes()] == ["cube"]
        assert reader.rid not in memory.peers and memory.dropped == {}
    assert devices == [] and not reader.asked.is_set()
    assert reader.ask(launcher.rid)  # it may read, though


def test_a_new_system_begins_although_a_reader_is_still_there(join: Join) -> None:
    first = join("launcher")
    reader = join("dsr")
    first.close()
    second, arm = join("launcher"), join("arm")
    arm.add_node("gen3", "arm")
    assert eventually(lambda: "gen3" in second and "gen3" in reader)


# ---- an agent writes only what it declares


def test_an_agent_cannot_use_the_keys_of_another(join: Join, intrude: Intrude, keys: SecurityFolder) -> None:
    launcher, scene = join("launcher"), join("scene")
    board = StatusBoard(launcher.transport, KEYS, WALL_CLOCK)
    heard: list[str] = []
    for key in (f"{KEYS.root}/**", descriptor_key(f"{KEYS.root}/**")):
        launcher.transport.subscribe(key, lambda key, _: heard.append(key))
    rogue = intrude("arm", keys)
    wait()
    rogue.write(rid="scene-0badc0de")
    rogue.write(rid=scene.rid)
    for agent in ("scene", "arm"):
        status = Status(agent=agent, rid=f"{agent}-1", pid=1, state=State.FAILED)
        rogue.transport.publish(KEYS.status(agent), encode_status(status))
        rogue.transport.publish(KEYS.log(agent), b"")
    rogue.transport.publish(KEYS.blob("camera/detections"), b"")
    rogue.transport.publish(descriptor_key(KEYS.blob("camera/detections")), b"")
    rogue.transport.publish(KEYS.truth(), b"")
    rogue.transport.publish(KEYS.device("arm/state"), b"")
    rogue.transport.publish(KEYS.device("arm/command"), b"")
    for agent in ("arm", "scene"):
        rogue.declared.append(rogue.transport.announce(KEYS.live(agent, "scene-0badc0de")))
        rogue.transport.announce(KEYS.live(agent, scene.rid)).close()
    rogue.declared.append(rogue.transport.serve(KEYS.sync(scene.rid), lambda *_: b"forged"))
    assert eventually(lambda: KEYS.device("arm/command") in heard)
    wait()
    assert board.agents() == ["arm"] and launcher.nodes() == []
    own = {KEYS.status("arm"), KEYS.log("arm"), KEYS.device("arm/command")}
    assert {key for key in heard if "/dig/" not in key} == own
    assert sorted(launcher.peers) == sorted([rogue.rid, scene.rid])
    reader = intrude("dsr", keys)
    wait()
    assert b"forged" not in reader.ask(scene.rid) != []


def test_undeclared_writes_are_refused_where_they_are_made(join: Join) -> None:
    arm = join("arm")
    with pytest.raises(AgentError, match=r"nodes of type 'cube', which it does not declare.*dsr security show"):
        arm.add_node("cube", "cube")
    with pytest.raises(AgentError, match="attribute 'mass'"):
        arm.add_node("gen3", "arm", mass=1.0)
    assert arm.nodes() == []


def test_undeclared_writes_of_a_rogue_are_dropped_and_the_others_agree(
    join: Join, keys: SecurityFolder, policy: AccessPolicy
) -> None:
    launcher, scene = join("launcher"), join("scene")
    scene.add_node("cube", "cube", mass=1.0)
    settings = {key: value for key, value in zenoh_settings(keys, policy, "arm").items() if key != "access_control"}
    endpoint = f"tls/127.0.0.1:{rendezvous.free_port()}"
    transport = ZenohTransport(endpoint, rendezvous.endpoints("g"), settings)
    with Memory("g", "arm", transport=transport, threaded=True) as rogue:  # neither guard nor gate
        rogue.wait_joined(PATIENCE)
        assert eventually(lambda: "cube" in rogue)
        rogue.update_node("cube", mass=99.0)
        rogue.add_node("gen3", "arm", mass=99.0, status="fine")
        rogue.add_node("cube_2", "cube")
        rogue.remove_node("cube")
        rogue.add_node("world", "world")
        expected = {"cube": {"mass": 1.0}, "gen3": {"status": "fine"}, "world": {}}
        late = join("scene")
        for memory in (launcher, scene, late):
            assert eventually(lambda memory=memory: {n.name: dict(n) for n in memory.nodes()} == expected)
            assert eventually(lambda memory=memory: context_of(memory) == context_of(rogue))
    transport.close()


def context_of(memory: Memory) -> dict[str, int]:
    return dict(memory._graph.store.context.vector)


def test_a_driver_without_a_memory_has_its_keys_too(join: Join, keys: SecurityFolder) -> None:
    launcher = join("launcher")
    heard: list[str] = []
    launcher.transport.subscribe(KEYS.device("**"), lambda key, _: heard.append(key))
    from dsr.connecting import identity_of

    transport, registration = open_transport("g", "arm-1", identity=identity_of("arm", keys.path))
    try:
        assert eventually(lambda: transport.publish(KEYS.device("arm/command"), b"") or heard)
        assert set(heard) == {KEYS.device("arm/command")}
    finally:
        registration.close()
        transport.close()


def test_a_relay_connects_machines_and_lets_nobody_pose_as_another(keys: SecurityFolder, policy: AccessPolicy) -> None:
    """Each agent on a machine of its own, all connected to a hub only; all of them route."""
    opened: list[ZenohTransport] = []
    ports = {agent: rendezvous.free_port() for agent in ("hub", "arm", "scene", "launcher")}
    for agent, port in ports.items():
        settings = {**zenoh_settings(keys, policy, agent), "mode": "router"}
        seed_peers = [] if agent == "hub" else [f"tls/127.0.0.1:{ports['hub']}"]
        if agent == "arm":
            del settings["access_control"]
        opened.append(ZenohTransport(f"tls/127.0.0.1:{port}", seed_peers, settings))
    _, arm, scene, launcher = opened
    heard: list[str] = []
    for transport in (scene, launcher):
        transport.subscribe(KEYS.delta(), lambda key, _: heard.append(key))

    def through() -> bool:
        for rid in ("scene-1", "launcher-1", "arm-1"):
            arm.publish(KEYS.delta(rid), b"")
        return heard.count(KEYS.delta("arm-1")) > 20

    assert eventually(through)
    assert set(heard) == {KEYS.delta("arm-1")}
    for transport in reversed(opened):
        transport.close()
