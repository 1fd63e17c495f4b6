"""Names of nodes in a scenario that its objects and persons cannot have."""

from __future__ import annotations

from pathlib import Path as FilePath

from agents.scenario.model import Scenario
from dsr.observed_actions import UNKNOWN
from dsr.runtime.system import agent_names, find_system
from dsr.timeline import TIMELINE

HANDS = frozenset(
    f"human_hand_{hand}{part}" for hand in range(2) for part in ("", *(f"_finger_{finger}" for finger in range(5)))
)
"""Nodes of hands and fingertips."""
_ALWAYS = frozenset({"world", "table", "mind", TIMELINE})
_BODY = frozenset({"robot", "arm", "gripper", "body"})
_CAMERAS = frozenset({"camera_overhead", "camera_wrist", "camera_fixed"})


def taken_names(scenario: Scenario, folder: FilePath) -> set[str]:
    """Names that agents give or have themselves, and that of somebody unknown; `folder` is that of the file."""
    agents = agent_names(find_system(scenario.system, folder))
    return {*_ALWAYS, *_BODY, *_CAMERAS, *_arm_links(scenario), *HANDS, UNKNOWN, *agents}


def _arm_links(scenario: Scenario) -> set[str]:
    """Nodes of the links that joints of the arm move."""
    return {f"arm_link_{joint}" for joint, _ in enumerate(scenario.robot.start, start=1)}
