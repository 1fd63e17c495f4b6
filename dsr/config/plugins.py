"""Methods and drivers that other packages provide: found by name among the entry points of what is installed."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import entry_points
from typing import Any

from dsr.config.extras import missing_extra
from dsr.errors import ConfigError, suggest

REASONERS = "dsr.reasoners"
"""Group of those who keep the belief: callables of a `BeliefConfig`, which give a `Reasoner` (simulation_handler)."""
EXPLAINERS = "dsr.explainers"
"""Group of methods that explain surprises: callables without arguments, which give a `Policy` (simulation_handler)."""
ACTION_POLICIES = "dsr.action_policies"
"""Group of methods that infer actions: callables of a dict of parameters, which give a `Policy` (action_inference)."""
CALIBRATION_METHODS = "dsr.calibration_methods"
"""Group of methods that find a camera's pose: functions of a problem and a pose to start from (agents/calibrator)."""

EXPORTERS = "dsr.exporters"
"""Group of those who write recordings in formats of others (`dsr record export`)."""
DRIVERS = "dsr.drivers"
"""Group of drivers of cameras: a `CameraEntry` each (agents/drivers.py)."""
RECORDINGS = "dsr.recordings"
"""Group of those who read recordings of others as if they were ours (agents/replay)."""


def provided(group: str) -> list[str]:
    """Names of all that packages provide in a group, sorted."""
    return sorted(entry_points(group=group).names)


def checked_name(group: str, name: str, own: Iterable[str], kind: str = "method") -> str:
    """The name of a method, either one of `own` or provided in `group`. Raises `ConfigError` for an unknown one."""
    own = tuple(own)
    if name not in own and name not in (known := provided(group)):
        raise ConfigError(f"unknown {kind} {name!r}; {suggest(name, [*own, *known])}")
    return name


def load(group: str, name: str, kind: str = "method") -> Any:
    """Import the object that packages provide under `name` in `group`; errors call it a `kind`.

    Raises `ConfigError` if there is none, or it cannot be imported.
    """
    checked_name(group, name, (), kind)
    (entry_point, *_) = entry_points(group=group, name=name)
    try:
        return entry_point.load()
    except (ImportError, AttributeError) as error:
        reason = missing_extra(error) or error
        raise ConfigError(f"{kind} {name!r} ({entry_point.value}) cannot be loaded: {reason}") from error
