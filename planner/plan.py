"""Plans: steps as the solver wrote them, and their effects on the relations."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

from dsr.vocabulary.relations import Relation, Relations
from planner.errors import SolverFailed
from planner.pddl import Names

_LINE = re.compile(r"\(([^()]+)\)")
_ARGUMENTS = {"pick": 1, "stack": 2, "putdown": 1}
_ANY_GRIPPER = "gripper"


class PlanStep(NamedTuple):
    """One action of the domain."""

    name: str
    """pick, stack or putdown"""
    thing: str
    support: str = ""
    """Name of the object that the thing is put on; empty for pick."""

    def __str__(self) -> str:
        return f"{self.name} {self.thing}{f' on {self.support}' if self.support else ''}"

    @property
    def starts_from(self) -> tuple[Relation, ...]:
        """Relations that must hold before the step."""
        if self.name == "pick":
            return Relation("handempty", ()), Relation("clear", (self.thing,))
        held = (Relation("holding", (self.thing,)),)
        return (*held, Relation("clear", (self.support,))) if self.name == "stack" else held

    @property
    def effect(self) -> Relation:
        """Relation that holds after the step."""
        return Relation("holding", (self.thing,)) if self.name == "pick" else Relation("on", (self.thing, self.support))

    def may_change(self, fact: Relation) -> bool:
        """Whether a fact (`on` or `holding`) may begin or end while this step is carried out."""
        if fact.arguments[0] != self.thing:
            return False
        return fact.name == "holding" or self.name == "pick" or fact == self.effect

    def possible(self, relations: Relations) -> bool:
        """Whether the step can begin."""
        return all(relations.holds(relation) for relation in self.starts_from)

    def after(self, relations: Relations) -> Relations:
        """Relations after the step, if `relations` held before."""
        others = frozenset(pair for pair in relations.on if pair[0] != self.thing)
        if self.name == "pick":
            return replace(relations, on=others, grasping=frozenset({(_ANY_GRIPPER, self.thing)}))
        on = others | {(self.thing, self.support)}
        return replace(relations, on=on, grasping=frozenset())


def read_plan(text: str, names: Names, table: str) -> tuple[PlanStep, ...]:
    """The steps in a plan file of the solver. Raises `SolverFailed` for anything else."""
    steps = []
    for written in text.splitlines():
        line = written.partition(";")[0].strip()
        if not line:
            continue
        found = _LINE.fullmatch(line)
        name, *arguments = found[1].split() if found else [""]
        if len(arguments) != _ARGUMENTS.get(name, -1):
            raise SolverFailed(f"the solver wrote {line!r}, which is no step of a plan")
        try:
            things = [names.node(argument) for argument in arguments]
        except KeyError as error:
            raise SolverFailed(f"the solver wrote {line!r}, and there is no {error}") from None
        steps.append(PlanStep(name, *things, *([table] if name == "putdown" else [])))
    return tuple(steps)


def leads_to(steps: tuple[PlanStep, ...], relations: Relations) -> Relations:
    """Apply all steps one after the other, and return the relations then.

    Raises `SolverFailed` if a step is not possible.
    """
    for number, step in enumerate(steps, 1):
        if not step.possible(relations):
            raise SolverFailed(f"step {number} of the plan, {step}, is not possible then")
        relations = step.after(relations)
    return relations
