"""The counter, in lockstep: no processes, no waiting."""

from my_robot.counter import Counter

from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec


def test_boxes_in_view_are_counted() -> None:
    with Lockstep([AgentSpec("counter", Counter)], strict=True) as system:
        memory = system.memory
        memory.add_node("table", "table")
        memory.add_node("box_1", "box", perceived=True, size=(0.1, 0.1, 0.1))
        memory.add_node("box_2", "box", perceived=False, size=(0.1, 0.1, 0.1))
        system.run_for(1.0)
        assert memory.node("table")["seen"] == 1
