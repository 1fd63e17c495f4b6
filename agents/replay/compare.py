"""Two runs of the same recording, compared as they go: poses, relations, surprises, explanations."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from dsr.cli.common import add_names, add_numbers, shown
from dsr.graph.watch import Watch
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.timeline import OBJECTS, RELATIONS, Event, Timeline

EdgeId = tuple[str, str, str]
"""(type, source, destination)"""
_COMPARED = ("explained", "surprised", "calmed", "began", "ended", "appeared", "gone")
"""Kinds of events that are put side by side."""


class Stretch(msgspec.Struct):
    """The duration of a state."""

    total_s: float = 0.0
    longest_s: float = 0.0
    """Longest time (s) without a break."""
    lasting_s: float = 0.0
    """Time (s) that it has lasted until now without a break; 0 if it has ended."""

    def note(self, holds: bool, passed: float) -> None:
        """Note whether the difference held during the last `passed` s."""
        self.lasting_s = self.lasting_s + passed if holds else 0.0
        self.total_s += passed * holds
        self.longest_s = max(self.longest_s, self.lasting_s)


class PoseDifference(msgspec.Struct):
    """The difference of a geometric edge between the two runs."""

    edge: str
    """`type source destination`"""
    max_m: float = 0.0
    max_rad: float = 0.0
    mean_m: float = 0.0
    max_at_s: float = 0.0
    """Time of the greatest difference, s since the recording's first message."""
    both_s: float = 0.0
    """Time (s) during which both runs had the edge."""
    beyond: Stretch = msgspec.field(default_factory=Stretch)
    """Time during which the poses differed by more than the tolerance."""
    only_recorded: Stretch = msgspec.field(default_factory=Stretch)
    only_anew: Stretch = msgspec.field(default_factory=Stretch)


class Disagreement(msgspec.Struct):
    """The duration of something that held in one run only."""

    what: str
    only_recorded: Stretch = msgspec.field(default_factory=Stretch)
    only_anew: Stretch = msgspec.field(default_factory=Stretch)


class ReplayOutcome(msgspec.Struct, kw_only=True):
    """The result of a comparison."""

    agents: list[str]
    seconds: float
    """Time (s) over which the runs were compared."""
    poses: list[PoseDifference]
    relations: list[Disagreement]
    """`source type destination`"""
    surprising: list[Disagreement]
    recorded_events: list[Event]
    """Times are seconds since the recording's first message."""
    anew_events: list[Event]
    notes: list[str] = []
    failures: list[str] = []
    """Agents whose ticks failed, and why."""

    def differences(self, grace: float) -> list[str]:
        """List differences that last longer than `grace` (s) without a break, and explanations that differ; one line
        each.
        """
        found = list(self.failures)
        for pose in self.poses:
            if pose.beyond.longest_s > grace:
                most = f"{pose.max_m * 1e3:.2f} mm at {pose.max_at_s:.2f} s, {pose.max_rad:.3f} rad"
                found.append(f"{pose.edge}: apart for {pose.beyond.longest_s:.2f} s, by up to {most}")
            found += _lasting(pose.edge, pose, grace)
        for held in self.relations:
            found += _lasting(held.what, held, grace)
        for held in self.surprising:
            found += _lasting(f"{held.what} surprising", held, grace)
        recorded, anew = _explanations(self.recorded_events), _explanations(self.anew_events)
        if recorded != anew:
            found.append(f"explanations: recorded {'; '.join(recorded) or 'none'}, anew {'; '.join(anew) or 'none'}")
        return found


def _lasting(what: str, held: PoseDifference | Disagreement, grace: float) -> list[str]:
    sides = (("recorded", held.only_recorded), ("anew", held.only_anew))
    return [f"{what}: only {side}, for {alone.longest_s:.2f} s" for side, alone in sides if alone.longest_s > grace]


def _explanations(events: Iterable[Event]) -> list[str]:
    return [str(event.details.get("explanation", "")) for event in events if event.kind == "explained"]


def _order(event: Event) -> tuple[float, str, str]:
    """By time; those of one instant always alike."""
    return event.time, event.kind, event.subject


class _Side:
    """One of the two runs."""

    def __init__(self, memory: Memory) -> None:
        self.memory = memory
        self.events: list[Event] = []
        self._timeline = Timeline()
        self._watch: Watch = memory.watch()

    def look(self, now: float, begin: float) -> None:
        """Note what happened until `now` (stamp, s)."""
        for event in self._timeline.note(self._watch.poll(), self.memory, now):
            if event.kind in _COMPARED:
                self.events.append(msgspec.structs.replace(event, time=event.time - begin))

    def poses(self, types: Collection[str]) -> dict[EdgeId, Pose]:
        """The geometric edges of these types to objects."""
        return {
            (edge.type, edge.src, edge.dst): pose
            for type in types
            for edge in self.memory.edges(type)
            if (pose := edge.get("pose")) is not None and self.memory.node(edge.dst).type in OBJECTS
        }

    def relations(self) -> set[str]:
        """`source type destination` of each."""
        return {f"{edge.src} {type} {edge.dst}" for type in RELATIONS for edge in self.memory.edges(type)}

    def surprising(self) -> set[str]:
        """Names of nodes."""
        return {node.name for node in self.memory.nodes() if node.get("surprising") is True}


class RunComparison:
    """Compares two graphs at each call of `sample`.

    Args:
        recorded: the graph as it was.
        anew: the graph of the agents that run anew.
        types: types of geometric edges to compare.
        begin: stamp of the recording's first message, s.
        tolerance: m, up to which positions count as equal.
        turn_tolerance: rad, likewise.
    """

    def __init__(
        self,
        recorded: Memory,
        anew: Memory,
        types: Collection[str],
        begin: float,
        tolerance: float = 0.0,
        turn_tolerance: float = 0.0,
    ) -> None:
        self._tolerance, self._turn_tolerance = tolerance, turn_tolerance
        self._recorded, self._anew = _Side(recorded), _Side(anew)
        self._types = sorted(types)
        self._begin = begin
        self._last = begin
        self._poses: dict[EdgeId, PoseDifference] = {}
        self._relations: dict[str, Disagreement] = {}
        self._surprising: dict[str, Disagreement] = {}

    def sample(self, now: float) -> None:
        """Compare the present states, which hold since the last call; `now` is a stamp, s."""
        passed, self._last = now - self._last, now
        for side in (self._recorded, self._anew):
            side.look(now, self._begin)
        self._compare_poses(now, passed)
        for found, recorded, anew in (
            (self._relations, self._recorded.relations(), self._anew.relations()),
            (self._surprising, self._recorded.surprising(), self._anew.surprising()),
        ):
            for what in sorted(recorded | anew | found.keys()):
                held = found.setdefault(what, Disagreement(what))
                held.only_recorded.note(what in recorded and what not in anew, passed)
                held.only_anew.note(what in anew and what not in recorded, passed)

    def _compare_poses(self, now: float, passed: float) -> None:
        recorded, anew = self._recorded.poses(self._types), self._anew.poses(self._types)
        for key in dict.fromkeys([*recorded, *anew, *self._poses]):
            found = self._poses.setdefault(key, PoseDifference(" ".join(key)))
            found.only_recorded.note(key in recorded and key not in anew, passed)
            found.only_anew.note(key in anew and key not in recorded, passed)
            metres = radians = 0.0
            if key in recorded and key in anew:
                metres, radians = recorded[key].distance(anew[key])
                if metres > found.max_m:
                    found.max_m, found.max_at_s = metres, now - self._begin
                found.max_rad = max(found.max_rad, radians)
                found.both_s += passed
                found.mean_m += metres * passed  # a sum until `outcome`
            found.beyond.note(metres > self._tolerance or radians > self._turn_tolerance, passed)

    def outcome(self, agents: Collection[str], notes: list[str]) -> ReplayOutcome:
        """Return the result until now; nothing may be sampled after that."""
        for pose in self._poses.values():
            pose.mean_m = pose.mean_m / pose.both_s if pose.both_s > 0.0 else 0.0
        return ReplayOutcome(
            agents=sorted(agents),
            seconds=self._last - self._begin,
            poses=sorted(self._poses.values(), key=lambda pose: pose.edge),
            relations=[self._relations[name] for name in sorted(self._relations)],
            surprising=[self._surprising[name] for name in sorted(self._surprising)],
            recorded_events=sorted(self._recorded.events, key=_order),
            anew_events=sorted(self._anew.events, key=_order),
            notes=notes,
        )


_TOLD = ("explained", "surprised", "calmed")
"""Kinds of events that the table shows; the JSON holds all."""


def to_json(outcome: ReplayOutcome, differences: list[str]) -> dict[str, Any]:
    """The outcome as plain data, with `equal` and what differs."""
    return {"equal": not differences, "differences": differences, **msgspec.to_builtins(outcome)}


def show(outcome: ReplayOutcome, differences: list[str], console: Console) -> None:
    """Print tables, then the verdict."""
    if outcome.poses:
        console.print(_poses(outcome))
    held = [("relation", item) for item in outcome.relations] + [("surprising", item) for item in outcome.surprising]
    disagreements = [(kind, item) for kind, item in held if item.only_recorded.total_s or item.only_anew.total_s]
    if disagreements:
        console.print(_disagreements(disagreements))
    told = [event for event in outcome.recorded_events + outcome.anew_events if event.kind in _TOLD]
    if told:
        console.print(_events(outcome))
    for note in outcome.notes:
        console.print(f"[yellow]note[/] {shown(note)}", soft_wrap=True)
    for difference in differences:
        console.print(f"[red]✗[/] {shown(difference)}", soft_wrap=True)
    what = f"{', '.join(outcome.agents)} anew over {outcome.seconds:.1f} s"
    equal = "[green]equal within the tolerance, but for breaks shorter than the grace[/]"
    verdict = f"[red]{len(differences)} differences[/]" if differences else equal
    console.print(f"{verdict}: {what}", soft_wrap=True)


def _poses(outcome: ReplayOutcome) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "pose")
    add_numbers(table, "max\n(mm)", "at\n(s)", "mean\n(mm)", "max turn\n(rad)")
    add_numbers(table, "apart\n(s)", "only re-\ncorded (s)", "only\nanew (s)")
    for pose in outcome.poses:
        table.add_row(
            shown(pose.edge),
            f"{pose.max_m * 1e3:.2f}",
            f"{pose.max_at_s:.2f}" if pose.max_m > 0.0 else "",
            f"{pose.mean_m * 1e3:.2f}",
            f"{pose.max_rad:.3f}",
            _seconds(pose.beyond.total_s),
            _seconds(pose.only_recorded.total_s),
            _seconds(pose.only_anew.total_s),
        )
    return table


def _disagreements(held: list[tuple[str, Disagreement]]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "what", "")
    add_numbers(table, "only recorded (s)", "only anew (s)")
    for kind, item in held:
        alone = (_seconds(item.only_recorded.total_s), _seconds(item.only_anew.total_s))
        table.add_row(kind, shown(item.what), *alone)
    return table


def _events(outcome: ReplayOutcome) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_numbers(table, "s")
    add_names(table, "run", "event")
    rows: list[tuple[Event, str]] = [(event, "recorded") for event in outcome.recorded_events]
    rows += [(event, "anew") for event in outcome.anew_events]
    for event, run in sorted(rows, key=lambda row: row[0].time):
        if event.kind in _TOLD:
            table.add_row(f"{event.time:.2f}", run, shown(event.text), style="" if run == "recorded" else "cyan")
    return table


def _seconds(seconds: float) -> str:
    return f"{seconds:.2f}" if seconds > 0.0 else ""
