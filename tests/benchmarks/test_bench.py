"""The harness of `dsr bench`: what it reports, and that it leaves nothing behind. No figure is judged here."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from benchmarks import cli, curves, groups, session
from benchmarks.cli import app
from benchmarks.group import Group, Measured, Missing, Run, Step
from benchmarks.links import DsrLink, Link
from benchmarks.pairs import Latencies
from benchmarks.peers.tcp_link import TcpLink
from benchmarks.peers.zenoh_link import ZenohLink, open_session
from benchmarks.ports import reserved_port
from benchmarks.progress import EVERY, Progress
from benchmarks.rows import Peer, Row, Spec, judged, median_row, number
from benchmarks.session import Findings
from benchmarks.workers import BenchmarkError, Worker
from dsr.errors import ConfigError

ROOT = Path(__file__).parents[2]
KEYS = {"row", "value", "unit", "target", "peer", "ratio", "meets", "note", "of_peer"}


@pytest.fixture(autouse=True)
def private_runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


@pytest.mark.parametrize(
    ("better", "value", "meets"),
    [("lower", 2.0, True), ("lower", 2.1, False), ("higher", 2.0, True), ("higher", 1.9, False)],
)
def test_a_target_is_met_on_its_better_side(better: str, value: float, meets: bool) -> None:
    assert judged(Spec("r", "ms", 2.0, better), value).meets is meets  # type: ignore[arg-type]


def test_a_row_without_target_or_peers_is_judged_by_nothing() -> None:
    row = judged(Spec("r", "ms"), 1.0)
    assert (row.meets, row.ratio, row.peer) == (None, None, None)


def test_the_ratio_is_to_the_first_peer() -> None:
    assert judged(Spec("r", "ms"), 3.0, [Peer("a", 2.0), Peer("b", 1.0)]).ratio == 1.5


@pytest.mark.parametrize(("better", "meets"), [("lower", False), ("higher", True)])
def test_a_target_by_the_first_peer_counts_where_that_was_measured(better: str, meets: bool) -> None:
    spec = Spec("r", "ms", 2.0, better, of_peer=1.5)  # type: ignore[arg-type]
    beside = judged(spec, 2.0, [Peer("a", 1.0), Peer("b", 9.0)])
    assert (beside.ratio, beside.of_peer, beside.meets) == (2.0, 1.5, meets)
    alone = judged(spec, 2.0)
    assert (alone.of_peer, alone.meets) == (None, True)


def test_runs_are_summed_up_by_medians_and_judged_anew() -> None:
    spec = Spec("r", "ms", 2.5)
    rows = [judged(spec, value, [Peer("a", value * 2)]) for value in (1.0, 2.0, 9.0)]
    row = median_row(spec, rows)
    assert (row.value, row.ratio, row.meets) == (2.0, 0.5, True) and row.peer == [Peer("a", 4.0)]
    assert "1 to 9" in row.note


def test_numbers_are_short() -> None:
    assert [number(value) for value in (123456.7, 12.345, 0.00012345)] == ["123 000", "12.3", "0.000123"]


def test_rows_have_different_names() -> None:
    assert len({group.name for group in groups.GROUPS}) == len(groups.GROUPS)
    names = [spec.row for group in groups.GROUPS for spec in group.specs]
    assert len(set(names)) == len(names)


def test_rows_are_chosen_by_a_part_of_their_name_or_by_their_group() -> None:
    [(group, specs)] = groups.choose(["late JOIN"])
    assert group.name == "join" and specs and all("late join" in spec.row for spec in specs)
    assert groups.choose(["local"])[0][0].name == "local"
    with pytest.raises(ConfigError, match=r"no row contains 'teleport'.*latency, throughput"):
        groups.choose(["teleport"])


def test_the_list_shows_rows_and_targets() -> None:
    result = CliRunner().invoke(app, ["--list", "join"], env={"COLUMNS": "120"})
    assert result.exit_code == 0
    assert "late join, 10 000 nodes" in result.output and "≤ 300 ms" in result.output


def test_a_group_is_measured_and_written_as_json(tmp_path: Path) -> None:
    file = tmp_path / "deep" / "rows.json"
    result = CliRunner().invoke(app, ["nodes by type among", "--quick", "--json-file", str(file)])
    assert result.exit_code == 0, result.output
    rows = json.loads(file.read_text())
    assert [set(row) for row in rows] == [KEYS] * len(rows)
    assert rows[0]["row"] == "nodes by type among 10 000, 1000 found" and rows[0]["target"] == 0.2
    assert all(row["value"] > 0 for row in rows)
    assert not list(tmp_path.glob("dsr-bench-*"))


def test_a_file_that_cannot_be_written_is_refused_before_anything_is_measured() -> None:
    result = CliRunner().invoke(app, ["local", "--json-file", "/proc/none/rows.json"])
    assert isinstance(result.exception, ConfigError)


def test_the_check_fails_if_a_target_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(group: Group, specs: list[Spec], findings: Findings, **_options: object) -> None:
        findings.rows += [judged(spec, 1e9) for spec in specs]

    monkeypatch.setattr(session, "measure", measure)
    assert CliRunner().invoke(app, ["late join"]).exit_code == 0
    assert CliRunner().invoke(app, ["late join", "--check"]).exit_code == 1


def test_a_group_that_fails_says_why() -> None:
    with pytest.raises(BenchmarkError, match=r"(?s)'no such group' failed: .*invalid choice"):
        nothing, progress = Group("no such group", [], lambda run: None), Progress(Console(), None)
        session.measure(nothing, [], Findings(), quick=True, repeat=1, progress=progress)


def test_a_port_of_a_peer_is_given_to_nobody_else() -> None:
    """Peers picked a port twice, and one of them could not listen: that ended the group `world cascade`."""
    ports = [reserved_port() for _ in range(50)]
    with contextlib.ExitStack() as stack:
        others = [stack.enter_context(socket.create_server(("127.0.0.1", 0))).getsockname()[1] for _ in range(2000)]
    assert len({*ports}) == 50 and not {*ports} & {*others}
    session = open_session(listen=f"tcp/127.0.0.1:{ports[0]}")
    try:
        socket.create_connection(("127.0.0.1", ports[0])).close()
    finally:
        session.close()  # type: ignore[no-untyped-call]


def test_without_a_terminal_steps_are_told_now_and_then_and_rows_at_once() -> None:
    told, now = io.StringIO(), iter([0.0, 0.0, 0.0, EVERY / 2, EVERY, EVERY, EVERY + 1])
    progress = Progress(Console(file=told), None, lambda: next(now))
    for step in ("first", "second", "third"):
        progress.step(step)
    progress.row(judged(Spec("a row", "ms"), 3.0, [Peer("raw Zenoh", 2.0)]))
    assert [line.split(maxsplit=2)[2] for line in told.getvalue().splitlines()] == [
        "first", "third", "a row: 3 ms, 1.5 of raw Zenoh"
    ]  # fmt: skip


def test_a_run_without_a_terminal_shows_that_it_goes_on() -> None:
    command = [sys.executable, "-m", "dsr.cli", "bench", "nodes by type among", "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "by type: filling" in done.stderr and "1000 found: 0.0" in done.stderr


def test_a_missing_peer_is_reported() -> None:
    told: list[object] = []
    run = Run(told.append, quick=True)
    assert run.has("json") and not run.has("no_such_library")
    run.step("now")
    run.row(Spec("r", "ms"), 1.0)
    assert told == [Missing("no_such_library"), Step("now"), Measured(Row("r", 1.0, "ms", None, None, None, None))]


def links() -> list[Link]:
    return [
        DsrLink("bench-attribute", "attribute", nodes=20),
        DsrLink("bench-watch", "attribute", watched=True, nodes=20),
        DsrLink("bench-rt", "RT", nodes=20),
        TcpLink(reserved_port(), 64),
        ZenohLink(f"tcp/127.0.0.1:{reserved_port()}", 64),
    ]


@pytest.mark.parametrize("link", links(), ids=lambda link: type(link).__name__)
def test_messages_take_time_from_one_process_to_the_other(link: Link) -> None:
    with Latencies(link) as pair:
        pair.warm_up()
        latencies = pair.burst(5)
    assert 3 <= len(latencies) <= 5 and all(0 < seconds < 10 for seconds in latencies)


def test_a_worker_that_fails_is_noticed() -> None:
    with Worker(fail) as worker, pytest.raises(BenchmarkError, match="ended early"):
        worker.receive()


def fail(_connection: object) -> None:
    sys.exit(7)


def test_an_interrupted_run_leaves_no_process_behind(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "dsr.cli", "bench", "latency", "--quick"]
    environment = {**os.environ, "DSR_BENCH_TEST": str(tmp_path)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 60
        while len(list(marked(str(tmp_path)))) < 4 and time.monotonic() < deadline:
            time.sleep(0.1)
        assert len(list(marked(str(tmp_path)))) >= 4
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 130
    assert list(marked(str(tmp_path))) == []


def marked(value: str) -> Iterator[int]:
    """Processes with the test's mark in their environment."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"DSR_BENCH_TEST={value}".encode() in (folder / "environ").read_bytes().split(b"\0"):
                yield int(folder.name)
        except OSError:
            continue


def test_curves_are_written_as_csv(tmp_path: Path) -> None:
    measured = {
        "latency": {"quiet": {"attribute": [0.1]}, "busy": {"attribute": [0.1]}},
        "world cascade": {"worlds": [1, 20], "ms": {"ours": [1.0, 20.5], "raw Zenoh": [0.5, 6.0]}},
    }
    [file] = curves.write(measured, tmp_path / "plots")
    assert file.name == "world_cascade.csv"
    assert file.read_text().splitlines() == ["worlds,ours (ms),raw Zenoh (ms)", "1,1.0,0.5", "20,20.5,6.0"]


def test_without_matplotlib_the_curves_are_written_still(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(group: Group, specs: list[Spec], findings: Findings, **_options: object) -> None:
        findings.curves["growth"] = {"nodes": [100, 1000], "us": {"get node": [1.0, 1.1]}}

    monkeypatch.setattr(session, "measure", measure)
    monkeypatch.setattr(cli, "find_spec", lambda _name: None)
    result = CliRunner().invoke(app, ["growth", "--plots", str(tmp_path)])
    assert result.exit_code == 0 and "matplotlib is not installed" in result.output
    assert (tmp_path / "growth.csv").read_text().startswith("nodes,get node (us)")


def test_without_ros_the_other_rows_are_measured() -> None:
    code = """
import sys
sys.modules |= dict.fromkeys(("rosbags", "cyclonedds", "xxhash"))
from benchmarks import groups
from benchmarks.group import Run
told = []
run = Run(told.append)
run.has = lambda module: told.append(module)
groups.find("ros").measure(run)
print(told)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "['rosbags']\n", done.stderr


def test_plots_are_drawn_of_what_was_measured(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from benchmarks.plots import draw

    rows = [judged(spec, spec.target or 1.0) for group in groups.GROUPS for spec in group.specs]
    samples = {"attribute": [0.1, 0.2], "raw Zenoh, attribute": [0.1, 0.3]}
    curves = {
        "latency": {"quiet": samples, "busy": samples},
        "throughput to 3": {"attributes": 1e4, "raw TCP": 2e4},
        "join": {"1000": {"ours": [0.1, 0.2]}, "10000": {"ours": [0.5]}},
        "camera frames": {"ours": [1.0, 2.0]},
        "cascade": {"graphs": [1, 5], "ms": {"ours": [1.0, 2.0]}},
        "world cascade": {"worlds": [1, 2], "ms": {"ours": [1.0, 2.0], "Underworlds (published)": [3.6, 10.7]}},
        "growth": {"nodes": [100, 1000], "us": {"get node": [1.0, 1.1]}},
    }
    files = draw(Findings(rows, curves), tmp_path)
    assert {file.stem for file in files} == {*(name.replace(" ", "_") for name in curves), "overview"}
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files)
