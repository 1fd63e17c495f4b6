"""Checks an agent's class before it runs: that it does something, and declares only what can be."""

from __future__ import annotations

import difflib
import inspect
import math
import sys
from collections.abc import Mapping
from typing import Any

from dsr.agent import Agent
from dsr.errors import ConfigError
from dsr.graph.access import Access

_ALIKE = 0.7
"""Similarity (0 to 1, by difflib) from which a method's name may be a misspelt `tick`: `tik`, `tcik`, `on_tick`."""
_LIFE = {"setup": "setup(self)", "tick": "tick(self, now)", "teardown": "teardown(self)"}
"""The methods that the runtime calls, as they are declared."""


def configured_class(kind: type[Agent], config: Mapping[str, Any]) -> type[Agent]:
    """The agent class `kind` with what `config` changes in its declarations.

    Raises `ConfigError`, with class and file, for a class that would do nothing or whose declarations cannot be.
    """
    configured = kind.configured(config)
    if problem := _problem(configured):
        module = sys.modules.get(configured.__module__)
        raise ConfigError(f"agent class {configured.__name__!r} {problem}", file=getattr(module, "__file__", None))
    return configured


def _problem(kind: type[Agent]) -> str:
    """What is wrong with a class, as the end of a sentence; empty if nothing is."""
    for name, declaration in _LIFE.items():
        if problem := _method_problem(kind, name):
            return f"{problem}; expected: def {declaration}"
    rate = kind.rate_hz
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not (math.isfinite(rate) and rate > 0):
        return f"has rate_hz = {rate!r}: expected a positive number"
    for name in ("reads", "writes"):
        if not isinstance(access := getattr(kind, name), Access):
            return f"has {name} = {access!r:.100}: expected an Access, such as Access(nodes=('cube',))"
    return _idle(kind)


def _method_problem(kind: type[Agent], name: str) -> str:
    method = inspect.getattr_static(kind, name)
    if not callable(getattr(kind, name)):
        return f"has {name} = {method!r:.100}, which is no method"
    function = method.__func__ if isinstance(method, staticmethod | classmethod) else method
    if inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function):
        return f"has an async {name!r}, which nobody awaits"
    if inspect.isgeneratorfunction(function):
        return f"has a generator {name!r} (it contains `yield`), which nobody iterates"
    if inspect.isfunction(method):
        try:
            inspect.signature(method).bind(None, *([0.0] if name == "tick" else []))
        except TypeError as error:
            return f"has {name}{inspect.signature(method)}, which cannot be called so: {error}"
    return ""


def _idle(kind: type[Agent]) -> str:
    """Why the class would do nothing; empty if it ticks, or does all its work in `setup`."""
    if kind.tick is not Agent.tick:
        return ""
    own = [name for name, _ in inspect.getmembers(kind, inspect.isfunction) if not hasattr(Agent, name)]
    meant = [name for name in own if not name.startswith("_") and _takes_now(getattr(kind, name))]
    meant = difflib.get_close_matches("tick", own, n=1, cutoff=_ALIKE) or meant
    if kind.setup is not Agent.setup and not meant:
        return ""
    hint = f"; is its method {meant[0]!r} meant to be 'tick'?" if meant else ""
    empty = "; if 'setup' does all its work, give it a 'tick' with `pass`" if kind.setup is not Agent.setup else ""
    return f"has no method tick(self, now): it would do nothing{hint}{empty}"


def _takes_now(method: Any) -> bool:
    """Whether a method has the parameters of `tick`."""
    return list(inspect.signature(method).parameters)[1:] == ["now"]
