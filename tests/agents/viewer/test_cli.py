"""`dsr view`: served to a browser, refused clearly, and gone after Ctrl-C."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from agents.viewer import ViewerConfig
from agents.viewer.cli import app
from agents.viewer.window import LOOPBACK, WindowError, check_free, free_port, page_url
from dsr import Memory, Pose, connect
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from tests.agents.viewer import browser

_ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def private_runtime_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests meet nobody but themselves."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("DSR_SECURITY", raising=False)
    monkeypatch.delenv("DSR_GRAPH", raising=False)


@pytest.fixture
def table() -> Iterator[Memory]:
    """A graph that runs in this process."""
    with connect("served", agent="scene", must_exist=False) as memory:
        memory.add_node("world", "world")
        memory.add_node("cube_1", "cube", size=(0.05, 0.05, 0.05))
        memory.add_node("table", "table", size=(1.0, 0.8, 0.04))
        memory.add_edge("world", "table", "RT", pose=Pose((0.3, 0.0, -0.02)))
        for kind in ("RT", "Virtual_RT"):
            memory.add_edge("world", "cube_1", kind, pose=Pose((0.3, 0.0, 0.025)))
        yield memory


class Served:
    """`dsr view --serve` as a process."""

    def __init__(self) -> None:
        self.port, self.web_port = free_port(), free_port()
        ports = ["--port", str(self.port), "--web-port", str(self.web_port)]
        program = "import sys; from dsr.cli import start; sys.argv[0] = 'dsr'; start()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, "view", "--serve", *ports],
            cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        self.said: list[str] = []
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said.append(line)
            if line.startswith("from elsewhere"):
                return
        raise AssertionError("".join(self.said))

    def end(self) -> str:
        """End it as Ctrl-C does; returns what it still said."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
        return self.process.communicate(timeout=60)[0]


@pytest.fixture
def served(table: Memory) -> Iterator[Served]:
    process = Served()
    yield process
    process.end()


def test_the_page_is_served_to_this_machine_only_until_ctrl_c(served: Served) -> None:
    page = page_url(served.port, served.web_port)
    assert any(page in line for line in served.said)
    with urllib.request.urlopen(page, timeout=30) as answer:
        assert answer.status == 200 and b"<html" in answer.read().lower()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", served.web_port), 1.0)  # another address of this machine
    assert served.end() == ""
    assert served.process.returncode == 0
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((LOOPBACK, served.web_port), 1.0)


def test_it_says_when_the_system_has_gone_also_beside_others_that_look(table: Memory, served: Served) -> None:
    with connect("served", agent="record", must_exist=True):
        table.close()
        assert served.process.stdout is not None
        assert "nobody else is in the graph any more" in served.process.stdout.readline()


GRAPH_TAB = (180, 50)
BLUE, AMBER, TABLE = "blue", "amber", "table"


def shows(page: browser.Browser, *colors: str) -> bool:
    """Whether more than a few pixels have the colour of beliefs, of `RT` edges, or of the table in its light."""
    red, green, blue = page.picture().astype(int).transpose(2, 0, 1)
    found = {
        BLUE: np.count_nonzero((blue > red + 80) & (blue > green + 40)) > 100,
        AMBER: np.count_nonzero((red > 220) & (abs(green - 176) < 25) & (blue < 60)) > 100,
        TABLE: np.count_nonzero((abs(red - green - 22) < 8) & (abs(green - blue - 22) < 8) & (red > 80)) > 5000,
    }
    return all(found[color] for color in colors)


def wait_for(condition: Callable[[], bool], otherwise: str) -> None:
    for _ in range(120):
        WALL_CLOCK.wait(threading.Event(), 1.0)
        if condition():
            return
    pytest.fail(otherwise)


@pytest.mark.skipif(browser.PROGRAM is None, reason="no chromium or google-chrome on the path")
@pytest.mark.timeout(400)  # a page without a graphics card, on a busy machine
def test_a_browser_shows_the_view(served: Served, tmp_path: Path) -> None:
    """The dark page draws the belief of the cube in blue; a click on the tab shows the graph as large as the page."""
    with browser.Browser(page_url(served.port, served.web_port), tmp_path) as page:
        wait_for(lambda: shows(page, BLUE, TABLE), "the page never showed the blue cube on its table")
        page.click(*GRAPH_TAB)
        wait_for(lambda: shows(page, AMBER) and not shows(page, TABLE), "the page never showed the graph alone")


@pytest.mark.parametrize(("place", "option"), [(0, "--port"), (1, "--web-port")])
def test_a_port_that_is_taken_is_named(table: Memory, place: int, option: str) -> None:
    with socket.create_server((LOOPBACK, 0)) as taken:
        ports = [free_port(), free_port()]
        ports[place] = taken.getsockname()[1]
        answer = CliRunner().invoke(app, ["--serve", "--port", str(ports[0]), "--web-port", str(ports[1])])
        assert isinstance(answer.exception, WindowError)
        assert f"port {ports[place]} of {LOOPBACK} is taken" in str(answer.exception)
        assert f"with {option}" in str(answer.exception)


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(WindowError, match=r"nobody can be served at 192\.0\.2\.1"):
        check_free("192.0.2.1", 9090, "--port")


def test_without_a_display_the_way_out_is_told(table: Memory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    answer = CliRunner().invoke(app, [])
    assert isinstance(answer.exception, ConfigError) and "--serve" in str(answer.exception)


def test_a_graph_must_run() -> None:
    answer = CliRunner().invoke(app, ["--serve", "--graph", "nowhere"])
    assert isinstance(answer.exception, ConfigError) and "no graph 'nowhere' runs" in str(answer.exception)


def test_equal_ports_are_refused(table: Memory) -> None:
    answer = CliRunner().invoke(app, ["--serve", "--port", "9000", "--web-port", "9000"])
    assert isinstance(answer.exception, ConfigError) and "must differ" in str(answer.exception)


@pytest.mark.parametrize(
    "wrong", [{"port": 0}, {"web_port": 70_000}, {"port": 9090}, {"record": False}, {"listens": -1}]
)
def test_a_viewer_that_could_not_show_anything_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError):
        ViewerConfig(**wrong)  # type: ignore[arg-type]


def test_a_server_that_ends_is_told(served: Served) -> None:
    assert served.process.stdout is not None
    children = Path(f"/proc/{served.process.pid}/task")
    pids = [int(pid) for task in children.iterdir() for pid in (task / "children").read_text().split()]
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    for _ in range(300):
        if served.process.poll() is not None:
            break
        WALL_CLOCK.wait(threading.Event(), 0.1)
    assert served.process.returncode == 1
    assert "the server ended" in served.process.stdout.read()
