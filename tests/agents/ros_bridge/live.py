"""The system file `ros` as a user runs it, beside a simulated robot that an independent node of ROS plays."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil

from dsr.files.built_in import ETC
from dsr.runtime.system import load_system
from tests.agents.ros_bridge.told import eventually

ROOT = Path(__file__).parents[3]
PROGRAM = [sys.executable, "-c", "import sys; from dsr.cli import start; sys.argv[0] = 'dsr'; start()"]
READY = "all agents are ready"


TABLE = """# [[agent]]
# name = "scene_setup"
# class = "agents.scene_setup:SceneSetup"
"""


def system_copy(folder: Path, router: str, world_frame: str) -> Path:
    """A copy of the system file for a router elsewhere, and for a robot at a table, as users make one."""
    text = (ETC / "systems" / "ros.toml").read_text()
    changes = {
        "tcp/localhost:7447": router,
        'world_frame = "world"': f'world_frame = "{world_frame}"',
        TABLE: TABLE.replace("# ", ""),
    }
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new)
    file = folder / "ros_copy.toml"
    file.write_text(text)
    return file


class Run:
    """`dsr` with these arguments, in a session of its own.

    Args:
        arguments: of `dsr`.
        folder: where it works, and leaves what it says.
        environment: beside that of this process.
    """

    def __init__(self, arguments: list[str], folder: Path, environment: dict[str, str] | None = None) -> None:
        self._log = folder / f"{arguments[0]}.said"
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                [*PROGRAM, *arguments], cwd=folder, stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
                env={**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
            )  # fmt: skip

    @property
    def said(self) -> str:
        """All that it said so far."""
        return self._log.read_text()

    def wait_for(self, text: str, seconds: float = 150.0) -> None:
        """Wait until it says this."""

        def is_said() -> bool:
            assert self.process.poll() is None, self.said
            return text in self.said

        eventually(is_said, seconds)

    def interrupt(self) -> int:
        """Ctrl-C as a terminal sends it, to the whole group; returns the exit code."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
        return self.process.wait(120)

    def processes(self) -> list[str]:
        """Those of its session that are there still."""
        return [" ".join(one.cmdline()) for one in psutil.process_iter() if _session(one.pid) == self.process.pid]

    def kill(self) -> None:
        """End what is left, for tests that failed."""
        for one in psutil.process_iter():
            if _session(one.pid) == self.process.pid:
                one.kill()
        self.process.wait()


def agents_of(file: Path) -> set[str]:
    """Names of the agents of a system."""
    return {spec.name for spec in load_system(str(file)).agents}


def _session(pid: int) -> int | None:
    try:
        return os.getsid(pid)
    except ProcessLookupError:
        return None
