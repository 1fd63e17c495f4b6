"""The process that asks services in a robot's ROS, when that ROS hangs, dies or says what nobody expects.

Programs of some lines play that ROS here; `tests/ros/test_arm.py` has the real one.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from agents.ros_bridge.errors import RosLinkError, RosTimeoutError
from agents.ros_bridge.link.dds import in_ros
from agents.ros_bridge.link.dds.installed_ros import InstalledRos, environment
from agents.ros_bridge.link.link import LinkConfig
from tests.agents.ros_bridge.told import eventually

SERVICE, TYPE = "/ask", "std_srvs/srv/Trigger"
HEAD = """
import json, os, pathlib, sys, time
starts = pathlib.Path(sys.argv[0]).with_suffix(".starts")
with starts.open("a") as file:
    file.write(f"{os.getpid()}\\n")
number = len(starts.read_text().split())
def say(**answer):
    print(json.dumps(answer), flush=True)
def obey():
    for line in sys.stdin:
        command = json.loads(line)
        if "call" in command:
            say(call=command["call"], taken=True)
            say(call=command["call"], response=command["request"])
"""
HANGS_AT_FIRST = """
say(ready="jazzy")
if number == 1:
    time.sleep(1000)
obey()
"""
Make = Callable[[str], InstalledRos]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    """Starts a program as if it were `in_ros.py` in an installed ROS."""
    opened: list[InstalledRos] = []

    def start(text: str) -> InstalledRos:
        program = tmp_path / "ros"
        program.write_text(f"#!{sys.executable}{HEAD}{text}")
        program.chmod(0o755)
        opened.append(InstalledRos(LinkConfig(transport="dds", installed_ros=str(program)), "/dsr/asking"))
        return opened[-1]

    yield start
    for one in opened:
        within(one.close)
    for pid in starts(tmp_path):
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def starts(folder: Path) -> list[int]:
    """The processes that were started."""
    return [int(pid) for pid in (folder / "ros.starts").read_text().split()]


def within(do: Callable[[], object]) -> None:
    """Do it; fails if it never ends."""
    thread = threading.Thread(target=do, daemon=True)
    thread.start()
    thread.join(20.0)
    assert not thread.is_alive(), "it never ended"


def test_a_process_that_hangs_with_a_full_pipe_blocks_nobody_and_is_started_again(make: Make, tmp_path: Path) -> None:
    installed, errors = make(HANGS_AT_FIRST), list[str]()

    def ask() -> None:
        try:
            installed.call(SERVICE, TYPE, bytes(1 << 20), 5.0)
        except RosLinkError as error:
            errors.append(str(error))

    asking = [threading.Thread(target=ask, daemon=True) for _ in range(3)]
    for thread in asking:
        thread.start()
    for thread in asking:
        within(thread.join)
    assert errors and all("ended: it did not react for 1 s, and was killed" in text for text in errors)
    assert installed.call(SERVICE, TYPE, b"a", 5.0) == b"a" and len(starts(tmp_path)) == 2


def test_a_process_that_hangs_with_an_empty_pipe_is_started_again(make: Make, tmp_path: Path) -> None:
    installed = make(HANGS_AT_FIRST)
    with pytest.raises(RosLinkError, match="it did not react for 1 s, and was killed"):
        installed.call(SERVICE, TYPE, b"a", 5.0)
    assert installed.call(SERVICE, TYPE, b"b", 5.0) == b"b"


def test_a_process_that_stands_still_is_ended_with_its_full_pipe(make: Make, tmp_path: Path) -> None:
    installed = make("say(ready='jazzy')\nobey()")
    assert installed.call(SERVICE, TYPE, b"a", 5.0) == b"a"
    os.kill(starts(tmp_path)[0], signal.SIGSTOP)
    telling = threading.Thread(target=lambda: installed.prepare("/" + "a" * (1 << 20), TYPE), daemon=True)
    telling.start()
    within(installed.close)
    within(telling.join)


def test_a_ros_that_dies_at_each_question_is_not_started_at_the_rate_of_the_questions(
    make: Make, tmp_path: Path
) -> None:
    installed = make("say(ready='jazzy')\nsys.stdin.readline()\nsys.exit('no memory')")
    said = []
    for _ in range(50):
        with pytest.raises(RosLinkError, match="no memory") as caught:
            installed.call(SERVICE, TYPE, b"", 5.0)
        said.append(str(caught.value))
    assert len(starts(tmp_path)) == 3 and "it ends too often, and is started again in" in said[-1]
    assert installed.problems() == ["the process in the robot's ROS ended: no memory"]


def test_nobody_waits_longer_than_asked_for_a_ros_that_starts_slowly(make: Make, tmp_path: Path) -> None:
    end, go = tmp_path / "end", tmp_path / "go"
    installed = make(
        "def wait_for(file):\n    while not pathlib.Path(file).exists():\n        time.sleep(0.01)\n"
        f"if number == 1:\n    say(ready='jazzy')\n    wait_for({str(end)!r})\n    sys.exit('crash')\n"
        f"wait_for({str(go)!r})\nsay(ready='jazzy')\nobey()"
    )
    end.touch()
    eventually(installed.problems)
    for _ in range(2):
        with pytest.raises(RosTimeoutError, match="is not ready"):
            installed.call(SERVICE, TYPE, b"", 0.2)
    go.touch()
    assert installed.call(SERVICE, TYPE, b"a", 20.0) == b"a" and len(starts(tmp_path)) == 2


def test_whatever_bytes_ros_prints_it_does_not_block(make: Make) -> None:
    installed = make("sys.stderr.buffer.write(bytes(range(256)) * 4000)\nprint('{')\nsay(ready='jazzy')\nobey()")
    assert installed.call(SERVICE, TYPE, b"a", 5.0) == b"a"


def test_what_could_not_be_prepared_is_a_problem_and_not_the_reason_of_a_later_end(make: Make) -> None:
    installed = make(
        "say(ready='jazzy')\nsys.stdin.readline()\nsay(call=None, failed='this ROS has no such type')\n"
        "sys.stdin.readline()\nsys.exit('crash')"
    )
    installed.prepare(SERVICE, TYPE)
    assert eventually(installed.problems) == ["this ROS has no such type"]
    with pytest.raises(RosLinkError, match="crash"):
        installed.call(SERVICE, TYPE, b"", 5.0)
    assert installed.problems() == ["the process in the robot's ROS ended: crash"]


def test_a_process_that_ended_is_no_zombie_and_is_told(
    make: Make, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    installed = make("say(ready='jazzy')\nsys.stdin.readline()\nsys.exit('crash')")
    installed.prepare(SERVICE, TYPE)
    eventually(installed.problems)
    with pytest.raises(ProcessLookupError):
        os.kill(starts(tmp_path)[0], 0)
    eventually(lambda: "the process in the robot's ROS ended: crash" in caplog.text)


@pytest.mark.parametrize("hangs_in", ["init", "create_node"])
def test_a_ros_that_hangs_at_its_start_ends_when_its_owner_dies(tmp_path: Path, hangs_in: str) -> None:
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy" / "serialization.py").touch()
    (tmp_path / "rclpy" / "__init__.py").write_text(
        "import time\ndef init(**options): pass\ndef create_node(*names, **options): pass\ndef shutdown(): pass\n"
        f"def {hangs_in}(*given, **options):\n    print('here', flush=True)\n    time.sleep(1000)\n"
    )
    started = subprocess.Popen(
        [sys.executable, in_ros.__file__, "/", "asking"], env={**os.environ, "PYTHONPATH": str(tmp_path)},
        stdin=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert started.stdin is not None and started.stderr is not None
        assert started.stderr.readline() == b"here\n"
        started.stdin.close()  # as the kernel does when the owner dies
        assert started.wait(20.0) == 0
    finally:
        with suppress(ProcessLookupError):
            started.kill()
        started.wait()
        started.stderr.close() if started.stderr is not None else None


def test_a_variable_of_older_releases_does_not_override_how_far_it_reaches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    found = environment(LinkConfig(transport="dds", beyond_loopback=True))
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET" and "ROS_LOCALHOST_ONLY" not in found
    assert environment(LinkConfig(transport="dds", distro="humble"))["ROS_LOCALHOST_ONLY"] == "1"
