"""Descriptions of robots with macros (xacro), expanded by xacrodoc.

A xacro file is a program: it may read files and evaluate Python expressions. So it runs in a process of its own, which
has a time limit: `python -m agents.xacro_file FILE NAME:=VALUE ...` prints the expanded description.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from agents.urdf_elements import read_urdf
from agents.urdf_files import find_package
from dsr.config.extras import check_installed
from dsr.errors import ConfigError, suggest

_LONGEST = 30.0
"""s that macros may take: those of a humanoid take 2."""
_MOST_PACKAGES = 100
"""Packages that one description may name; each is sought once."""
_MARKS = (b"<xacro:", b"${", b"$(")
_GIVES = ":="

Value = str | bool | int | float
"""Of an argument of macros; true and false are told in small letters, as ROS does."""


def read_robot(file: Path, args: Mapping[str, Value] | None = None) -> bytes:
    """The description of a robot, its macros expanded if it has any.

    Args:
        file: the description.
        args: arguments of its macros, by name; others keep their defaults.

    Raises:
        ConfigError: for macros that cannot be expanded, arguments that the file lacks, and those that it needs.
    """
    data, args = read_urdf(file), args or {}
    if file.suffix != ".xacro" and not any(mark in data for mark in _MARKS):
        if args:
            raise ConfigError(f"it has no macros, so it takes no arguments: {', '.join(args)}", file=str(file))
        return data
    if wrong := [name for name in args if not name or _GIVES in name]:
        raise ConfigError(f"{wrong[0]!r} is no name of an argument", file=str(file))
    check_installed(["xacrodoc"], f"{file} has macros")
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__, str(file.resolve()), *(_given(*item) for item in args.items())],
            capture_output=True, stdin=subprocess.DEVNULL, timeout=_LONGEST, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise ConfigError(f"its macros take more than {_LONGEST:g} s", file=str(file)) from error
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise ConfigError(f"its macros cannot be expanded: {said[-1]:.300}", file=str(file))
    return done.stdout


def _given(name: str, value: Value) -> str:
    return f"{name}{_GIVES}{str(value).lower() if isinstance(value, bool) else value}"


class _Asked(dict[str, str]):
    """Arguments that remember which of them macros ask for: `<xacro:arg>` and `$(arg ...)` do."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.names: set[object] = set()

    def __contains__(self, name: object) -> bool:
        self.names.add(name)
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.names.add(name)
        return super().__getitem__(name)


def main(name: str, *given: str) -> None:
    """Print the description in the file `name` without its macros; what is wrong is the last line of the errors.

    Args:
        name: of the file.
        given: its arguments, as `NAME:=VALUE`.
    """
    from xacrodoc import XacroDoc, packages

    file = Path(name)
    values = dict(one.split(_GIVES, 1) for one in given)
    asked = _Asked(values)
    os.chdir(file.parent)  # xacro seeks what is included from here
    for _ in range(_MOST_PACKAGES):
        try:
            expanded = XacroDoc.from_file(file, subargs=asked, resolve_packages=False).to_urdf_string()
            if unknown := [one for one in values if one not in asked.names]:
                known = [str(one) for one in asked.names]
                raise SystemExit(f"it has no argument {unknown[0]!r}; {suggest(unknown[0], known)}")
            sys.stdout.write(expanded)
            return
        except Exception as error:
            if missing := _missing(error):
                raise SystemExit(f"it needs the argument {missing!r}: give it in `urdf_args`") from error
            inner = error if isinstance(error, packages.PackageNotFoundError) else error.__context__
            if not isinstance(inner, packages.PackageNotFoundError):
                raise SystemExit(" ".join(str(error).split())) from error
            package = str(inner.args[0])
            found = find_package(package, file.parent)
            if found is None:
                where = f"above {file.parent} or in ROS_PACKAGE_PATH"
                raise SystemExit(f"there is no package {package!r} {where}") from error
            packages.update_package_cache({package: found})
    raise SystemExit(f"more than {_MOST_PACKAGES} packages")


def _missing(error: BaseException | None) -> str:
    """The argument that macros ask for, and that has neither a value nor a default; empty if it is another error."""
    while error is not None:
        if type(error).__name__ == "ArgException":
            return str(error)
        error = error.__cause__ or error.__context__ or getattr(error, "exc", None)
    return ""


if __name__ == "__main__":
    main(*sys.argv[1:])
