"""`dsr doctor`: checks whether this machine has all that is needed, and advises if not."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import secrets
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from typing import Literal

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from dsr.cli.common import JsonOption, add_names, console, print_json
from dsr.clock import WALL_CLOCK
from dsr.connecting import open_transport
from dsr.errors import DsrError
from dsr.network.keys import Keys
from dsr.network.rendezvous import runtime_dir
from dsr.network.shared_ring import Ring, RingReader

app = typer.Typer()

PACKAGES = {
    "eclipse-zenoh": "zenoh",
    "msgspec": "msgspec",
    "numpy": "numpy",
    "scipy": "scipy",
    "opencv-python-headless": "cv2",
    "rerun-sdk": "rerun",
    "mcap": "mcap",
}
"""Packages that must be installed, with the module that each provides; pybullet has a check of its own."""
_COMPILERS = ("c++", "g++", "clang++", "cl")
_EGL_PROBE = "from agents.plant.renderer import egl_works; raise SystemExit(0 if egl_works() else 3)"
_SOLVER_PROBE = "from planner.solver import probe; print(probe())"
_PROBE = b"frame"
_PATIENCE = 30.0  # s


class Check(msgspec.Struct, frozen=True):
    """The result of one look."""

    name: str
    state: Literal["ok", "limited", "missing"]
    """`limited`: all works, with the restriction that `detail` tells."""
    detail: str


@app.command()
def doctor(as_json: JsonOption = False) -> None:
    """Check this machine. The exit code is 1 if something that is needed is missing."""
    results = list(run_checks())
    if as_json:
        print_json(results)
    else:
        marks = {"ok": "[green]✓[/]", "limited": "[yellow]![/]", "missing": "[red]✗[/]"}
        table = Table(show_header=False)
        add_names(table, "", "what", "finding")
        for check in results:
            table.add_row(marks[check.state], check.name, escape(check.detail))
        console.print(table)
    raise typer.Exit(1 if any(check.state == "missing" for check in results) else 0)


def run_checks() -> Iterable[Check]:
    """All checks, one after the other; one that fails unexpectedly is reported as missing."""
    checks: list[Callable[[], Check]] = [
        check_python,
        check_packages,
        check_pybullet,
        check_solver,
        check_egl,
        check_runtime_folder,
        check_shared_memory,
        check_zenoh,
        check_ros,
        check_display,
        check_viewer,
    ]
    for check in checks:
        try:
            yield check()
        except (OSError, DsrError, subprocess.SubprocessError) as error:
            yield Check(check.__name__.removeprefix("check_").replace("_", " "), "missing", str(error))


def check_python() -> Check:
    """Version 3.11 or newer."""
    version = ".".join(map(str, sys.version_info[:3]))
    fine = sys.version_info >= (3, 11)
    return Check("Python", "ok" if fine else "missing", version if fine else f"{version}; 3.11 or newer is needed")


def check_packages() -> Check:
    """All Python packages but pybullet."""
    lacking = [package for package, module in PACKAGES.items() if importlib.util.find_spec(module) is None]
    if lacking:
        return Check("packages", "missing", f"not installed; run: pip install {' '.join(lacking)}")
    return Check("packages", "ok", ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES))


def check_pybullet() -> Check:
    """Check the physics engine, or the tools to build it."""
    if importlib.util.find_spec("pybullet") is not None:
        return Check("pybullet", "ok", importlib.metadata.version("pybullet"))
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        advice = "and no C++ compiler to build it: install one (Debian, Ubuntu: apt install g++ python3-dev)"
    else:
        advice = f"run: pip install pybullet (if there is no wheel, {compiler} builds it in about ten minutes)"
    return Check("pybullet", "missing", f"not installed; {advice}")


def check_solver() -> Check:
    """The planner's solver, which is optional; started as a process."""
    probe = [sys.executable, "-c", _SOLVER_PROBE]
    found = subprocess.run(probe, capture_output=True, text=True, timeout=_PATIENCE, check=False)
    if found.returncode == 0:
        return Check("planner", "ok", found.stdout.strip())
    reason = found.stderr.strip().rpartition("\n")[2].partition(": ")[2]
    return Check("planner", "limited", f"{reason} (only goals need it: dsr mission, scenarios with a mission)")


def check_egl() -> Check:
    """Rendering by EGL, tried in a process of its own."""
    probe = subprocess.run([sys.executable, "-c", _EGL_PROBE], capture_output=True, timeout=_PATIENCE, check=False)
    if probe.returncode == 0:
        return Check("EGL", "ok", "simulated cameras render with OpenGL")
    return Check("EGL", "limited", "not available: simulated cameras render in software, two to five times slower")


def check_runtime_folder() -> Check:
    """The folder where processes find each other."""
    folder = runtime_dir()
    probe = folder / f"doctor-{secrets.token_hex(4)}"
    probe.touch()
    probe.unlink()
    return Check("runtime folder", "ok", str(folder))


def check_shared_memory() -> Check:
    """Camera frames without copies."""
    try:
        ring = Ring(len(_PROBE))
        descriptor = ring.write([_PROBE])
        found = None if descriptor is None else RingReader(descriptor).view(descriptor)
    except OSError as error:
        return Check("shared memory", "limited", f"{error}: camera frames are copied and travel over TCP")
    if found is None or bytes(found) != _PROBE:
        return Check("shared memory", "limited", "what was written is not read: camera frames may be lost")
    return Check("shared memory", "ok", "camera frames are read in place")


def check_zenoh() -> Check:
    """Two sessions on this machine find each other and a message arrives."""
    graph = f"doctor-{secrets.token_hex(4)}"
    key = Keys(graph).device("echo")
    arrived = threading.Event()
    receiver, first = open_transport(graph, "doctor-a")
    sender, second = open_transport(graph, "doctor-b")
    try:
        receiver.subscribe(key, lambda *_: arrived.set())
        began = WALL_CLOCK.monotonic()
        while not arrived.is_set() and WALL_CLOCK.monotonic() < began + _PATIENCE / 3:
            sender.publish(key, b"?")
            WALL_CLOCK.wait(arrived, 0.02)
    finally:
        for resource in (sender, receiver, second, first):
            resource.close()
    if arrived.is_set():
        return Check("Zenoh", "ok", "two sessions met over the loopback interface")
    return Check("Zenoh", "missing", "two sessions on 127.0.0.1 do not reach each other; is there a firewall?")


def check_ros() -> Check:
    """The libraries of the bridge to ROS 2, which is optional."""
    found = {name: importlib.util.find_spec(name) is not None for name in ("rosbags", "xxhash", "cyclonedds")}
    if not (found["rosbags"] and found["xxhash"]):
        return Check("ROS 2", "limited", "not installed; robots that speak ROS 2 need: pip install 'dsr-memory[ros]'")
    dds = "and DDS" if found["cyclonedds"] else "(DDS needs: pip install 'dsr-memory[ros-dds]')"
    return Check("ROS 2", "ok", f"nodes under rmw_zenoh {dds}; a robot is checked by dsr ros check")


def check_display() -> Check:
    """A screen for the viewer."""
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if display or sys.platform in ("darwin", "win32"):
        return Check("display", "ok", display or sys.platform)
    return Check("display", "limited", "none: the viewer writes recordings, open them elsewhere with rerun FILE.rrd")


def check_viewer() -> Check:
    """The rerun viewer's program."""
    program = [sys.executable, "-m", "rerun_cli", "--version"]
    found = subprocess.run(program, capture_output=True, text=True, timeout=_PATIENCE, check=False)
    if found.returncode == 0:
        return Check("rerun", "ok", found.stdout.partition(" (")[0])
    return Check("rerun", "missing", f"the viewer does not start: {found.stderr.strip()[-200:]}")
