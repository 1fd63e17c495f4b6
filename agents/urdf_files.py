"""Finds descriptions of robots (URDF) and the files that they name: meshes beside them, or in packages of ROS.

A package is a folder that bears its name. It is sought above the description, beside those folders, and where ROS looks
for packages (`AMENT_PREFIX_PATH`, `ROS_PACKAGE_PATH`). Without ROS the first two are enough.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from dsr.errors import ConfigError, suggest
from dsr.files.built_in import ETC

_PACKAGE, _FILE = "package://", "file://"


def find_mesh(name: str, folder: Path) -> Path:
    """The file that `<mesh filename=...>` names in a description in `folder`; ValueError if there is none.

    `name` is a path, relative to the description, or begins with `package://` or `file://`.
    """
    if name.startswith(_PACKAGE):
        package, _, rest = unquote(name.removeprefix(_PACKAGE)).partition("/")
        places = [found / rest for found in _packages(package, folder.resolve())]
        if not places:
            hint = f"expected a folder of that name above {folder}, or in ROS_PACKAGE_PATH"
            raise ValueError(f"mesh {name!r}: there is no package {package!r}; {hint}")
    else:
        places = [folder / unquote(name.removeprefix(_FILE))]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise ValueError(f"mesh {name!r}: there is no file {places[0]}")
    return found


def find_package(name: str, folder: Path) -> Path | None:
    """The folder of a package as a description in `folder` sees it; None if there is none."""
    return next(_packages(name, folder.resolve()), None)


def _packages(name: str, folder: Path) -> Iterator[Path]:
    """Folders that may be the package, those near the description first."""
    if name in ("", ".", ".."):
        return
    for above in (folder, *folder.parents):
        places = [above] if above.name == name else [above / name]
        yield from (place for place in places if place.is_dir())
    for prefix in _listed("AMENT_PREFIX_PATH"):
        yield from (place for place in [prefix / "share" / name] if place.is_dir())
    for path in _listed("ROS_PACKAGE_PATH"):
        yield from (place for place in (path, path / name) if place.name == name and place.is_dir())


def _listed(variable: str) -> list[Path]:
    return [Path(part) for part in os.environ.get(variable, "").split(os.pathsep) if part]


def known_robots() -> dict[str, Path]:
    """Find the robots that come along, by name."""
    return {file.stem: file for file in sorted((ETC / "robots").glob("*.urdf"))}


def find_robot(name_or_path: str, folder: Path) -> Path:
    """The description of a robot: a path with a suffix, relative to `folder`, or the name of one that comes along.

    Raises `ConfigError` for a name that there is not.
    """
    if Path(name_or_path).suffix:
        return folder / Path(name_or_path).expanduser()
    known = known_robots()
    if name_or_path not in known:
        hint = suggest(name_or_path, known)
        raise ConfigError(f"unknown robot model {name_or_path!r}; {hint}, or the path of a URDF file")
    return known[name_or_path]
