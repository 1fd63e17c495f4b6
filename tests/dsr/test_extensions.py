"""Registered names travel: whoever joins knows their unit and meaning, and is told of contradictions."""

from __future__ import annotations

import logging
from collections.abc import Callable
from itertools import count

import pytest

from dsr import Access, AttributeType, ConfigError, Memory, NodeTypeError, Pose, RegistrationError, Schema, SchemaError
from dsr.crdt.delta import Delta
from dsr.graph import extensions
from dsr.graph.access import WriteGuard
from dsr.graph.extensions import ExtensionRecord
from dsr.graph.graph import Graph
from dsr.graph.schema import RECORDS, SCHEMA_RECORD
from dsr.persistence.content import GraphContent, NodeContent
from tests.dsr.conftest import Net


def drones() -> Schema:
    schema = Schema()
    schema.register_node_type("drone", "flies")
    schema.register_edge_type("tether", "pose of what hangs on it", geometric=True)
    schema.register_attribute("battery", AttributeType("float", "V", "at the poles"))
    return schema


def forge(memory: Memory, write: Callable[[Graph], Delta]) -> None:
    """Write what an honest memory refuses, as a hostile process or one of another version may."""
    memory.replica.commit(write(memory.replica.graph))
    memory.replica.send_soon()


def test_names_are_known_where_nobody_registered_them(net: Net) -> None:
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    pilot.add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    assert reader.schema.attribute("battery") == AttributeType("float", "V", "at the poles")
    assert reader.schema.node_types["drone"] == "flies"
    watch = reader.watch(node_type="drone", attribute="battery")
    assert [change.name for change in watch.poll()] == ["d1"]
    reader.update_node("d1", battery=10.9)
    with pytest.raises(SchemaError, match="float in V"):
        reader.update_node("d1", battery="low")


def test_who_joins_later_knows_them_too(net: Net) -> None:
    pilot = net.join("pilot", schema=drones())
    pilot.add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    late = net.join("late")
    net.pump(0.5)
    assert late.schema.attribute("battery").unit == "V"
    assert [node.name for node in late.nodes()] == ["d1"]


def test_a_learned_edge_type_carries_frames(net: Net) -> None:
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    pilot.add_node("d1", "drone")
    pilot.add_node("load", "cube")
    pilot.add_edge("d1", "load", "tether", pose=Pose((0.0, 0.0, -1.0)))
    net.pump(0.5)
    assert reader.transform("d1", "load", types=("tether",)).t == (0.0, 0.0, -1.0)


def test_a_name_that_is_registered_late_travels_with_the_next_write(net: Net) -> None:
    pilot, reader = net.join("pilot"), net.join("reader")
    pilot.add_node("d1", "cube")
    pilot.schema.register_attribute("battery", AttributeType("float", "V"))
    pilot.update_node("d1", battery=11.1)
    net.pump(0.5)
    assert reader.schema.attribute("battery").unit == "V"


def test_names_that_only_another_world_uses_travel_too(net: Net) -> None:
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    world = pilot.fork("what_if")
    world.add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    assert "drone" in reader.schema.node_types


def test_records_are_not_among_the_things(net: Net) -> None:
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    everything = reader.watch()
    pilot.add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    assert [node.name for node in reader.nodes()] == ["d1"]
    assert {change.name for change in everything.poll()} == {"d1"}
    assert len(reader.nodes(SCHEMA_RECORD)) == 3
    assert set(GraphContent.of(reader).nodes) == {"d1"}
    assert GraphContent.of(reader).schema.attribute("battery").meaning == "at the poles"


def test_another_meaning_of_a_name_is_told_once(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    other = Schema()
    other.register_attribute("battery", AttributeType("float", "%"))
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader", schema=other)
    with caplog.at_level(logging.WARNING, "dsr.memory"):
        pilot.add_node("d1", "drone", battery=11.1)
        net.pump(0.5)
        reader.update_node("d1", battery=90.0)
        net.pump(0.5)
    told = [record.getMessage() for record in caplog.records if "battery" in record.getMessage()]
    assert told == [
        "attribute 'battery' is float in % here, but float in V for another process: their values do not mean the same"
    ]
    assert reader.schema.attribute("battery").unit == "%"
    assert pilot.schema.attribute("battery").unit == "V"


def test_a_known_name_is_not_registered_with_another_unit(net: Net) -> None:
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    pilot.add_node("d1", "drone")
    net.pump(0.5)
    with pytest.raises(SchemaError, match="already a float in V, not a float in %"):
        reader.schema.register_attribute("battery", AttributeType("float", "%"))
    reader.schema.register_attribute("battery", AttributeType("float", "V", "in other words"))


@pytest.mark.parametrize(
    "record",
    [
        "",
        "{",
        "[]",
        '{"what": "node"}',
        '{"what": "planet", "name": "x"}',
        '{"what": "node", "name": "a b"}',
        '{"what": "attribute", "name": "battery", "attribute": {"kind": "matrix"}}',
        '{"what": "attribute", "name": 3}',
    ],
)
def test_a_senseless_record_changes_nothing(
    net: Net, record: str, caplog: pytest.LogCaptureFixture
) -> None:
    attacker, reader = net.join("attacker"), net.join("reader")
    with caplog.at_level(logging.WARNING, "dsr.memory"):
        forge(attacker, lambda graph: graph.add_node(".schema.x", SCHEMA_RECORD, {"record": record}, 0.0))
        net.pump(0.5)
    assert reader.schema.node_types == Schema().node_types
    assert reader.schema.attributes == Schema().attributes
    assert any(".schema.x" in entry.getMessage() for entry in caplog.records)


def test_built_in_names_cannot_be_described_anew(net: Net) -> None:
    attacker, reader = net.join("attacker"), net.join("reader")
    text = '{"what": "attribute", "name": "mass", "attribute": {"kind": "str", "unit": "lb"}}'
    forge(attacker, lambda graph: graph.add_node(".schema.attribute.mass", SCHEMA_RECORD, {"record": text}, 0.0))
    net.pump(0.5)
    assert reader.schema.attribute("mass") == Schema().attribute("mass")


def test_whoever_may_not_write_a_name_does_not_describe_it(net: Net) -> None:
    guard = WriteGuard("eye", Access(("cube",), ("RT",), ("mass",)))
    eye, reader = net.join("eye", schema=drones(), guard=guard), net.join("reader")
    eye.add_node("c", "cube", mass=0.1)
    net.pump(0.5)
    assert "drone" not in reader.schema.node_types
    pilot = net.join("pilot", schema=drones(), guard=WriteGuard("pilot", Access(("drone",), (), ("battery",))))
    pilot.add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    assert "drone" in reader.schema.node_types


@pytest.mark.parametrize("node", [(".schema.node.ship", "cube"), ("mine", SCHEMA_RECORD)])
def test_content_that_holds_such_nodes_is_not_put_in(net: Net, node: tuple[str, str]) -> None:
    memory = net.join("a")
    content = GraphContent("g", nodes={"c": NodeContent("cube", {}), node[0]: NodeContent(node[1], {})})
    with pytest.raises(ConfigError, match="are the graph's own"):
        content.put_into(memory)
    assert "c" not in memory


RECORD = ".schema.attribute.battery"


@pytest.mark.parametrize(
    "write",
    [
        lambda memory: memory.remove_node(RECORD),
        lambda memory: memory.update_node(RECORD, record="{}"),
        lambda memory: memory.remove_attribute(RECORD, "record"),
        lambda memory: memory.remove_attribute(memory.node(RECORD), "record"),
        lambda memory: memory.add_node(RECORD, SCHEMA_RECORD, record="{}"),
        lambda memory: memory.add_node(".schema.node.ship", SCHEMA_RECORD, record="{}"),
        lambda memory: memory.add_node(".schema.node.ship", "cube"),
        lambda memory: memory.add_node("mine", SCHEMA_RECORD),
        lambda memory: memory.copy(memory.node(RECORD), {"record": "{}"}),
        lambda memory: memory.withdraw(memory.node(RECORD)),
        lambda memory: memory.remove_node(".world.plan"),
        lambda memory: memory.update_node(".world.plan", record="{}"),
        lambda memory: memory.add_node(".world.dream", "world_record", record="{}"),
        lambda memory: memory.add_node(".world.dream", "cube"),
    ],
)
def test_what_the_graph_tells_of_itself_is_not_for_others_to_write(net: Net, write: Callable[[Memory], object]) -> None:
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    pilot.fork("plan")
    pilot.add_node("d1", "drone")
    net.pump(0.5)
    for memory in (pilot, reader):
        before = {node.name: dict(node) for kind in RECORDS for node in memory.nodes(kind)}
        with pytest.raises(SchemaError, match=r"are the graph's own; they change with memory\.schema\.register_"):
            write(memory)
        assert {node.name: dict(node) for kind in RECORDS for node in memory.nodes(kind)} == before
    pilot.delete_world("plan")
    assert not pilot.nodes("world_record")


@pytest.mark.parametrize(
    "harm",
    [
        lambda graph: graph.remove_node(RECORD),
        lambda graph: graph.write(graph.node(RECORD), {"record": "nonsense"}, 0.0),
        lambda graph: graph.write(graph.node(RECORD), {"record": '{"what": "node", "name": "x"}'}, 0.0),
        lambda graph: graph.remove_attribute(graph.node(RECORD), "record", 0.0),
    ],
)
@pytest.mark.parametrize("survivor", ["pilot", "reader"])
def test_a_name_whose_record_was_harmed_is_told_again_by_whoever_knows_it(
    net: Net, harm: Callable[[Graph], Delta], survivor: str
) -> None:
    """Also by one that only learned the name, when the process that registered it is gone."""
    memories = {"pilot": net.join("pilot", schema=drones()), "reader": net.join("reader")}
    attacker = net.join("attacker")
    memories["pilot"].add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    forge(attacker, harm)
    net.pump(0.5)
    if survivor == "reader":
        memories["pilot"].close()
    memories[survivor].update_node("d1", battery=11.0)
    net.pump(0.5)
    late = net.join("late")
    net.pump(0.5)
    assert late.schema.attribute("battery").unit == "V"
    assert ExtensionRecord("attribute", "battery").node_name == RECORD and RECORD in late


def test_nobody_takes_the_place_of_a_record(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    attacker, pilot = net.join("attacker"), net.join("pilot", schema=drones())
    forge(attacker, lambda graph: graph.copy(".schema.node.drone", "cube", [], 0.0))
    net.pump(0.5)
    with caplog.at_level(logging.WARNING, "dsr.memory"):
        pilot.add_node("d1", "drone", battery=11.1)
    assert "a node about the graph itself whose name and type do not fit" in caplog.text
    assert pilot.node(".schema.node.drone").type == SCHEMA_RECORD
    assert RECORD in pilot and pilot.node("d1")["battery"] == 11.1


def test_to_harm_one_record_of_thousands_has_nobody_look_at_all(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    """A message of 45 bytes had each process look at all names with its next write, at 3 us a name."""
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    for number in range(500):
        pilot.schema.register_node_type(f"drone_{number}", "flies")
    pilot.add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    assert "drone_499" in reader.schema.node_types
    looks, read = count(), extensions._read
    monkeypatch.setattr(extensions, "_read", lambda node: read(node) if next(looks) >= 0 else None)
    for number in range(5):
        forge(pilot, lambda graph: graph.write(graph.node(RECORD), {"record": "nonsense"}, 0.0))
        net.pump(0.5)
        reader.update_node("d1", battery=float(number))
        net.pump(0.5)
        assert "nonsense" not in (pilot.node(RECORD)["record"], reader.node(RECORD)["record"])
    assert next(looks) < 100


def test_nonsense_in_thousands_of_records_is_told_of_a_thousand(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    liar, reader = net.join("liar"), net.join("reader")
    for number in range(1100):
        forge(liar, lambda graph, name=f".schema.node.n{number}": graph.copy(name, SCHEMA_RECORD, [], 0.0))  # type: ignore[misc]
        forge(liar, lambda graph, name=f".schema.node.n{number}": graph.write(graph.node(name), {"record": "?"}, 0.0))  # type: ignore[misc]
        liar.flush()
    net.pump(1.0)
    assert not reader.extensions._lost, "nobody here registered these names"
    reader.add_node("x", "cube")
    assert len([record for record in caplog.records if "no valid record" in record.getMessage()]) == 2 * 1000


def test_records_come_to_rest(net: Net) -> None:
    """Two processes that contradict one another do not write their records in turn."""
    other = Schema()
    other.register_attribute("battery", AttributeType("float", "%"))
    one, two = net.join("one", schema=drones()), net.join("two", schema=other)
    for value in range(5):
        one.add_node("d1", "drone", battery=float(value))
        net.pump(0.5)
        two.update_node("d1", battery=value + 0.5)
        net.pump(0.5)
        if value == 1:
            settled = [node.newest_write("record") for node in one.nodes(SCHEMA_RECORD)]
    assert [node.newest_write("record") for node in one.nodes(SCHEMA_RECORD)] == settled


def test_names_of_every_length_have_a_record() -> None:
    names = ["a", "b" * 120, "c" * 128]
    assert all(len(ExtensionRecord("attribute", name).node_name) <= 128 for name in names)
    assert len({ExtensionRecord("attribute", name).node_name for name in names}) == 3


def test_a_node_keeps_its_type(net: Net) -> None:
    memory: Memory = net.join("a")
    memory.add_node("c", "cube", mass=0.1)
    with pytest.raises(NodeTypeError, match=r"node 'c' is a 'cube', not a 'ball'.*update_node"):
        memory.add_node("c", "ball")
    memory.add_node("c", "cube", mass=0.2)
    assert memory.node("c")["mass"] == 0.2


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        (AttributeType("float", unit=3), "unit of attribute 'charge': expected a text"),  # type: ignore[arg-type]
        (AttributeType("float", meaning="x" * 1001), "meaning of attribute 'charge': expected a text of at most 1000"),
        (AttributeType("vector", length=0), "length 0: expected 1 to"),
        (AttributeType("vector", length=2.0), "length 2.0: expected 1 to"),  # type: ignore[arg-type]
        (AttributeType("float", length=2), "length 2: expected 1 to .* for a vector only"),
        (AttributeType("float", stream=1), "stream 1: expected True or False"),  # type: ignore[arg-type]
        (AttributeType(["int"]), "unknown kind"),  # type: ignore[arg-type]
    ],
)
def test_what_could_not_travel_is_refused_where_it_is_registered(attribute: AttributeType, said: str) -> None:
    schema = Schema()
    with pytest.raises(SchemaError, match=said):
        schema.register_attribute("charge", attribute)
    assert "charge" not in schema.attributes and schema.registered == []


def test_a_meaning_that_is_no_short_text_is_refused_and_later_writes_go_on(net: Net) -> None:
    pilot, reader = net.join("pilot", schema=drones()), net.join("reader")
    for meaning in ("x" * 5_000_000, None):
        with pytest.raises(SchemaError, match="meaning of node type 'ship': expected a text of at most 1000"):
            pilot.schema.register_node_type("ship", meaning)  # type: ignore[arg-type]
        with pytest.raises(SchemaError, match="meaning of edge type 'tows': expected a text of at most 1000"):
            pilot.schema.register_edge_type("tows", meaning)  # type: ignore[arg-type]
    pilot.add_node("d1", "drone", battery=11.1)
    net.pump(0.5)
    assert reader.node("d1")["battery"] == 11.1 and reader.schema.attribute("battery").unit == "V"


def test_an_edge_type_stays_geometric_or_not() -> None:
    schema = drones()
    schema.register_edge_type("tether", "in other words", geometric=True)
    with pytest.raises(SchemaError, match="edge type 'tether' is already one that is geometric"):
        schema.register_edge_type("tether", "a rope")
    with pytest.raises(SchemaError, match="edge type 'has' is already one that is not geometric"):
        schema.register_edge_type("has", "a pose", geometric=True)
    assert schema.edge_types["tether"] == "in other words" and "has" not in schema.geometric


@pytest.mark.parametrize(
    ("register", "said"),
    [
        (lambda s: s.register_node_type("cup", "a trophy"), "node type 'cup' is built in and means .*'a trophy', too"),
        (lambda s: s.register_edge_type("has", "owns"), "edge type 'has' .*means 'structure'.*'owns', too"),
        (
            lambda s: s.register_attribute("mass", AttributeType("float", "kg", "of many people")),
            "attribute 'mass' is built in and means 'mass': it cannot mean 'of many people', too",
        ),
        (
            lambda s: s.register_attribute("opening", AttributeType("float", "m")),
            "attribute 'opening' .*is built in as a stream: it cannot be none",
        ),
        (
            lambda s: s.register_attribute("mass", AttributeType("float", "kg", stream=True)),
            "attribute 'mass' .*is built in as no stream: it cannot be one",
        ),
        (lambda s: s.register_attribute("mass", AttributeType("str", "kg")), "already a float in kg, not a str in kg"),
    ],
)
def test_a_built_in_name_keeps_its_meaning(register: Callable[[Schema], None], said: str) -> None:
    schema = Schema()
    with pytest.raises(RegistrationError, match=said):
        register(schema)
    untouched = Schema()
    assert (schema.node_types, schema.edge_types) == (untouched.node_types, untouched.edge_types)
    assert schema.attributes == untouched.attributes and schema.registered == []


def test_a_built_in_name_may_be_registered_again_as_it_is_or_without_a_meaning() -> None:
    schema, untouched = Schema(), Schema()
    for meaning in (untouched.node_types["cup"], ""):
        schema.register_node_type("cup", meaning)
    for meaning in (untouched.edge_types["RT"], ""):
        schema.register_edge_type("RT", meaning, geometric=True)
    for attribute in (untouched.attributes["mass"], AttributeType("float", "kg")):
        schema.register_attribute("mass", attribute)
    assert (schema.node_types, schema.edge_types) == (untouched.node_types, untouched.edge_types)
    assert schema.attributes == untouched.attributes


def test_an_attribute_of_an_unknown_kind_is_refused_at_once() -> None:
    with pytest.raises(SchemaError, match="attribute 'mass': unknown kind 'flaot'; did you mean 'float'"):
        Schema().register_attribute("mass", AttributeType("flaot"))  # type: ignore[arg-type]
