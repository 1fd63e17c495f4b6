"""What must be consistent about the names that expectations mention, so that none holds for a typo."""

from __future__ import annotations

import re
from collections.abc import Iterable

from agents.scenario.expectations import Attribute, Check, Edges, Inside, KnownIn, Mission, TrueRelations, Worlds
from agents.scenario.inconsistency import require
from agents.scenario.model import Scenario
from agents.scenario.naming import node_names, of_own_system
from dsr.config.toml_lines import Path
from dsr.errors import suggest
from dsr.graph.schema import Schema
from dsr.network.keys import BASE
from dsr.vocabulary.calibration import CONFIRMED, IN_DOUBT, PROVISIONAL, STEADY
from dsr.vocabulary.intentions import ACTIVE, ENDED, FULFILLED, GIVEN_UP, HALT, PLANNED, RUN, RUNNING

_SCHEMA = Schema()
_INTENDED = re.compile(r"intention_\d+|action_\d+_\d+")
"""Nodes of intentions and of the steps of their plans."""
MISSION_STATUSES = (*ACTIVE, *FULFILLED, *GIVEN_UP)
"""Words that an intention's `status` may be."""
ACTION_STATUSES = (PLANNED, RUNNING, *ENDED)
"""Words that an action's `status` may be."""
_WORDS = {"mount": (STEADY, IN_DOUBT, PROVISIONAL, CONFIRMED), "request": (RUN, HALT)}
"""All that these attributes may be, on any node."""
_KINDS: dict[str, type | tuple[type, ...]] = {"bool": bool, "int": (int, float), "float": (int, float), "str": str}
"""What the file may say of an attribute of that kind; others cannot be written there."""


def check_mentions(check: Check, path: Path, scenario: Scenario) -> None:
    """The working memory may hold what an expectation is about.

    Agents of a system of one's own may have other nodes, attributes and worlds.
    """
    if isinstance(check, Edges):
        _require_known("edge type", check.type, _SCHEMA.edge_types, (*path, "type"))
    if isinstance(check, Edges | Inside | TrueRelations):
        _check_pairs(check, path)
    if isinstance(check, Edges | Inside | TrueRelations | Worlds):
        both = sorted({*check.present} & {*check.absent})
        require(not both, (*path, "absent"), f"{both[0] if both else ''!r} is `present` too; expected one of both")
    if isinstance(check, Mission):
        _require_known("status", check.status, MISSION_STATUSES, (*path, "status"))
    if of_own_system(scenario):
        return
    if isinstance(check, Edges):
        _check_ends(check, path, scenario)
    if isinstance(check, Attribute):
        _check_node(check.node, (*path, "node"), scenario)
        _require_known("attribute", check.name, _SCHEMA.attributes, (*path, "name"))
        _check_value(check, (*path, "value"))
    if isinstance(check, Edges | KnownIn):
        _require_known("world", check.world, {BASE, *_worlds(scenario)}, (*path, "world"))
    if isinstance(check, Worlds):
        for field, names in (("present", check.present), ("absent", check.absent)):
            for index, name in enumerate(names):
                _require_known("world", name, _worlds(scenario), (*path, field, index))


def _check_pairs(check: Edges | Inside | TrueRelations, path: Path) -> None:
    for field, pairs in (("present", check.present), ("absent", check.absent)):
        for index, (source, destination) in enumerate(pairs):
            message = f"[{source!r}, {destination!r}]: expected two different things"
            require(source != destination, (*path, field, index), message)


def _check_ends(check: Edges, path: Path, scenario: Scenario) -> None:
    for field, pairs in (("present", check.present), ("absent", check.absent)):
        for index, pair in enumerate(pairs):
            for name in pair:
                _check_node(name, (*path, field, index), scenario)


def _check_node(name: str, path: Path, scenario: Scenario) -> None:
    if not _INTENDED.fullmatch(name):
        _require_known("node", name, node_names(scenario), path)


def _check_value(check: Attribute, path: Path) -> None:
    """The attribute can have that value: it is of its kind, and one of its words if those are known."""
    kind = _SCHEMA.attributes[check.name].kind
    message = f"the attribute {check.name!r} is a {kind}, which no check can compare; expected another one"
    require(kind in _KINDS, (*path[:-1], "name"), message)
    fits = isinstance(check.value, _KINDS[kind]) and (kind == "bool") == isinstance(check.value, bool)
    require(fits, path, f"the attribute {check.name!r} is a {kind}; expected a value of that kind, got {check.value!r}")
    words = _WORDS.get(check.name, ())
    if check.name == "status" and _INTENDED.fullmatch(check.node):
        words = MISSION_STATUSES if check.node.startswith("intention") else ACTION_STATUSES
    if words:
        _require_known(check.name, str(check.value), words, path)


def _worlds(scenario: Scenario) -> set[str]:
    """The worlds beside the base that agents make: of each plan, and of what each person knows."""
    plans = {f"plan_{plan.name}" for plan in scenario.plans}
    return plans | {f"view_of_{person.name}" for person in scenario.persons}


def _require_known(what: str, name: str, known: Iterable[str], path: Path) -> None:
    require(name in {*known}, path, f"unknown {what} {name!r}; {suggest(name, known)}")
