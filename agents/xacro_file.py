"""Descriptions of robots with macros (xacro), expanded by xacrodoc.

A xacro file is a program: it may read files and evaluate Python expressions. So it runs in a process of its own, which
has a time limit: `python -m agents.xacro_file FILE` prints the expanded description.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from agents.urdf_elements import read_urdf
from agents.urdf_files import find_package
from dsr.config.extras import check_installed
from dsr.errors import ConfigError

_LONGEST = 30.0
"""s that macros may take: those of a humanoid take 2."""
_MOST_PACKAGES = 100
"""Packages that one description may name; each is sought once."""
_MARKS = (b"<xacro:", b"${", b"$(")


def read_robot(file: Path) -> bytes:
    """The description of a robot, its macros expanded if it has any. Raises `ConfigError`."""
    data = read_urdf(file)
    if file.suffix != ".xacro" and not any(mark in data for mark in _MARKS):
        return data
    check_installed(["xacrodoc"], f"{file} has macros")
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__, str(file.resolve())],
            capture_output=True, stdin=subprocess.DEVNULL, timeout=_LONGEST, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise ConfigError(f"its macros take more than {_LONGEST:g} s", file=str(file)) from error
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise ConfigError(f"its macros cannot be expanded: {said[-1]:.300}", file=str(file))
    return done.stdout


def main(name: str) -> None:
    """Print the description in the file `name` without its macros; what is wrong is the last line of the errors."""
    from xacrodoc import XacroDoc, packages

    file = Path(name)
    os.chdir(file.parent)  # xacro seeks what is included from here
    for _ in range(_MOST_PACKAGES):
        try:
            sys.stdout.write(XacroDoc.from_file(file, resolve_packages=False).to_urdf_string())
            return
        except Exception as error:
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


if __name__ == "__main__":
    main(sys.argv[1])
