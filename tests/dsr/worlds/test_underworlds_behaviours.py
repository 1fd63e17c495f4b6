"""What Underworlds promises of its worlds, one by one, in each kind of world that we have."""

from __future__ import annotations

import random
import threading
import time

import pytest

import dsr
from dsr import CycleError, Faults, LocalNetwork, ManualClock, Memory, NoPathError, Pose
from dsr.persistence.content import GraphContent, NodeContent
from dsr.worlds.mirror import Mirror
from tests.dsr.conftest import Net

KINDS = ("base", "made", "fork", "overlay")


def make(memory: Memory, kind: str) -> Memory:
    """A world of this kind with a root."""
    memory.add_node("world", "world")
    if kind == "base":
        return memory
    return memory.create_world("w") if kind == "made" else memory.fork("w", follow=kind == "overlay")


def two(net: Net, kind: str) -> tuple[Memory, Memory]:
    """A world as two processes have it."""
    a, b = net.join("a"), net.join("b")
    net.pump(1.5)
    world = make(a, kind)
    net.pump(0.5)
    return world, b.world(world.world_name)


def hang(world: Memory, parent: str, name: str, x: float = 0.0, stamp: float = 0.0) -> None:
    """Put something below a frame."""
    world.add_node(name, "cube")
    world.add_edge(parent, name, "RT", pose=Pose((x, 0, 0), stamp=stamp))


# ---- default root


def test_a_new_world_has_a_root(net: Net) -> None:
    world = net.join("a").create_world("w")
    assert [(node.name, node.type) for node in world.nodes()] == [("world", "world")] and world.edges() == []


@pytest.mark.parametrize("kind", KINDS)
def test_without_types_everything_is_asked_for_in_the_root(net: Net, kind: str) -> None:
    world = make(net.join("a"), kind)
    hang(world, "world", "shelf", 1.0)
    assert world.transform("world", "shelf").t == (1.0, 0.0, 0.0) and world.node("world").type == "world"


# ---- reparenting


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("first", ["add", "remove"])
def test_a_node_moves_to_another_parent_with_all_below_it(net: Net, kind: str, first: str) -> None:
    ours, theirs = two(net, kind)
    hang(ours, "world", "shelf", 1.0)
    hang(ours, "world", "tray", 10.0)
    hang(ours, "shelf", "cup", 2.0, stamp=1.0)
    hang(ours, "cup", "spoon", 0.5)
    if first == "remove":
        ours.remove_edge("shelf", "cup", "RT")
    ours.add_edge("tray", "cup", "RT", pose=Pose((3.0, 0, 0), stamp=2.0))
    ours.remove_edge("shelf", "cup", "RT")
    net.pump(0.5)
    for world in (ours, theirs):
        assert world.transform("world", "spoon").t == (13.5, 0.0, 0.0)
        assert [edge.src for edge in world.edges("RT", dst="cup")] == ["tray"]


# ---- orphans


@pytest.mark.parametrize("kind", KINDS)
def test_what_hung_at_a_removed_node_stays_without_a_place_until_it_is_hung_elsewhere(net: Net, kind: str) -> None:
    ours, theirs = two(net, kind)
    hang(ours, "world", "tray", 1.0)
    hang(ours, "tray", "cup", 2.0)
    ours.remove_node("tray")
    net.pump(0.5)
    for world in (ours, theirs):
        assert "cup" in world and world.edges("RT", dst="cup") == []
        with pytest.raises(NoPathError):
            world.transform("world", "cup")
    ours.add_node("tray", "table")  # another tray: what hung at the first one does not hang at this one
    theirs.add_edge("world", "cup", "RT", pose=Pose((5.0, 0, 0)))
    net.pump(0.5)
    for world in (ours, theirs):
        assert world.transform("world", "cup").t == (5.0, 0.0, 0.0)


# ---- ordering


@pytest.mark.parametrize("kind", KINDS)
def test_changes_of_one_writer_are_seen_in_their_order(net: Net, kind: str) -> None:
    ours, theirs = two(net, kind)
    with theirs.watch(node_type="cube", existing=False) as watch:
        for index in range(50):
            ours.add_node(f"n{index}", "cube")
        net.pump(0.2)
        assert [change.name for change in watch.poll()] == [f"n{index}" for index in range(50)]


@pytest.mark.parametrize("kind", KINDS)
def test_out_of_order_no_child_hangs_before_its_parent_is_there_and_the_end_is_the_same(net: Net, kind: str) -> None:
    ours, theirs = two(net, kind)
    faults = Faults(loss=0.2, duplication=0.3, delay=(0.0, 0.4))
    for index in range(30):
        hang(ours, f"n{index - 1}" if index else "world", f"n{index}", 1.0)
        net.pump(0.05, faults)
        assert all(edge.src in theirs and edge.dst in theirs for edge in theirs.edges())
    net.pump(12.0)
    assert theirs.transform("world", "n29").t == (30.0, 0.0, 0.0)


# ---- waiting


def test_waiting_ends_in_time_or_with_the_change(net: Net) -> None:
    world = net.join("a").create_world("w")
    with world.watch(node_type="ball") as watch:
        assert watch.next(timeout=0.01) is None
        threading.Timer(0.05, lambda: world.add_node("ball", "ball")).start()
        change = watch.next(timeout=10.0)
        assert change is not None and change.name == "ball"


@pytest.mark.parametrize("kind", KINDS)
def test_waiting_ends_when_the_world_goes(net: Net, kind: str) -> None:
    base = net.join("a")
    world = make(base, kind)
    with world.watch(existing=False) as watch:
        threading.Timer(0.05, base.close if kind == "base" else lambda: base.delete_world("w")).start()
        assert watch.next(timeout=10.0) is None and watch.closed


# ---- no lost wake-ups


@pytest.mark.parametrize("kind", KINDS)
def test_a_thousand_rapid_creations_are_a_thousand_seen(net: Net, kind: str) -> None:
    ours, theirs = two(net, kind)
    seen: list[str] = []
    with theirs.watch(node_type="ball") as watch:
        for index in range(1000):
            ours.add_node(f"n{index}", "ball")
            if index % 37 == 0:
                net.pump()
                seen += [change.name for change in watch.poll() if change.kind == "added"]
        net.pump(0.2)
        seen += [change.name for change in watch.poll() if change.kind == "added"]
    assert len(seen) == len(set(seen)) == 1000


def test_who_sleeps_between_a_thousand_creations_is_woken_for_each_of_them() -> None:
    with dsr.connect("worlds", agent="a") as a, dsr.connect("worlds", agent="b") as b:
        ours = a.create_world("w")
        watch = b.watch(node_type="world_record")
        while b.worlds() == a.worlds()[:1]:
            assert watch.next(timeout=5.0)
        woken = threading.Event()
        with b.world("w").watch(node_type="ball", notify=woken.set) as balls:
            writer = threading.Thread(target=lambda: [ours.add_node(f"n{index}", "ball") for index in range(1000)])
            writer.start()
            seen: set[str] = set()
            while len(seen) < 1000:
                assert woken.wait(5.0), f"asleep with {len(seen)} of 1000 seen"
                woken.clear()
                seen |= {change.name for change in balls.poll()}
            writer.join()


# ---- restart without a server


def test_nobody_is_a_server_whoever_goes_and_comes_back_finds_the_world() -> None:
    with dsr.connect("worlds", agent="b") as b:
        with dsr.connect("worlds", agent="a") as a:
            a.create_world("w").add_node("ball", "ball")
            with b.watch(node_type="world_record") as watch:
                assert watch.next(timeout=5.0)
            b.world("w").add_node("cup", "cup")
        with dsr.connect("worlds", agent="a") as again:
            assert {"ball", "cup"} <= {node.name for node in again.create_world("w", exist_ok=True).nodes()}
            again.world("w").remove_node("ball")
        with dsr.connect("worlds", agent="a") as third:
            assert "ball" not in third.world("w") and "cup" in third.world("w")


# ---- late writers


@pytest.mark.parametrize("kind", KINDS)
def test_a_late_writer_does_not_resurrect_what_was_removed(net: Net, kind: str) -> None:
    ours, theirs = two(net, kind)
    hang(ours, "world", "cup", 1.0)
    net.pump(0.5)
    net.network.partition(["a"], ["b"])
    ours.remove_node("cup")
    net.pump(1.0)
    theirs.update_node("cup", mass=1.0)
    theirs.update_edge("world", "cup", "RT", pose=Pose((2.0, 0, 0), stamp=9.0))
    net.pump(1.0)
    net.network.heal()
    net.pump(3.0)
    for world in (ours, theirs):
        assert "cup" not in world and world.edges("RT") == []


# ---- cycles


@pytest.mark.parametrize("kind", KINDS)
def test_an_edge_that_closes_a_cycle_is_refused_and_changes_nothing(net: Net, kind: str) -> None:
    world = make(net.join("a"), kind)
    for parent, name in (("world", "a"), ("a", "b"), ("b", "c")):
        hang(world, parent, name, 1.0)
    for src, dst, way in (("c", "a", "'a' -> 'b' -> 'c' -> 'a'"), ("b", "b", "'b' -> 'b'")):
        with pytest.raises(CycleError, match=f"RT edge '{src}' -> '{dst}' closes a cycle of frames: {way}"):
            world.add_edge(src, dst, "RT", pose=Pose())
        assert world.get_edge(src, dst, "RT") is None
    world.add_edge("b", "c", "RT", pose=Pose((3.0, 0, 0), stamp=1.0))  # what is there is written, not made
    world.add_edge("c", "a", "on")  # no frames
    world.add_edge("c", "a", "Virtual_RT", pose=Pose())  # other frames: who asks for both kinds is told
    world.remove_edge("a", "b", "RT")
    world.add_edge("c", "a", "RT", pose=Pose())  # turned upside down
    assert world.transform("b", "a").t == (3.0, 0.0, 0.0)


def test_a_parent_that_is_not_the_newest_counts_too(net: Net) -> None:
    world = make(net.join("a"), "made")
    for name in ("camera", "table"):
        hang(world, "world", name)
    hang(world, "camera", "tag", stamp=1.0)
    world.add_edge("table", "tag", "RT", pose=Pose(stamp=2.0))
    with pytest.raises(CycleError, match="'camera' -> 'tag' -> 'camera'"):
        world.add_edge("tag", "camera", "RT", pose=Pose())


def test_random_edges_are_refused_if_and_only_if_they_close_a_cycle(net: Net) -> None:
    world, choose = net.join("a"), random.Random(1)
    names = [f"n{index}" for index in range(8)]
    for name in names:
        world.add_node(name, "cube")
    refused = 0
    for _ in range(400):
        src, dst = choose.choice(names), choose.choice(names)
        above, waiting = {src}, [src]
        while waiting:
            found = {edge.src for edge in world.edges("RT", dst=waiting.pop())} - above
            above |= found
            waiting += found
        if world.get_edge(src, dst, "RT") is not None:
            world.remove_edge(src, dst, "RT")
        elif dst in above:
            refused += 1
            with pytest.raises(CycleError):
                world.add_edge(src, dst, "RT", pose=Pose())
        else:
            world.add_edge(src, dst, "RT", pose=Pose())
    assert refused > 50


@pytest.mark.parametrize("kind", KINDS)
def test_edges_that_close_a_cycle_only_together_are_told_by_everybody_until_one_goes(net: Net, kind: str) -> None:
    ours, theirs = two(net, kind)
    for name in ("a", "b"):
        hang(ours, "world", name)
        ours.remove_edge("world", name, "RT")
    net.pump(0.5)
    net.network.partition(["a"], ["b"])
    ours.add_edge("a", "b", "RT", pose=Pose((1.0, 0, 0)))
    theirs.add_edge("b", "a", "RT", pose=Pose((2.0, 0, 0)))
    net.pump(1.0)
    net.network.heal()
    net.pump(3.0)
    said = set()
    for world in (ours, theirs):
        assert {edge.key for edge in world.edges("RT")} == {("a", "b", "RT"), ("b", "a", "RT")}
        with pytest.raises(CycleError, match="cycle") as caught:
            world.transform("world", "a")
        said.add(str(caught.value))
        assert world.transform("a", "b").t == (1.0, 0.0, 0.0)  # who is below the other is still told
    assert len(said) == 1
    hang(theirs, "a", "below")  # no further cycle
    theirs.remove_edge("a", "b", "RT")
    theirs.add_edge("world", "b", "RT", pose=Pose((5.0, 0, 0)))
    net.pump(0.5)
    for world in (ours, theirs):
        assert world.transform("world", "below").t == (7.0, 0.0, 0.0)


def test_an_overlay_and_its_parent_may_close_a_cycle_only_together(net: Net) -> None:
    base = make(net.join("a"), "base")
    hang(base, "world", "a")
    base.add_node("b", "cube")
    overlay = base.fork("w", follow=True)
    overlay.add_edge("a", "b", "RT", pose=Pose())
    base.remove_edge("world", "a", "RT")
    base.add_edge("b", "a", "RT", pose=Pose())  # the base knows of no cycle
    with pytest.raises(CycleError):
        overlay.transform("world", "b")
    overlay.remove_edge("b", "a", "RT")
    overlay.add_edge("world", "a", "RT", pose=Pose((1.0, 0, 0)))
    assert overlay.transform("world", "b").t == (1.0, 0.0, 0.0)


def test_of_a_file_with_a_cycle_all_but_the_edge_that_leads_back_up_is_loaded(net: Net) -> None:
    """Else one edge of a liar in a saved graph takes all of that graph away."""
    memory = make(net.join("a"), "base")
    for parent, name in (("world", "a"), ("a", "b")):
        hang(memory, parent, name)
    edges = [("b", "world", "RT"), ("c", "b", "RT"), ("c", "c", "RT"), ("b", "c", "RT"), ("c", "world", "on")]
    content = GraphContent("g", nodes={name: NodeContent("cube", {}) for name in "abc"})
    content.nodes["world"] = NodeContent("world", {})
    content.edges = {key: {"pose": Pose()} if key[2] == "RT" else {} for key in edges}
    left_out = sorted(content.put_into(memory))
    assert left_out[0] == "left out: RT edge 'c' -> 'b': it closes a circle of frames"
    assert left_out[1] == "left out: RT edge 'c' -> 'c': it closes a circle of frames"
    assert left_out[2].startswith("left out: the RT edge 'b' -> 'world' closes a cycle of frames: 'world' -> 'a'")
    content.edges["world", "a", "RT"] = content.edges["a", "b", "RT"] = {"pose": Pose()}
    fresh = net.join("b").create_world("fresh")
    for world in (memory, fresh):
        content.put_into(world, replace=True)
        assert {edge.key[:2] for edge in world.edges("RT")} == {("world", "a"), ("a", "b"), ("b", "c")}
        assert world.transform("world", "c").t == (0.0, 0.0, 0.0) and world.edges("on")


def test_a_file_of_circles_within_circles_costs_by_its_length(net: Net) -> None:
    """A way through thousands of frames is neither gone nor told for each edge."""
    memory, count = make(net.join("a"), "base"), 1500
    nodes = {f"n{number}": NodeContent("cube", {}) for number in range(count)}
    edges = [(f"n{number}", f"n{number + 1}", "RT") for number in range(count - 1)]
    edges += [(f"n{number}", f"n{number // 2}", "RT") for number in range(count)]
    edges += [(f"n{number}", f"n{number + 2}", "RT") for number in range(count - 2)]
    content = GraphContent("g", nodes=nodes, edges={key: {} for key in edges})
    begin = time.process_time()
    left_out = content.put_into(memory)
    assert time.process_time() - begin < 3.0
    assert len(left_out) == count and max(map(len, left_out)) < 100
    assert len(memory.edges("RT")) == len(edges) - count


def test_what_filters_repeat_and_what_arrives_is_never_refused() -> None:
    """Else worlds would differ by the order in which changes arrive."""
    clock = ManualClock()
    network = LocalNetwork(clock)
    a = Memory("g", "a", transport=network.connect("a"), clock=clock)
    left, right, merged = (a.create_world(name) for name in ("left", "right", "merged"))
    for world in (left, right, merged):
        for name in "ab":
            world.add_node(name, "cube")
    left.add_edge("a", "b", "RT", pose=Pose())
    right.add_edge("b", "a", "RT", pose=Pose())
    assert merged.copy(left.edge("a", "b", "RT")) and merged.copy(right.edge("b", "a", "RT"))
    with pytest.raises(CycleError):
        merged.transform("world", "a")


def test_a_filter_follows_what_is_turned_upside_down(net: Net) -> None:
    """On the way there are moments at which the old edge is still in the output."""
    base = make(net.join("a"), "base")
    out = base.create_world("out")
    mirror = Mirror({"base": base}, out, lambda node: node.name != "between", lambda edge: True)
    with base.watch() as watch:
        for parent, name in (("world", "a"), ("a", "between"), ("between", "b"), ("b", "c")):
            hang(base, parent, name, 1.0)
        mirror.update({"base": watch.poll()})
        assert out.transform("world", "c").t == (4.0, 0.0, 0.0) and {e.src for e in out.edges("RT", dst="b")} == {"a"}
        for src, dst in (("world", "a"), ("a", "between"), ("between", "b"), ("b", "c")):
            base.remove_edge(src, dst, "RT")
        for src, dst in (("world", "c"), ("c", "b"), ("b", "between"), ("between", "a")):
            base.add_edge(src, dst, "RT", pose=Pose((1.0, 0, 0)))
        mirror.update({"base": watch.poll()})
    assert out.transform("world", "a").t == (4.0, 0.0, 0.0)
    assert {edge.key[:2] for edge in out.edges("RT")} == {("world", "c"), ("c", "b"), ("b", "a")}
