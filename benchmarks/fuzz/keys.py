"""A live memory whose every key gets mutated messages: state changes only by valid ones, losses are counted."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator

from agents.plant.driver import PlantArm, PlantCamera, PlantPoses
from benchmarks.fuzz import corpus
from benchmarks.fuzz.mutations import Dice, Mutator, dump_frame, load_frame
from benchmarks.fuzz.tally import Tally, measured
from dsr import LocalNetwork, ManualClock, Memory
from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import reply_to
from dsr.errors import WireError
from dsr.network.keys import WHOLE, Keys, is_key
from dsr.network.transport import names_one
from dsr.replication.peers import MAX_PEERS
from dsr.replication.piece_wire import decode_piece, decode_request
from dsr.replication.portions import parts_in
from dsr.replication.wire import decode_delta, decode_digest, encode_delta
from dsr.runtime.status import StatusBoard

_BATCH = 200
"""messages between two looks at the state"""
_MOST_ENTRIES = 5000
"""nodes and edges after which the memory is replaced: valid messages may fill it"""
_STRANGE = ("", "x" * 300, "*", "**", "a/b", "..", "\0", "\U0001f600", "arm_controller-5f0c12aa", "me-1", "new-{}")
"""Replica ids in keys; `{}` is a number, so that there is no end of them."""


class Witness(logging.Handler):
    """Counts what the memory says about whom."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Count one record by its text up to the details."""
        self.said[f"{record.msg}{record.args[:1] if isinstance(record.args, tuple) else ''}"] += 1


class Victim:
    """A memory with all that listens beside it, and a stranger on the same network."""

    def __init__(self, seed: int, part: str = WHOLE) -> None:
        self.clock = ManualClock(corpus.NOW)
        self.network = LocalNetwork(self.clock, seed=seed)
        transport = self.network.connect("me")
        self.memory = Memory("g", "me", transport=transport, clock=self.clock, rid="me-1", interest=())
        self.memory.add_node("world", "world")
        self.memory.create_part(corpus.PART)
        self.memory.add_node("floor", "table", corpus.PART)
        self.replica = self.memory.part_replica(part) if part else self.memory.replica
        self.to = Keys("g", part=part)
        """The keys under which it is attacked."""
        self.stranger = self.network.connect("stranger")
        keys = self.memory.keys
        self.arm = PlantArm(transport, keys)
        self.camera = PlantCamera(transport, keys)
        self.poses = PlantPoses(transport, keys)
        self.frames = self.memory.frames("camera")
        self.board = StatusBoard(transport, keys, self.clock)
        self.replies = 0

    def make_durable(self) -> None:
        """Deliver, merge and look at everything once."""
        self.clock.advance(0.01)
        self.network.deliver()
        self.memory.poll()
        self.memory.flush()
        for take in (self.arm.state, self.camera.frame, self.poses.readings, self.frames.latest):
            take()

    def rest(self) -> None:
        """Let seconds pass, until samples of streams that were accepted are durable."""
        for _ in range(5):
            self.clock.advance(1.0)
            self.make_durable()

    def state(self) -> bytes:
        """Everything that the memory holds, and has seen."""
        stores = [self.memory._graph.store, self.memory.part_replica(corpus.PART).graph.store]
        beside = repr([(store.fingerprint, len(store._waiting)) for store in stores])
        return b"".join(encode_delta(reply_to(store, CausalContext())) for store in stores) + beside.encode()


def fuzz_keys(messages: int, seed: int) -> Iterator[Tally]:
    """Send mutated messages on each kind of key; gives the tally of each now and then, and in the end."""
    kinds: list[tuple[str, float, Callable[[Tally, int, int], Iterator[Tally]]]] = [
        ("key d/ (deltas)", 0.2, _fuzz_deltas), ("key rt/ (samples)", 0.1, _fuzz_deltas),
        ("key dig/ (digests)", 0.1, _fuzz_digests), ("key sync/ (requests)", 0.1, _fuzz_requests),
        ("replies to our requests", 0.1, _fuzz_replies), ("keys beside the graph", 0.1, _fuzz_others),
        ("key part/ d/ (deltas)", 0.15, _fuzz_deltas), ("key part/ dig/ (digests)", 0.05, _fuzz_digests),
        ("key part/ sync/ (requests)", 0.05, _fuzz_requests), ("replies to requests of a part", 0.05, _fuzz_replies),
    ]  # fmt: skip
    for name, share, fuzz in kinds:
        yield from fuzz(Tally(name), round(messages * share), seed)


def _fuzz_deltas(tally: Tally, messages: int, seed: int) -> Iterator[Tally]:
    part = _part(tally)
    mutate = Mutator(corpus.part_deltas() if part else [*corpus.deltas(), *corpus.replies()], seed)
    durable = "d/" in tally.name

    def key(victim: Victim, rid: str, payload: bytes) -> str:
        sender = _maker(payload) or rid
        return victim.to.delta(sender) if durable else victim.to.stream(sender)

    def is_valid(payload: bytes) -> bool:
        delta = decode_delta(payload)
        return delta.live is None and all(one == part for one in parts_in(delta))

    yield from _fuzz_key(tally, messages, seed, mutate, is_valid, key)


def _part(tally: Tally) -> str:
    """The part of the graph that is attacked."""
    return corpus.PART if "part" in tally.name else WHOLE


def _maker(payload: bytes) -> str | None:
    """The replica whose dots a delta accounts for: from anybody else the memory takes none."""
    try:
        delta = decode_delta(payload)
    except WireError:
        return None
    rids = [add.dot[0] for add in delta.adds] + [rid for rid, _, _ in delta.context]
    return next((rid for rid in rids if is_key(rid) and "/" not in rid), None)


def _fuzz_digests(tally: Tally, messages: int, seed: int) -> Iterator[Tally]:
    """Digests never change the state; those of others than the key names are malformed too."""
    mutate = Mutator(corpus.part_digests() if _part(tally) else corpus.digests(), seed)

    def is_valid(payload: bytes) -> bool:
        decode_digest(payload)
        return True

    yield from _fuzz_key(tally, messages, seed, mutate, is_valid, lambda victim, rid, _: victim.to.digest(rid))


def _fuzz_key(
    tally: Tally,
    messages: int,
    seed: int,
    mutate: Mutator,
    is_valid: Callable[[bytes], bool],
    key: Callable[[Victim, str, bytes], str],
) -> Iterator[Tally]:
    """Send batches of refused and of accepted messages; only the latter may change anything."""
    dice = Dice(seed)
    part = _part(tally)
    witness, victim = Witness(), Victim(seed, part)
    logging.getLogger("dsr").addHandler(witness)
    with measured(tally) as look:
        for _ in range(0, messages, _BATCH):
            sorted_out: dict[bool, list[tuple[str, bytes]]] = {True: [], False: []}
            for _ in range(_BATCH):
                payload, rid = mutate(), dice.pick(_STRANGE).format(dice.below(10**6))
                sorted_out[_judge(tally, payload, is_valid)].append((key(victim, rid, payload), payload))
            sync = victim.replica.synchroniser
            before, dropped = victim.state(), sum(sync.dropped.values())
            heard = _send(tally, victim, sorted_out[False])
            tally.changes += victim.state() != before
            if "dig" not in tally.name:
                tally.miscounted += abs(sum(sync.dropped.values()) - dropped - heard)
            _send(tally, victim, sorted_out[True])
            victim.rest()
            tally.miscounted += any(times > 1 for times in witness.said.values())
            tally.miscounted += len(sync.dropped) > MAX_PEERS + 1 or len(sync.peers) > MAX_PEERS
            look()
            if len(victim.replica.graph.store.entries) > _MOST_ENTRIES:
                victim = Victim(seed, part)
                witness.said.clear()
            yield tally
    logging.getLogger("dsr").removeHandler(witness)
    yield tally


def _judge(tally: Tally, payload: bytes, is_valid: Callable[[bytes], bool]) -> bool:
    tally.messages += 1
    try:
        valid = is_valid(payload)
    except WireError:
        valid = False
    tally.accepted += valid
    tally.refused += not valid
    return valid


def _send(tally: Tally, victim: Victim, messages: list[tuple[str, bytes]]) -> int:
    """Send messages and let the memory take them in; how many of them its keys match, and tell whose they are."""
    heard = 0
    for key, payload in messages:
        heard += names_one(key) and key.count("/") == victim.to.delta().count("/")
        victim.stranger.publish(key, payload)
        _guarded(tally, payload, victim.make_durable)
    return heard


def _fuzz_requests(tally: Tally, messages: int, seed: int) -> Iterator[Tally]:
    """A request is answered if it is valid, and changes nothing."""
    part = _part(tally)
    mutate, victim = Mutator(corpus.part_requests() if part else corpus.requests(), seed), Victim(seed, part)
    key = victim.to.sync(victim.replica.graph.rid)
    before = victim.state()

    def count(_key: str, reply: bytes) -> None:
        decode_piece(reply)
        victim.replies += 1

    with measured(tally) as look:
        for number in range(messages):
            payload = mutate()
            valid, replies = _judge(tally, payload, lambda p: bool(decode_request(p))), victim.replies
            victim.stranger.request(key, payload, count, lambda: None, 0.0)
            _guarded(tally, payload, victim.make_durable)
            tally.miscounted += (victim.replies > replies) != valid
            if number % _BATCH == 0:
                tally.changes += victim.state() != before
                look()
                yield tally
    yield tally


def _fuzz_replies(tally: Tally, messages: int, seed: int) -> Iterator[Tally]:
    """The memory asks, and gets nonsense."""
    part = _part(tally)
    mutate, victim = Mutator(corpus.part_pieces() if part else corpus.pieces(), seed), Victim(seed, part)
    with measured(tally) as look:
        for number in range(messages):
            payload = mutate()
            valid = _judge(tally, payload, lambda p: bool(decode_piece(p)))
            sync, store = victim.replica.synchroniser, victim.replica.graph.store
            before = None if valid else (store.fingerprint, list(store.context.ranges()))
            _guarded(tally, payload, lambda: sync.receive_reply("peer", 0, payload, corpus.NOW))  # noqa: B023
            after = None if valid else (store.fingerprint, list(store.context.ranges()))
            tally.changes += before != after
            if number % _BATCH == 0:
                victim = victim if len(store.entries) < _MOST_ENTRIES else Victim(seed, part)
                look()
                yield tally
    yield tally


def _fuzz_others(tally: Tally, messages: int, seed: int) -> Iterator[Tally]:
    """Frames, device messages, statuses and keys that nobody expects: the graph never changes."""
    dice, victim = Dice(seed), Victim(seed)
    keys = victim.memory.keys
    kinds = [
        (keys.blob("camera"), Mutator(corpus.frames(), seed, load_frame, dump_frame)),
        (keys.device("camera/overhead"), Mutator(corpus.frames(), seed, load_frame, dump_frame)),
        (keys.device("camera/overhead/poses"), Mutator(corpus.tag_readings(), seed)),
        (keys.device("arm/state"), Mutator(corpus.arm_states(), seed)),
        (keys.status("viewer"), Mutator(corpus.statuses(), seed)),
        *[(f"{keys.root}/{key}", Mutator(corpus.deltas(), seed)) for key in ("", "d", "d//", "nonsense/x", "live/a/b")],
    ]
    before = victim.state()
    with measured(tally) as look:
        for number in range(messages):
            key, mutate = dice.pick(kinds)
            payload = mutate()
            tally.messages += 1
            victim.stranger.publish(key, payload)
            _guarded(tally, payload, victim.make_durable)
            if number % _BATCH == 0:
                tally.changes += victim.state() != before
                look()
                yield tally
    tally.refused = sum(part.dropped for part in (victim.arm._states, victim.camera._frames, victim.poses._readings))
    tally.refused += victim.board.malformed + victim.frames.dropped
    yield tally


def _guarded(tally: Tally, payload: bytes, action: Callable[[], None]) -> None:
    try:
        action()
    except Exception:
        tally.exceptions += 1
        tally.note(payload)
