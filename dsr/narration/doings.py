"""Tells what the robot and hands hold, what each person sees, what the robot wants, and why it waits."""

from __future__ import annotations

from collections.abc import Iterator

from dsr.errors import GoalError
from dsr.graph.elements import Edge, Node
from dsr.narration.places import GRIPPER, relation_evidence
from dsr.narration.statements import Basis, Moment, StatedClaim, Statement, Subject, ago, is_seen
from dsr.visibility import PERSON
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.halting import HALT_NODE, order_of
from dsr.vocabulary.handling import HOLDING, Handling
from dsr.vocabulary.intentions import ACTIVE, EXECUTING, FULFILLED, GIVEN_UP, PLANNING, WAITING, WANTED, nobody_pursues
from dsr.vocabulary.relations import Relation, nodes_by_name
from dsr.vocabulary.sentences import RELATION_WORDS, TOUCHING, RelationWords, listed

_RELATIONS = {
    "on": "{0} on {1}",
    "ontable": "{0} on a table",
    "clear": "nothing on {0}",
    "holding": "{0} in the gripper",
    "handempty": "the gripper empty",
}
"""Relations of goals as what is wanted."""


def holding_statements(moment: Moment) -> list[Statement]:
    """One statement for each hand or gripper that holds or touches something, and for each gripper that is empty."""
    edges = sorted(moment.memory.edges("grasping"), key=lambda edge: (edge.src, edge.dst))
    holders = {edge.src for edge in edges}
    empty = [node.name for node in nodes_by_name(moment.memory, "gripper") if node.name not in holders]
    return [*(_holding(moment, edge) for edge in edges), *map(_empty, empty)]


def grip_words(moment: Moment, edge: Edge) -> RelationWords:
    """The words of an edge `grasping`: a hand only touches what it has hold of on one side while that rests on more."""
    is_touch = edge.get("handling", Handling.PINCHING) not in HOLDING and bool(moment.memory.edges("on", src=edge.dst))
    return TOUCHING if is_touch else RELATION_WORDS["grasping"]


def sight_statements(moment: Moment) -> list[Statement]:
    """One statement for each person: whether the person is there, and which things the person is believed to see."""
    return [sight_of(moment, person) for person in nodes_by_name(moment.memory, PERSON)]


def sight_of(moment: Moment, person: Node) -> Statement:
    """Tell whether a person is there, and what that person is believed to see."""
    now = moment.now
    edges = sorted(moment.memory.edges("sees", src=person.name), key=lambda edge: edge.dst)
    seen = [edge.dst for edge in edges if edge.get("visible") is True]
    if is_seen(person, now):
        text, basis = f"{person.name} is believed to see {listed(seen) or 'none of the things'}.", Basis.BELIEVED
    else:
        last = f", last seen {ago(now - person['last_seen'])}" if "last_seen" in person else ""
        text, basis, seen = f"{person.name} is not there{last}.", Basis.PERCEIVED, []
    return Statement(
        text=text, subject=Subject.SIGHT, basis=basis, names=(person.name, *seen),
        claims=tuple(StatedClaim("sees", (person.name, thing)) for thing in seen),
        evidence={"seen": {edge.dst: edge.get("share", 0.0) for edge in edges}},
    )  # fmt: skip


def wish_statements(moment: Moment) -> list[Statement]:
    """For each intention, what is wanted and how far it is; why it waits, fails or is forbidden."""
    found = list(_forbidden(moment))
    intentions = nodes_by_name(moment.memory, "intention")
    for node in intentions:
        found += [_own(_wanted(node), node), _own(_progress(node), node)]
    is_active = any(node.get("status", WANTED) in ACTIVE for node in intentions)
    if is_active and moment.memory.peers and (nobody := nobody_pursues(moment.memory)):  # a recording has no peers
        found.append(Statement(text=f"Nothing will come of that: {nobody}.", subject=Subject.WANTED, basis=Basis.OWN))
    return found


def goal_words(goal: str) -> str:
    """A goal in words: `cube_3 on cube_4 and cube_6 on cube_5`; as it is written, if it is none."""
    try:
        return listed([_relation_words(relation) for relation in parse_goal(goal).relations])
    except GoalError:
        return goal


def _relation_words(relation: Relation) -> str:
    return _RELATIONS[relation.name].format(*relation.arguments)


def _holding(moment: Moment, edge: Edge) -> Statement:
    words = grip_words(moment, edge)
    is_sure = edge.get("source") == GRIPPER  # what hands hold is worked out from their places: no sensor feels it
    verb = words.holds if is_sure else f"is believed to {words.hold}"
    relation = "touching" if words is TOUCHING else edge.type
    return Statement(
        text=f"{edge.src} {verb} {edge.dst}.", subject=Subject.HOLDING,
        basis=Basis.PERCEIVED if is_sure else Basis.BELIEVED,
        names=(edge.src, edge.dst), claims=(StatedClaim(relation, (edge.src, edge.dst)),),
        evidence=relation_evidence(edge),
    )  # fmt: skip


def _empty(gripper: str) -> Statement:
    return Statement(
        text=f"{gripper} holds nothing.", subject=Subject.HOLDING, basis=Basis.PERCEIVED, names=(gripper,),
        claims=(StatedClaim("empty", (gripper,)),),
    )  # fmt: skip


def _wanted(node: Node) -> str:
    kept = ", and wants it to stay so" if node.get("maintain", False) else ""
    return f"The robot wants {goal_words(str(node.get('goal', '')))}{kept}."


def _progress(node: Node) -> str:
    """How far an intention is, as a sentence."""
    status, why = node.get("status", WANTED), node.get("explanation", "")
    because = f": {why}" if why else ""
    replans = node.get("replans", 0)
    again = f" It has planned again {'once' if replans == 1 else f'{replans} times'}." if replans else ""
    if status == WAITING:
        return f"The robot waits with that{because}.{again}"
    if status == EXECUTING:
        return f"The robot acts for that{because}.{again}"
    if status == PLANNING:
        return f"The robot makes a plan for that.{again}"
    if status in FULFILLED:
        return f"The robot believes that this goal is reached.{again}"
    if status in GIVEN_UP:
        return f"The robot has given this goal up ({status}){because}.{again}"
    return f"The robot has not begun with that ({status}){because}.{again}"


def _own(text: str, node: Node) -> Statement:
    evidence = {"intention": node.name, "goal": node.get("goal", ""), "status": node.get("status", WANTED)}
    return Statement(text=text, subject=Subject.WANTED, basis=Basis.OWN, names=_things(node), evidence=evidence)


def _things(node: Node) -> tuple[str, ...]:
    """An intention and the things of its goal."""
    try:
        return node.name, *parse_goal(str(node.get("goal", ""))).things
    except GoalError:
        return (node.name,)


def _forbidden(moment: Moment) -> Iterator[Statement]:
    order = order_of(moment.memory.get_node(HALT_NODE))
    if order is not None and order.halted:
        text = f"Motion is forbidden: {order.reason}."
        evidence = {"order": order.id, "since": order.stamp}
        yield Statement(
            text=text, subject=Subject.FORBIDDEN, basis=Basis.OWN, names=(HALT_NODE,), evidence=evidence
        )  # fmt: skip
