"""An arm as its description (URDF) has it: which links are base, palm and tool, and which joints move the fingers.

What is not named is found: by an SRDF file beside the description, or by the joints. The base is the root, the palm
is where the joints branch into fingers, and the tool is a link that bears one of the usual names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.arm_controller.model.gripper import GripperModel
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.srdf import semantics_of
from agents.arm_controller.model.urdf import Robot, fixed_pose, load_robot
from agents.xacro_file import Value
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose

TOOL = "dsr_tool"
"""Link that is added where the tool point is not at a link of the description."""
_PALMS = ("end_effector_link", "flange", "tool0")
_TOOLS = ("tool_link", "tcp", "tcp_link", "hand_tcp", "tool0")
"""Names of links that are sought, the first first; also behind a prefix and `_`."""


@dataclass(frozen=True)
class ArmModel:
    """A robot with the roles of its links."""

    robot: Robot
    base: str
    """Link from which the arm hangs."""
    palm: str
    """Link that carries the fingers."""
    tool: str
    """Link at the tool point: between the fingers, z out of the gripper, x from finger to finger."""
    chain: JointChain
    """From base to tool."""
    gripper: GripperModel
    home: tuple[float, ...] = ()
    """Positions (rad or m) of the chain's joints at its home posture; empty if nobody says."""

    @property
    def palm_from_tool(self) -> Pose:
        """Where the tool point is."""
        return fixed_pose(self.robot.between(self.palm, self.tool))


def load_arm(
    file: Path, *, args: Mapping[str, Value] | None = None, tool_mount: Pose | None = None, **names: Any
) -> ArmModel:
    """The arm in a URDF file, with what the SRDF file beside it says.

    Args:
        file: the description.
        args: arguments of its macros, by name.
        tool_mount: as of `arm_model`.
        names: `base`, `palm`, `tool` and `fingers` as of `arm_model`; they precede those of the SRDF file.

    Raises:
        ConfigError: for files that cannot be read, and whatever `arm_model` refuses.
    """
    said = semantics_of(file)
    given = {key: value for key, value in names.items() if value}
    robot = load_robot(file, args)
    roles = {"base": said.base, "palm": said.palm, "tool": said.tool, "fingers": said.fingers, **given}
    return arm_model(robot, tool_mount=tool_mount, home=said.home, **roles)


def arm_model(
    robot: Robot,
    *,
    base: str = "",
    palm: str = "",
    tool: str = "",
    tool_mount: Pose | None = None,
    fingers: Sequence[str] = (),
    home: Mapping[str, float] | None = None,
) -> ArmModel:
    """The arm of a robot. What is empty is found.

    Args:
        robot: its description.
        base: link from which the arm hangs.
        palm: link that carries the fingers.
        tool: link of the tool point.
        tool_mount: where the tool point is in the frame of link `tool`; at its origin if None.
        fingers: names of the joints that are driven.
        home: position (rad or m) of each joint of the arm at its home posture; none if empty.

    Raises:
        ConfigError: for links and joints that there are not, and where nothing is found.
    """
    base = base or robot.root
    palm = palm or _find_palm(robot, base)
    tool = tool or _find_tool(robot, palm)
    if tool_mount is not None:
        robot, tool = robot.with_frame(TOOL, tool, tool_mount), TOOL
    between = robot.between(palm, tool)
    if moving := [joint.name for joint in between if joint.moves]:
        raise ConfigError(f"robot {robot.name!r}: joint {moving[0]!r} moves tool {tool!r} against {palm!r}")
    chain = JointChain(robot.between(base, tool))
    if not len(chain):
        raise ConfigError(f"robot {robot.name!r}: no joint moves {tool!r} against {base!r}")
    gripper = GripperModel(robot, palm, fixed_pose(between), fingers)
    return ArmModel(robot, base, palm, tool, chain, gripper, _posture(robot, chain, home or {}))


def _posture(robot: Robot, chain: JointChain, home: Mapping[str, float]) -> tuple[float, ...]:
    if not home:
        return ()
    if missing := [name for name in chain.names if name not in home]:
        raise ConfigError(f"robot {robot.name!r}: its home posture does not say where joint {missing[0]!r} is")
    return tuple(home[name] for name in chain.names)


def _find_palm(robot: Robot, base: str) -> str:
    """The link at which the joints branch; without branches that at the end of the last joint, or a flange there."""
    link = base
    while True:
        fixed = [other for other, _ in robot.fixed_to(link)]
        leaving = [joint for joint in robot.joints if joint.moves and joint.parent in fixed]
        if len(leaving) == 1:
            link = leaving[0].child
            continue
        parents = {joint.parent for joint in leaving}
        if len(parents) == 1:
            return parents.pop()
        return (None if leaving else _named(_PALMS, fixed)) or link


def _find_tool(robot: Robot, palm: str) -> str:
    """A link with a usual name that is fixed to the palm, or the palm."""
    return _named(_TOOLS, [other for other, _ in robot.fixed_to(palm)]) or palm


def _named(names: Sequence[str], links: Sequence[str]) -> str | None:
    """The first link that is called like one of `names`."""
    return next((link for name in names for link in links if link == name or link.endswith(f"_{name}")), None)
