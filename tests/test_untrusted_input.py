"""Nothing from the network is unpickled, evaluated, run or used as a path: read off the sources."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.test_imports import FILES, imports, is_in, parse

UNSAFE_MODULES = (
    *("pickle", "_pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "jsonpickle"),
    *("yaml", "ruamel", "code", "codeop", "runpy", "torch", "multiprocessing", "xmlrpc", "copyreg"),
    "logging.config",
)
UNSAFE_NAMES = {"eval", "exec", "compile", "__import__"}
UNSAFE_ATTRIBUTES = {"system", "popen", "load", "loadtxt", "genfromtxt", "fromfile", "fromregex", "memmap"}
"""Of `os` and `numpy`."""
OWN_CHILDREN = {"agents/scenario/run/sweep.py", "agents/scenario/run/sweep_worker.py"}
"""Speak with processes that they start themselves, through pipes that nobody else can reach."""
LOADED_BY_NAME = {
    "dsr/runtime/system.py",
    "dsr/runtime/forked.py",
    "agents/drivers.py",
    "dsr/__init__.py",
    "dsr/cli/commands.py",
    "agents/ros_bridge/link/dds/in_ros.py",
}
"""May import a module by a name, which comes from a local file, a command line or the parent process."""


def offences(tree: ast.AST) -> list[str]:
    """Each use of something that could turn data into code."""
    return [f"line {node.lineno}: {what}" for node in ast.walk(tree) if (what := offence_of(node))]  # type: ignore[attr-defined]


def offence_of(node: ast.AST) -> str:
    if isinstance(node, ast.Name) and node.id in UNSAFE_NAMES:
        return node.id
    if isinstance(node, ast.Attribute):
        owner = ast.unparse(node.value)
        if owner in ("os", "np", "numpy") and node.attr in UNSAFE_ATTRIBUTES:
            return ast.unparse(node)
        if owner == "builtins":
            return ast.unparse(node)
    if isinstance(node, ast.keyword) and node.arg in ("shell", "allow_pickle"):
        return f"{node.arg}="
    return ""


@pytest.mark.parametrize("file", FILES, ids=str)
def test_no_data_becomes_code(file: Path) -> None:
    allowed = ("multiprocessing",) if file.as_posix() in OWN_CHILDREN else ()
    unsafe = [module for module in UNSAFE_MODULES if module not in allowed]
    assert [name for name in imports(file) if any(is_in(name, module) for module in unsafe)] == []
    assert offences(parse(file)) == []


def test_modules_are_loaded_by_name_in_few_places_only() -> None:
    importers = {file.as_posix() for file in FILES if "import_module" in (file_text(file))}
    assert importers == LOADED_BY_NAME


def file_text(file: Path) -> str:
    return (Path(__file__).parents[1] / file).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "code",
    [
        "eval(text)",
        "exec(payload)",
        "f = eval",
        "import os\nos.system('ls')",
        "import numpy as np\nnp.load(file)",
        "subprocess.run(command, shell=True)",
        "np.frombuffer(x, allow_pickle=True)",
        "import builtins\nbuiltins.eval(x)",
    ],
)
def test_the_search_finds_them(code: str) -> None:
    assert offences(ast.parse(code))
