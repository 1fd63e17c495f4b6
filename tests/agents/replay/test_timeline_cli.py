"""`dsr timeline` of a recording and of a running graph."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import dsr
from agents.replay.timeline_cli import app
from dsr.cli.common import console
from dsr.timeline import Chronicle


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runtime").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setattr(console, "width", 160)


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments), catch_exceptions=False)


def test_a_recording_tells_what_happened(counted: Path) -> None:
    text = run(str(counted)).stdout
    lines = [line.split(maxsplit=2) for line in text.splitlines() if "cube" in line]
    assert [(words[1], words[2].strip()) for words in lines] == [
        ("appeared", "cube_old appeared"),
        ("appeared", "cube_3 appeared"),
        ("gone", "cube_old gone"),
        ("surprised", "cube_new is surprising"),
        ("appeared", "cube_new appeared"),
    ]
    assert [float(words[0]) for words in lines] == pytest.approx([0.0, 0.0, 4.0, 8.0, 8.0], abs=0.06)


def test_kinds_can_be_chosen_and_json_holds_them(hovering: Path) -> None:
    events = json.loads(run(str(hovering), "--kind", "began", "-k", "agent", "--json").stdout)
    assert {event["kind"] for event in events} == {"began", "agent"}
    assert "cube_3 on table" in {event["subject"] for event in events}
    assert {"plant", "simulation_handler"} <= {event["subject"] for event in events}
    assert [event["time"] for event in events] == sorted(event["time"] for event in events)


@pytest.mark.parametrize(
    ("name", "expected"), [("cube_od", "did you mean 'cube_old'"), ("nobody", "valid: .*cube_new, cube_old.*world")]
)
def test_a_participant_that_never_was_is_told_in_a_recording(counted: Path, name: str, expected: str) -> None:
    with pytest.raises(dsr.ConfigError, match=f"--participant {name}: no such node or agent; {expected}"):
        run(str(counted), "-p", name)
    assert run(str(counted), "-p", "world", "--json").stdout.strip() == "[]"  # it was there, and nothing happened to it
    assert "cube_old gone" in run(str(counted), "-p", "cube_old").stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [(["x.mcap", "--kind", "surprise"], "did you mean 'surprised'"), (["x.mcap", "-f"], "a recording has an end"),
     (["x.mcap", "-g", "tabletop"], "a recording is one graph"),
     (["x.mcap", "--since", "nan"], "the earlier time first"),
     (["x.mcap", "--since", "5", "--until", "4"], "the earlier time first"),
     (["x.mcap"], "cannot be read"), ([], "no graph runs"),
     (["--type", "evnt"], "no type 'evnt' of entries; did you mean 'event'"),
     (["--open", "-t", "event"], "events do not last"),
     (["-r", "durin", "--of", "-60:0"], "did you mean 'during'"), (["-r", "during"], "go together: --relation during"),
     (["--of", "-60:0"], "go together"), (["-r", "during", "--of", "3:1"], "--of 3:1: .*the earlier time first"),
     (["-r", "during", "--of", "nan:1"], "--of nan:1: expected BEGIN:END"),
     (["-f", "--open"], "--follow tells what happens from now on")],
)  # fmt: skip
def test_wrong_input_is_told(arguments: list[str], expected: str) -> None:
    with pytest.raises(dsr.DsrError, match=expected):
        run(*arguments)


def test_a_running_graph_is_followed_until_ctrl_c() -> None:
    command = [sys.executable, "-c", "from agents.replay.timeline_cli import app; app()", "--follow", "--json"]
    with dsr.connect("scene", agent="owner") as memory:
        memory.add_node("table", "table")
        memory.add_node("cube_3", "cube")
        assert "cube_3 appeared" in run().stdout
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout
            assert json.loads(process.stdout.readline())["text"] == "cube_3 appeared"
            memory.add_edge("cube_3", "table", "on", source="contact")
            assert json.loads(process.stdout.readline())["text"] == "cube_3 on table (contact)"
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 0


def write_a_past(memory: dsr.Memory) -> tuple[Chronicle, str, float]:
    now = memory.clock.now()
    chronicle = Chronicle(memory)
    chronicle.claim()
    held = chronicle.begin("grasping", ("gripper", "cube_3"), now - 400.0)
    chronicle.end(held, now - 300.0)
    chronicle.happened("Pick", ("cube_3", "gripper"), now - 400.0, text="picked", confidence=0.9)
    on = chronicle.begin("on", ("cube_3", "table"), now - 200.0)
    chronicle.happened("Juggle", ("cube_4",), now - 100.0)
    return chronicle, on, now


def test_a_running_graph_tells_its_timeline_with_true_times() -> None:
    with dsr.connect("scene", agent="teller") as memory:
        _, _, now = write_a_past(memory)
        memory.add_node("cube_9", "cube")

        def told(*arguments: str) -> list[tuple[str, str, int]]:
            rows = json.loads(run(*arguments, "--json").stdout)
            return [(row["kind"], row["subject"], round(row["time"] - now)) for row in rows]

        held, picked = ("began", "gripper grasping cube_3", -400), ("Pick", "cube_3", -400)
        ended, on = ("ended", "gripper grasping cube_3", -300), ("began", "cube_3 on table", -200)
        assert sorted(told()) == sorted([held, picked, ended, on, ("Juggle", "cube_4", -100)])
        assert told("--kind", "grasping") == [held, ended] and told("-k", "Juggle") == [("Juggle", "cube_4", -100)]
        assert told("--participant", "gripper", "-p", "cube_3", "--since", "-350") == [ended]
        assert told("--until", "-350", "-k", "Pick") == [picked]
        assert re.search(r"-4\d\d\.\d\d +Pick +picked", run("-k", "Pick").stdout)
        with pytest.raises(dsr.ConfigError, match="no such kind"):
            run("--kind", "Jongleur")
        with pytest.raises(dsr.ConfigError, match="cube_8: no such node or agent; valid: cube_3, cube_4, cube_9"):
            run("-p", "cube_3", "-p", "cube_8")
        assert told("-p", "cube_9") == [] and told("-p", "teller") == [] and told("-p", "cube_4") != []


def test_a_running_graph_is_asked_by_type_and_relations_between_times() -> None:
    with dsr.connect("scene", agent="teller") as memory:
        chronicle, _, now = write_a_past(memory)
        chronicle.begin("action", ("move_1", "cube_3"), now - 50.0)

        def told(*arguments: str) -> list[tuple[str, str, int]]:
            rows = json.loads(run(*arguments, "--json").stdout)
            return [(row["kind"], row["details"]["kind"], round(row["time"] - now)) for row in rows]

        picked, juggled = ("Pick", "Pick", -400), ("Juggle", "Juggle", -100)
        held, on, moving = ("began", "grasping", -400), ("began", "on", -200), ("began", "action", -50)
        dropped = ("ended", "grasping", -300)
        assert told("--type", "event") == [picked, juggled]
        assert sorted(told("-t", "situation")) == sorted([held, dropped, on, moving])
        assert told("--open") == [on, moving] and told("--open", "-p", "table") == [on]
        assert told("--open", "-k", "action") == [moving]
        assert told("-r", "during", "--of", "-150:-20") == [juggled]
        assert told("-r", "before", "--of=-250:", "-t", "event") == [picked]
        assert told("-r", "contains", "-r", "overlapped_by", "--of", "-210:-150") == [on]
        row = json.loads(run("-t", "situation", "-k", "grasping", "--json").stdout)[0]
        assert (row["details"]["type"], round(row["details"]["end"] - now)) == ("situation", -300)
        name = row["details"]["name"]
        assert told("--relation", "starts", "--of", name) == [picked]
        assert re.search(rf"began +gripper grasping cube_3 +{name}", run("-r", "equals", "--of", name).stdout)
        with pytest.raises(dsr.ConfigError, match=f"neither an entry nor a time BEGIN:END; did you mean '{name}'"):
            run("-r", "during", "--of", f"x{name}")


def test_a_recording_is_asked_by_type_and_relations_between_times(hovering: Path, counted: Path) -> None:
    def told(*arguments: str) -> list[dict[str, Any]]:
        return list(json.loads(run(str(hovering), *arguments, "--json").stdout))

    rows = told("--open", "-k", "on")
    assert rows and {(row["kind"], row["details"]["end"]) for row in rows} == {("began", None)}
    assert told("-t", "event") == []
    everything = {row["details"]["name"] for row in told("-t", "situation")}
    begun = {row["details"]["name"] for row in told("-t", "situation", "-r", "after", "--of", "-2:-1")}
    assert begun == everything
    result = CliRunner().invoke(app, [str(counted), "--open", "--json"], catch_exceptions=False)
    assert result.stdout.strip() == "[]" and "no timeline was recorded" in result.stderr


def test_the_timeline_is_followed() -> None:
    program = "from agents.replay.timeline_cli import app; app()"
    command = [sys.executable, "-c", program, "--follow", "--json", "-k", "on"]
    with dsr.connect("scene", agent="teller") as memory:
        chronicle, on, _ = write_a_past(memory)
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout
            assert json.loads(process.stdout.readline())["text"] == "cube_3 on table"
            chronicle.end(on)
            assert json.loads(process.stdout.readline())["text"] == "no more cube_3 on table"
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 0


def test_who_is_followed_may_still_come() -> None:
    program = "from agents.replay.timeline_cli import app; app()"
    command = [sys.executable, "-c", program, "--follow", "--json", "-p", "cube_3"]
    with dsr.connect("scene", agent="teller") as memory:
        chronicle, _ = Chronicle(memory), memory.add_node("cube_4", "cube")
        chronicle.claim()
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout and process.stderr
            assert "no such node or agent; valid: cube_4" in process.stderr.readline()
            chronicle.happened("Pick", ("cube_3", "gripper"))
            assert json.loads(process.stdout.readline())["kind"] == "Pick"
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 0


def test_where_nobody_writes_the_past_is_told_and_the_rest_derived() -> None:
    with dsr.connect("scene", agent="owner") as memory:
        with dsr.connect("scene", agent="teller") as other:
            write_a_past(other)
        memory.add_node("table", "table")
        memory.add_node("cube_3", "cube")
        memory.add_edge("cube_3", "table", "on")
        while len(memory.nodes("event")) < 2 or memory.peers:
            pass
        rows = [(row["kind"], row["subject"]) for row in json.loads(run("--json").stdout)]
        assert rows.count(("began", "cube_3 on table")) == 1 and ("appeared", "cube_3") in rows
        assert ("Pick", "cube_3") in rows
