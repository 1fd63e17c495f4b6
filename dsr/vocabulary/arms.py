"""The arms of a graph by name: what belongs to one of several arms is called after its node.

The first arm is called `arm`, and its parts have the names that a graph with one arm has: the gripper `gripper`, the
keys of its device `arm/state` and `arm/command`. The gripper of an arm `left` is `left_gripper`, its keys are
`left/state` and `left/command`, and the node of an emergency stop of this arm alone is `halt_left`.
"""

from __future__ import annotations

from dsr.graph.elements import Node
from dsr.graph.shares import shared_out
from dsr.memory import Memory
from dsr.vocabulary.relations import nodes_by_name

ARM = "arm"
"""Name of the first arm, and of the only one."""
CONTROLLER = "arm_controller"
"""Name of the agent that moves an arm whose node does not tell another one."""


MOST_ARMS = 64
"""Arms of one graph that are looked at, more than a fleet of 50 robots has: who may make their nodes could make any
number."""


def gripper_of(arm: str) -> str:
    """Name of the node of an arm's gripper, unless its controller is told another one."""
    return "gripper" if arm == ARM else f"{arm}_gripper"


def arm_nodes(memory: Memory) -> list[Node]:
    """The arms of a graph: the first one, then the others in the order of their names.

    Of more than `MOST_ARMS` they are as many of each agent's.
    """
    return shared_out(_all_arms(memory), MOST_ARMS)


def arms_beyond(memory: Memory) -> list[str]:
    """Names of the arms that nobody looks at, since there are too many."""
    every = _all_arms(memory)
    if len(every) <= MOST_ARMS:
        return []
    looked_at = {node.name for node in shared_out(every, MOST_ARMS)}
    return [node.name for node in every if node.name not in looked_at]


def _all_arms(memory: Memory) -> list[Node]:
    return sorted(nodes_by_name(memory, "arm"), key=lambda node: node.name != ARM)


def first_arm(memory: Memory) -> str:
    """Name of the arm that is meant where none is named."""
    return next((node.name for node in arm_nodes(memory)), ARM)


def arm_of_action(memory: Memory, action: Node) -> str:
    """Name of the arm that is to carry out an action."""
    named: str = action.get("arm", "")
    return named or first_arm(memory)


def controller_of(arm: Node) -> str:
    """Name of the agent that moves an arm."""
    told: str = arm.get("controller", "")
    return told or CONTROLLER


def gripper_node_of(arm: Node) -> str:
    """Name of the node of the arm's gripper."""
    told: str = arm.get("gripper", "")
    return told or gripper_of(arm.name)
