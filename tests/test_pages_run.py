"""Every block of code in README, ARCHITECTURE and docs is run, or at least read as what it is."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from dsr import Pose, connect
from dsr.clock import WALL_CLOCK
from tests.pages import PAGES, ROOT, Attempt, blocks_in, blocks_of, needs_system

STAGED = [page for page in PAGES if needs_system(blocks_of(page))]
"""Pages that take the running system `tabletop` for granted."""
UNRUN = 1
"""Blocks that cannot be run. Each has a reason on its page."""
FEWEST_LOOKS = 20
"""Different commands that look into the running system and are run, not only parsed."""
LEFT_OUT = ("viewer", "action_inference", "mission", "calibrator")
"""Agents of the system that no block needs."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder to be in, with a runtime directory of its own; its modules are forgotten in the end."""
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for file in tmp_path.glob("*.py"):
        sys.modules.pop(file.stem, None)


def dsr(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "dsr.cli", *arguments], check=True, capture_output=True, timeout=90)


@pytest.fixture
def stage(folder: Path) -> Iterator[Path]:
    """The system `tabletop` without what nobody needs here, in the background; the cameras tell poses."""
    head, *agents = (ROOT / "etc/systems/tabletop.toml").read_text(encoding="utf-8").split("[[agent]]\n")
    kept = [text for text in agents if not text.startswith(tuple(f'name = "{name}"\n' for name in LEFT_OUT))]
    kept[0] = kept[0].replace("[agent.config]\n", '[agent.config]\nsensor = "poses"\n')
    assert len(agents) - len(kept) == len(LEFT_OUT) and "poses" in kept[0]
    (folder / "stage.toml").write_text("[[agent]]\n".join((head, *kept)), encoding="utf-8")
    dsr("run", "stage.toml", "--detach", "--folder", "stage")
    yield folder / "stage"
    dsr("stop")


@pytest.mark.parametrize("page", [page for page in PAGES if page not in STAGED], ids=lambda page: page.stem)
def test_all_blocks_of_the_page_work(page: Path, folder: Path) -> None:
    Attempt(blocks_of(page)).all()


def test_all_blocks_of_pages_about_a_running_system_work(stage: Path, subtests: pytest.Subtests) -> None:
    known: set[str] = set()
    for page in STAGED:
        shutil.copy(stage / "recording.mcap", "recording.mcap")
        with subtests.test(page=page.stem):
            Attempt(blocks_of(page), known).all()
    assert len(known) >= FEWEST_LOOKS


def test_the_program_of_the_readme_waits_until_it_is_known_where_a_cube_is(folder: Path) -> None:
    """It may hear of a cube before it hears where the camera is that sees the cube."""
    (block,) = (block for block in blocks_of(ROOT / "README.md") if block.name == "counter.py")
    Path(block.name).write_text(block.code, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with connect("tabletop", agent="robot", must_exist=False) as memory:
        for name, type in (("world", "world"), ("table", "table"), ("camera_1", "camera"), ("cube_1", "cube")):
            memory.add_node(name, type)
        memory.add_edge("camera_1", "cube_1", "RT", pose=Pose((0.0, 0.0, 1.0)))
        with subprocess.Popen(
            [sys.executable, "-u", block.name], stdout=subprocess.PIPE, env=environment, text=True
        ) as process:
            said = memory.watch(node_type="table", attribute="seen", existing=False)
            while not memory.peers and process.poll() is None:
                WALL_CLOCK.wait(threading.Event(), 0.05)
            WALL_CLOCK.wait(threading.Event(), 1.0)  # it looks at the cube
            memory.add_edge("world", "camera_1", "RT", pose=Pose((0.5, 0.0, 0.0)))
            while not said.poll() and process.poll() is None:
                memory.update_node("cube_1", last_seen=WALL_CLOCK.now())
                WALL_CLOCK.wait(threading.Event(), 0.05)
            process.send_signal(signal.SIGINT)
            assert process.stdout is not None
            assert process.stdout.readline() == "cube_1 is at [0.5 0.  1. ] m\n"
        assert memory.node("table")["seen"] == 1


def test_few_blocks_have_an_excuse() -> None:
    excused = [block for page in PAGES for block in blocks_of(page) if block.excuse]
    assert len(excused) == UNRUN, [block.where for block in excused]


@pytest.mark.parametrize(
    "code",
    [
        "```python\n1 / 0\n```",
        "```python\nprint(1)\n```\n\n```text\n2\n```",
        "```sh\ndsr nonsense\n```",
        "```sh\ndsr ls --nonsense\n```",
        "```sh\ndsr scenario check nowhere.toml\n```",
        "```sh\npython -m benchmarks.fuzz --nonsense 1\n```",
        "```sh\npip install 'dsr-memory[nonsense]'\n```",
        "```sh\nmake nonsense\n```",
        "```sh\nnonsense\n```",
        '```toml\n[[agent]]\nname = "a"\nclass = "no.such:Class"\n```',
        '```toml\n# excerpt\n[[event]]\nat = 1.0\ndo = "nonsense"\n```',
        "```json\n{,}\n```",
        "```xml\n<robot/>\n```",
        "```ini\nnonsense\n```",
        "```\nno language\n```",
        "```python\nno end",
    ],
)
def test_a_block_that_does_not_work_is_found(code: str, folder: Path) -> None:
    with pytest.raises(Exception, match=r"."):
        Attempt(blocks_in(code, ROOT / "docs" / "made_up.md")).all()
