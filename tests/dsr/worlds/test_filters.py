"""Filters in lockstep: what they pass on, circles, restarts, worlds that are missing or deleted."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping
from random import Random
from typing import Any

import pytest

from dsr import Access, AgentError, Edge, LocalNetwork, ManualClock, Memory, Node, Pose
from dsr.agent import make_agent
from dsr.network.local_transport import LocalTransport
from dsr.network.transport import Qos
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.worlds.clients import Reader
from dsr.worlds.filters import Filter


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Messages with durable changes of worlds beside the base, by world."""
    sent: Counter[str] = Counter()
    publish = LocalTransport.publish

    def counted(self: LocalTransport, key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        parts = key.split("/")
        if parts[3] == "world" and parts[6] == "d":
            sent[parts[4]] += 1
        publish(self, key, payload, qos)

    monkeypatch.setattr(LocalTransport, "publish", counted)
    return sent


class Copy(Filter):
    name = "copy"
    reads = ("base",)
    writes = "copied"


def run(*specs: AgentSpec, **options: Any) -> Lockstep:
    return Lockstep(specs, strict=True, **options)


def cube(memory: Memory, name: str = "cube_1", x: float = 0.4, **attributes: Any) -> None:
    if "world" not in memory:
        memory.add_node("world", "world")
    memory.add_node(name, "cube", **attributes)
    memory.add_edge("world", name, "RT", pose=Pose((x, 0.0, 0.02)))


def content(memory: Memory) -> dict[Any, Any]:
    found: dict[Any, Any] = {node.name: (node.type, node.attributes) for node in memory.nodes()}
    found.update({edge.key: edge.attributes for edge in memory.edges()})
    for _, attributes in list(found.items()):
        (attributes[1] if isinstance(attributes, tuple) else attributes).pop("via", None)
    return found


def chain(*worlds: str) -> list[AgentSpec]:
    pairs = itertools.pairwise(worlds)
    return [AgentSpec(f"f_{a}_{b}", Copy, {"reads": [a], "writes": b}) for a, b in pairs]


def test_the_output_is_what_the_input_is() -> None:
    with run(AgentSpec("copy", Copy)) as lockstep:
        base = lockstep.memory
        cube(base, mass=1.0, size=(0.04, 0.04, 0.04))
        lockstep.run_for(1.0)
        copied = base.world("copied")
        assert content(copied) == content(base)
        assert copied.node("cube_1")["via"] == "base"
        base.update_node("cube_1", mass=2.0)
        base.update_edge("world", "cube_1", "RT", pose=Pose((0.5, 0.0, 0.02)))
        base.remove_attribute("cube_1", "size")
        lockstep.run_for(1.0)
        assert content(copied) == content(base)
        base.remove_node("cube_1")
        cube(base, "cube_2")
        lockstep.run_for(1.0)
        assert "cube_1" not in copied
        assert content(copied) == content(base)


def test_values_keep_their_time_and_newer_ones_in_the_output_stay() -> None:
    with run(AgentSpec("copy", Copy)) as lockstep:
        base = lockstep.memory
        cube(base, mass=1.0)
        written = base.node("cube_1").written_at("mass")
        lockstep.run_for(1.0)
        copied = base.world("copied")
        assert copied.node("cube_1").written_at("mass") == written
        copied.update_node("cube_1", mass=3.0)
        base.update_node("cube_1", friction=0.5)
        lockstep.run_for(1.0)
        assert copied.node("cube_1")["mass"] == 3.0
        base.update_node("cube_1", mass=1.5)
        lockstep.run_for(1.0)
        assert copied.node("cube_1")["mass"] == 1.5


@pytest.mark.parametrize("length", [3, 10])
def test_in_a_circle_every_change_passes_each_filter_once(length: int, sent: Counter[str]) -> None:
    worlds = [f"w{index}" for index in range(length)]
    with run(*chain(*worlds, worlds[0])) as lockstep:
        lockstep.run_for(2.0)
        first = lockstep.memory.world("w0")
        lockstep.run_for(2.0)
        sent.clear()
        cube(first, mass=1.0)
        first.flush()
        lockstep.run_for(3.0)
        assert all(content(lockstep.memory.world(world)) == content(first) for world in worlds)
        assert sum(sent.values()) == length  # ours, and one of each filter but the last, which has nothing to say
        middle = lockstep.memory.world(worlds[length // 2])
        lockstep.run_for(1.0)
        sent.clear()
        middle.update_node("cube_1", mass=2.0)
        lockstep.run_for(3.0)
        assert first.node("cube_1")["mass"] == 2.0
        assert sum(sent.values()) == length
        sent.clear()
        first.remove_node("cube_1")
        lockstep.run_for(3.0)
        assert not any("cube_1" in lockstep.memory.world(world) for world in worlds)
        assert sum(sent.values()) == length


class Heavier(Copy):
    def edit(self, element: Node | Edge, values: Mapping[str, Any]) -> Mapping[str, Any]:
        return {**values, "mass": values["mass"] + 1.0} if "mass" in values else values


@pytest.mark.parametrize("back", [Copy, Heavier])
@pytest.mark.parametrize("name", ["cube_1", "world"])
def test_in_a_circle_what_is_edited_comes_to_rest(back: type[Filter], name: str, sent: Counter[str]) -> None:
    there = AgentSpec("there", Heavier, {"reads": ["low"], "writes": "high"})
    with run(there, AgentSpec("back", back, {"reads": ["high"], "writes": "low"})) as lockstep:
        lockstep.run_for(2.0)
        low, high = (lockstep.memory.world(world) for world in ("low", "high"))
        lockstep.run_for(1.0)
        cube(low, mass=1.0)
        lockstep.run_for(1.0)
        assert high.node("cube_1")["mass"] >= 2.0
        high.update_node(name, mass=100.0)
        lockstep.run_for(1.0)
        low.update_node(name, mass=200.0)
        lockstep.run_for(1.0)
        assert 201.0 <= high.node(name)["mass"] < 204.0
        sent.clear()
        lockstep.run_for(3.0)
        assert sum(sent.values()) == 0


def test_in_a_circle_changes_that_chase_each_other_come_to_rest(sent: Counter[str]) -> None:
    worlds = [f"w{index}" for index in range(5)]
    with run(*chain(*worlds, worlds[0])) as lockstep:
        lockstep.run_for(2.0)
        memories = [lockstep.memory.world(world) for world in worlds]
        lockstep.run_for(2.0)
        cube(memories[0], mass=0.0)
        lockstep.run_for(2.0)
        for round_ in range(5):
            for index, memory in enumerate(memories):
                lockstep.clock.advance_to(lockstep.clock.now() + 1e-3)
                if "cube_1" in memory:
                    memory.update_node("cube_1", mass=float(10 * round_ + index))
            if round_ % 2:
                memories[0].remove_node("cube_1")
                lockstep.run_for(0.02)
                cube(memories[0], mass=float(-round_))
            lockstep.run_for(0.02)
        lockstep.run_for(3.0)
        sent.clear()
        lockstep.run_for(3.0)
        assert sum(sent.values()) == 0
        assert {str(content(memory)) for memory in memories} == {str(content(memories[0]))}


def test_a_filter_takes_away_only_what_it_added_and_brings_back_what_others_took() -> None:
    with run(AgentSpec("copy", Copy)) as lockstep:
        base = lockstep.memory
        cube(base)
        lockstep.run_for(1.0)
        copied = base.world("copied")
        cube(copied, "mine")
        copied.remove_node("cube_1")
        lockstep.run_for(1.0)
        assert "cube_1" in copied
        assert copied.get_edge("world", "cube_1", "RT") is not None
        base.remove_node("cube_1")
        base.remove_node("world")
        lockstep.run_for(1.0)
        assert "cube_1" not in copied
        assert "mine" in copied and "world" in copied


def test_a_thing_that_two_ways_lead_to_stays_until_both_let_it_go() -> None:
    class Heavy(Copy):
        def accepts(self, node: Node) -> bool:
            return bool(node.get("mass", 0.0) > 1.0)

    class Seen(Copy):
        def accepts(self, node: Node) -> bool:
            return bool(node.get("perceived", False))

    with run(AgentSpec("heavy", Heavy), AgentSpec("seen", Seen)) as lockstep:
        base = lockstep.memory
        cube(base, mass=2.0, perceived=True)
        lockstep.run_for(1.0)
        copied = base.world("copied")
        for mass, perceived, there in ((0.5, True, True), (2.0, False, True), (0.5, False, False), (2.0, False, True)):
            base.update_node("cube_1", mass=mass, perceived=perceived)
            lockstep.run_for(1.0)
            assert ("cube_1" in copied) is there, (mass, perceived)
            assert (copied.get_edge("world", "cube_1", "RT") is not None) is there


def test_what_is_made_anew_keeps_nothing_of_the_old() -> None:
    with run(AgentSpec("copy", Copy)) as lockstep:
        base = lockstep.memory
        cube(base, mass=1.0)
        lockstep.run_for(1.0)
        base.remove_node("cube_1")
        cube(base, x=0.1)
        lockstep.run_for(1.0)
        assert content(base.world("copied")) == content(base)
        base.remove_node("cube_1")
        base.add_node("cube_1", "box")
        lockstep.run_for(1.0)
        assert content(base.world("copied")) == content(base)


def test_several_inputs_are_merged_newest_or_first() -> None:
    for conflict, mass in (("newest", 3.0), ("first", 1.0)):
        specs = [AgentSpec("merge", Copy, {"reads": ["one", "two"], "writes": "both", "conflict": conflict})]
        with run(*specs) as lockstep:
            one, two = (lockstep.memory.create_world(name) for name in ("one", "two"))
            cube(one, mass=0.0)
            cube(two, "cube_2")
            cube(two, mass=2.0)
            one.update_node("cube_1", mass=1.0)
            lockstep.run_for(1.0)
            both = lockstep.memory.world("both")
            lockstep.run_for(1.0)
            two.update_node("cube_1", mass=3.0)
            lockstep.run_for(1.0)
            assert both.node("cube_1")["mass"] == mass
            assert "cube_2" in both
            one.remove_node("cube_1")
            lockstep.run_for(1.0)
            assert both.node("cube_1")["mass"] == 3.0
            two.remove_node("cube_1")
            lockstep.run_for(1.0)
            assert "cube_1" not in both


def test_values_may_be_changed_on_the_way() -> None:
    class Rounded(Copy):
        def edit(self, element: Node | Edge, values: Mapping[str, Any]) -> Mapping[str, Any]:
            return {name: round(value) if name == "mass" else value for name, value in values.items() if name != "note"}

    with run(AgentSpec("rounded", Rounded)) as lockstep:
        cube(lockstep.memory, mass=1.4, note="hidden")
        lockstep.run_for(1.0)
        node = lockstep.memory.world("copied").node("cube_1")
        assert node["mass"] == 1.0
        assert "note" not in node


def test_it_waits_for_a_world_and_goes_on_after_one_was_deleted(caplog: pytest.LogCaptureFixture) -> None:
    with run(AgentSpec("copy", Copy, {"reads": ["raw"], "writes": "copied"})) as lockstep:
        memory = lockstep.memory
        runner = lockstep.runner("copy")
        lockstep.run_for(1.0)
        assert "no world 'raw'" in runner.agent.degraded
        assert str(runner.state) == "degraded"
        cube(memory.create_world("raw"))
        lockstep.run_for(1.0)
        assert str(runner.state) == "ready"
        assert "cube_1" in memory.world("copied")
        memory.delete_world("raw")
        lockstep.run_for(1.0)
        assert runner.agent.degraded == "world 'raw' was deleted"
        assert "world 'raw' was deleted; it waits for that" in caplog.text
        cube(memory.create_world("raw"), "cube_2")
        lockstep.run_for(1.0)
        assert "cube_2" in memory.world("copied") and "cube_1" not in memory.world("copied")
        memory.delete_world("copied")
        lockstep.run_for(1.0)
        assert "no world 'copied'" in runner.agent.degraded
        assert [info.name for info in memory.worlds()] == ["base", "raw"]
        memory.create_world("copied")
        lockstep.run_for(1.0)
        assert content(memory.world("copied")) == content(memory.world("raw"))


def test_a_filter_that_is_restarted_goes_on(sent: Counter[str]) -> None:
    with run(AgentSpec("copy", Copy)) as lockstep:
        base = lockstep.memory
        cube(base, "cube_1", mass=1.0)
        cube(base, "cube_2")
        lockstep.run_for(1.0)
        copied = base.world("copied")
        lockstep.run_for(1.0)
        lockstep.kill("copy")
        sent.clear()
        lockstep.restart("copy")
        lockstep.run_for(1.0)
        assert not sent, "nothing has changed meanwhile"
        lockstep.kill("copy")
        base.remove_node("cube_2")
        base.update_node("cube_1", mass=2.0)
        cube(base, "cube_3")
        lockstep.run_for(1.0)
        lockstep.restart("copy")
        lockstep.run_for(1.0)
        assert content(copied) == content(base)


def test_a_filter_may_write_only_into_its_output() -> None:
    class Stray(Copy):
        def update(self, now: float) -> None:
            super().update(now)
            self.memory.add_node("stray", "cube")

    with run(AgentSpec("stray", Stray)) as lockstep, pytest.raises(AgentError, match="into world 'base', which it"):
        lockstep.run_for(1.0)


def test_two_runs_are_equal() -> None:
    def outcome() -> str:
        with run(*chain("base", "w1", "w2", "w1"), seed=3) as lockstep:
            cube(lockstep.memory, mass=1.0)
            lockstep.run_for(1.0)
            cube(lockstep.memory.world("w2"), "cube_2")
            lockstep.run_for(1.0)
            return lockstep.memory.world("w1").snapshot().hex()

    assert outcome() == outcome()


class _Narrow(Copy):
    contents = Access(nodes=("cube",), edges=("RT",), attributes=("via",))


def test_contents_narrow_what_is_declared() -> None:
    assert _Narrow.writes == Access(
        ("cube", "world_record", "world"), ("RT",), ("via",), worlds=("copied",)
    )  # fmt: skip
    assert Copy.reads.worlds == ("base",)


def test_a_failing_filter_leaves_the_rest_in_step() -> None:
    class Picky(Copy):
        def accepts(self, node: Node) -> bool:
            return bool(node["mass"] > 0.5)

    with Lockstep([AgentSpec("picky", Picky)]) as lockstep:
        lockstep.memory.add_node("unknown", "cube")
        cube(lockstep.memory, mass=1.0)
        lockstep.run_for(1.0)
        assert "cube_1" in lockstep.memory.world("copied")
        assert "no attribute 'mass'" in lockstep.runner("picky").status().last_error


@pytest.mark.parametrize("follow", [False, True])
def test_a_fork_or_an_overlay_may_be_read(follow: bool) -> None:
    with run(AgentSpec("copy", Copy, {"reads": ["idea"]})) as lockstep:
        base = lockstep.memory
        cube(base, mass=1.0)
        base.add_node("cube_2", "cube")
        idea = base.fork("idea", follow=follow)
        lockstep.run_for(1.0)
        copied = base.world("copied")
        idea.update_node("cube_1", mass=2.0, friction=0.5)
        idea.remove_node("cube_2")
        base.update_node("cube_1", note="from the base")
        cube(base, "cube_3")
        lockstep.run_for(1.0)
        assert content(copied) == content(idea)
        assert ("cube_3" in copied) is follow
        base.update_edge("world", "cube_1", "RT", pose=Pose((0.7, 0.0, 0.02)))
        base.remove_node("cube_3")
        lockstep.run_for(1.0)
        assert content(copied) == content(idea)


class Cubes(Copy):
    """Leaves out what is no cube."""

    def accepts(self, node: Node) -> bool:
        return node.type == "cube"


def arm(memory: Memory) -> None:
    """A cube below a camera below an arm, another one on it."""
    for name, kind in (("world", "world"), ("arm", "arm"), ("camera", "camera"), ("low", "cube"), ("high", "cube")):
        memory.add_node(name, kind)
    memory.add_edge("world", "arm", "RT", pose=Pose((1.0, 0.0, 0.0), (0.0, 0.0, 0.6, 0.8)))
    memory.add_edge("arm", "camera", "RT", pose=Pose((0.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0)))
    memory.add_edge("camera", "low", "RT", pose=Pose((0.1, 0.0, 0.4), stamp=0.5))
    memory.add_edge("low", "high", "RT", pose=Pose((0.0, 0.0, 0.04)))


def test_what_hangs_on_a_frame_that_is_left_out_is_where_it_was() -> None:
    with run(AgentSpec("copy", Cubes)) as lockstep:
        base = lockstep.memory
        arm(base)
        lockstep.run_for(1.0)
        copied = base.world("copied")
        assert {edge.key for edge in copied.edges()} == {("world", "low", "RT"), ("low", "high", "RT")}
        for name in ("low", "high"):
            assert max(copied.transform("world", name).distance(base.transform("world", name))) < 1e-9
        assert copied.transform("world", "low").stamp == 0.5
        base.update_edge("world", "arm", "RT", pose=Pose((2.0, 0.0, 0.0)))
        lockstep.run_for(1.0)
        assert max(copied.transform("world", "high").distance(base.transform("world", "high"))) < 1e-9
        base.remove_edge("arm", "camera", "RT")  # now nobody knows where it is
        lockstep.run_for(1.0)
        assert {edge.key for edge in copied.edges()} == {("low", "high", "RT")}
        base.add_edge("arm", "camera", "RT", pose=Pose((0.0, 0.0, 0.7)))
        base.add_edge("world", "low", "RT", pose=Pose((5.0, 0.0, 0.0), stamp=0.9))
        lockstep.run_for(1.0)
        assert copied.transform("world", "low").t == (5.0, 0.0, 0.0)
        base.remove_edge("world", "low", "RT")
        lockstep.run_for(1.0)
        assert max(copied.transform("world", "low").distance(base.transform("world", "low"))) < 1e-9
        base.remove_node("low")
        lockstep.run_for(1.0)
        assert not copied.edges()


def test_what_a_frame_that_is_left_out_shows_last_counts() -> None:
    with run(AgentSpec("copy", Cubes)) as lockstep:
        base = lockstep.memory
        base.add_node("world", "world")
        base.add_node("shelf", "cube")
        base.add_node("camera", "camera")
        base.add_node("cup", "cube")
        base.add_edge("world", "shelf", "RT", pose=Pose((0.0, 1.0, 0.0)))
        base.add_edge("world", "camera", "RT", pose=Pose((10.0, 0.0, 0.0)))
        base.add_edge("shelf", "cup", "RT", pose=Pose((1.0, 0.0, 0.0), stamp=0.1))
        lockstep.run_for(0.5)
        base.add_edge("camera", "cup", "RT", pose=Pose((1.0, 0.0, 0.0), stamp=0.2))
        lockstep.run_for(0.5)
        copied = base.world("copied")
        assert copied.transform("world", "cup").t == base.transform("world", "cup").t == (11.0, 0.0, 0.0)
        base.remove_edge("camera", "cup", "RT")
        lockstep.run_for(0.5)
        assert copied.transform("world", "cup").t == base.transform("world", "cup").t == (1.0, 1.0, 0.0)


def test_what_was_reparented_stays_over_a_restart_and_ends_with_the_filter_that_wants_the_parent() -> None:
    class Wider(Cubes):
        wide = False

        def accepts(self, node: Node) -> bool:
            return type(self).wide or super().accepts(node)

    with run(AgentSpec("copy", Wider)) as lockstep:
        base = lockstep.memory
        arm(base)
        lockstep.run_for(1.0)
        copied = base.world("copied")
        created = copied.edge("world", "low", "RT").created
        lockstep.kill("copy")
        lockstep.run_for(0.5)
        lockstep.restart("copy")
        lockstep.run_for(1.0)
        assert copied.edge("world", "low", "RT").created == created
        Wider.wide = True
        base.update_edge("camera", "low", "RT", pose=Pose((0.1, 0.0, 0.4), stamp=1.5))
        for name in ("arm", "camera"):
            base.update_node(name, mass=1.0)
        lockstep.run_for(1.0)
        assert content(copied) == content(base)


def test_what_was_reparented_does_not_come_back_in_a_circle(sent: Counter[str]) -> None:
    specs = [AgentSpec("there", Cubes), AgentSpec("back", Copy, {"reads": ["copied"], "writes": "base"})]
    with run(*specs) as lockstep:
        base = lockstep.memory
        arm(base)
        lockstep.run_for(2.0)
        before = sent["copied"]
        lockstep.run_for(3.0)
        assert sent["copied"] == before
        assert base.get_edge("world", "low", "RT") is None
        assert base.world("copied").get_edge("world", "low", "RT") is not None


def test_of_two_sources_with_orphans_the_newer_one_counts() -> None:
    with run(AgentSpec("copy", Cubes, {"reads": ["left", "right"], "writes": "merged"})) as lockstep:
        left, right = (lockstep.memory.create_world(name) for name in ("left", "right"))
        for memory, x in ((left, 1.0), (right, 2.0)):
            memory.add_node("camera", "camera")
            memory.add_edge("world", "camera", "RT", pose=Pose((x, 0.0, 0.0)))
            memory.add_node("cube_1", "cube")
            memory.add_edge("camera", "cube_1", "RT", pose=Pose((0.0, 0.0, 0.5)))
            lockstep.run_for(0.5)
        lockstep.run_for(1.0)
        merged = lockstep.memory.world("merged")
        assert merged.transform("world", "cube_1").t == (2.0, 0.0, 0.5)
        left.update_edge("camera", "cube_1", "RT", pose=Pose((0.0, 0.0, 0.6)))
        lockstep.run_for(1.0)
        assert merged.transform("world", "cube_1").t == (1.0, 0.0, 0.6)
        lockstep.memory.delete_world("merged")


@pytest.mark.parametrize("length", [2, 3])
def test_a_ring_that_is_written_everywhere_comes_to_rest_with_the_same_everywhere(length: int) -> None:
    worlds = [f"w{index}" for index in range(length)]
    random = Random(length)
    with run(*chain(*worlds, worlds[0])) as lockstep:
        lockstep.run_for(3.0)
        memories = [lockstep.memory.world(world) for world in worlds]
        for _, memory in itertools.product(range(30), memories):
            name, action = f"cube_{random.randrange(6)}", random.random()
            if name not in memory:
                cube(memory, name, random.random(), mass=random.random())
            elif action < 0.4:
                memory.update_node(name, mass=random.random())
            elif action < 0.7 and memory.get_edge("world", name, "RT"):
                memory.update_edge("world", name, "RT", pose=Pose((random.random(), 0.0, 0.0)))
            elif action < 0.9:
                memory.remove_node(name)
            lockstep.run_for(0.1)
        lockstep.run_for(4.0)
        assert all(content(memory) == content(memories[0]) for memory in memories)
        before = [memory.replica.written for memory in memories]
        lockstep.run_for(2.0)
        assert [memory.replica.written for memory in memories] == before


@pytest.mark.parametrize("reactive", [True, False])
def test_only_who_is_reactive_is_woken_by_changes(reactive: bool) -> None:
    class Listener(Reader):
        name = "listener"
        reads = ("base",)

    Listener.reactive = reactive
    clock, woken = ManualClock(), []
    with Memory("g", "listener", transport=LocalNetwork(clock).connect("a"), clock=clock) as memory:
        memory.replica.synchroniser.nobody_there()
        bus, keys = memory.transport, memory.keys
        agent = make_agent(Listener, name="listener", config={}, bus=bus, keys=keys, clock=clock, memory=memory)
        agent.wake = lambda: woken.append(1)
        agent.setup()
        agent.tick(clock.now())
        woken.clear()
        memory.add_node("cube_1", "cube")
        assert bool(woken) is reactive
