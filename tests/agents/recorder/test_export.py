"""Tables of a recording hold what its graph held: read back with `csv` and compared with the replayed graph."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from agents.recorder.cli import app
from agents.recorder.export import TABLES, ExportSelection, export_csv
from agents.replay import ReplayedGraph
from dsr import Memory, Pose
from dsr.errors import ConfigError
from dsr.graph.elements import Edge
from dsr.runtime.logs import LogRecord
from dsr.runtime.status import State, Status, encode_status
from tests.agents.recorder.world import KEYS, World

Rows = list[dict[str, str]]
SECONDS = 8
COMMAND = [sys.executable, "-c", "from agents.recorder.cli import app; app()"]


def written_pose(index: int, stamp: float) -> Pose:
    """A pose with another covariance each time, or none."""
    covariance = np.diag(np.arange(1.0, 7.0) * 1e-4 * (index + 1)) if index % 2 else None
    return Pose.from_rotvec((0.1 * index, -0.2, 0.3), (0.0, 0.1 * index, 0.2), stamp, covariance)


@pytest.fixture
def world(world: World) -> World:
    """Eight seconds: cubes that move, come and go, an arm, logs, statuses, the truth; the recording is closed."""
    memory, bus = world.memory, world.memory.transport
    memory.schema.register_attribute("charge", msgspec.structs.replace(memory.schema.attributes["mass"], unit="J"))
    memory.add_node("world", "world")
    memory.add_node("arm", "arm", joint_names="a,b", joint_positions=[0.0, 0.5], joint_velocities=[0.0, 0.0])
    memory.add_node("cube_3", "cube", mass=0.05, size=(0.04, 0.04, 0.04), note='says "1,5",\nthen more; =1+1 ü')
    world.run(1.0)
    recorder = world.start_recorder(rotate_period=3.0)
    world.run(1.5)
    for second in range(SECONDS):
        now = world.clock.now()
        memory.add_edge("world", "cube_3", "RT", pose=written_pose(second, now))
        memory.add_edge("world", "arm", "Virtual_RT", pose=written_pose(second + 1, now))
        memory.update_node("arm", joint_positions=[0.1 * second, 0.2], joint_velocities=[0.1, 0.0])
        if second % 2:
            memory.add_node("cube_4", "cube", charge=float(second), perceived=True)
            memory.add_edge("cube_4", "cube_3", "on", score=0.5)
        else:
            memory.remove_node("cube_4")
            memory.remove_attribute("cube_3", "note")
        truth = {"stamp": now, "objects": {"cube_3": [0.1 * second, 0, 0, 0, 0, 0, 1]}, "robot": [], "camera": {}}
        bus.publish(KEYS.truth(), msgspec.msgpack.encode(truth))
        bus.publish(KEYS.log("planner"), msgspec.msgpack.encode(LogRecord(now, "INFO", "planner", f"step {second}")))
        status = Status(agent="planner", rid="planner-1", pid=7, state=State.READY, rate_hz=10.0, stamp=now)
        bus.publish(KEYS.status("planner"), encode_status(status))
        world.run(1.0)
    recorder.teardown()
    return world


def tables(source: Path, folder: Path, **selection: Any) -> dict[str, Rows]:
    export_csv(ReplayedGraph(source), folder, ExportSelection(**selection))
    return read(folder)


def read(folder: Path) -> dict[str, Rows]:
    found = {}
    for file in folder.glob("*.csv"):
        with file.open(encoding="utf-8", newline="") as lines:
            found[file.stem] = list(csv.DictReader(lines))
    return found


def rebuilt(found: dict[str, Rows]) -> dict[Any, Any]:
    """The state of a graph after all rows, as text; joints and poses as numbers."""
    state: dict[Any, dict[str, Any]] = {}
    rows = [
        (float(row["time_s"]), table, row) for table in ("nodes", "edges", "joints", "poses") for row in found[table]
    ]
    order = ("nodes", "edges", "joints", "poses")
    for _, table, row in sorted(rows, key=lambda item: (item[0], order.index(item[1]))):
        key: Any = row["node"] if "node" in row else (row["src"], row["dst"], row["type"])
        if table == "joints":
            state[key].setdefault("joints", {})[row["joint"]] = (row["position_rad"], row["velocity_rad_s"])
        elif table == "poses":
            state[key]["pose"] = numbers(row)
        elif row["change"] == "removed":
            state.pop(key, None)
        elif not row["attribute"]:
            state[key] = {}
        elif row["value"]:
            state[key][row["attribute"]] = row["value"]
        else:
            state[key].pop(row["attribute"], None)
    return state


def numbers(row: dict[str, str]) -> tuple[float, ...]:
    return tuple(float(row[name]) for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "stamp_s"))


def expected(memory: Memory) -> dict[Any, Any]:
    state: dict[Any, Any] = {}
    for element in (*memory.nodes(), *memory.edges()):
        values: dict[str, Any] = {}
        for name, value in element.attributes.items():
            if name == "pose":
                values[name] = (*value.t, *value.q, value.stamp)
            elif not name.startswith("joint_"):
                values[name] = value if isinstance(value, str) else json.dumps(value)
        key = element.key if isinstance(element, Edge) else element.name
        if "joint_positions" in element:
            pairs = zip(element["joint_positions"], element["joint_velocities"], strict=True)
            joints = element["joint_names"].split(",")
            values["joint_names"] = element["joint_names"]
            values["joints"] = {name: (str(p), str(v)) for name, (p, v) in zip(joints, pairs, strict=True)}
        state[key] = values
    return state


def test_the_rows_add_up_to_the_graph_at_the_end(world: World, tmp_path: Path) -> None:
    source = ReplayedGraph(world.folder)
    found = tables(world.folder, tmp_path / "out")
    assert rebuilt(found) == expected(source.at(source.duration))
    assert set(found) == {table.name for table in TABLES}


@pytest.mark.parametrize("until", [2.0, 4.4, 6.1])
def test_the_rows_add_up_to_the_graph_at_any_time(world: World, tmp_path: Path, until: float) -> None:
    assert rebuilt(tables(world.folder, tmp_path / "out", until=until)) == expected(
        ReplayedGraph(world.folder).at(until)
    )


@pytest.mark.parametrize("since", [2.0, 4.4, 6.1])
def test_a_later_begin_starts_with_what_is_known_then(world: World, tmp_path: Path, since: float) -> None:
    source = ReplayedGraph(world.folder)
    found = tables(world.folder, tmp_path / "out", since=since)
    assert rebuilt(found) == expected(source.at(source.duration))
    assert all(float(row["time_s"]) >= since for rows in found.values() for row in rows)


def test_every_sample_is_a_row_with_its_covariance(world: World, tmp_path: Path) -> None:
    found = tables(world.folder, tmp_path / "out")["poses"]
    cube = [row for row in found if row["dst"] == "cube_3"]
    assert len(cube) == SECONDS
    for index, row in enumerate(cube):
        pose = written_pose(index, float(row["stamp_s"]))
        assert (row["type"], row["src"], row["writer"]) == ("RT", "world", "writer")
        np.testing.assert_allclose(numbers(row)[:7], [*pose.translation, *pose.rotation], atol=1e-15)
        variances = [row[name] for name in row if name.startswith("var_")]
        if pose.covariance is None:
            assert variances == [""] * 6
        else:
            np.testing.assert_allclose([float(text) for text in variances], np.diag(pose.covariance))
    stamps = [float(row["stamp_s"]) for row in cube]
    assert np.diff(stamps) == pytest.approx(1.0)
    assert [float(row["time_s"]) for row in cube] == pytest.approx(
        np.array(stamps) - stamps[0] + float(cube[0]["time_s"]), abs=0.2
    )


def test_traffic_beside_the_graph_has_its_tables(world: World, tmp_path: Path) -> None:
    found = tables(world.folder, tmp_path / "out")
    assert [row["text"] for row in found["logs"]] == [f"step {second}" for second in range(SECONDS)]
    assert [float(row["x_m"]) for row in found["truth"]] == pytest.approx([0.1 * second for second in range(SECONDS)])
    assert {(row["agent"], row["state"], row["rate_hz"]) for row in found["statuses"]} == {("planner", "ready", "10.0")}
    assert {row["subject"] for row in found["events"]} >= {"planner", "cube_4"}


def test_units_of_registered_attributes_are_told(world: World, tmp_path: Path) -> None:
    found = tables(world.folder, tmp_path / "out")["nodes"]
    assert {row["unit"] for row in found if row["attribute"] == "charge"} == {"J"}
    assert {row["unit"] for row in found if row["attribute"] == "size"} == {"m"}


def test_the_readme_tells_every_column(world: World, tmp_path: Path) -> None:
    tables(world.folder, tmp_path / "out")
    text = (tmp_path / "out" / "README.txt").read_text()
    for table in TABLES:
        assert f"{table.name}.csv: " in text
        with (tmp_path / "out" / f"{table.name}.csv").open(newline="") as file:
            header = next(csv.reader(file))
        assert header == [column.name for column in table.columns]
        assert all(f"    {name} " in text for name in header)


def test_nodes_and_tables_can_be_chosen(world: World, tmp_path: Path) -> None:
    found = tables(world.folder, tmp_path / "out", nodes=["cube_*"], tables=["poses", "nodes", "edges"])
    assert set(found) == {"poses", "nodes", "edges"}
    assert {row["dst"] for row in found["poses"]} == {"cube_3"}
    assert {row["node"] for row in found["nodes"]} == {"cube_3", "cube_4"}
    assert {(row["src"], row["dst"]) for row in found["edges"]} == {("world", "cube_3"), ("cube_4", "cube_3")}


@pytest.mark.parametrize(
    ("selection", "said"),
    [
        ({"tables": ["pose"]}, "--table pose: no such table; did you mean 'poses'"),
        ({"nodes": ["cube_33"]}, "--node cube_33: no such node"),
        ({"nodes": ["arn"]}, "did you mean 'arm'"),
        ({"since": 5.0, "until": 4.0}, "--from 5, --until 4"),
        ({"since": 500.0}, "--from 500: expected at most"),
        ({"until": float("nan")}, "--until nan"),
    ],
)
def test_a_choice_that_fits_nothing_is_refused(
    world: World, tmp_path: Path, selection: dict[str, Any], said: str
) -> None:
    before = sorted(tmp_path.iterdir())
    with pytest.raises(ConfigError, match=said):
        tables(world.folder, tmp_path / "out", **selection)
    assert sorted(tmp_path.iterdir()) == before, "nothing is left behind"


def test_a_folder_with_something_in_it_is_not_touched(world: World, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    tables(world.folder, tmp_path / "out")
    (tmp_path / "out" / "poses.csv").write_text("mine")
    with pytest.raises(ConfigError, match="is empty"):
        tables(world.folder, tmp_path / "out")
    assert (tmp_path / "out" / "poses.csv").read_text() == "mine"


def test_an_interrupted_export_leaves_nothing_behind(world: World, tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())

    def interrupt(time: float, end: float) -> None:
        if time > end / 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_csv(ReplayedGraph(world.folder), tmp_path / "out", ExportSelection(), interrupt)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("seed", range(12))
def test_a_truncated_recording_is_exported_up_to_its_cut(world: World, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = tables(world.folder, tmp_path / "whole")
    last = sorted(world.folder.glob("recording*.mcap"), key=lambda file: file.stat().st_mtime_ns)[-1]
    data = last.read_bytes()
    last.write_bytes(data[: int(rng.integers(len(data) // 20, len(data) - 200))])
    source = ReplayedGraph(world.folder)
    assert source.problems
    exported = export_csv(source, tmp_path / "cut", ExportSelection())
    assert exported.problems == source.problems
    assert "cut off" in (tmp_path / "cut" / "README.txt").read_text()
    cut = read(tmp_path / "cut")
    for name, rows in cut.items():
        assert rows == whole[name][: len(rows)], name
    assert rebuilt(cut) == expected(source.at(source.duration))


def test_nonsense_is_counted_and_left_out(world: World, tmp_path: Path) -> None:
    recorder = world.start_recorder()
    for key in (KEYS.truth(), KEYS.log("x"), KEYS.status("x"), KEYS.delta("x-1")):
        world.memory.transport.publish(key, b"\xc1 nonsense")
    world.run(1.0)
    recorder.teardown()
    exported = export_csv(ReplayedGraph(world.folder), tmp_path / "out", ExportSelection())
    assert exported.malformed == 4
    assert "Left out: 4 messages" in (tmp_path / "out" / "README.txt").read_text()


def test_the_command_writes_tells_and_refuses(world: World, tmp_path: Path) -> None:
    folder, out = str(world.folder), tmp_path / "out"
    told = CliRunner().invoke(app, ["export", folder, "--csv", str(out), "-t", "poses", "-n", "cube_3", "--json"])
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["rows"] == {"poses": SECONDS}
    with pytest.raises(ConfigError, match="--csv FOLDER"):
        CliRunner().invoke(app, ["export", folder], catch_exceptions=False)
    command = [*COMMAND, "export", folder, "--csv", str(tmp_path / "two")]
    shown = subprocess.run(command, capture_output=True, text=True, check=True)
    assert f"poses.csv  {2 * SECONDS} rows" in shown.stdout
