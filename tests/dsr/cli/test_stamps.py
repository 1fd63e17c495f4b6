"""`dsr stamps`, and what `dsr top` tells of forged stamps."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from typer.testing import CliRunner

from dsr import Memory, WallClock
from dsr.cli.main import app
from dsr.crdt.delta import Delta, Write
from dsr.crdt.hlc import MAX_STAMP
from dsr.network import rendezvous
from dsr.network.zenoh_transport import ZenohTransport
from dsr.replication.wire import encode_delta

PATIENCE = 10.0


@pytest.fixture
def poisoned(memory: Memory) -> Memory:
    """Somebody has stamped two values of the graph "scene" with the last stamp that there is."""
    transport = ZenohTransport(f"tcp/127.0.0.1:{rendezvous.free_port()}", rendezvous.endpoints("scene"))
    cube, edge = memory.node("cube_3").created[0], memory.edge("world", "table", "RT").created[0]
    pose = memory.edge("world", "table", "RT").pose
    values = [(cube, "perceived", False), (edge, "pose", pose)]
    writes = [
        Write(owner, name, MAX_STAMP, "forger-1", ("forger-1", number), value)
        for number, (owner, name, value) in enumerate(values, 1)
    ]
    transport.publish(memory.keys.delta("forger-1"), encode_delta(Delta(writes=writes, context=[("forger-1", 1, 2)])))
    assert memory.replica.wait_until(lambda: len(memory.far_stamps()) == 2, PATIENCE)
    transport.close()
    return memory


def test_a_clean_graph_has_none(memory: Memory, cli: Callable[..., str]) -> None:
    assert "no value is stamped" in cli("stamps") and json.loads(cli("stamps", "--json")) == []
    assert "no value is stamped" in cli("stamps", "--clean", "--yes")


def test_they_are_listed_with_their_writer_and_cleaned_without_a_restart(
    poisoned: Memory, cli: Callable[..., str]
) -> None:
    listed = CliRunner().invoke(app, ["stamps", "--json"], catch_exceptions=False)
    rows = json.loads(listed.stdout)
    assert listed.exit_code == 1
    assert [(row["element"], row["attribute"], row["writer"]) for row in rows] == [
        ("cube_3", "perceived", "forger-1"), (["world", "table", "RT"], "pose", "forger-1"),
    ]  # fmt: skip
    assert "2 values are stamped days ahead of this clock, last written by forger (2)" in " ".join(cli("top").split())
    asked = CliRunner().invoke(app, ["stamps", "--clean"], input="n\n")
    assert asked.exit_code == 1 and len(poisoned.far_stamps()) == 2
    before = {edge.key: dict(edge) for edge in poisoned.edges()}
    assert "no value is stamped" in cli("stamps", "--clean", "--yes")
    assert poisoned.replica.wait_until(lambda: not poisoned.far_stamps(), PATIENCE)
    assert {edge.key: dict(edge) for edge in poisoned.edges()} == before
    poisoned.update_node("cube_3", perceived=True)
    written = poisoned.node("cube_3").written_at("perceived")
    assert poisoned.node("cube_3")["perceived"] is True and abs((written or 0.0) - WallClock().now()) < PATIENCE
