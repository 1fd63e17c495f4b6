"""What an installation takes: disk, time to start and what works, in fresh environments with packages of an index.

    python -m benchmarks.installing
    python -m benchmarks.installing --extras cli sim,view --python python3.13

The command builds the wheel of this checkout. For each set of extras it makes an environment and lets pip install the
wheel with them. It prints the size of the environment, the time of the installation, and the processor time of `import
dsr` with a memory and of `dsr --help`. Then it runs what the extras promise. The exit code is 1 if any of that fails.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from benchmarks.timing import duration

_ROOT = Path(__file__).parents[1]
_BUILD = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
_ALONE = """
import dsr
with dsr.connect("benchmark_installing", agent="me") as memory:
    memory.add_node("cup_1", "cup")
"""
_PLAY = ("dsr", "scenario", "run", "hovering_1", "--lockstep", "--sensor", "poses", "--no-viewer")
_CHECKS = {
    "": (("python", "-c", _ALONE),),
    "cli": (("dsr", "--version"), ("dsr", "security", "--help")),
    "sim": (("dsr", "scenario", "list"), _PLAY),
    "view": (("python", "-c", "import agents.viewer.views"),),
    "planning": (("python", "-c", "from planner.solver import probe; print(probe())"),),
}
"""What must work with each extra: programs with their arguments, exit code 0."""


class Installed(NamedTuple):
    """What one environment takes."""

    size: int
    """bytes on disk"""
    seconds: float
    """of the installation, downloads included"""
    start: float
    """s of processor time to import `dsr` and join a graph"""
    help: float | None
    """s of processor time of `dsr --help`; None without the extra `cli`"""
    failed: list[str]
    """Programs that did not do what the extras promise."""


def main() -> int:
    """Install, measure and check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    sets = ["", "cli", "sim", "sim,view,planning"]
    parser.add_argument("--extras", nargs="*", default=sets, metavar="A,B", help=f"default: {sets}")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the environments; default: this one")
    options = parser.parse_args()
    table = Table("extras", "disk", "installed in", "import and join", "dsr --help", "works")
    for column in table.columns[1:5]:
        column.justify = "right"
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        wheel = build(Path(folder))
        for number, extras in enumerate(options.extras):
            found = install(Path(folder) / str(number), wheel, extras, options.python)
            failed |= bool(found.failed)
            table.add_row(
                extras or "(none)", f"{found.size / 1e6:.0f} MB", f"{found.seconds:.0f} s", f"{found.start:.2f} s CPU",
                "" if found.help is None else f"{found.help:.2f} s CPU", ", ".join(found.failed) or "yes",
            )  # fmt: skip
    Console().print(table)
    return int(failed)


def build(folder: Path) -> Path:
    """The wheel of this checkout, in a folder."""
    source = folder / "source"
    subprocess.run(["git", "clone", "--quiet", str(_ROOT), str(source)], check=True)
    subprocess.run([sys.executable, "-c", _BUILD, str(folder)], cwd=source, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def install(home: Path, wheel: Path, extras: str, python: str) -> Installed:
    """Make an environment with the wheel and these extras (comma-separated), and try it."""
    subprocess.run([python, "-m", "venv", str(home)], check=True)
    pip = [str(home / "bin" / "pip"), "install", "-qq", f"{wheel}[{extras}]" if extras else str(wheel)]
    seconds = duration(lambda: subprocess.run(pip, check=True))
    size = sum(file.lstat().st_size for file in home.rglob("*") if not file.is_dir())
    chosen = {"", *filter(None, extras.split(","))} | ({"cli"} if extras else set())
    failed = [" ".join(command) for extra in sorted(chosen) for command in _CHECKS[extra] if run(home, command) is None]
    start, shown = run(home, ("python", "-c", _ALONE)), run(home, ("dsr", "--help")) if extras else None
    return Installed(size, seconds, start or 0.0, shown, failed)


def run(home: Path, command: tuple[str, ...]) -> float | None:
    """Processor time (s) of a program of an environment; None if it fails, with what it said on standard error."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    program = [str(home / "bin" / command[0]), *command[1:]]
    result = subprocess.run(program, cwd=home, env=environment, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if result.returncode:
        sys.stderr.write(f"{' '.join(command)}: {result.stdout}{result.stderr}\n")
        return None
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    sys.exit(main())
