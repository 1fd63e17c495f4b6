"""The distribution: built, installed into environments that have nothing else, and used from an empty folder.

Libraries are linked from the environment of the tests, so nothing is downloaded. `benchmarks/installing.py` does the
same with downloads, and measures.
"""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
import tomllib
import venv
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from dsr.config.extras import DISTRIBUTION, EXTRAS

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PACKAGES = {"dsr", "agents", "simulation_handler", "surprise", "planner", "benchmarks"}
SOURCES = (*PACKAGES, "etc", "docs", "pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", "NOTICE")
MODULES = {
    "ai_edge_litert": "ai-edge-litert", "collada": "pycollada", "cv2": "opencv-python-headless",
    "dynamixel_sdk": "dynamixel-sdk", "pybullet_data": "pybullet", "rerun": "rerun-sdk",
    "up_fast_downward": "up-fast-downward",
}  # fmt: skip
"""The distributions of modules that have another name."""
ALONE = """
import dsr
assert dsr.__version__
with dsr.connect("kitchen", agent="me") as memory:
    print(memory.add_node("cup_1", "cup").name)
"""
BUILD = "import sys; from setuptools import build_meta as build; build.build_{kind}(sys.argv[1])"

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The wheel and the source distribution."""
    folder, result = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("built")
    for name in SOURCES:
        place = ROOT / name
        if place.is_dir():
            shutil.copytree(place, folder / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        else:
            shutil.copy(place, folder / name)
    for kind in ("wheel", "sdist"):
        command = [sys.executable, "-c", BUILD.format(kind=kind), str(result)]
        subprocess.run(command, cwd=folder, capture_output=True, check=True)
    return {"wheel": next(result.glob("*.whl")), "sdist": next(result.glob("*.tar.gz"))}


def requirements(extras: Iterable[str]) -> set[str]:
    """Names of all distributions that this one needs with these extras."""
    wanted, found = [(DISTRIBUTION, frozenset(extras))], set()
    while wanted:
        name, chosen = wanted.pop()
        if name == DISTRIBUTION:
            optional = PROJECT["optional-dependencies"]
            texts = [*PROJECT["dependencies"], *(text for extra in chosen for text in optional[extra])]
        else:
            texts = importlib.metadata.requires(name) or []
        for requirement in map(Requirement, texts):
            marker, key = requirement.marker, (canonicalize_name(requirement.name), frozenset(requirement.extras))
            applies = marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *chosen))
            if applies and key not in found:
                found.add(key)
                wanted.append(key)
    return {name for name, _ in found} - {DISTRIBUTION}


@pytest.fixture
def install(built: dict[str, Path], tmp_path: Path) -> Callable[..., Run]:
    """Install the wheel beside the libraries that some extras need; returns what runs its programs."""

    def make(*extras: str) -> Run:
        home, libraries = tmp_path / "environment", tmp_path / "libraries"
        venv.create(home, symlinks=True)
        libraries.mkdir()
        for name in requirements(extras):
            found = importlib.metadata.distribution(name)
            for top in {file.parts[0] for file in found.files or [] if file.parts[0] != ".."}:
                if not (libraries / top).exists():
                    (libraries / top).symlink_to(Path(str(found.locate_file(top))))
        (packages,) = home.glob("lib/python*/site-packages")
        (packages / "libraries.pth").write_text(f"{libraries}\n")
        pip = [sys.executable, "-m", "pip", "--python", str(home / "bin" / "python"), "install", "--no-deps", "--quiet"]
        subprocess.run([*pip, str(built["wheel"])], check=True, capture_output=True)
        empty = tmp_path / "empty"
        empty.mkdir()

        def run(program: str, *arguments: str, inside: str = ".") -> subprocess.CompletedProcess[str]:
            environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
            environment["XDG_RUNTIME_DIR"] = str(empty)  # no graph of anybody else is there
            command = [str(home / "bin" / program), *arguments]
            return subprocess.run(
                command, cwd=empty / inside, env=environment, capture_output=True, text=True, timeout=120.0, check=False
            )

        return run

    return make


def test_the_wheel_holds_what_it_must_and_no_more(built: dict[str, Path]) -> None:
    names = set(zipfile.ZipFile(built["wheel"]).namelist())
    assert {"dsr/py.typed", "dsr/etc/systems/tabletop.toml", "dsr/etc/planning/domain.pddl"} <= names
    assert {"dsr/etc/robots/gen3.urdf", "dsr/etc/objects/cup.urdf", "dsr/etc/scenarios/towers.toml"} <= names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert {name.split("/")[0] for name in names if "dist-info" not in name} == PACKAGES


def test_the_source_distribution_makes_the_same_wheel(built: dict[str, Path], tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--quiet", "-w", str(tmp_path)]
    subprocess.run([*pip, str(built["sdist"])], check=True, capture_output=True)
    (again,) = tmp_path.glob("*.whl")
    assert zipfile.ZipFile(again).namelist() == zipfile.ZipFile(built["wheel"]).namelist()


def test_the_memory_alone_needs_four_libraries(install: Callable[..., Run]) -> None:
    run = install()
    result = run("python", "-c", ALONE)
    assert result.stdout == "cup_1\n", result.stderr
    result = run("dsr", "ls")
    assert result.returncode == 2
    assert result.stderr == "dsr: the library 'typer' is not installed; run: pip install 'dsr-memory[cli]'\n"


def test_the_commands_that_look_into_a_graph_need_no_simulation(install: Callable[..., Run]) -> None:
    run = install("cli")
    assert run("dsr", "--version").stdout == f"dsr {PROJECT['version']}\n"
    assert "no graph runs on this machine" in run("dsr", "ls").stderr
    for command in (("demo",), ("run", "tabletop"), ("scenario", "run", "hovering_1")):
        result = run("dsr", *command)
        assert result.returncode == 2, result.stdout
        assert "pip install 'dsr-memory[sim]'" in " ".join(result.stderr.split()), result.stderr


def test_installed_it_does_what_the_checkout_does(install: Callable[..., Run], tmp_path: Path) -> None:
    run = install("sim")
    (tmp_path / "empty" / "dsr").mkdir()
    (tmp_path / "empty" / "dsr" / "__init__.py").write_text("raise SystemExit('the wrong dsr')\n")
    assert "towers" in run("dsr", "scenario", "list").stdout
    result = run("dsr", "scenario", "run", "hovering_1", "--lockstep", "--sensor", "poses", "--no-viewer")
    assert result.returncode == 0, result.stdout + result.stderr
    assert "viewer is left out" in result.stderr and "dsr-memory[view]" in result.stderr


def test_a_package_of_ones_own_adds_an_agent_an_object_a_scenario_and_a_command(
    install: Callable[..., Run], tmp_path: Path
) -> None:
    run = install("sim")
    assert "lab_bot/lab_bot/counter.py" in run("dsr", "new", "lab_bot").stdout
    command = [sys.executable, "-c", BUILD.format(kind="wheel"), str(tmp_path)]
    subprocess.run(command, cwd=tmp_path / "empty" / "lab_bot", capture_output=True, check=True)
    pip = [sys.executable, "-m", "pip", "--python", str(tmp_path / "environment" / "bin" / "python"), "install"]
    subprocess.run([*pip, "--no-deps", "--quiet", *map(str, tmp_path.glob("lab_bot*.whl"))], check=True)
    assert "Say how many boxes are in view" in run("dsr", "--help").stdout
    play = ("scenario", "run", "lab_bot", "--lockstep", "--sensor", "poses", "--no-viewer")
    result = run("dsr", *play, inside="lab_bot")
    assert result.returncode == 0, result.stdout + result.stderr


def test_another_package_of_the_same_name_is_told_apart(install: Callable[..., Run], tmp_path: Path) -> None:
    run = install("sim")
    (packages,) = (tmp_path / "environment").glob("lib/python*/site-packages")
    (packages / "agents" / "__init__.py").write_text("import no_such_library\n")
    info = packages / "other_agents-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other-agents\nVersion: 1.0\n")
    (info / "top_level.txt").write_text("agents\n")
    said = "other-agents also installs a package 'agents': install it and dsr-memory into different environments"
    for command in (("run", "tabletop"), ("record",)):
        result = run("dsr", *command)
        assert result.returncode == 2 and said in " ".join(result.stderr.split()), result.stderr
    shutil.copytree(packages / "agents", tmp_path / "empty" / "agents")
    shutil.rmtree(packages / "agents")
    result = run("python", "-m", "dsr.cli", "run", "tabletop")
    assert "the package 'agents' is the one in" in " ".join(result.stderr.split()), result.stderr


def test_extras_are_those_of_the_project() -> None:
    declared = {
        canonicalize_name(Requirement(text).name): extra
        for extra in (
            "cli", "sim", "view", "planning", "hands", "mediapipe", "dynamixel", "realsense", "ros", "ros-dds", "xacro",
            "assist",
        )
        for text in PROJECT["optional-dependencies"][extra]
    }
    assert all(declared[MODULES.get(module, module)] == extra for module, extra in EXTRAS.items())
