"""What must be consistent about the hands of a scenario: there when they move or are named, and at what they take."""

from __future__ import annotations

from agents.scenario.events import Event, HandEvent, HandGrasp, HandLeave, HandMove, HandRelease
from agents.scenario.inconsistency import require
from agents.scenario.model import Scenario
from agents.scenario.naming import of_own_system
from dsr.config.toml_lines import Path
from dsr.errors import suggest
from dsr.vocabulary.observed_actions import UNKNOWN

_NEEDS_HAND = HandMove | HandRelease | HandLeave
"""Moves of a hand that must be there already; all others with a hand bring it."""


def check_hands(scenario: Scenario) -> None:
    """A hand that moves, opens or leaves has come before, as far as the file tells.

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


def check_reach(event: HandGrasp, path: Path, scenario: Scenario) -> None:
    """The fingertips are at the object, however it lies; whether a hand could span it is not asked."""
    above, most = event.above or 0.0, 0.5 * max(scenario.object(event.object).size)
    message = f"{above} m from the centre of {event.object!r} there is nothing of it; expected at most {most:g} m"
    require(abs(above) <= most, (*path, "above"), message)


def check_doer(name: str, path: Path, scenario: Scenario) -> None:
    """Who shall have done something is a hand of some event, or the gripper; systems of one's own may have others."""
    known = {f"human_hand_{hand}" for hand in _hands(scenario)} | {UNKNOWN}
    known |= {"gripper"} if scenario.robot.exists else set()
    require(of_own_system(scenario) or name in known, path, f"nobody is called {name!r} here; {suggest(name, known)}")


def _hands(scenario: Scenario) -> list[int]:
    return sorted({hand for event in scenario.events if (hand := _hand(event)) is not None})


def _hand(event: Event) -> int | None:
    """The hand that an event is of, or that carries it out."""
    return event.hand if isinstance(event, HandEvent) else getattr(event, "hand", None)


def _start(event: Event) -> float:
    """When it starts, s; infinite if a condition decides."""
    return float("inf") if event.at is None else event.at + event.delay
