"""What the gate lets in: honest replicas decide alike whatever the order, and refusals leave no holes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from typing import Any

import pytest

from dsr import AttributeType, Memory
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.hlc import stamp_at
from dsr.crdt.pieces import reply_to
from dsr.graph.graph import Graph
from dsr.graph.schema import SCHEMA_RECORD
from dsr.network.keys import agent_of
from dsr.replication.wire import Digest, decode_delta, encode_delta, encode_digest
from dsr.security.gate import Gate
from dsr.security.policy import AccessPolicy, Grant, checked
from tests.dsr.conftest import Net, reply_of
from tests.dsr.security.conftest import GRANTS

Join = Callable[..., Memory]


@pytest.fixture
def join(net: Net, policy: AccessPolicy) -> Join:
    """One more replica: with a gate, or a rogue one that writes what it likes."""

    def start(agent: str, *, rogue: bool = False, **options: Any) -> Memory:
        return net.join(agent, gate=None if rogue else Gate(policy), **options)

    return start


def content(memory: Memory) -> dict[Any, Any]:
    elements = {node.name: (node.type, dict(node)) for node in memory.nodes()}
    return {**elements, **{edge.key: dict(edge) for edge in memory.edges()}}


def refused(memory: Memory) -> int:
    return sum(memory._replica.synchroniser.gate.refused.values())  # type: ignore[union-attr]


def context(memory: Memory) -> Any:
    return memory._graph.store.context


@pytest.mark.parametrize("how", ["digest", "reply"])
@pytest.mark.parametrize("liar", ["scene-9", "launcher-9", "arm-9"])
def test_who_speaks_for_itself_alone_makes_nobody_write_anew(net: Net, join: Join, how: str, liar: str) -> None:
    """Nobody believes of it what it says to have seen of others. Before, its word cost a new id each ten seconds."""
    arm, stranger = join("arm"), net.network.connect("stranger")
    arm.add_node("gen3", "arm")
    net.pump(2.0)
    rid = arm.replica.graph.rid
    seen = CausalContext([(rid, 1, 99) if how == "digest" else ("ghost-1", 1, 1)])
    if how == "reply":
        reply = reply_of(Delta(context=[(rid, 1, 99)]))
        stranger.serve(arm.keys.sync(liar), lambda key, payload: reply)
    for _ in range(3):
        stranger.publish(arm.keys.digest(liar), encode_digest(Digest(liar, net.clock.now(), seen.summary(), 0, ())))
        net.pump(1.0)
    assert (arm.replica.graph.rid == rid) == (liar == "scene-9")


def test_refusals_under_made_up_replica_ids_take_neither_memory_nor_lines_of_the_log(
    net: Net, join: Join, caplog: pytest.LogCaptureFixture
) -> None:
    arm = join("arm")
    for number in range(100):
        delta = Delta([Add((f"scene-{number}", 1), "gen3", "arm")], context=[(f"scene-{number}", 1, 1)])
        arm.replica.synchroniser.receive_delta(f"scene-{number}", encode_delta(delta), net.clock.now())
    assert len(arm._replica.synchroniser.gate.refused) == 1 and refused(arm) == 100  # type: ignore[union-attr]
    assert len([record for record in caplog.records if record.name == "dsr.security"]) == 1


def test_what_is_granted_gets_through(net: Net, join: Join) -> None:
    arm, scene, launcher = join("arm"), join("scene"), join("launcher")
    net.pump(2.0)
    arm.add_node("world", "world")
    arm.add_node("gen3", "arm", status="idle")
    arm.add_edge("world", "gen3", "RT", translation=(1.0, 0.0, 0.0), rotation=(0, 0, 0, 1))
    net.pump(1.0)
    scene.add_node("cube", "cube", size=(1.0, 1.0, 1.0))
    net.pump(1.0)
    scene.remove_node("cube")
    arm.update_edge("world", "gen3", "RT", translation=(2.0, 0.0, 0.0), rotation=(0, 0, 0, 1))
    net.pump(3.0)
    assert content(arm) == content(scene) == content(launcher) != {}
    assert launcher.edge("world", "gen3", "RT").pose.translation[0] == 2.0
    assert not any(map(refused, (arm, scene, launcher)))


def test_undeclared_writes_are_dropped_by_all_and_asked_for_by_nobody(net: Net, join: Join) -> None:
    rogue, scene, launcher = join("arm", rogue=True), join("scene"), join("launcher")
    net.pump(2.0)
    scene.add_node("cube", "cube", mass=1.0)
    scene.add_node("table", "table")
    scene.add_edge("cube", "table", "on")
    net.pump(1.0)
    before = content(launcher)
    rogue.update_node("cube", mass=99.0)  # neither the type nor the attribute
    rogue.add_node("gen3", "arm", mass=99.0)  # not the attribute
    rogue.add_node("cube_2", "cube", status="mine")  # not the type
    rogue.add_edge("gen3", "cube", "on")
    rogue.remove_edge("cube", "table", "on")
    rogue.remove_node("table")
    rogue.update_node("gen3", status="fine")
    net.pump(3.0)
    assert content(scene) == content(launcher) == {**before, "gen3": ("arm", {"status": "fine"})}
    assert context(scene) == context(launcher) == context(rogue)
    assert refused(scene) == refused(launcher) > 4
    net.pump(5.0)
    assert [memory._replica.synchroniser.repairs for memory in (scene, launcher)] == [0, 0]


def test_whoever_may_remove_a_node_may_remove_the_edges_at_it(net: Net, join: Join) -> None:
    arm, scene, launcher = join("arm"), join("scene"), join("launcher")
    net.pump(2.0)
    scene.add_node("cube", "cube")
    net.pump(1.0)
    arm.add_node("world", "world")
    arm.add_edge("world", "cube", "RT", translation=(0.0, 0.0, 0.0), rotation=(0, 0, 0, 1))
    net.pump(1.0)
    scene.remove_node("cube")
    net.pump(2.0)
    assert set(content(scene)) == set(content(arm)) == set(content(launcher)) == {"world"}
    assert not any(map(refused, (arm, scene, launcher)))


def test_a_type_is_checked_whatever_arrives_first(policy: AccessPolicy) -> None:
    """The writes of a rogue on a cube and on an arm, before and after what they are about, with a repair at the end."""
    author, other, rogue = Graph("scene-1"), Graph("arm-1"), Graph("arm-2")
    made = author.add_node("cube", "cube", {"size": (1.0, 1.0, 1.0)}, 1.0)
    gen3 = other.add_node("gen3", "arm", {}, 1.0)
    rogue.join(made, 1.0)
    rogue.join(gen3, 1.0)
    forbidden = rogue.write(rogue.node("cube"), {"status": "mine"}, 2.0)
    allowed = rogue.write(rogue.node("gen3"), {"status": "fine"}, 3.0)
    removal = rogue.remove_node("cube")
    messages = [("scene-1", made), ("arm-1", gen3), ("arm-2", forbidden), ("arm-2", allowed), ("arm-2", removal)]
    outcomes = []
    for order in permutations(messages):
        graph, gate = Graph("scene-9"), Gate(policy)
        for sender, delta in order:
            graph.join(gate.delta(sender, decode_delta(encode_delta(delta)), graph.store), 1.0)
        reply = reply_to(rogue.store, graph.store.context)
        graph.join(gate.reply("arm-2", reply, graph.store), 1.0)
        outcomes.append(({name: dict(node) for name, node in graph.nodes.items()}, graph.store.context.vector))
    expected = {"cube": {"size": (1.0, 1.0, 1.0)}, "gen3": {"status": "fine"}}, {"scene-1": 2, "arm-1": 1, "arm-2": 3}
    assert all(outcome == expected for outcome in outcomes)


def test_a_removal_counts_whatever_arrives_first(policy: AccessPolicy) -> None:
    """One that comes before its node is put off; the repair that follows removes the node."""
    author, remover = Graph("scene-1"), Graph("scene-2")
    made = author.add_node("table", "table", {}, 1.0)
    remover.join(made, 1.0)
    both = remover.add_node("cube", "cube", {"mass": 1.0}, 2.0)
    removal = remover.remove_node("table")
    both.removed, both.context = removal.removed, [*both.context, *removal.context]
    for order in permutations([("scene-1", made), ("scene-2", both)]):
        graph, gate = Graph("arm-9"), Gate(policy)
        for sender, delta in order:
            graph.join(gate.delta(sender, decode_delta(encode_delta(delta)), graph.store), 1.0)
        reply = reply_to(remover.store, graph.store.context)
        if not graph.store.context.covers(remover.store.context):
            graph.join(gate.reply("scene-2", reply, graph.store), 1.0)
        assert {name: dict(node) for name, node in graph.nodes.items()} == {"cube": {"mass": 1.0}}
        assert graph.store.context.vector == {"scene-1": 1, "scene-2": 3}


def test_nobody_writes_in_the_name_of_another(policy: AccessPolicy) -> None:
    graph, gate = Graph("launcher-1"), Gate(policy)
    graph.join(gate.delta("scene-1", Graph("scene-1").add_node("cube", "cube", {"mass": 1.0}, 1.0), graph.store), 1.0)
    forged = Delta(
        adds=[Add(("scene-7", 1), "cube_2", "cube")],
        writes=[
            Write(("scene-1", 1), "mass", 1 << 60, "scene-1", ("arm-1", 1), 9.0),
            Write(("scene-1", 1), "mass", 1 << 60, "scene-1", ("scene-1", 7), 9.0),
            Write(("scene-1", 1), "mass", 1 << 60, "scene-1", None, 9.0),
        ],
        removed=[("scene-1", 1)],
        context=[("scene-1", 1, 1000), ("arm-1", 1, 2)],
    )
    graph.join(gate.delta("arm-1", forged, graph.store), 1.0)
    assert {name: dict(node) for name, node in graph.nodes.items()} == {"cube": {"mass": 1.0}}
    assert graph.store.context.vector == {"scene-1": 2, "arm-1": 2}


@pytest.mark.parametrize("sender", ["dsr-1", "nobody-1", "arm", "-1", ""])
def test_readers_and_strangers_change_nothing(policy: AccessPolicy, sender: str) -> None:
    graph, gate = Graph("launcher-1"), Gate(policy)
    for name, type in (("cube", "cube"), ("gen3", "arm")):
        graph.join(gate.delta(sender, Graph(sender or "x").add_node(name, type, {}, 1.0), graph.store), 1.0)
    assert graph.nodes == {} and gate.refused == {agent_of(sender): 2}


def forged_reply(graph: Graph) -> Delta:
    """All that `graph` holds is gone, there is a forged cube, and everything that will ever be is known already."""
    return Delta(
        adds=[Add(("scene-1", 77), "forged", "cube"), Add(("arm-1", 1), "gen3", "arm")],
        writes=[
            Write(owner, "mass", 1 << 60, "scene-1", dot, 9.0)
            for owner in graph.store.entries
            for dot in (("scene-1", 78), ("arm-1", 2), None)
        ],
        context=[("scene-1", 1, 1000), ("arm-1", 1, 2)],
        live=frozenset(),
    )


def test_a_reply_lets_an_agent_do_no_more_than_its_deltas(policy: AccessPolicy) -> None:
    graph, gate = Graph("launcher-1"), Gate(policy)
    graph.join(gate.delta("scene-1", Graph("scene-1").add_node("cube", "cube", {"mass": 1.0}, 1.0), graph.store), 1.0)
    graph.join(gate.reply("arm-1", forged_reply(graph), graph.store), 1.0)
    assert {name: dict(node) for name, node in graph.nodes.items()} == {"cube": {"mass": 1.0}, "gen3": {}}
    assert graph.store.context.vector == {"scene-1": 2, "arm-1": 2}


def test_a_trusted_reply_hands_on_what_others_wrote_within_their_grants(policy: AccessPolicy) -> None:
    graph, gate = Graph("scene-9"), Gate(policy)
    graph.join(gate.reply("launcher-1", forged_reply(graph), graph.store), 1.0)
    assert set(graph.nodes) == {"forged", "gen3"}
    bad = Delta(adds=[Add(("arm-1", 3), "cube_9", "cube")], context=[("arm-1", 3, 3)], live=frozenset([("arm-1", 3)]))
    graph.join(gate.reply("launcher-1", bad, graph.store), 1.0)
    assert "cube_9" not in graph.nodes and ("arm-1", 3) in graph.store.context


def test_a_newcomer_gets_everything_from_the_trusted_replica(net: Net, join: Join) -> None:
    launcher, scene = join("launcher"), join("scene")
    net.pump(2.0)
    scene.add_node("cube", "cube", mass=1.0)
    net.pump(1.0)
    scene.close()
    net.memories.remove(scene)
    net.pump(1.0)
    arm = join("arm", holders=lambda: [launcher.rid])
    net.pump(2.0)
    assert content(arm) == content(launcher) == {"cube": ("cube", {"mass": 1.0})}


def test_without_a_trusted_replica_each_agent_still_tells_what_it_wrote(net: Net, join: Join) -> None:
    scene, arm = join("scene"), join("arm")
    net.pump(2.0)
    scene.add_node("cube", "cube", mass=1.0)
    arm.add_node("gen3", "arm")
    net.pump(1.0)
    late = join("scene")
    net.pump(6.0)
    assert content(late) == content(scene) == content(arm)
    assert not any(map(refused, (late, scene, arm)))


def test_what_a_rogue_claims_to_know_is_asked_for_ever_more_rarely(net: Net, join: Join) -> None:
    rogue, scene = join("arm", rogue=True), join("scene")
    net.pump(2.0)
    rogue._graph.store.context.add_range("ghost-1", 1, 1000)
    requests: list[str] = []
    answer = rogue._replica.synchroniser.answer
    rogue._replica.synchroniser.answer = lambda *a: (requests.append("asked"), answer(*a))[1]  # type: ignore[method-assign]
    net.pump(10.0)
    assert 2 <= len(requests) <= 6
    net.pump(60.0)
    assert len(requests) <= 8
    assert "ghost-1" not in context(scene).vector


def test_streams_of_a_dead_writer_are_settled_by_the_trusted_replica(net: Net, join: Join) -> None:
    arm, scene, launcher = join("arm"), join("scene"), join("launcher")
    net.pump(2.0)
    arm.add_node("world", "world")
    arm.add_node("gen3", "arm")
    arm.add_edge("world", "gen3", "RT", translation=(1.0, 0.0, 0.0), rotation=(0, 0, 0, 1))
    net.pump(2.0)
    arm.update_edge("world", "gen3", "RT", translation=(2.0, 0.0, 0.0), rotation=(0, 0, 0, 1))
    net.pump()
    net.memories.remove(arm)
    net.pump(8.0)
    late = join("scene", holders=lambda: [launcher.rid])
    net.pump(2.0)
    assert [m.edge("world", "gen3", "RT").pose.translation[0] for m in (scene, launcher, late)] == [2.0] * 3
    assert not any(map(refused, (scene, launcher, late)))


def a_node_of_two(net: Net, join: Join) -> tuple[Memory, Memory, Memory]:
    """A cube of `scene`, of which `arm`, a rogue, has made an arm, too; with an edge of `launcher` at both."""
    rogue, scene, launcher = join("arm", rogue=True), join("scene"), join("launcher")
    net.pump(2.0)
    scene.add_node("cube", "cube", mass=1.0)
    scene.add_node("table", "table")
    net.pump(1.0)
    forged = Delta([Add((rogue.rid, 1), "cube", "arm")], context=[(rogue.rid, 1, 1)])
    rogue.replica.graph.counter = 1
    rogue.transport.publish(rogue.keys.delta(rogue.rid), encode_delta(forged))
    rogue.replica.graph.join(forged, net.clock.now())
    net.pump(1.0)
    scene.add_edge("cube", "table", "on")
    net.pump(1.0)
    return rogue, scene, launcher


def test_who_has_made_a_node_too_does_not_remove_the_edges_of_others_with_it(net: Net, join: Join) -> None:
    rogue, scene, launcher = a_node_of_two(net, join)
    rogue.remove_node("cube")
    net.pump(3.0)
    assert ("cube", "table", "on") in {edge.key for edge in scene.edges()} == {edge.key for edge in launcher.edges()}
    assert scene.node("cube").type == launcher.node("cube").type == "cube"


def test_what_is_not_ours_of_a_node_is_neither_written_nor_removed_here(net: Net, join: Join) -> None:
    """Others would refuse that: replicas would differ from then on."""
    _, scene, launcher = a_node_of_two(net, join)
    scene.update_node("cube", mass=2.0)
    net.pump(1.0)
    assert scene.node("cube")["mass"] == launcher.node("cube")["mass"] == 2.0
    scene.remove_node("cube")
    net.pump(3.0)
    assert content(scene) == content(launcher)
    assert scene.node("cube").type == "arm" and "mass" not in scene.node("cube")
    assert scene.replica.graph.store.fingerprint == launcher.replica.graph.store.fingerprint
    assert refused(launcher) == 0


def test_of_a_node_that_others_made_too_only_ones_own_is_made_anew(net: Net, join: Join) -> None:
    """Others would refuse the rest: replicas would differ from then on."""
    rogue, scene, launcher = a_node_of_two(net, join)
    stamp = stamp_at(net.clock.now() + 10 * 86400)
    (own,) = [dot for dot in scene.node("cube").created if dot[0] == scene.rid]
    far = [
        (scene.rid, Write(own, "mass", stamp, scene.rid, (scene.rid, scene.replica.graph.counter + 1), 3.0)),
        (rogue.rid, Write((rogue.rid, 1), "status", stamp, rogue.rid, (rogue.rid, 2), "late")),
    ]
    scene.replica.graph.counter += 1
    for _, write in far:
        delta = Delta(writes=[write], context=[(*write.dot, write.dot[1])] if write.dot else [])
        for memory in (rogue, scene, launcher):
            memory.replica.graph.join(decode_delta(encode_delta(delta)), net.clock.now())
    cleaned = scene.clean_stamps()
    net.pump(3.0)
    assert [stamp.attribute for stamp in cleaned.renewed] == ["mass"] and "cube" in cleaned.refused
    assert content(scene) == content(launcher) and refused(launcher) == 0
    assert scene.node("cube")["mass"] == 3.0 and len(scene.node("cube").created) == 2
    assert scene.replica.graph.store.fingerprint == launcher.replica.graph.store.fingerprint


@pytest.mark.parametrize("ahead", [0, 10 * 86400])
def test_a_maker_goes_on_whatever_another_has_made_of_the_name(net: Net, ahead: int) -> None:
    """The other one's value may be of a time to come. Whoever removes its own part makes it again."""
    grants = {**GRANTS, "scene": Grant(("cube",), (), ("status",))}
    arm, scene, launcher = (net.join(agent, gate=Gate(checked(grants))) for agent in ("arm", "scene", "launcher"))
    net.pump(2.0)
    arm.add_node("cup", "arm", status="mine")
    net.pump(1.0)
    foreign = Graph("scene-zz").add_node("cup", "cube", {}, net.clock.now())
    (dot,) = (add.dot for add in foreign.adds)
    late = stamp_at(net.clock.now() + ahead)
    foreign.writes = [Write(dot, "status", late, "scene-zz", ("scene-zz", 2), "theirs")]
    foreign.context = [("scene-zz", 1, 2)]
    for memory in (arm, scene, launcher):
        memory._replica.synchroniser.receive_delta("scene-zz", encode_delta(foreign), net.clock.now())
    if ahead == 0:
        assert arm.node("cup")["status"] == "theirs"
    arm.update_node("cup", status="mine again")
    net.pump(1.0)
    assert {memory.node("cup")["status"] for memory in (arm, scene, launcher)} == {"mine again"}
    arm.remove_node("cup")
    net.pump(1.0)
    arm.add_node("cup", "arm")
    arm.update_node("cup", status="anew")
    net.pump(1.0)
    assert {memory.node("cup")["status"] for memory in (arm, scene, launcher)} == {"anew"}
    assert content(arm) == content(scene) == content(launcher)


def test_who_may_not_write_a_name_does_not_tell_others_what_it_means(net: Net) -> None:
    """Else an agent with few rights takes each name that another one registers, which then fails whenever it starts."""
    policy = checked(
        {
            "liar": Grant(("gadget",), (), ("own",)),
            "heater": Grant(("heater", "cube"), (), ("temperature",)),
            "launcher": Grant(trusted=True),
        }
    )
    liar, reader = (net.join(name, gate=Gate(policy)) for name in ("liar", "launcher"))
    net.pump(2.0)
    liar.schema.register_node_type("gadget", "of its own")
    liar.schema.register_attribute("temperature", AttributeType("str"))
    liar.add_node("g", "gadget")
    text = '{"what":"attribute","name":"temperature","attribute":{"kind":"str"}}'
    for name in (".schema.attribute.temperature", ".schema.attribute.own"):
        delta = liar._graph.copy(name, SCHEMA_RECORD, [Write(("", 1), "record", 0, "", None, text)], net.clock.now())
        liar.replica.commit(delta)
        net.pump(1.0)
        heater = net.join("heater", gate=Gate(policy))
        net.pump(2.0)
        assert "temperature" not in {**reader.schema.attributes, **heater.schema.attributes}
        assert "gadget" in reader.schema.node_types
    heater.schema.register_attribute("temperature", AttributeType("float", "K"))
    heater.add_node("h", "cube", temperature=300.0)
    net.pump(2.0)
    assert reader.schema.attribute("temperature").unit == "K" and reader.node("h")["temperature"] == 300.0
    record = heater.node(".schema.attribute.temperature")
    written = record.newest_write("record")
    net.pump(2.0)
    heater.update_node("h", temperature=301.0)
    reader.poll()
    assert record.newest_write("record") == written, "they come to rest"
