"""Names of nodes in a scenario: those that its objects and persons cannot have, and all that there may be."""

from __future__ import annotations

from pathlib import Path as FilePath

from agents.scenario.format.model import Scenario
from dsr.runtime.system import agent_names, find_system
from dsr.timeline import TIMELINE
from dsr.vocabulary.arms import ARM, gripper_of
from dsr.vocabulary.observed_actions import UNKNOWN

HANDS = frozenset(
    f"human_hand_{hand}{part}" for hand in range(2) for part in ("", *(f"_finger_{finger}" for finger in range(5)))
)
"""Nodes of hands and fingertips."""
_ALWAYS = frozenset({"world", "table", "mind", TIMELINE})
_BODY = frozenset({"robot", "body"})
_CAMERAS = frozenset({"camera_overhead", "camera_wrist", "camera_fixed"})


def taken_names(scenario: Scenario, folder: FilePath) -> set[str]:
    """Names that agents give or have themselves, and that of somebody unknown; `folder` is that of the file."""
    agents = agent_names(find_system(scenario.system, folder))
    return {*_ALWAYS, *_BODY, *_CAMERAS, *_arm_parts(scenario), *HANDS, UNKNOWN, *agents}


def node_names(scenario: Scenario) -> set[str]:
    """Nodes that the agents of the systems that come along may write, but for requests and what follows from them."""
    has_arm = scenario.robot.exists
    things = {spec.name for spec in scenario.objects} | {person.name for person in scenario.persons}
    tags = {f"cube_{spec.marker_id}" for spec in scenario.objects if spec.marker_id is not None}
    body = {*_BODY, *_arm_parts(scenario)} if has_arm else set[str]()
    cameras = {"camera_overhead", "camera_wrist"} if has_arm else {"camera_fixed"}
    return {*things, *tags, *_ALWAYS, *HANDS, *body, *cameras, f"camera_{scenario.camera_name}"}


def of_own_system(scenario: Scenario) -> bool:
    """Whether the system is none of those that come along, but a file of its own, with any agents."""
    return scenario.system.endswith(".toml")


def _arm_parts(scenario: Scenario) -> set[str]:
    """Nodes of all arms, of their grippers, and of the links that their joints move; there may be a first arm."""
    arms = {ARM: scenario.robot, **scenario.arms}
    links = {f"{arm}_link_{joint}" for arm, spec in arms.items() for joint, _ in enumerate(spec.start, start=1)}
    return {*arms, *map(gripper_of, arms), *links}


GROUND = ("table",)
"""Names of other supports, as nodes of the working memory; the floor has none."""
