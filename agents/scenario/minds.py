"""What must be consistent about the persons of a scenario, and the plans that the robot considers."""

from __future__ import annotations

from pathlib import Path as FilePath

from agents.scenario.inconsistency import InconsistencyError, check_given_name, require
from agents.scenario.model import Scenario
from agents.scenario.naming import taken_names
from agents.scenario.relations import GROUND
from dsr.config.toml_lines import Path
from dsr.errors import ConfigError, GoalError, suggest
from dsr.imagining import parse_step
from dsr.runtime.system import agent_names, find_system
from dsr.vocabulary.goals import parse_goal


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
