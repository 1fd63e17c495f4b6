"""Who may import whom, and who may read the time: the rules of DESIGN and ARCHITECTURE, read off the sources."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("dsr", "agents", "simulation_handler", "surprise", "planner")
FILES = sorted(path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
MEASURED = sorted(path.relative_to(ROOT) for path in (ROOT / "benchmarks").rglob("*.py"))
"""Not part of the system: these may import all of it, but keep its other rules."""

ONE_PLACE = {
    "ai_edge_litert": ("agents/hand_tracker/model/litert.py",),
    "mediapipe": ("agents/hand_tracker/model/tasks.py", "benchmarks/real/"),
    "zenoh": ("dsr/network/zenoh_transport.py", "agents/ros_bridge/link/zenoh/", "benchmarks/peers/"),
    "xacrodoc": ("agents/xacro_file.py",),
    "rosbags": ("agents/ros_bridge/", "benchmarks/real/"),
    "cyclonedds": ("agents/ros_bridge/link/dds/",),
    "trimesh": ("dsr/geometry/files.py", "dsr/geometry/glb_file.py", "agents/arm_controller/model/mesh_boxes.py"),
    "collada": ("dsr/geometry/collada_file.py",),
    "cryptography": ("dsr/security/authority.py",),
    "rerun": ("agents/viewer/",),
    "mcap": ("agents/recorder/",),
    "mcp": ("agents/assistant/server.py", "agents/assistant/following.py"),
    "lark": ("dsr/narration/questions.py",),
    "pyrealsense2": ("agents/cameras/realsense.py",),
    "dynamixel_sdk": ("agents/dynamixel/servos.py",),
    "ruckig": ("agents/joint_ramp.py",),
    "pybullet": (
        *("simulation_handler/", "agents/plant/"),
        *("benchmarks/peers/tiny_renderer.py", "benchmarks/adept/unseen/ghosts.py"),
    ),
}
"""Libraries that only these files or folders import."""
SHARED_BY_AGENTS = (
    "agents.arm_controller.model.arm_model",
    "agents.arm_controller.model.kinematics",
    "agents.arm_controller.model.urdf",
    "agents.camera_feed",
    "agents.checked_frames",
    "agents.colors",
    "agents.depth_alignment",
    "agents.drivers",
    "agents.frame_images",
    "agents.hand_tracker.config",
    "agents.hand_tracker.model.loading",
    "agents.inbox",
    "agents.joint_ramp",
    "agents.intrinsics_file",
    "agents.object_models",
    "agents.packed_images",
    "agents.pairing",
    "agents.recorder",
    "agents.replay.source",
    "agents.scenario.format.scenario",
    "agents.scene_estimator.detection",
    "agents.segments",
    "agents.stillness",
    "agents.urdf_elements",
    "agents.urdf_files",
    "agents.xacro_file",
    "agents.viewer.camera_window",
)
"""Modules within `agents` that all its packages may import."""
LAYERS = (
    "dsr.errors dsr.clock dsr.forking dsr.threads",
    "dsr.files dsr.math3d",
    "dsr.config dsr.crdt dsr.network",
    "dsr.frames.tree",
    "dsr.graph.graph",
    "dsr.replication",
    "dsr.geometry",
    "dsr.parts",
    "dsr.images dsr.worlds dsr.believing.distribution",
    "dsr.memory",
    "dsr.agent dsr.vocabulary dsr.geometry.boxes dsr.geometry.placing",
    "dsr.worlds.comparison dsr.worlds.presence dsr.believing.worlds",
    "dsr.declared",
    "dsr.worlds.source dsr.worlds.clients dsr.worlds.reparenting dsr.worlds.mirror",
    "dsr.worlds.filters dsr.worlds.hosting",
    "dsr.persistence dsr.runtime",
    "dsr.timeline",
    "dsr.spatial dsr.visibility dsr.perception",
    "dsr.imagining dsr.security",
    "dsr.narration",
    "dsr.connecting",
    "dsr.runtime.agent_process dsr.runtime.supervised dsr.runtime.launcher dsr.runtime.shared_process",
    "dsr.cli dsr.runtime.__main__",
    "simulation_handler.config simulation_handler.scales",
    "simulation_handler.shapes",
    "simulation_handler.physics",
    "simulation_handler.perception",
    "simulation_handler.contact",
    "simulation_handler.state",
    "simulation_handler.explaining",
    "simulation_handler.hands.state",
    "simulation_handler.motion",
    "simulation_handler.reasoner",
    "simulation_handler.belief",
    "simulation_handler.graph_io",
    "simulation_handler.agent",
    "agents.scenario.format agents.calibrator.solve",
    "agents.scenario.truth agents.calibrator.watch",
    "agents.scenario.judge",
    "agents.scenario.run agents.scenario.check",
    "agents.scenario.generate",
    "agents.ros_bridge.errors",
    "agents.ros_bridge.messages",
    "agents.ros_bridge.link",
    "agents.ros_bridge.mapping",
    "agents.ros_bridge.bridge",
    "agents.ros_bridge.services",
    "agents.ros_bridge.agent",
    "agents.ros_bridge.bags",
    "agents.ros_bridge.run_cli",
)
"""From the bottom up: what a module or room is in it may import its own layer and those above it here."""
TIME = {
    "time": {"time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "sleep"},
    "datetime": {"now", "utcnow", "today"},
}
SEEDED_RANDOM = {"default_rng", "Generator", "SeedSequence", "BitGenerator", "PCG64", "Philox"}
"""What may be used of `numpy.random`: all else has global state."""


@cache
def parse(file: Path) -> ast.Module:
    return ast.parse((ROOT / file).read_text(encoding="utf-8"))


@cache
def imports(file: Path) -> tuple[str, ...]:
    """Full names of all that a file imports, at any depth: `from a.b import c` gives `a.b.c`."""
    found: list[str] = []
    for node in ast.walk(parse(file)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [f"{'.' * node.level}{node.module or ''}.{alias.name}" for alias in node.names]
    return tuple(found)


def group(file: Path) -> str:
    """What a file belongs to: a package, or one of the packages within `agents`."""
    return "/".join(file.parts[:2]) if file.parts[0] == "agents" else file.parts[0]


def is_in(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


@pytest.mark.parametrize("file", FILES, ids=str)
def test_dependencies_point_towards_dsr(file: Path) -> None:
    foreign = [name for name in imports(file) if any(is_in(name, package) for package in (*PACKAGES, "benchmarks"))]
    own = group(file).replace("/", ".")
    allowed = [own] if own == "dsr" else [own, "dsr"]
    if file.parts[0] == "agents":
        allowed += SHARED_BY_AGENTS
    assert [name for name in foreign if not any(is_in(name, package) for package in allowed)] == []


def module(file: Path) -> str:
    """Its full name: of a package, the one of its folder."""
    return ".".join((file.parent if file.name == "__init__.py" else file.with_suffix("")).parts)


def test_no_module_imports_another_in_a_circle() -> None:
    """Wherever in a file the import stands, also where it is only for types."""
    modules = {module(file): file for file in FILES}
    left = {
        name: {found if found in modules else found.rpartition(".")[0] for found in imports(file)} & modules.keys()
        for name, file in modules.items()
    }
    while leaves := [name for name, imported in left.items() if not imported]:
        for name in leaves:
            del left[name]
        for imported in left.values():
            imported.difference_update(leaves)
    assert left == {}


def layer(name: str) -> int | None:
    """Place in `LAYERS` of the longest entry that the module is in."""
    places = {entry: place for place, entries in enumerate(LAYERS) for entry in entries.split()}
    return max(((len(entry), place) for entry, place in places.items() if is_in(name, entry)), default=(0, None))[1]


def test_no_module_imports_from_a_higher_layer() -> None:
    """The face of a package gathers names of all its modules, and is none of them."""
    modules = {module(file): file for file in FILES if file.name != "__init__.py"}
    upwards = {
        (name, found)
        for name, file in modules.items()
        if (own := layer(name)) is not None
        for found in imports(file)
        if (other := layer(found)) is not None and other > own and is_in(found, name.partition(".")[0])
    }
    assert upwards == set()


@pytest.mark.parametrize("file", FILES + MEASURED, ids=str)
def test_imports_are_absolute(file: Path) -> None:
    assert [name for name in imports(file) if name.startswith(".")] == []


@pytest.mark.parametrize("library", ONE_PLACE)
def test_a_library_is_imported_in_one_place(library: str) -> None:
    importers = [file.as_posix() for file in FILES + MEASURED if any(is_in(name, library) for name in imports(file))]
    assert importers, f"nobody imports {library} any more"
    assert [name for name in importers if not name.startswith(ONE_PLACE[library])] == []


def test_mcap_is_imported_by_one_file_only() -> None:
    assert len([file for file in FILES if any(is_in(name, "mcap") for name in imports(file))]) == 1


def test_the_simulated_reality_never_reads_the_working_memory() -> None:
    """Otherwise prediction would be compared with itself."""
    memory = ("dsr.memory", "dsr.Memory", "dsr.connect", "dsr.connecting")
    forbidden = (*memory, "dsr.graph.graph", "dsr.replication", "dsr.crdt")
    for file in FILES:
        if group(file) == "agents/plant":
            assert [name for name in imports(file) if any(is_in(name, part) for part in forbidden)] == [], file
            attributes = {node.attr for node in ast.walk(parse(file)) if isinstance(node, ast.Attribute)}
            assert "memory" not in attributes, file


@pytest.mark.parametrize("file", [file for file in FILES + MEASURED if file.as_posix() != "dsr/clock.py"], ids=str)
def test_only_the_clock_reads_the_time_and_nobody_uses_global_random_state(file: Path) -> None:
    found = [f"line {node.lineno}: {offence}" for node in ast.walk(parse(file)) if (offence := offence_of(node))]
    assert found == []


def offence_of(node: ast.AST) -> str:
    """What a piece of syntax does that it must not, or nothing."""
    if isinstance(node, ast.ImportFrom):
        names = {alias.name for alias in node.names}
        if node.module == "random" or (node.module == "time" and names & TIME["time"]):
            return f"from {node.module} import {', '.join(sorted(names))}"
    if isinstance(node, ast.Import) and "random" in {alias.name for alias in node.names}:
        return "import random"
    if isinstance(node, ast.Attribute):
        owner = ast.unparse(node.value)
        if node.attr in TIME.get(owner.rpartition(".")[2], ()):
            return ast.unparse(node)
        if owner in ("np.random", "numpy.random") and node.attr not in SEEDED_RANDOM:
            return ast.unparse(node)
    return ""


@pytest.mark.parametrize(
    "code",
    [
        "import time\ntime.time()",
        "from time import sleep",
        "import datetime\ndatetime.datetime.now()",
        "import random",
        "from random import choice",
        "import numpy as np\nnp.random.normal()",
        "import numpy as np\nnp.random.seed(1)",
    ],
)
def test_the_search_for_time_and_random_state_finds_them(code: str) -> None:
    assert any(offence_of(node) for node in ast.walk(ast.parse(code)))


def test_seeded_random_numbers_and_given_times_are_fine() -> None:
    code = "import numpy as np\nnp.random.default_rng(3)\nfrom datetime import datetime\ndatetime.fromtimestamp(1.0)"
    assert not any(offence_of(node) for node in ast.walk(ast.parse(code)))
