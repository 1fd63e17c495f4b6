"""Answers whether a thing is still where it was, for how long it has been there, and why it is not somewhere."""

from __future__ import annotations

from dsr.frames.tree import BELIEVED, WORLD
from dsr.math3d.transforms import Pose
from dsr.narration.account import LATELY
from dsr.narration.answer import Response, joined, understood
from dsr.narration.asked import span_asked
from dsr.narration.calendar import TimeSpan
from dsr.narration.happenings import entry_statements
from dsr.narration.naming import node_of
from dsr.narration.past import doings, relations_during
from dsr.narration.persons import ELSEWHERE
from dsr.narration.places import place_of_thing, relations_of
from dsr.narration.questions import Query
from dsr.narration.retrospect import explanations_of
from dsr.narration.statements import Moment, Statement, ago, length_of_time
from dsr.timeline import recall
from dsr.vocabulary.relations import THINGS

_STEP = 1.0
"""s between two times at which a pose of the past is looked for: no thing is put away and back within that"""


def unmoved(moment: Moment, query: Query) -> Response:
    """Whether a thing is where it was: at a time, or lately.

    Poses tell that as far back as they are kept. Beyond that the timeline does: what the thing was on or in, and
    whether it was moved since.
    """
    node, span = node_of(moment, query.things[0]), span_asked(moment, query)
    place = [place_of_thing(moment, node)] if node.type in THINGS else []
    then = moment.now - LATELY if span is None else span.begin
    since = TimeSpan(then, moment.now, "")
    before = _earliest(moment, node.name, then, is_exact=span is not None)
    here = moment.memory.get_transform(WORLD, node.name, types=BELIEVED)
    if before is not None and here is not None and (far := here.distance(before[1])[0]) > ELSEWHERE:
        text = f"No: {node.name} is {far:.2f} m from where it was {ago(moment.now - before[0])}."
        told = doings(moment, node.name, "move", since)[-1:]
        return understood(f"{text} {joined([*told, *place])}".strip(), [*told, *place], verdict=False)
    told = _left(moment, node.name, then)
    if span is None or before is None:
        told += doings(moment, node.name, "move", since)
    if told:
        return understood(f"No: {joined(told)} {joined(place)}".strip(), [*told, *place], verdict=False)
    text = f"Yes: nothing tells that {node.name} is elsewhere now. {joined(place)}"
    return understood(text.strip(), place, verdict=True)


def how_long_there(moment: Moment, query: Query) -> Response:
    """For how long a thing has been on, in or held by what it is on, in or held by now."""
    node = node_of(moment, query.things[0])
    place = place_of_thing(moment, node)
    supports, contents, holders = relations_of(moment, node.name)
    edges = contents or supports or holders
    times = [edge["since"] for edge in edges if "since" in edge]
    if not times:
        return understood(f"That is not known. {place.text}", [place])
    since = max(times)
    return understood(f"For {length_of_time(moment.now - since)}. {place.text}", [place], time=since)


def why_not_so(moment: Moment, query: Query) -> Response:
    """Why a thing is not, or no longer, on or in another: when that ended, what was done, and the explanation."""
    thing, other = (node_of(moment, asked) for asked in query.things)
    place = place_of_thing(moment, thing)
    kinds = ("on", "in") if query.relation != "in" else ("in",)
    if any(moment.memory.get_edge(thing.name, other.name, kind) is not None for kind in kinds):
        return understood(f"But that is so. {place.text}", [place])
    entries = recall(moment.memory, kind=kinds, participants=(thing.name, other.name))
    over = [entry for entry in entries if entry.end is not None and entry.participants == (thing.name, other.name)]
    ended = [one for one in entry_statements(moment, over[-1:]) if over and one.time == over[-1].end]
    told = [*ended, *doings(moment, thing.name, "move")[-1:], *explanations_of(moment, thing.name), place]
    unique = list({one.text: one for one in told}.values())
    never = "" if over else f"{thing.name} is not known to have been {query.relation} {other.name}. "
    return understood(f"{never}{joined(unique)}", unique)


def _earliest(moment: Moment, name: str, then: float, *, is_exact: bool) -> tuple[float, Pose] | None:
    """The pose of a thing at a time (s), or else the oldest one since that is kept; None without any."""
    time = then
    while time < moment.now:
        pose = moment.memory.get_transform(WORLD, name, at=time, types=BELIEVED)
        if pose is not None:
            return time, pose
        if is_exact:
            return None
        time += _STEP
    return None


def _left(moment: Moment, name: str, then: float) -> list[Statement]:
    """What a thing was on, in or held by then and is no more, as sentences."""
    before = relations_during(moment, name, TimeSpan(then, then, ""))
    over = [entry for entry in before if entry.end is not None and entry.end <= moment.now]
    now = {(edge.type, edge.dst) for edges in relations_of(moment, name)[:2] for edge in edges}
    gone = [entry for entry in over if (entry.kind, entry.participants[-1]) not in now]
    return [one for one in entry_statements(moment, gone) if any(one.time == entry.end for entry in gone)]
