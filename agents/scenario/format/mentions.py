"""Checks the names that expectations mention, so that none holds for a typo."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path as FilePath

from agents.scenario.format.events import Event, HandEvent, HandGraspEvent, HandLeave, HandMove, HandRelease
from agents.scenario.format.expectations import (
    Attribute,
    Check,
    Edges,
    Inside,
    KnownIn,
    MissionCheck,
    TrueRelationsCheck,
    WorldsCheck,
)
from agents.scenario.format.inconsistency import InconsistencyError, check_given_name, require
from agents.scenario.format.model import Scenario
from agents.scenario.format.naming import GROUND, node_names, of_own_system, taken_names
from dsr.config.toml_lines import Path
from dsr.errors import ConfigError, GoalError, suggest
from dsr.graph.schema import Schema
from dsr.imagining import parse_step
from dsr.network.keys import BASE
from dsr.runtime.system import agent_names, find_system
from dsr.vocabulary.arms import gripper_of
from dsr.vocabulary.calibration import CONFIRMED, IN_DOUBT, PROVISIONAL, STEADY
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.intentions import ACTIVE, ENDED, FULFILLED, GIVEN_UP, HALT, PLANNED, RUN, RUNNING
from dsr.vocabulary.observed_actions import UNKNOWN

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
    if isinstance(check, Edges | Inside | TrueRelationsCheck):
        _check_pairs(check, path)
    if isinstance(check, Edges | Inside | TrueRelationsCheck | WorldsCheck):
        both = sorted({*check.present} & {*check.absent})
        require(not both, (*path, "absent"), f"{both[0] if both else ''!r} is `present` too; expected one of both")
    if isinstance(check, MissionCheck):
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
    if isinstance(check, WorldsCheck):
        for field, names in (("present", check.present), ("absent", check.absent)):
            for index, name in enumerate(names):
                _require_known("world", name, _worlds(scenario), (*path, field, index))


def _check_pairs(check: Edges | Inside | TrueRelationsCheck, path: Path) -> None:
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


def check_persons(scenario: Scenario, folder: FilePath) -> None:
    """Persons have names of their own, and look somewhere."""
    taken = taken_names(scenario, folder) | {spec.name for spec in scenario.objects}
    for index, person in enumerate(scenario.persons):
        path: Path = ("person", index, "name")
        check_given_name(path, person.name)
        require(person.name not in taken, path, f"the name {person.name!r} is taken; expected a name used once")
        taken.add(person.name)
        message = "expected another place than its `position`"
        require(person.position != person.look_at, ("person", index, "look_at"), message)


def check_plans(scenario: Scenario, folder: FilePath) -> None:
    """Plans can be read, are about things that are there, and somebody considers them."""
    things = {*GROUND, *(spec.name for spec in scenario.objects)}
    names: set[str] = set()
    for index, plan in enumerate(scenario.plans):
        path: Path = ("plan", index)
        check_given_name((*path, "name"), plan.name)
        require(plan.name not in names, (*path, "name"), f"the name {plan.name!r} is taken; expected one used once")
        names.add(plan.name)
        try:
            parse_goal(plan.goal).check_names(things)
        except GoalError as error:
            raise InconsistencyError((*path, "goal"), str(error)) from error
        for number, text in enumerate(plan.steps):
            try:
                step = parse_step(text)
            except ConfigError as error:
                raise InconsistencyError((*path, "steps", number), str(error)) from error
            for name in filter(None, (step.target, step.destination)):
                require(name in things, (*path, "steps", number), f"unknown object {name!r}; {suggest(name, things)}")
    message = (
        f"the system {scenario.system!r} has no agent 'imagination'; expected another `system`, e.g. 'imagination'"
    )
    has_it = not scenario.plans or "imagination" in agent_names(find_system(scenario.system, folder))
    require(has_it, ("system",), message)


_NEEDS_HAND = HandMove | HandRelease | HandLeave
"""Moves of a hand that must be there already; all others with a hand bring it."""


def check_hands(scenario: Scenario) -> None:
    """Check that a hand that moves, opens or leaves has come before, as far as the file tells.

    What starts `when` a condition comes true may do so at any time.
    """
    for hand in _hands(scenario):
        events = [(index, event) for index, event in enumerate(scenario.events) if _hand(event) == hand]
        brought = [event for _, event in events if not isinstance(event, _NEEDS_HAND)]
        may_come = any(event.at is None for event in brought)
        is_there = False
        for index, event in sorted(events, key=lambda entry: _start(entry[1])):
            if isinstance(event, _NEEDS_HAND):
                known = is_there or may_come or (event.at is None and bool(brought))
                name = event.__struct_config__.tag
                message = f"{name}: hand {hand} is not in the scene then; expected hand_enter or hand_grasp before"
                require(known, ("event", index), message)
            if event.at is not None:
                is_there = not isinstance(event, HandLeave)


def check_reach(event: HandGraspEvent, path: Path, scenario: Scenario) -> None:
    """The fingertips are at the object, however it lies; whether a hand could span it is not asked."""
    above, most = event.above or 0.0, 0.5 * max(scenario.object(event.object).size)
    message = f"{above} m from the centre of {event.object!r} there is nothing of it; expected at most {most:g} m"
    require(abs(above) <= most, (*path, "above"), message)


def check_doer(name: str, path: Path, scenario: Scenario) -> None:
    """Check that an expected actor is a hand of some event, or the gripper; systems of one's own may have others."""
    known = {f"human_hand_{hand}" for hand in _hands(scenario)} | {UNKNOWN}
    known |= set(map(gripper_of, scenario.arms))
    require(of_own_system(scenario) or name in known, path, f"nobody is called {name!r} here; {suggest(name, known)}")


def _hands(scenario: Scenario) -> list[int]:
    return sorted({hand for event in scenario.events if (hand := _hand(event)) is not None})


def _hand(event: Event) -> int | None:
    """The hand that an event is of, or that carries it out."""
    return event.hand if isinstance(event, HandEvent) else getattr(event, "hand", None)


def _start(event: Event) -> float:
    """When it starts, s; infinite if a condition decides."""
    return float("inf") if event.at is None else event.at + event.delay
