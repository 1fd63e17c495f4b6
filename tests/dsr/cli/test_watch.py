"""`dsr watch`, as a process: it ends with Ctrl-C."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import dsr
from dsr import AttributeType, Memory


@contextmanager
def watching(*options: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "dsr.cli", "watch", "--period", "0.01", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def test_changes_come_line_by_line_until_ctrl_c(memory: Memory) -> None:
    with watching("--node-type", "cube") as process:
        assert process.stdout and process.stderr
        first = process.stdout.readline()
        assert "added" in first and "cube cube_3  perceived True  size (0.04, 0.04, 0.04) m" in first
        memory.update_node("cube_3", perceived=False)
        assert process.stdout.readline().rstrip().endswith("updated cube cube_3  perceived False")
        memory.remove_node("cube_3")
        assert process.stdout.readline().rstrip().endswith("removed cube cube_3")
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
        assert process.stderr.read() == ""


def test_programs_get_json_lines(memory: Memory) -> None:
    with watching("--edge-type", "on", "--json") as process:
        assert process.stdout
        line = json.loads(process.stdout.readline())
        assert (line["kind"], line["element"], line["src"], line["dst"]) == ("added", "edge", "cube_3", "table")
        assert line["attributes"] == {"source": "contact"}
        process.terminate()
        assert process.wait(20) == 0


def test_it_ends_when_the_world_is_deleted(memory: Memory) -> None:
    idea = memory.fork("idea")
    with watching("--world", "idea", "--node-type", "cube") as process:
        assert process.stdout and process.stderr
        assert "cube_3" in process.stdout.readline()
        idea.update_node("cube_3", perceived=False)
        assert process.stdout.readline().rstrip().endswith("updated cube cube_3  perceived False")
        memory.delete_world("idea")
        assert process.wait(20) == 1
        assert "world 'idea' was deleted" in process.stderr.read()


def test_it_says_when_the_last_one_has_left_and_when_somebody_comes(memory: Memory) -> None:
    with watching("--node-type", "cube") as process:
        assert process.stdout and process.stderr
        assert "cube_3" in process.stdout.readline()
        memory.close()
        assert "nobody else is in the graph any more" in process.stderr.readline()
        with dsr.connect(memory.graph_name, agent="later", must_exist=True):
            assert "somebody is in the graph again" in process.stderr.readline()
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0


def test_another_one_that_only_looks_is_no_company(memory: Memory) -> None:
    with watching("--node-type", "cube") as first, watching("--node-type", "cube") as second:
        for process in (first, second):
            assert process.stdout and "cube_3" in process.stdout.readline()
        memory.close()
        for process in (first, second):
            assert process.stderr and "nobody else is in the graph any more" in process.stderr.readline()


def test_names_of_ones_own_have_their_units(memory: Memory) -> None:
    memory.schema.register_attribute("battery", AttributeType("float", unit="%", meaning="charge left"))
    memory.update_node("cube_3", battery=87.5)
    with watching("--attribute", "battery") as process:
        assert process.stdout
        assert process.stdout.readline().rstrip().endswith("cube cube_3  battery 87.5 %")
