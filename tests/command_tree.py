"""All commands of `dsr`, those of other packages included, and options that they have in common."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dsr.cli.commands import OWN, load_command, plugins


def leaves() -> dict[str, Any]:
    """Every command that does something, by what one types after `dsr`."""
    return {path: command for name in (*OWN, *plugins()) for path, command in _below(name, load_command(name))}


def _below(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    commands = getattr(command, "commands", {})
    if not commands or command.invoke_without_command:
        yield path, command
    for name, sub in commands.items():
        yield from _below(f"{path} {name}", sub)


def option(command: Any, name: str) -> Any | None:
    """The option of a command that is called `name`, such as `--json`; None if it has none."""
    return next((param for param in command.params if name in getattr(param, "opts", ())), None)
