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
from dsr.config.extras import DISTRIBUTION, EXTRAS
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
"""Packages whose versions are told, with the module that each provides; pybullet has a check of its own."""
_OWN_CHECK = frozenset({"pybullet", "pybullet_data"})
_PURPOSES = {"cli": "the command dsr", "sim": "agents and simulated worlds", "view": "the live view"}
"""What the extras are for that have no check of their own."""
_COMPILERS = ("c++", "g++", "clang++", "cl")
_OPENGL_PROBE = "from agents.plant.renderer import opengl_works; raise SystemExit(0 if opengl_works() else 3)"
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
        check_opengl,
        check_runtime_folder,
        check_shared_memory,
        check_zenoh,
        check_ros,
        check_realsense,
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
    """All Python packages but pybullet. An extra of which nothing is installed was not asked for."""
    absent = {extra: _absent(extra) for extra in _PURPOSES}
    partly = {extra: modules for extra, modules in absent.items() if modules and not _is_left_out(extra)}
    if partly:
        named = ", ".join(module for modules in partly.values() for module in modules)
        return Check("packages", "missing", f"not installed: {named}; run: pip install '{_with_extras(partly)}'")
    left_out = [extra for extra in _PURPOSES if absent[extra]]
    if left_out:
        purposes = ", ".join(_PURPOSES[extra] for extra in left_out)
        return Check("packages", "limited", f"for {purposes}: pip install '{_with_extras(left_out)}'")
    return Check("packages", "ok", ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES))


def _absent(extra: str) -> list[str]:
    """The modules of an extra that are not installed."""
    return [module for module in _modules(extra) if importlib.util.find_spec(module) is None]


def _is_left_out(extra: str) -> bool:
    """Whether nothing of an extra is installed."""
    return len(_absent(extra)) == len(_modules(extra))


def _modules(extra: str) -> list[str]:
    return [module for module, of in EXTRAS.items() if of == extra and module not in _OWN_CHECK]


def _with_extras(extras: Iterable[str]) -> str:
    return f"{DISTRIBUTION}[{','.join(extras)}]"


def check_pybullet() -> Check:
    """Check the physics engine, or the tools to build it."""
    if importlib.util.find_spec("pybullet") is not None:
        return Check("pybullet", "ok", importlib.metadata.version("pybullet"))
    if _is_left_out("sim"):
        return Check("pybullet", "limited", f"not installed; it comes with: pip install '{_with_extras(['sim'])}'")
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


def check_opengl() -> Check:
    """Rendering by OpenGL, tried in a process of its own."""
    probe = subprocess.run([sys.executable, "-c", _OPENGL_PROBE], capture_output=True, timeout=_PATIENCE, check=False)
    if probe.returncode == 0:
        return Check("OpenGL", "ok", "simulated cameras render with it")
    return Check("OpenGL", "limited", "not available: simulated cameras render in software, several times slower")


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


def check_realsense() -> Check:
    """The library of RealSense cameras, which is optional; loaded in a process of its own."""
    if importlib.util.find_spec("pyrealsense2") is None:
        said = f"not installed; RealSense cameras need: pip install '{_with_extras(['realsense'])}'"
        return Check("RealSense", "limited", said)
    probe = [sys.executable, "-c", "import pyrealsense2"]
    found = subprocess.run(probe, capture_output=True, text=True, timeout=_PATIENCE, check=False)
    if found.returncode == 0:
        version = importlib.metadata.version("pyrealsense2")
        return Check("RealSense", "ok", f"pyrealsense2 {version}; cameras are tried by dsr drivers try")
    reason = found.stderr.strip().rpartition("\n")[2]
    return Check("RealSense", "limited", f"{reason or 'it crashes'}; Debian, Ubuntu: apt install libusb-1.0-0")


def check_display() -> Check:
    """A screen for the viewer."""
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if display or sys.platform in ("darwin", "win32"):
        return Check("display", "ok", display or sys.platform)
    return Check("display", "limited", "none: the viewer writes recordings, open them elsewhere with rerun FILE.rrd")


def check_viewer() -> Check:
    """The rerun viewer's program."""
    if _is_left_out("view"):
        return Check("rerun", "limited", f"not installed; it comes with: pip install '{_with_extras(['view'])}'")
    program = [sys.executable, "-m", "rerun_cli", "--version"]
    found = subprocess.run(program, capture_output=True, text=True, timeout=_PATIENCE, check=False)
    if found.returncode == 0:
        return Check("rerun", "ok", found.stdout.partition(" (")[0])
    return Check("rerun", "missing", f"the viewer does not start: {found.stderr.strip()[-200:]}")
