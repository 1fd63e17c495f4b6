"""The commands of `dsr`, each imported when it is used: its own, and those that packages add under `dsr.commands`."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from dsr.cli.interrupts import end_in_good_order
from dsr.config.extras import DISTRIBUTION, missing_extra
from dsr.config.own_packages import stranger
from dsr.errors import ConfigError

GROUP = "dsr.commands"
"""Group of entry points: typer apps, each with the name of its command."""
OWN = {
    "new": "new", "run": "run", "stop": "background", "logs": "background", "halt": "halt",
    "ls": "inspect", "show": "inspect", "tree": "inspect", "relations": "relations",
    "visibility": "visibility", "worlds": "worlds", "parts": "parts", "watch": "watch", "top": "top",
    "topology": "topology", "diff": "diff", "what-if": "what_if", "save": "persist", "convert": "persist",
    "load": "load", "hub": "hub",
    "stamps": "stamps", "doctor": "doctor", "security": "security",
}  # fmt: skip
"""Own commands in the order of the help, with the module beside this one that has each."""
_LISTED = re.compile(r"^([-*]|\s|\x08)", re.MULTILINE)
"""A paragraph of a docstring in which lines are lines: a list, or something indented."""


class Commands(TyperGroup):
    """A group whose help reads the first lines of docstrings, and which imports a command to run it."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        files: dict[str, Path | None] = {name: Path(__file__).with_name(f"{file}.py") for name, file in OWN.items()}
        files |= {name: file_of(plugin) for name, plugin in plugins().items()}
        helps = {name: help_in(file, name) if file else "(is not installed)" for name, file in files.items()}
        self.commands = {name: TyperCommand(name, help=text) for name, text in helps.items()}

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that the arguments name, imported. Raises `ConfigError` if it cannot be imported."""
        name, _, rest = super().resolve_command(ctx, args)
        command = None if name is None else load_command(name)
        end_in_good_order()
        return name, command, rest


def load_command(name: str) -> Any:
    """Import the command `name`. Raises `ConfigError` if it cannot be imported."""
    if name in OWN:
        group = typer.main.get_group(importlib.import_module(f"dsr.cli.{OWN[name]}").app)
        return _flowing(group.commands.get(name, group))
    plugin = plugins()[name]
    try:
        command: Any = typer.main.get_group(plugin.load())
    except (ImportError, AttributeError) as error:
        reason = stranger(plugin.module) or missing_extra(error) or f"{plugin.value}: {error}"
        raise ConfigError(f"the command {name!r} cannot be loaded: {reason}") from error
    command.name = name
    if not command.commands:
        command.resolve_command = _refuse
    return _flowing(command)


def _refuse(context: Any, words: list[str]) -> None:
    """Say that a command without others below it takes no such words. Raises `UsageError`."""
    context.fail(f"Got unexpected extra argument{'s' * (len(words) > 1)} ({' '.join(words)})")


def _flowing(command: Any) -> Any:
    """The command, whose help fills its lines: where a docstring breaks them, a narrow terminal would once more."""
    for one in (command, *getattr(command, "commands", {}).values()):
        paragraphs = re.split(r"\n\s*\n", inspect.cleandoc(one.help or ""))
        one.help = "\n\n".join(text if _LISTED.search(text) else " ".join(text.split()) for text in paragraphs) or None
    return command


@cache
def plugins() -> dict[str, EntryPoint]:
    """The commands that packages add, by name. Of several of one name, that of this distribution counts."""
    added = {plugin.name: plugin for plugin in sorted(entry_points(group=GROUP), key=_is_ours)}
    return {name: added[name] for name in sorted(added) if name not in OWN}


def _is_ours(plugin: EntryPoint) -> bool:
    return plugin.dist is not None and plugin.dist.name == DISTRIBUTION


def help_in(file: Path, name: str) -> str:
    """The help of a command, read from the source in which it is defined; nothing is imported.

    It is the first line of the docstring of the function of about that name, the first `help` of a typer app, or the
    first line of the file.
    """
    text = file.read_text(encoding="utf-8")
    function = re.escape(name.replace("-", "_"))
    docstring = r'\(.*?^    """(.+?)(?:"""|$)'
    forms = (
        rf"^def (?:\w+_)?{function}{docstring}",
        r'typer\.Typer\([^)]*?help="(.+?)"',
        r'\A"""(.+?)(?:"""|$)',
    )
    found = (re.search(form, text, re.DOTALL | re.MULTILINE) for form in forms)
    return next((line[1].strip() for line in found if line), "")


def file_of(plugin: EntryPoint) -> Path | None:
    """The source of the module that has a command; None if it is not there or not a file."""
    top, *rest = plugin.module.split(".")
    try:
        found = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return None
    if found is None:
        return None
    folder = Path(next(iter(found.submodule_search_locations or []), found.origin or ""))
    places = (folder.joinpath(*rest).with_suffix(".py"), folder.joinpath(*rest, "__init__.py"), folder)
    return next((place for place in places if place.is_file()), None)
