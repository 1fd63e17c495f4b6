"""Runs a trace of the model against the real code: graphs and synchronisers, with the bytes between them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any
from unittest import mock

from benchmarks.years.showing import state
from dsr.crdt import pieces
from dsr.crdt.context import CausalContext, Dot
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import reply_to
from dsr.graph.graph import Graph
from dsr.replication.lacking import GRACE
from dsr.replication.outputs import Ask
from dsr.replication.pace import DIGEST_PERIOD
from dsr.replication.peers import LAST_PAUSE
from dsr.replication.piece_wire import decode_request, encode_piece
from dsr.replication.sync import Synchroniser
from dsr.replication.wire import decode_delta, encode_delta

Step = tuple[str, int, list[Any], dict[str, Any]]
"""What is done, at which site, with what, and what that site holds then; see `holds_in_model`."""
NOW = 1_000_000.0
"""s, physical time of everything: so stamps follow causality alone, as those of the model do."""
PATIENCE = 50
"""Questions, or rounds of digests, after which all must know all: each trace has fewer elements"""
NODE, LOOP = "a", ("a", "a", "on")
"""The node of the model, and its edge."""


class DiffersError(AssertionError):
    """The real code does not do what the model says."""


class Place:
    """One replica, as `Memory` has it, without a network."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.graph = Graph(rid_of(number))
        self.sync = Synchroniser(self.graph)


class Room:
    """Replicas at the sites of the model, and every delta that was ever sent.

    Args:
        sites: number of them.
    """

    def __init__(self, sites: int) -> None:
        self.places = {site: Place(site) for site in range(1, sites + 1)}
        for place in self.places.values():
            place.sync.nobody_there()
        self._messages: dict[tuple[int, tuple[Dot, ...]], bytes] = {}
        self._names: dict[Dot, Dot] = {}
        """Dots as the model has them: to which of several incarnations the first one goes, is open."""
        self._time = 0.0
        self._numbers = sites

    def run(self, steps: list[Step]) -> None:
        """Take all steps. Raises `DiffersError` at the first one after which a replica holds something else."""
        for count, (do, site, argument, expected) in enumerate(steps):
            self._take(do, site, argument)
            if do == "write":
                self._name_writes(self.places[site], expected)
            found = self._holds(self.places[site])
            if found != expected:
                raise DiffersError(f"step {count + 1}, {do} at {site}: {found}, not {expected}")

    def heal(self) -> None:
        """Everybody hears everybody's digests, and does what follows. Raises `DiffersError` if they stay apart."""
        for _ in range(PATIENCE):
            for place in self.places.values():
                self._hear(place)
            self._time += 2 * GRACE
            for place in self.places.values():
                self._ask_on(place)
            self._time += DIGEST_PERIOD
        states = [state(place.graph) for place in self.places.values()]
        if any(other != states[0] for other in states):
            raise DiffersError("they stay apart after the healing")

    def _hear(self, place: Place) -> None:
        for other in self.places.values():
            if other is not place:
                place.sync.peer_appeared(other.graph.rid, self._time)
                place.sync.receive_digest(other.graph.rid, other.sync.digest(NOW), self._time, NOW)

    def _ask_on(self, place: Place) -> None:
        """Ask for piece after piece, until nothing seems to be missing."""
        for _ in range(PATIENCE):
            questions = self._questions(place)
            if not questions:
                return
            self._answer(place, questions[0])
        raise DiffersError("it asks for ever")

    def _take(self, do: str, site: int, argument: list[Any]) -> None:
        place = self.places[site]
        match do:
            case "deliver":
                sender, dots = argument
                payload = self._messages[sender, tuple(sorted((rid_of(rid), n) for rid, n in dots))]
                place.sync.receive_delta(rid_of(sender), payload, NOW)
            case "ask":
                self._ask(place, self.places[argument[0]])
            case "ask for all":
                self._ask_for_all(place, self.places[argument[0]])
            case "next piece":
                self._next_piece(place)
            case "break off":
                place.sync.request_done(self._question(place).number)
            case "restart" | "restart with disk":
                self._restart(site, kept=do != "restart")
            case _:
                self._change(place, do)

    def _change(self, place: Place, do: str) -> None:
        graph = place.graph
        changes: dict[str, Callable[[], Delta]] = {
            "add node": lambda: graph.add_node(NODE, "cube", {}, NOW),
            "add edge": lambda: graph.add_edge(*LOOP, {}, NOW),
            "write": lambda: graph.write(graph.node(NODE), {"seen": graph.counter}, NOW),
            "remove node": lambda: graph.remove_node(NODE),
            "remove edge": lambda: graph.remove_edge(LOOP),
        }
        delta = changes[do]()
        dots = ((rid, n) for rid, first, last in delta.context for n in range(first, last + 1))
        self._messages[place.number, tuple(sorted(dots))] = encode_delta(delta)

    def _ask(self, place: Place, other: Place) -> None:
        """The model asks whom it likes, whether a digest told of something or not."""
        place.sync.peer_appeared(other.graph.rid, self._time)
        with mock.patch.object(place.sync.inquiry, "_peer_to_ask", lambda *now, **options: other.graph.rid):
            question = self._question(place)
        self._answer(place, question)

    def _ask_for_all(self, place: Place, other: Place) -> None:
        """A digest must be reason enough to ask for everything, when no pause after a useless answer is left."""
        self._time += LAST_PAUSE
        place.sync.receive_digest(other.graph.rid, other.sync.digest(NOW), self._time, NOW)
        self._time += 2 * GRACE
        question = self._question(place)
        if question.peer != other.graph.rid or decode_request(question.payload).seen != CausalContext():
            raise DiffersError("it does not ask for everything")
        self._answer(place, question)

    def _next_piece(self, place: Place) -> None:
        self._answer(place, self._question(place))

    def _question(self, place: Place) -> Ask:
        questions = self._questions(place)
        if not questions:
            raise DiffersError("it asks for nothing")
        return questions[0]

    def _questions(self, place: Place) -> list[Ask]:
        return [output for output in place.sync.tick(self._time, NOW) if isinstance(output, Ask)]

    def _answer(self, place: Place, question: Ask) -> None:
        other = next((each for each in self.places.values() if each.graph.rid == question.peer), None)
        if other is None:  # it is dead
            place.sync.request_done(question.number)
            return
        with mock.patch.object(pieces, "MAX_EXAMINED", 1):
            piece = other.sync.answer(place.graph.rid, question.payload)
        assert piece is not None
        place.sync.receive_reply(question.peer, question.number, encode_piece(piece), NOW)

    def _restart(self, site: int, *, kept: bool) -> None:
        snapshot = encode_delta(reply_to(self.places[site].graph.store, CausalContext()))
        self._numbers += 1
        self.places[site] = Place(self._numbers)
        if kept:
            self.places[site].graph.join(decode_delta(snapshot), NOW)


    def _name_writes(self, place: Place, expected: dict[str, Any]) -> None:
        """Each write of a change has the name of that to the same incarnation in the model."""
        named = {(rid_of(owner[0]), owner[1]): (rid_of(dot[0]), dot[1]) for owner, dot in expected["regs"]}
        for entry in place.graph.store.entries.values():
            write = entry.registers.get("seen")
            if write is not None and write.dot is not None and entry.dot in named:
                self._names.setdefault(write.dot, named[entry.dot])

    def _holds(self, place: Place) -> dict[str, Any]:
        """What a replica holds, in the words of the model; dots as [replica, counter], in order."""
        store = place.graph.store
        seen = [(rid, n) for rid, first, last in store.context.ranges() for n in range(first, last + 1)]
        written = [entry for entry in store.entries.values() if "seen" in entry.registers]
        newest = {entry.dot: entry.registers["seen"].dot for entry in written}
        return {
            "rid": place.number,
            "seen": self._numbers_of(seen),
            "live": self._numbers_of(store.entries),
            "regs": sorted(self._numbers_of([owner]) + self._numbers_of([dot]) for owner, dot in newest.items() if dot),
            "waits": self._numbers_of(write.dot for write in store.waiting_writes() if write.dot),
            "joined": place.sync.joined,
            "asks": place.sync.is_asking,
        }

    def _numbers_of(self, dots: Iterable[Dot]) -> list[list[int]]:
        named = [self._names.get(dot, dot) for dot in dots]
        return sorted([int(rid.removeprefix("r-")), counter] for rid, counter in named)


def rid_of(number: int) -> str:
    """The replica id of a replica of the model: they are ordered in the same way."""
    return f"r-{number}"


def holds_in_model(site: dict[str, Any]) -> dict[str, Any]:
    """What a site holds in a state of the model; dots as [replica, counter], in order."""
    return {
        "rid": site["rid"],
        "seen": sorted(site["seen"]),
        "live": sorted(site["live"]),
        "regs": sorted([write["owner"], write["dot"]] for write in site["regs"]),
        "waits": sorted(write["dot"] for write in site["waits"]),
        "joined": site["joined"],
        "asks": site["fetch"]["from"] != 0,
    }
