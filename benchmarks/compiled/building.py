"""Builds the prototype of a compiled core with the compiler of this machine, and loads it."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from dsr.graph.schema import KINDS, RECORDS, Schema
from dsr.math3d.transforms import Pose

SOURCE = Path(__file__).with_name("core.cpp")
_COMPILERS = ("c++", "g++", "clang++")
_OPTIONS = ("-std=c++17", "-O2", "-Wall", "-Wextra", "-Wno-missing-field-initializers", "-shared", "-fPIC")


def compiler() -> str | None:
    """Path of a C++ compiler, if this machine has one."""
    return next((found for name in _COMPILERS if (found := shutil.which(name))), None)


def why_not() -> str | None:
    """Say what is missing to build the prototype; None if nothing is."""
    if compiler() is None:
        return f"there is no C++ compiler ({', '.join(_COMPILERS)}); on Debian and Ubuntu: apt install g++"
    if not Path(sysconfig.get_path("include"), "Python.h").exists():
        return "the headers of Python are missing; on Debian and Ubuntu: apt install python3-dev"
    return None


def build(folder: Path) -> Path:
    """Compile the prototype into `folder`, and return its file. Raises `RuntimeError` with what the compiler says."""
    program = compiler()
    if program is None:
        raise RuntimeError(why_not())
    file = folder / f"compiled_core{sysconfig.get_config_var('EXT_SUFFIX')}"
    options = [*_OPTIONS, *(["-undefined", "dynamic_lookup"] if sys.platform == "darwin" else [])]
    command = [program, *options, f"-I{sysconfig.get_path('include')}", str(SOURCE), "-o", str(file)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        raise RuntimeError(f"{SOURCE} cannot be compiled: {result.stderr}")
    return file


def new_core(file: Path | str, rid: str, schema: Schema | None = None) -> Any:
    """Make a replica `rid` of the prototype that was built as `file`, with the names of `schema`."""
    spec = importlib.util.spec_from_file_location("compiled_core", file)
    assert spec is not None and spec.loader is not None
    module = sys.modules.get(spec.name)
    if module is None:
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    known = schema or Schema()
    attributes = {
        name: (KINDS.index(one.kind), -1 if one.length is None else one.length, one.stream)
        for name, one in known.attributes.items()
    }
    edge_types = {name: name in known.geometric for name in known.edge_types}
    return module.Core(rid, attributes, dict(known.node_types), edge_types, RECORDS, Pose.unchecked)
