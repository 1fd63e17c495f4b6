"""`dsr new`: a package of one's own around the working memory, made from `etc/template`."""

from __future__ import annotations

import importlib.util
import keyword
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from dsr.cli.commands import OWN, plugins
from dsr.cli.common import console, shown
from dsr.errors import ConfigError
from dsr.files.built_in import ETC

app = typer.Typer()
PLACEHOLDER = "my_robot"
"""Stands in the template, in texts and names of files, for the name of the package."""
_TEMPLATE = ETC / "template"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the package: lower-case letters, digits and _.")],
    folder: Annotated[Path | None, typer.Option(help="Where to make it; default: a new folder of that name.")] = None,
) -> None:
    """Make a package of your own: an agent, a system, an object, a scenario, a command, a test.

    Everything in it works as it is; its README.md says how to run it.
    """
    check_package_name(name)
    place = folder or Path(name)
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise ConfigError(f"{place} is already there and not empty")
    for file in make_package(name, place):
        console.print(f"  {shown(str(file))}", soft_wrap=True)
    console.print(f"\nNow: cd {shown(str(place))}, and see README.md", soft_wrap=True)


def check_package_name(name: str) -> None:
    """Raise `ConfigError` for a name that a package cannot have, or that hides a package, command or system."""
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise ConfigError(f"{name!r} cannot be the name of a package; expected lower-case letters, digits and _")
    if name in sys.stdlib_module_names or importlib.util.find_spec(name) is not None:
        raise ConfigError(f"there is a package {name!r} already; choose another name")
    if name in OWN or name in plugins():
        raise ConfigError(f"there is a command `dsr {name}` already; choose another name")
    if name != PLACEHOLDER and (_TEMPLATE / name).exists():
        raise ConfigError(f"the package has a folder {name!r} besides; choose another name")
    for kind in ("systems", "scenarios"):
        if (ETC / kind / f"{name}.toml").exists():
            raise ConfigError(f"{name!r} is one of the {kind} of dsr already; choose another name")


def make_package(name: str, place: Path) -> list[Path]:
    """Write the template with `name` for its placeholder; returns the files.

    Args:
        name: of the package.
        place: a folder that is empty or missing, and is so again if not all can be written (`OSError`).
    """
    was_there = place.exists()
    try:
        return list(_written(name, place))
    except BaseException:
        for left in place.iterdir() if place.is_dir() else ():
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        if not was_there and place.exists():
            place.rmdir()
        raise


def _written(name: str, place: Path) -> Iterator[Path]:
    for source in sorted(_TEMPLATE.rglob("*")):
        relative = str(source.relative_to(_TEMPLATE))
        if source.is_file() and "__pycache__" not in relative:
            file = place / relative.replace(PLACEHOLDER, name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(source.read_text(encoding="utf-8").replace(PLACEHOLDER, name), encoding="utf-8")
            yield file
