"""What if? Any agent asks the belief's simulator what would become of the objects, and disturbs nothing by it.

A question says what to change of the scene as it is believed to be now, and how many seconds to simulate; the answer
says where everything is then and what rests on what. A question may be tried in several worlds of the belief; the
answer then tells the outcome of each, with its probability. What moves in a world without the changes, too, is told:
the effect of the changes is the difference. Both are MessagePack maps with the field names below, on
`Keys.service("what_if")`. Everything is in the world frame, in m, rad and s, quaternions (x, y, z, w).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from typing import Annotated, Literal

import msgspec

from dsr.clock import Clock
from dsr.errors import TransportError, WireError
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import MOST_PARTS, Shape, to_numbers
from dsr.math3d.transforms import Pose
from dsr.network.decoding import decoded
from dsr.network.keys import Keys
from dsr.network.transport import Transport

SERVICE = "what_if"
"""Name of the service, see `Keys.service`."""
MAX_SECONDS = 10.0
MAX_CHANGES = 1000
MAX_WORLDS = 16
"""Worlds of the belief in which a question may be tried."""
USUAL_WORLDS = 8
"""In which plans and places are tried: what may be so besides is improbable."""
_MOST_NUMBERS = 11 * MOST_PARTS  # of the shape of what is added
TIMEOUT = 5.0
"""s to wait for an answer, unless told otherwise."""
LONGEST = 30.0
"""s for which a question is worked on at most, six times what askers wait: it holds up all others."""

Numbers = tuple[float, float, float, float, float, float, float]
"""A pose as it travels: translation x y z, then the quaternion x y z w."""
Action = Literal["place", "hold", "remove", "add"]


class Supposed(msgspec.Struct, frozen=True, omit_defaults=True):
    """A change of the believed scene; `place`, `hold`, `remove` and `add` make one."""

    object: str
    """Name of an object or a fixture (a table)."""
    action: Action
    pose: Numbers | None = None
    """world_from_object, of the centre of its box; of a held one, None is where it is."""
    size: tuple[float, float, float] | None = None
    """m, of what is added: edge lengths of the box around it"""
    shape: Annotated[tuple[float, ...], msgspec.Meta(max_length=_MOST_NUMBERS)] = ()
    """Parts of the shape, as in the attribute `shape` of a node; none for a solid box."""
    mass: float = 0.1
    """kg, mass of an added object."""
    friction: float = 0.5
    """Coulomb coefficient"""

    @staticmethod
    def place(name: str, pose: Pose) -> Supposed:
        """Place an object at `pose` (world_from_object), at rest, and free to move from there."""
        return Supposed(name, "place", (*pose.t, *pose.q))

    @staticmethod
    def hold(name: str, pose: Pose | None = None) -> Supposed:
        """Hold it at `pose` or where it is, whatever pushes it."""
        return Supposed(name, "hold", None if pose is None else (*pose.t, *pose.q))

    @staticmethod
    def add(
        name: str, pose: Pose, size: Vector3, shape: Shape = (), mass: float = 0.1, friction: float = 0.5
    ) -> Supposed:
        """Let there be one more object at `pose`, which nobody believes in, at rest and free to move from there."""
        numbers = to_numbers(shape) if shape else ()
        return Supposed(name, "add", (*pose.t, *pose.q), size, numbers, mass, friction)

    @staticmethod
    def remove(name: str) -> Supposed:
        """Remove an object."""
        return Supposed(name, "remove")


class Question(msgspec.Struct, frozen=True, omit_defaults=True):
    """A what-if question: the state of the objects after some time, with these changes made now, in their order."""

    seconds: Annotated[float, msgspec.Meta(ge=0.0, le=MAX_SECONDS)]
    """s to simulate; everything begins at rest."""
    changes: Annotated[tuple[Supposed, ...], msgspec.Meta(max_length=MAX_CHANGES)] = ()
    expires: float = 0.0
    """s, when nobody waits for the answer any more, on the asker's clock; 0 if that is not told. `WhatIf` fills it in.

    It is worked on for `LONGEST` at most in any case."""
    worlds: Annotated[int, msgspec.Meta(ge=1, le=MAX_WORLDS)] = 1
    """In how many worlds of the belief it is tried, at most: the one that the graph shows, then the most probable."""


class WorldOutcome(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """The outcome in one world of the belief.

    It is about objects only; static bodies occur only in `rests_on` and `touches`.
    """

    refused: str = ""
    """Why this world cannot be changed so, for people; then all about its end is empty."""
    weight: float = 1.0
    """1, probability of the world; 0 if the question was tried in no world"""
    otherwise: tuple[str, ...] = ()
    """Names of the objects that are elsewhere in this world than the graph shows, or held otherwise; sorted."""
    stamp: float = 0.0
    """s, time of the belief that the simulation began with."""
    seconds: float = 0.0
    """s that were simulated; less than asked for if everything came to rest before."""
    at_rest: bool = False
    """Whether nothing moves any more."""
    poses: dict[str, Numbers] = {}
    """world_from_object at the end."""
    moved: dict[str, float] = {}
    """m from where each object was after the changes: how far physics took it."""
    turned: dict[str, float] = {}
    """rad that each object has turned since the changes, by name."""
    anyway: dict[str, Numbers] = {}
    """world_from_object at the end without the changes, of what then moves, too, and which no change is about.

    Empty if nothing moves with the changes: then the world without them is not simulated."""
    rests_on: dict[str, tuple[str, ...]] = {}
    """Names of the supports of each object: none for an object in the air, or on the floor, which has no name."""
    touches: tuple[tuple[str, str], ...] = ()
    """Pairs of bodies in contact, sorted, each in the order of the alphabet."""
    on_floor: tuple[str, ...] = ()
    """Objects on the floor beneath the tables."""

    def pose(self, name: str) -> Pose:
        """world_from_object of an object at the end. Raises `KeyError`."""
        numbers = self.poses[name]
        return Pose(numbers[:3], numbers[3:], self.stamp + self.seconds)

    def effect(self, name: str) -> tuple[float, float]:
        """How far (m, rad) an object is from where it would be at the end without the changes. Raises `KeyError`.

        Of what a change is about, it is how far physics took it since.
        """
        if name not in self.anyway:
            return self.moved[name], self.turned.get(name, 0.0)
        numbers = self.anyway[name]
        return Pose(numbers[:3], numbers[3:]).distance(self.pose(name))

    @property
    def effects(self) -> dict[str, float]:
        """How far (m) each object is from where it would be without the changes, by name; see `effect`."""
        return {name: self.effect(name)[0] for name in self.moved}


class Answer(WorldOutcome, frozen=True, omit_defaults=True, kw_only=True):
    """The answer to a what-if question: the outcome in the world that the graph shows, and in others that were tried.

    Each world has its outcome, which may be that it cannot be changed so.
    """

    others: Annotated[tuple[WorldOutcome, ...], msgspec.Meta(max_length=MAX_WORLDS)] = ()
    """The outcomes in other worlds, the most probable first."""

    @property
    def outcomes(self) -> tuple[WorldOutcome, ...]:
        """All that were tried, that of the world that the graph shows first."""
        return (self, *self.others)

    @property
    def failed(self) -> str:
        """Why there is no outcome in any world, for people; empty if there is one in some."""
        return self.refused if all(one.refused for one in self.outcomes) else ""

    def probability(self, test: Callable[[WorldOutcome], bool]) -> float:
        """Probability (0 to 1) of the worlds whose outcome passes `test`, among those that were tried."""
        return share(self.outcomes, test)


def share(outcomes: Collection[WorldOutcome], test: Callable[[WorldOutcome], bool]) -> float:
    """Probability (0 to 1) of the worlds whose outcome passes `test`, among all of these; 0 of none."""
    total = sum(one.weight for one in outcomes)
    return sum(one.weight for one in outcomes if test(one)) / total if total > 0.0 else 0.0


_encoder = msgspec.msgpack.Encoder()
_questions = msgspec.msgpack.Decoder(Question)
_answers = msgspec.msgpack.Decoder(Answer)


def encode_question(question: Question) -> bytes:
    """The question as a message."""
    return _encoder.encode(question)


def decode_question(payload: bytes) -> Question:
    """The question of a message, of the right form and with a time within bounds; raises `WireError`."""
    question = decoded(payload, "what-if question", _questions.decode)
    if not 0.0 <= question.seconds <= MAX_SECONDS:
        raise WireError(f"malformed what-if question: seconds {question.seconds}, expected 0 to {MAX_SECONDS}")
    return question


def encode_answer(answer: Answer) -> bytes:
    """The answer as a message."""
    return _encoder.encode(answer)


def decode_answer(payload: bytes) -> Answer:
    """The answer of a message; raises `WireError`."""
    return decoded(payload, "what-if answer", _answers.decode)


class Pending:
    """A question that was asked; look again until it is `done`."""

    def __init__(self) -> None:
        self.answer: Answer | None = None
        """What was answered."""
        self.failed = ""
        """Why there is no answer and will be none: refused in all worlds, nobody there, not in time, malformed."""
        self.refusals: tuple[WorldOutcome, ...] = ()
        """The outcomes if the question was refused in all worlds in which it was tried."""
        self.finished = threading.Event()
        """Set when it is done: for those that may wait."""

    @property
    def done(self) -> bool:
        """Whether there is an answer, or a failure."""
        return self.finished.is_set()

    def take(self, answer: Answer) -> None:
        """Take an answer, unless something came before."""
        if not self.finished.is_set():
            self.failed = answer.failed
            if self.failed:
                self.refusals = tuple(one for one in answer.outcomes if one.weight > 0.0)
            else:
                self.answer = answer
            self.finished.set()

    def fail(self, why: str) -> None:
        """There will be no answer, unless something came before."""
        if not self.finished.is_set():
            self.failed = why
            self.finished.set()


class WhatIf:
    """Asks the simulation handler of a graph.

    Args:
        bus: an agent's `bus`, or a memory's `transport`.
        keys: of the graph.
        clock: the agent's.
        timeout: s to wait for an answer.
    """

    def __init__(self, bus: Transport, keys: Keys, clock: Clock, timeout: float = TIMEOUT) -> None:
        self._bus = bus
        self._key = keys.service(SERVICE)
        self._clock = clock
        self._timeout = timeout

    def ask(self, question: Question) -> Pending:
        """Ask and return at once: for ticks. The answer comes with what the network delivers later.

        In an agent, keep the `Pending` and look at it at the next ticks; it is done when the time-out is over at the
        latest. Raises `TransportError` if the network was left.
        """
        pending = Pending()
        expires = question.expires or self._clock.now() + self._timeout
        payload = encode_question(msgspec.structs.replace(question, expires=expires))

        def on_reply(_key: str, payload: bytes) -> None:
            try:
                answer = decode_answer(payload)
            except WireError as error:
                pending.fail(str(error))
            else:
                pending.take(answer)

        def on_done() -> None:
            pending.fail("nobody answered: does the simulation handler run, and is it not overloaded?")

        self._bus.request(self._key, payload, on_reply, on_done, self._timeout)
        return pending

    def ask_and_wait(self, question: Question) -> Answer:
        """Ask and wait for the answer: for scripts. Not for agents, which must never block.

        Raises:
            TransportError: if there is none, and why.
        """
        pending = self.ask(question)
        self._clock.wait(pending.finished, 2.0 * self._timeout)
        if pending.answer is None:
            raise TransportError(f"what if? {pending.failed or 'no answer in time'}")
        return pending.answer
