"""All attacks by name: what the modules in `benchmarks/attacks/kinds` list under `ATTACKS`."""

from __future__ import annotations

import importlib
import pkgutil

from benchmarks.attacks import kinds
from benchmarks.attacks.attack import Attack


def attacks() -> dict[str, Attack]:
    """Every attack, in the order of the modules' names. Raises `ValueError` for a name that is used twice."""
    found: dict[str, Attack] = {}
    for module in sorted(info.name for info in pkgutil.iter_modules(kinds.__path__)):
        for attack in importlib.import_module(f"{kinds.__name__}.{module}").ATTACKS:
            if attack.name in found:
                raise ValueError(f"two attacks are called {attack.name!r}")
            found[attack.name] = attack
    return found
