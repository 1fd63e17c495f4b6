"""Options that several commands have: one name, one meaning, one form."""

from __future__ import annotations

from typing import Any

import pytest

from tests.command_tree import leaves, option

COMMANDS = leaves()
SHARED = ("--graph", "--json", "--json-file", "--security", "--world", "--as", "--connect")
OWN_DEFAULT = {"run", "replay"}
"""Commands that give a graph its name: their help says which one by default."""
NO_DATA = {
    "new": "writes files and names them",
    "run": "goes on until Ctrl-C",
    "stop": "does what it says",
    "save": "writes a file of JSON",
    "convert": "writes a file of JSON",
    "load": "does what it says",
    "hub": "goes on until Ctrl-C",
    "security init": "writes files",
    "security add": "writes files",
    "record": "writes a file",
    "view": "opens a window",
    "assist serve": "speaks a protocol",
    "ros run": "goes on until Ctrl-C",
    "scenario generate": "writes a file",
}
"""Commands that have no outcome but what they do."""


def form(param: Any) -> tuple[object, ...]:
    """Everything that makes an option what it is."""
    kind = param.type_descriptor.annotation
    return tuple(param.opts), param.is_flag, param.multiple, str(kind), param.metavar, param.envvar, param.help


def test_all_commands_are_walked_over() -> None:
    assert {"ls", "scenario sweep", "demo", "bench", "security show", "timeline"} <= COMMANDS.keys()
    assert len(COMMANDS) > 30


@pytest.mark.parametrize("name", SHARED)
def test_a_shared_option_is_the_same_everywhere(name: str) -> None:
    found = {path: param for path, command in COMMANDS.items() if (param := option(command, name)) is not None}
    found.pop("hub", None)  # --connect: the hub is a router itself, and joins any number of others
    if name == "--as":
        found.pop("tell")  # not whose certificate is used, but whose belief is told
    assert len(found) > 1
    if name == "--graph":
        for path in OWN_DEFAULT:
            assert found[path].help.startswith("Name of the graph; ")
            assert form(found.pop(path))[:-1] == form(found["ls"])[:-1]
    assert len({form(param) for param in found.values()}) == 1, {path: form(param) for path, param in found.items()}


def test_short_options_of_shared_ones_mean_nothing_else() -> None:
    for path, command in COMMANDS.items():
        for short, long in (("-g", "--graph"), ("-w", "--world")):
            param = option(command, short)
            assert param is None or long in param.opts, f"dsr {path} {short}"


def test_whatever_has_an_outcome_gives_it_as_json() -> None:
    without = {path for path, command in COMMANDS.items() if option(command, "--json") is None}
    assert without == NO_DATA.keys()


def test_a_file_of_json_is_beside_json_and_never_instead() -> None:
    for path, command in COMMANDS.items():
        if option(command, "--json-file") is not None:
            assert option(command, "--json") is not None, path
