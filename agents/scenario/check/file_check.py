"""Finds faults and doubts in a scenario file, for `dsr scenario check`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path as FilePath

import msgspec
from rich.console import Console
from rich.markup import escape

from agents.scenario.check.faults import Fault, doubts, faults
from agents.scenario.format.expectations import ActionsCheck, MissionCheck, OfObjects, TrueRelationsCheck
from agents.scenario.format.explain import value_error
from agents.scenario.format.model import Scenario
from agents.scenario.format.naming import of_own_system
from agents.scenario.run.runner import true_course
from agents.scenario.run.staging import Run, make_run, staged_system
from dsr.config.extras import MissingExtraError
from dsr.config.toml_lines import Path
from dsr.errors import ConfigError
from dsr.runtime.system import agent_names, find_system, load_system
from dsr.vocabulary.contradictions import by_meaning
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.intentions import GIVEN_UP

_MINDS = "perspectives"
"""The agent that keeps what persons believe."""


class Findings(msgspec.Struct, frozen=True):
    """The findings of a check, each with file and line."""

    errors: list[ConfigError] = []
    """Contents that cannot be meant."""
    doubts: list[ConfigError] = []
    """Contents that may be meant, but seldom are."""


def look_through(name_or_path: str, *, play: bool = True, beside: bool = True) -> Findings:
    """Check a scenario, and the system that plays it, for faults and doubts.

    Args:
        name_or_path: a built-in scenario or a file.
        play: also play its true course with seed 0.
        beside: modules beside the file of the system may be imported.

    Raises:
        ConfigError: if the file is wrong or cannot be played.
    """
    run = make_run(name_or_path, beside=beside)
    text = run.file.read_text(encoding="utf-8")
    history = true_course(run) if play else None

    def told(found: list[Fault]) -> list[ConfigError]:
        return [value_error(fault.text, fault.path, text, str(name_or_path)) for fault in found]

    unequipped = _checked_system(run)
    unplayed = list(_unplayed_doubts(run.scenario, run.file.parent))
    if history is None:
        return Findings(doubts=[*unequipped, *told(unplayed)])
    return Findings(told(faults(history)), [*unequipped, *told([*unplayed, *doubts(history)])])


def _checked_system(run: Run) -> list[ConfigError]:
    """Load and configure every agent of the system. Returns what needs libraries that are not installed here.

    Raises:
        ConfigError: for a class that does not exist, or a configuration that its agent refuses.
    """
    try:
        staged_system(run)
    except ConfigError as error:
        if isinstance(error.__cause__, MissingExtraError):
            return [error]
        raise
    return []


def show_all(name_or_path: str, console: Console) -> None:
    """Show all that is wrong or doubtful in a scenario that is run nevertheless. Raises `ConfigError`."""
    found = look_through(name_or_path)
    show_doubts([*found.errors, *found.doubts], console)


def show_doubts(found: Iterable[ConfigError], console: Console) -> None:
    """Show what may be meant, a line each."""
    for doubt in found:
        console.print(f"[yellow]![/] {escape(str(doubt))}", soft_wrap=True)


def _unplayed_doubts(scenario: Scenario, folder: FilePath) -> Iterator[Fault]:
    """What reading alone shows."""
    if not scenario.expectations:
        yield Fault((), "there is no [[expect]]: nothing is judged")
    yield from _goals_that_never_hold(scenario)
    needed = _to_be_recognised(scenario)
    finds_blocks = _finds_blocks(scenario, folder)
    for index, spec in enumerate(scenario.objects):
        if (
            spec.name in needed
            and spec.marker_id is None
            and not spec.by_color
            and not (spec.by_depth and finds_blocks)
        ):
            text = f"{spec.name!r} is never recognised: it has no `marker_id`, and is not `known` with a `color`"
            yield Fault(("object", index), text)
    if scenario.persons and not of_own_system(scenario):
        agents = agent_names(find_system(scenario.system, folder))
        if _MINDS not in agents:
            text = f"nobody keeps what persons believe: the system {scenario.system!r} has no agent {_MINDS!r}"
            yield Fault(("person", 0), f"{text}; 'people' has one")


def _finds_blocks(scenario: Scenario, folder: FilePath) -> bool:
    """Whether an agent of the system finds objects by depth."""
    system = load_system(find_system(scenario.system, folder))
    return any(spec.config.get("blocks") is True for spec in system.agents)


def _goals_that_never_hold(scenario: Scenario) -> Iterator[Fault]:
    """Unless the scenario expects that no plan is found."""
    wanted: list[tuple[Path, str]] = [(("plan", index, "goal"), plan.goal) for index, plan in enumerate(scenario.plans)]
    expected = {check.status for check in scenario.expectations if isinstance(check, MissionCheck)}
    if scenario.mission is not None and expected.isdisjoint(GIVEN_UP):
        wanted.append((("mission", "goal"), scenario.mission.goal))
    for path, goal in wanted:
        if conflict := by_meaning(parse_goal(goal)):
            yield Fault(path, f"the goal never holds: {conflict}")


def _to_be_recognised(scenario: Scenario) -> set[str]:
    """Names of the objects that the mission is about, or whose belief is judged."""
    names = set(parse_goal(scenario.mission.goal).things) if scenario.mission is not None else set()
    for check in scenario.expectations:
        if isinstance(check, OfObjects) and check.objects is None and not isinstance(check, ActionsCheck):
            names |= {spec.name for spec in scenario.objects}
        if not isinstance(check, TrueRelationsCheck):
            names |= {*check.named_objects}
    return names
