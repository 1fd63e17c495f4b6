"""What stands beside a robot's description in a semantic one (SRDF): the roles of its links, and its home posture.

https://wiki.ros.org/srdf. `arm.srdf` beside `arm.urdf`, as MoveIt writes it: `<chain>` of a group names base and tool,
`<end_effector>` the palm, the joints of its group drive the fingers, and `<group_state name="home">` is the posture.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from agents.urdf_elements import attribute, number, parse_urdf, read_urdf

HOME = "home"
"""Name of the state that is the home posture."""


@dataclass(frozen=True)
class Semantics:
    """The roles of links and joints; what is not said is empty."""

    base: str = ""
    tool: str = ""
    palm: str = ""
    fingers: tuple[str, ...] = ()
    home: Mapping[str, float] = field(default_factory=dict)
    """Position (rad or m) of joints at the home posture, by name."""


def semantics_of(urdf: Path) -> Semantics:
    """The semantic description beside `urdf`; empty if there is none. Raises `ConfigError`."""
    file = urdf.with_name(f"{urdf.name.partition('.')[0]}.srdf")
    return parse_urdf(read_urdf(file), str(file), _semantics) if file.is_file() else Semantics()


def _semantics(root: ET.Element) -> Semantics:
    chain, effector = root.find("group/chain"), root.find("end_effector")
    joints: list[str] = []
    if effector is not None:
        group = effector.get("group", "")
        joints = [attribute(joint, "name") for joint in root.findall(f"group[@name='{group}']/joint")]
    states = [state for state in root.findall("group_state") if state.get("name") == HOME]
    return Semantics(
        base="" if chain is None else attribute(chain, "base_link"),
        tool="" if chain is None else attribute(chain, "tip_link"),
        palm="" if effector is None else attribute(effector, "parent_link"),
        fingers=tuple(joints),
        home={
            attribute(joint, "name"): number(joint, "value", 0.0)
            for state in states
            for joint in state.findall("joint")
        },
    )
