"""Tells whether a package with the name of one of ours is ours: `agents` and `planner` are common names."""

from __future__ import annotations

import importlib.util
from importlib.metadata import packages_distributions
from pathlib import Path

from dsr.config.extras import DISTRIBUTION

OWN_PACKAGES = ("agents", "dsr", "planner", "simulation_handler", "surprise")
"""Top-level packages of this project."""
_FOLDER = Path(__file__).resolve().parents[2]


def stranger(module: str) -> str | None:
    """What is wrong if another package has taken the name of ours that `module` belongs to; None if nothing is."""
    package = module.partition(".")[0]
    if package not in OWN_PACKAGES:
        return None
    found = importlib.util.find_spec(package)
    places = [Path(place).resolve() for place in (found.submodule_search_locations or [] if found else [])]
    if _FOLDER / package not in places:
        where = f"is the one in {places[0]}" if places else "is missing"
        return f"the package {package!r} {where}, but that of dsr is in {_FOLDER}: rename or remove the other one"
    others = set(packages_distributions().get(package, ())) - {DISTRIBUTION}
    if others:
        names = " and ".join(sorted(others))
        return f"{names} also installs a package {package!r}: install it and {DISTRIBUTION} into different environments"
    return None
