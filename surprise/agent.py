"""The surprise detector: flags objects whose percepts and belief disagree, and cameras that see nothing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from functools import partial

from dsr.agent import Access, Agent
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.errors import DsrError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.tolerance import PoseTolerance
from dsr.perception.percepts import Percept, PerceptReader
from dsr.perception.scales import TICK_RATE
from dsr.vocabulary.bodies import MOST_BODIES, bodies_beyond, bodies_by_name
from dsr.vocabulary.nats import FALSE_FRAME, SURPRISING
from dsr.vocabulary.perceived import camera_nodes
from dsr.vocabulary.relations import THINGS, is_present
from surprise.beliefs import Beliefs, PastWhereabouts
from surprise.config import SurpriseConfig
from surprise.evidence import EvidenceTrack, Reason
from surprise.expectation import Expectations
from surprise.improbability import (
    ATTRIBUTE,
    HandMotion,
    ImprobabilityWriter,
    LatelySeen,
    at_most,
    improbability,
    silence,
)
from surprise.misfit import WAYS
from surprise.suspicion import Suspicion


class SurpriseDetector(Agent):
    """Compares percepts of each object with its belief, and says where they disagree.

    Writes `nats` on objects, hands and cameras, and for all together at the root: how improbable what is seen is under
    the whole belief. From `SURPRISING` of `dsr.vocabulary.nats` on, writes `surprising` and `surprise` (why, with
    figures). An object is improbable as far as

    - percepts disagree alike with where it is believed to be,
    - a camera that delivers should see it (edge `sees`) and does not,
    - a camera sees it although another object should hide it,
    - it is seen, although it is believed to be gone (`present` is False).

    A camera is improbable that sees nothing at all although it should, a hand that jumps. Everything is derived from
    the graph: after a restart, flags stay until percept and belief agree.
    """

    name = "surprise"
    rate_hz = TICK_RATE
    shares_process = True
    reads = Access(
        nodes=(*THINGS, "camera", "gripper", "hand", "world"),
        edges=("RT", "Virtual_RT", "sees", "grasping"),
        attributes=("surprising", "surprise", "present", "detectable", "covered_by", WHEREABOUTS, ATTRIBUTE),
    )
    writes = Access(
        nodes=(*THINGS, "camera", "hand", "world"),
        attributes=("surprising", "surprise", ATTRIBUTE),
        exclusive=("surprising", "surprise", ATTRIBUTE),
    )
    Config = SurpriseConfig
    config: SurpriseConfig

    def setup(self) -> None:
        """Begin with nothing seen yet."""
        self._suspicions: dict[str, Suspicion] = {}
        self._start_anew()

    def _start_anew(self) -> None:
        """Forget all evidence, not the flags."""
        config = self.config
        self._percepts = PerceptReader(self.memory, oldest=config.fresh)
        self._beliefs = Beliefs(
            self.memory, config.fresh, PoseTolerance(config.unseen_noise, config.unseen_rotation_noise)
        )
        self._whereabouts = PastWhereabouts(self.memory, config.fresh)
        self._expectations = Expectations(self.memory, config)
        self._tracks: dict[tuple[str, str], EvidenceTrack] = {}
        self._held_until: dict[str, float] = {}
        self._gone_since: dict[str, float] = {}
        self._hands: dict[str, HandMotion] = {}
        self._nats = ImprobabilityWriter(self.memory, WORLD)
        self._nats_due = -math.inf
        self._now: float | None = None

    def tick(self, now: float) -> None:
        """Compare new percepts at time `now` (s). A clock that was set back makes all evidence void."""
        if self._now is not None and now < self._now:
            self.log.warning("the clock was set back by %.1f s: beginning anew", self._now - now)
            self._start_anew()
        self._now = now
        objects, beyond = bodies_by_name(self.memory, THINGS), bodies_beyond(self.memory, THINGS)
        self.degraded = f"{beyond} things are passed over: {MOST_BODIES} others are looked at" if beyond else ""
        held = self._note_held(now)
        jumped = self._beliefs.update(now, objects, held)
        names = {node.name for node in objects}
        cameras = camera_nodes(self.memory)
        new = self._percepts.new(now, names, {camera.name for camera in cameras})
        self._reconsider(now, names, jumped, held)
        self._take_in(new)
        self._expectations.update(now, new, jumped | held)
        with self.memory.batch():
            is_due = not self._nats_due - self.config.nats_period <= now < self._nats_due
            if is_due:
                self._nats_due = now + self.config.nats_period
                self._whereabouts.note(now, names)
            tracks = self._fresh_tracks(now)
            nats = {
                node.name: self._judge_object(node, now, held, tracks.get(node.name, []), in_full=is_due)
                for node in objects
            }
            nats |= {camera.name: self._judge_camera(camera, now) for camera in cameras}
            nats |= {hand.name: self._judge_hand(hand, now) for hand in self.memory.nodes("hand")}
            if is_due:
                self._nats.update((name, known) for name, known in nats.items() if known is not None)
        self._suspicions = {name: found for name, found in self._suspicions.items() if name in self.memory}
        self._hands = {name: track for name, track in self._hands.items() if name in self.memory}

    @property
    def skipped(self) -> Counter[str]:
        """Percepts that could not be used, by reason."""
        return self._percepts.skipped

    def _note_held(self, now: float) -> set[str]:
        """Objects that the gripper holds, or has just released."""
        for edge in self.memory.edges("grasping"):
            self._held_until[edge.dst] = now + self.config.fresh
        self._held_until = {name: until for name, until in self._held_until.items() if now < until}
        return set(self._held_until)

    def _reconsider(self, now: float, objects: set[str], jumped: set[str], held: set[str]) -> None:
        """See earlier percepts in the light of what is believed now; forget those of what is gone."""
        self._tracks = {key: track for key, track in self._tracks.items() if key[1] in objects}
        for (_, name), track in self._tracks.items():
            belief = self._beliefs.now(name)
            if belief is not None and name in jumped:
                track.belief_jumped(belief)
            elif belief is not None and name in held:
                track.belief_changed(belief)

    def _take_in(self, percepts: Iterable[Percept]) -> None:
        """Compare with what was believed when they were made and what is believed now, and keep them."""
        for percept in percepts:
            now, then = self._beliefs.now(percept.name), self._beliefs.at(percept.name, percept.stamp)
            known = [belief for belief in (now, then if then is not now else None) if belief is not None]
            if known:
                track = self._tracks.setdefault(percept[:2], EvidenceTrack(percept.camera, self.config))
                before = partial(self._beliefs.before, percept.name)
                track.add(percept.stamp, percept.pose, percept.eye, known, before)

    def _fresh_tracks(self, now: float) -> dict[str, list[EvidenceTrack]]:
        """What cameras saw lately, by object."""
        found: dict[str, list[EvidenceTrack]] = {}
        for (_, name), track in self._tracks.items():
            if track.is_fresh(now):
                found.setdefault(name, []).append(track)
        return found

    def _judge_object(
        self, node: Node, now: float, held: set[str], tracks: list[EvidenceTrack], *, in_full: bool
    ) -> float | None:
        """Raise or clear its flag; how improbable what is seen of it is, nats, or None if nothing is believed of it.

        Unless `in_full`, what is sure to be no surprise is told by its upper bound.
        """
        start = min((track.start(track.last_stamp) for track in tracks), default=now - self.config.fresh)
        where = self._whereabouts.before(node.name, start, self._beliefs.since(node.name))
        seen = self._lately_seen(node, tracks, now, is_held=node.name in held)
        nats = None if where is None else at_most(where, seen, self.config)
        if where is not None and nats is not None and (in_full or nats >= SURPRISING):
            nats = improbability(where, seen, self.config)
        is_believed, is_surprising = self._beliefs.now(node.name) is not None, (nats or 0.0) >= SURPRISING
        reasons = self._reasons(node.name, seen) if is_surprising else []
        suspicion = self._suspicion(node)
        agrees = suspicion.raised and bool(tracks) and all(track.agrees(now) for track in tracks)
        changed = suspicion.update(now, reasons, agrees=agrees or not is_believed, undecided=bool(tracks))
        if changed or (is_believed and "surprising" not in node):
            self._write(node, suspicion)
        return nats

    def _lately_seen(self, node: Node, tracks: list[EvidenceTrack], now: float, *, is_held: bool) -> LatelySeen:
        """What cameras tell of an object.

        Nobody expects to see what the gripper holds or has just released. It is covered in part, and moves while it is
        seen: each percept of it tells half as much.
        """
        if is_present(node):
            self._gone_since.pop(node.name, None)
            while_gone = 0
        else:
            since = self._gone_since.setdefault(node.name, now)
            while_gone = self._expectations.times_seen(node.name, since)
        if is_held:
            return LatelySeen(tracks, while_gone=while_gone, false=0.5 * FALSE_FRAME)
        missed, hidden = self._expectations.missed(node.name)[0], self._expectations.impossible(node.name)[0]
        return LatelySeen(tracks, missed, hidden, while_gone)

    def _reasons(self, name: str, seen: LatelySeen) -> list[Reason]:
        """Why what is seen of an object is improbable, the greatest cost first; all that would be enough alone."""
        found = [(FALSE_FRAME * seen.while_gone, Reason("gone", "seen, though believed gone"))]
        for track in seen.tracks:
            found.append((track.misfit(seen.false).nats, track.reason(seen.false)))
        _, camera = self._expectations.missed(name)
        found.append((seen.missed, Reason("unseen", f"should be seen by {camera}, and is not")))
        _, camera, hides = self._expectations.impossible(name)
        found.append((seen.though_hidden, Reason("impossible", f"seen by {camera}, though {hides} should hide it")))
        found.sort(key=lambda pair: -pair[0])
        return [reason for nats, reason in found if nats >= min(SURPRISING, found[0][0])][: len(WAYS)]

    def _judge_camera(self, node: Node, now: float) -> float:
        """A camera that sees nothing is surprising until it delivers again, or nothing is expected of it any more."""
        nats, expected = silence(self._expectations.silence(node.name, now), self.config.pause), self._expectations
        names = expected.expected(node.name)
        text = f"sees nothing; expected {', '.join(names)} (covered, turned away or dead)"
        reasons = [Reason("silent", text)] if nats >= SURPRISING else []
        suspicion = self._suspicion(node)
        delivers = expected.delivers(node.name, now)
        if suspicion.update(now, reasons, agrees=delivers, undecided=bool(names)):
            self._write(node, suspicion)
        return nats

    def _judge_hand(self, node: Node, now: float) -> float:
        """A hand is surprising that jumps, until that is not of lately any more."""
        edge = self.memory.get_edge(WORLD, node.name, "RT")
        pose = None if edge is None else edge.get("pose")
        track = self._hands.setdefault(node.name, HandMotion(self.config))
        if pose is not None:
            track.add(pose)
        nats = track.improbability(now)
        reasons = [Reason("jump", "moves faster than hands do")] if nats >= SURPRISING else []
        suspicion = self._suspicion(node)
        if suspicion.update(now, reasons, agrees=False, undecided=False):
            self._write(node, suspicion)
        return nats

    def _suspicion(self, node: Node) -> Suspicion:
        """What is known of the flag, or what the graph says of it."""
        known = self._suspicions.get(node.name)
        if known is None:
            known = Suspicion(self.config, raised=node.get("surprising") is True, text=node.get("surprise", ""))
            self._suspicions[node.name] = known
        return known

    def _write(self, node: Node, suspicion: Suspicion) -> None:
        """Tell the graph, and the log when something begins or ends."""
        was = node.get("surprising") is True
        try:
            self.memory.update_node(node.name, surprising=suspicion.raised, surprise=suspicion.text)
        except DsrError as error:
            self.log.warning("%s: not told that it is surprising: %s", node.name, error)
            return
        if suspicion.raised and not was:
            self.log.info("%s is surprising: %s", node.name, suspicion.text)
        elif was and not suspicion.raised:
            self.log.info("%s is not surprising any more", node.name)
