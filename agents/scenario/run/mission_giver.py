"""Gives the robot the mission of a scenario without tags, as soon as the things that it is about have been found."""

from __future__ import annotations

from agents.scenario.format.model import MissionSpec
from agents.scenario.judge.found_names import FoundNames
from dsr.memory import Memory
from dsr.vocabulary.goals import Goal, parse_goal
from dsr.vocabulary.intentions import add_intention


class MissionGiver:
    """Asks once. Nobody can know beforehand what the working memory will call things that have no tags.

    Args:
        mission: its goal names the scenario's objects.
        memory: gets the intention, whose goal names the nodes that were found to be these objects.
        names: know which nodes are which objects.
    """

    def __init__(self, mission: MissionSpec, memory: Memory, names: FoundNames) -> None:
        self._mission, self._memory, self._names = mission, memory, names
        self._goal = parse_goal(mission.goal)
        self._asked = False

    def ask(self) -> None:
        """Write the intention if everything has been found now, and that is new."""
        nodes = {thing: self._names.node(thing) for thing in self._goal.things}
        if not self._asked and all(name in self._memory for name in nodes.values()):
            self._asked = True
            relations = (
                relation._replace(arguments=tuple(nodes[thing] for thing in relation.arguments))
                for relation in self._goal.relations
            )
            goal, mission = Goal(tuple(relations)), self._mission
            add_intention(self._memory, str(goal), maintain=mission.maintain, priority=mission.priority)
