"""What assistants may ask of a memory: each tool's answer as plain data, without the protocol."""

from __future__ import annotations

from collections.abc import Callable
from datetime import tzinfo
from typing import Any

import msgspec

from dsr.cli.common import plain
from dsr.errors import ConfigError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.imagining import think
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.narration import Moment, Statement, account, person_account, place_of_thing
from dsr.narration.answers import answer
from dsr.narration.calendar import TimeSpan, time_span
from dsr.narration.days import day_account
from dsr.narration.naming import name_of, node_of
from dsr.narration.questions import Query
from dsr.narration.retrospect import where_at
from dsr.runtime.status import StatusBoard
from dsr.spatial import read_scene, read_view
from dsr.timeline import EVENT, SITUATION, SUMMARY, recall, tell
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.intentions import describe_action
from dsr.vocabulary.relations import SURFACES, THINGS, nodes_by_name, read_relations
from dsr.vocabulary.what_if import Question, Supposed, WhatIf

_HISTORY = 600.0
"""s of the past that are told unless asked for otherwise: the ten minutes that a talk is about"""

_MOST_BOXES = 100
"""Boxes of which each is compared with each: that takes about a second"""


class MemoryTools:
    """Answers the tools that only read.

    Args:
        memory: read only.
        now: gives the time (s) of which is told; the memory's own clock by default.
        zone: on whose calendar days are counted; None for that of this machine.
    """

    def __init__(
        self, memory: Memory, now: Callable[[], float] | None = None, zone: tzinfo | None = None
    ) -> None:
        self._memory, self._zone = memory, zone
        self._now = now or memory.clock.now
        self._board = StatusBoard(memory.transport, memory.keys, memory.clock)
        self._what_if = WhatIf(memory.transport, memory.keys, memory.clock)

    @property
    def moment(self) -> Moment:
        """The memory as of now."""
        return Moment(self._memory, self._now(), zone=self._zone)

    def objects(self) -> list[dict[str, Any]]:
        """List things and surfaces with their types, places and how each is known."""
        moment, found = self.moment, []
        for node in nodes_by_name(self._memory, (*THINGS, *SURFACES)):
            pose = self._memory.get_transform(WORLD, node.name, types=BELIEVED)
            row: dict[str, Any] = {"name": node.name, "type": node.type, "size_m": node.get("size")}
            row["position_m"] = None if pose is None else list(pose.t)
            if node.type in THINGS:
                told = place_of_thing(moment, node)
                row |= {"sentence": told.text, "basis": told.basis.value}
            found.append(row)
        return found

    def where_is(self, name: str, seconds_ago: float = 0.0, when: str = "") -> dict[str, Any]:
        """Tell where a thing is, or was so many seconds ago, or at a time such as `last Tuesday`."""
        moment = self.moment
        if not 0.0 <= seconds_ago <= moment.now:
            raise ConfigError(f"seconds_ago {seconds_ago:g}: expected 0 or more, or a time in words as `when`")
        if when or seconds_ago > 0.0:
            said = when or f"{seconds_ago:.3f} s ago"
            query = Query(kind="where", things=(name_of(moment, name.lower()),), when=said)
        else:
            query = Query(kind="where", things=(node_of(moment, name.lower()).name,))
        found: dict[str, Any] = msgspec.to_builtins(where_at(moment, query))
        return found

    def relations(self, name: str = "", viewpoint: str = "") -> list[dict[str, Any]]:
        """List `on`, `in` and `grasping` as believed, and how boxes lie: above, next_to, left_of a `viewpoint`, ..."""
        edges = [edge for kind in ("on", "in", "grasping") for edge in self._memory.edges(kind)]
        found: list[dict[str, Any]] = [
            {"relation": edge.type, "of": edge.src, "to": edge.dst, "source": edge.get("source", "")}
            for edge in sorted(edges, key=lambda edge: (edge.type, edge.src, edge.dst))
        ]
        view = read_view(self._memory, viewpoint) if viewpoint else None
        scene = read_scene(self._memory)
        if name:
            margins = scene.margins(sources=name, view=view) | scene.margins(destinations=name, view=view)
        elif len(scene.boxes) <= _MOST_BOXES:
            margins = scene.margins(view=view)
        else:
            raise ConfigError(f"{len(scene.boxes)} boxes are too many to compare each with each: name one of them")
        found += [
            {"relation": fact.relation, "of": fact.source, "to": fact.destination, "margin_m": margin}
            for fact, margin in margins.items() if margin >= 0.0
        ]  # fmt: skip
        return [row for row in found if not name or name in (row["of"], row["to"])]

    def visible_to(self, viewer: str) -> list[dict[str, Any]]:
        """List which things a person or a camera sees, with the share of each and what hides the rest."""
        node = node_of(self.moment, viewer.lower())
        return [
            {"thing": edge.dst, "visible": edge.get("visible") is True, "share": edge.get("share", 0.0),
             "hidden_by": edge.get("covered_by") or edge.get("hidden_by") or ""}
            for edge in sorted(self._memory.edges("sees", src=node.name), key=lambda edge: edge.dst)
        ]  # fmt: skip

    def believes(self, person: str) -> list[dict[str, Any]]:
        """Tell what a person sees and believes, and where the robot believes otherwise."""
        return _rows(person_account(self.moment, person))

    def timeline(self, seconds: float = _HISTORY, participant: str = "", when: str = "") -> list[dict[str, Any]]:
        """List what happened in the last seconds, or at a time such as `yesterday`; also of days long past."""
        now = self._now()
        if not 0.0 <= seconds <= now:
            raise ConfigError(f"seconds {seconds:g}: expected 0 to {now:.0f}, or a time in words as `when`")
        span = time_span(when, now, self._zone) if when else TimeSpan(now - seconds, now, "")
        entries = recall(self._memory, since=span.begin, until=span.end, participants=participant or None)
        return [
            {"time": event.time, "kind": event.kind, "text": event.text, "of": event.subject}
            for event in tell(entries) if span.begin <= event.time <= span.end
        ]  # fmt: skip

    def tell(self, name: str = "", since: str = "") -> list[dict[str, Any]]:
        """Tell the memory in sentences, all of it or what is about one name; what happened, since a time in words."""
        moment = self.moment
        begin = time_span(since, moment.now, self._zone).begin if since else None
        return _rows(account(moment, since=begin, about=[name] if name else ()))

    def day(self, when: str) -> list[dict[str, Any]]:
        """Tell of a day or another time past: where things were, who moved them, what was surprising."""
        moment = self.moment
        return _rows(day_account(moment, time_span(when, moment.now, self._zone)))

    def ask(self, question: str) -> dict[str, Any]:
        """Answer a question in plain English with evidence."""
        found: dict[str, Any] = msgspec.to_builtins(think(answer(self.moment, question), self._what_if))
        return found

    def why(self, name: str) -> dict[str, Any]:
        """Tell why a thing is believed to be where it is, with what was concluded last."""
        moment = self.moment
        node = node_of(moment, name.lower())
        told = place_of_thing(moment, node)
        return {"place": msgspec.to_builtins(told), "moved": self.ask(f"why did {node.name} move?")}

    def what_if(self, remove: list[str], place: dict[str, list[float]], seconds: float = 1.0) -> dict[str, Any]:
        """Simulate the belief some seconds on with things taken away or put elsewhere."""
        changes = [Supposed.remove(node_of(self.moment, name.lower()).name) for name in remove]
        changes += [_placed(node_of(self.moment, name.lower()).name, numbers) for name, numbers in place.items()]
        found: dict[str, Any] = msgspec.to_builtins(self._what_if.ask_and_wait(Question(seconds, tuple(changes))))
        return found

    def plan(self, goal: str = "") -> dict[str, Any]:
        """Show what is planned now, and of a goal, which relations do not hold yet: nothing is begun by that."""
        planned = [
            {"action": describe_action(node), "status": node.get("status", ""), "why": node.get("explanation", "")}
            for node in sorted(self._memory.nodes("action"), key=lambda node: (node.get("order", 0), node.name))
        ]  # fmt: skip
        found: dict[str, Any] = {"planned": planned}
        if goal:
            wanted = parse_goal(goal)
            wanted.check_names({node.name for node in self._memory.nodes((*THINGS, *SURFACES))})
            found["missing"] = [str(relation) for relation in wanted.missing(read_relations(self._memory))]
        return found

    def agents(self) -> list[dict[str, Any]]:
        """List the agents that were heard, with their states."""
        found = []
        for name in self._board.agents():
            heard = self._board.get(name)
            if heard is not None:
                state = "silent" if self._board.is_silent(name) else str(heard.status.state)
                found.append({"agent": name, "state": state, "rate_hz": heard.status.rate_hz,
                              "last_error": heard.status.last_error})  # fmt: skip
        return found

    def node(self, name: str) -> dict[str, Any]:
        """One node with its attributes and edges. Raises `NodeNotFoundError`."""
        node = self._memory.node(name)
        edges = [*self._memory.edges(src=name), *self._memory.edges(dst=name)]
        return {
            "name": node.name, "type": node.type,
            "attributes": {key: plain(value) for key, value in node.attributes.items()},
            "edges": [
                {"type": edge.type, "from": edge.src, "to": edge.dst,
                 "attributes": {key: plain(value) for key, value in edge.attributes.items()}}
                for edge in sorted(edges, key=lambda edge: edge.key)
            ],
        }  # fmt: skip

    def nodes(self) -> list[dict[str, Any]]:
        """Names and types of all nodes, without those of the timeline."""
        found = [node for node in self._memory.nodes() if node.type not in (EVENT, SITUATION, SUMMARY)]
        return [{"name": node.name, "type": node.type} for node in sorted(found, key=lambda node: node.name)]

    def close(self) -> None:
        """Stop listening to agents."""
        self._board.close()


def _rows(told: list[Statement]) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = [msgspec.to_builtins(statement) for statement in told]
    return rows


def _placed(name: str, numbers: list[float]) -> Supposed:
    if len(numbers) != 3:
        raise ConfigError(f"place {name!r}: expected x, y, z in m, got {len(numbers)} numbers")
    return Supposed.place(name, Pose((numbers[0], numbers[1], numbers[2])))
