"""The planner: graph -> PDDL -> Fast Downward -> monitored execution.

Each stage takes the value that the stage before it gave:
`state` (what is believed) -> `pddl` (text) -> `solver` (a process) -> `plan` (steps) -> `grounding` (skills of the arm)
-> `execution` (action nodes, one at a time, watched by `monitor`).
"""

from planner.agent import Planner

__all__ = ["Planner"]
