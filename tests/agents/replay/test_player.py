"""Playing: speed, pause and seek, as those see it who follow the graph."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from agents.replay import ReplayedGraph
from agents.replay.mirror import GraphMirror
from agents.replay.player import Player
from dsr import Alternative, AttributeType, Frame, Memory, Mesh, Pose, Schema, Whereabouts
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.believing.distribution import encoded
from dsr.clock import ManualClock
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.runtime.status import State, Status, StatusBoard, encode_status
from tests.agents.replay.conftest import KEYS, Studio, state


class Theatre:
    """A player and an audience of one on a network in memory."""

    def __init__(self, path: Path, **options: float) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.audience = self.join("audience")
        stage = self.join("replay")
        self.stage = stage
        self.source = ReplayedGraph(path)
        self.player = Player(self.source, stage, **options)
        self.deliver()

    def join(self, name: str) -> Memory:
        memory = Memory("replay", name, transport=self.network.connect(name), clock=self.clock)
        memory.replica.synchroniser.joined = True
        return memory

    def deliver(self) -> None:
        self.stage.flush()
        self.network.deliver()
        self.audience.poll()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.02)):
            self.player.step(self.clock.monotonic())
            self.deliver()
            self.clock.advance(0.02)


def test_alternatives_of_the_belief_are_worlds_again(studio: Studio) -> None:
    memory = studio.memory
    memory.add_node("world", "world")
    memory.add_node("ball", "ball")
    memory.add_edge("world", "ball", "Virtual_RT", pose=Pose((0.1, 0.0, 0.0)))
    studio.run(1.0)
    alternatives = (
        Alternative(weight=0.7, pose=Pose((0.1, 0.0, 0.0))),
        Alternative(weight=0.3, pose=None, reason="gone", worlds=(1,)),
    )
    memory.update_node("ball", **{WHEREABOUTS: encoded(Whereabouts("ball", alternatives, ("ball",), (0.7, 0.3)))})
    studio.run(1.0)
    memory.update_node("ball", **{WHEREABOUTS: ""})
    studio.run(1.0)
    theatre = Theatre(studio.finish())
    seen = []
    for _ in range(30):
        theatre.run(0.1)
        worlds = [info.name for info in theatre.stage.worlds()]
        seen.append(worlds)
        if "belief_1" in worlds:
            assert theatre.stage.world("belief_1").node("ball")["present"] is False
    assert seen[2] == ["base"] and ["base", "belief_1"] in seen and seen[-1] == ["base"]


@pytest.mark.parametrize(("speed", "seconds"), [(1.0, 3.0), (4.0, 2.0), (0.5, 4.0), (math.inf, 1.0)])
def test_the_audience_sees_the_state_of_the_time(hovering: Path, speed: float, seconds: float) -> None:
    theatre = Theatre(hovering, speed=speed)
    theatre.run(seconds)
    if speed != math.inf:
        assert theatre.player.time == pytest.approx(min(speed * seconds, theatre.source.duration), abs=0.1)
    expected = state(ReplayedGraph(hovering).at(theatre.player.time))
    assert state(theatre.stage) == expected
    assert state(theatre.audience) == expected


def test_any_seek_gives_exactly_the_state_of_that_time(counted: Path) -> None:
    theatre = Theatre(counted)
    theatre.run(1.0)
    for time in np.random.default_rng(1).uniform(0.0, 12.0, 20):
        theatre.player.seek(float(time))
        theatre.run(0.1)
        theatre.player.pause()
        theatre.run(0.1)
        assert state(theatre.audience) == state(ReplayedGraph(counted).at(theatre.player.time))
        theatre.player.resume()


def test_frames_follow_a_seek_back(counted: Path) -> None:
    theatre = Theatre(counted, begin=9.5)
    theatre.player.pause()
    assert theatre.audience.transform("world", "cube_3", types=("Virtual_RT",)).translation[0] == pytest.approx(0.9)
    theatre.player.seek(2.5)
    theatre.deliver()
    assert theatre.audience.transform("world", "cube_3", types=("Virtual_RT",)).translation[0] == pytest.approx(0.2)


def test_a_pause_holds_and_pauses_on_the_way_come_once(counted: Path) -> None:
    theatre = Theatre(counted, pause_at=1.5, speed=2.0)
    theatre.run(2.0)
    assert theatre.player.time == 1.5 and not theatre.player.playing
    theatre.player.resume()
    theatre.run(1.0)
    assert theatre.player.time == pytest.approx(3.5, abs=0.1)


def test_it_ends_where_told_and_begins_again_after_the_end(counted: Path) -> None:
    theatre = Theatre(counted, begin=4.0, until=5.0)
    theatre.run(2.0)
    assert theatre.player.ended and theatre.player.time == 5.0
    theatre.player.resume()
    theatre.run(0.5)
    assert not theatre.player.ended and theatre.player.time == pytest.approx(0.5, abs=0.1)


def test_a_seek_beyond_the_ends_goes_to_them(counted: Path) -> None:
    theatre = Theatre(counted)
    for wanted, reached in ((1e9, theatre.source.duration), (-5.0, 0.0)):
        theatre.player.seek(wanted)
        assert theatre.player.time == pytest.approx(reached)


@pytest.mark.parametrize(
    "call", [lambda p: p.set_speed(0.0), lambda p: p.set_speed(math.nan), lambda p: p.seek(math.nan)]
)
def test_wrong_numbers_are_refused(counted: Path, call: Callable[[Player], None]) -> None:
    with pytest.raises(ValueError, match=r"0\.0|nan"):
        call(Theatre(counted).player)


def test_images_statuses_and_logs_are_published_again(studio: Studio) -> None:
    bus = studio.memory.transport
    for second in range(4):
        color = np.full((200, 300, 3), 50 * second, np.uint8)
        studio.memory.put_frame("camera", Frame(float(second), {"color": color}, {"fx": 200.0}))
        bus.publish(KEYS.log("x"), b"line %d" % second)
        status = Status(agent="x", rid="x-1", pid=7, state=State.READY, stamp=studio.clock.now())
        bus.publish(KEYS.status("x"), encode_status(status))
        bus.publish(KEYS.status("y"), b"nonsense")
        studio.run(1.0)
    theatre = Theatre(studio.finish())
    frames, lines, keys = theatre.audience.frames("camera"), [], Keys("replay")
    theatre.audience.transport.subscribe(keys.log(), lambda _, payload: lines.append(payload))
    board = StatusBoard(theatre.audience.transport, keys, theatre.clock)
    theatre.run(2.6)
    frame = frames.latest()
    assert frame is not None and frame.stamp == 2.0 and frame.meta == {"fx": 200.0}
    assert frame.arrays["color"].shape == (200, 300, 3) and abs(int(frame.arrays["color"].mean()) - 100) < 5
    assert lines == [b"line 1", b"line 2"]
    heard = board.get("x")
    assert heard is not None and heard.latency == pytest.approx(0.0) and heard.status.pid == 0
    assert board.agents() == ["x"]
    theatre.player.seek(1.5)
    theatre.deliver()
    again = frames.latest()
    assert again is not None and again.stamp == 1.0


def odd_schema() -> Schema:
    schema = Schema()
    schema.register_node_type("submarine", "of an older version")
    schema.register_edge_type("Old_RT", "of an older version", geometric=True)
    schema.register_attribute("depth_m", AttributeType("float"))
    del schema.attributes["mass"]
    schema.register_attribute("mass", AttributeType("str"))
    return schema


def test_names_of_other_versions_are_taken_over_and_misfits_left_out() -> None:
    network = LocalNetwork(ManualClock())
    source = Memory("a", "old", transport=network.connect("old"), schema=odd_schema())
    source.add_node("world", "world")
    source.add_node("nemo", "submarine", depth_m=12.0, mass="heavy")
    source.add_edge("world", "nemo", "Old_RT", pose=Pose((1.0, 0.0, 0.0)))
    target = Memory("b", "new", transport=network.connect("new"))
    mirror = GraphMirror(target)
    mirror.copy(source)
    assert target.node("nemo").type == "submarine" and target.node("nemo").attributes == {"depth_m": 12.0}
    assert target.transform("world", "nemo", types=("Old_RT",)).translation[0] == 1.0
    assert sum(mirror.left_out.values()) == 1 and "mass" in next(iter(mirror.left_out))


def test_a_node_of_another_type_is_made_anew_with_its_edges() -> None:
    network = LocalNetwork(ManualClock())
    source, target = (Memory(name, name, transport=network.connect(name)) for name in ("a", "b"))
    for memory, kind in ((source, "box"), (target, "cube")):
        memory.add_node("world", "world")
        memory.add_node("thing", kind)
        memory.add_edge("world", "thing", "has")
    target.add_node("leftover", "cube", mass=1.0)
    target.update_node("thing", mass=1.0)
    watch = source.watch(existing=False)
    GraphMirror(target).copy(source)
    assert state(target) == state(source)
    source.remove_node("thing")
    source.add_node("thing", "cup")
    source.add_edge("thing", "world", "on", since=1.0)
    mirror = GraphMirror(target)
    mirror.apply(watch.poll(), source)
    assert state(target) == state(source) and not mirror.left_out


def test_meshes_come_with_the_recording_and_missing_ones_are_told(tmp_path: Path) -> None:
    studio = Studio(tmp_path, snapshot_period=1.0)
    mesh = Mesh([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], [(0, 1, 2)])
    studio.memory.add_node("flag", "object", mesh=studio.memory.put_mesh(mesh))
    studio.memory.add_node("ghost", "object", mesh="0" * 64)
    studio.run(6.0)
    theatre = Theatre(studio.finish(), begin=5.0)
    theatre.run(0.5)
    assert theatre.audience.node("flag")["mesh"] == mesh.hash
    for _ in range(20):
        theatre.audience.get_mesh(mesh.hash)
        theatre.run(0.1)
        theatre.stage.poll()
        theatre.audience.flush()
    assert theatre.audience.get_mesh(mesh.hash) == mesh
    assert theatre.player.missing_meshes == {"0" * 64: "ghost"}


def test_nobody_waits_through_decades_at_greatest_speed(tmp_path: Path) -> None:
    """As where a clock was set after the recording began: it took thousands of millions of steps before."""
    writer = RecordingWriter(tmp_path / "a.mcap", {"graph": "tabletop"})
    for stamp in (10.0, 1e10):
        writer.write(RecordedMessage(stamp, "truth", b""))
    writer.close()
    theatre = Theatre(tmp_path / "a.mcap", speed=math.inf)
    for number in range(5):
        theatre.player.step(float(number))
    assert theatre.player.ended and theatre.player.time == pytest.approx(1e10 - 10.0)
