"""The surprise detector: flags objects whose percepts and belief disagree, and cameras that see nothing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial

from dsr.agent import Access, Agent
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.errors import DsrError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.perception.percepts import Percept, PerceptReader
from dsr.vocabulary.relations import THINGS, is_present, nodes_by_name
from surprise.beliefs import Beliefs, PastWhereabouts
from surprise.config import SurpriseConfig
from surprise.evidence import EvidenceTrack, Reason
from surprise.expectation import Expectations
from surprise.improbability import ATTRIBUTE, ImprobabilityWriter, LatelySeen, improbability, jump, silence
from surprise.suspicion import Suspicion


class SurpriseDetector(Agent):
    """Compares percepts of each object with its belief, and says where they disagree.

    Writes `surprising` and `surprise` (why, with figures) on objects and cameras. Writes `nats` on objects, hands and
    cameras, and for all together at the root: how improbable what is seen is under the whole belief. An object is
    surprising when

    - several percepts disagree alike with its Virtual_RT, beyond noise and beyond a least extent,
    - a camera that delivers should see it (edge `sees`) and does not,
    - a camera sees it although another object should hide it,
    - it is seen, although it is believed to be gone (`present` is False).

    A camera is surprising that sees nothing at all although it should. Everything is derived from the graph: after a
    restart, flags stay until percept and belief agree.
    """

    name = "surprise"
    rate_hz = 20.0  # Hz, ticks
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
        self._beliefs = Beliefs(self.memory, PoseTolerance(config.jump, config.jump_turn))
        self._whereabouts = PastWhereabouts(self.memory)
        self._expectations = Expectations(self.memory, config)
        self._tracks: dict[tuple[str, str], EvidenceTrack] = {}
        self._held_until: dict[str, float] = {}
        self._gone_since: dict[str, float] = {}
        self._hands: dict[str, Pose] = {}
        self._nats = ImprobabilityWriter(self.memory, WORLD)
        self._nats_due = -math.inf
        self._now: float | None = None

    def tick(self, now: float) -> None:
        """Compare new percepts at time `now` (s). A clock that was set back makes all evidence void."""
        if self._now is not None and now < self._now:
            self.log.warning("the clock was set back by %.1f s: beginning anew", self._now - now)
            self._start_anew()
        self._now = now
        objects = nodes_by_name(self.memory, THINGS)
        held = self._note_held(now)
        jumped = self._beliefs.update(now, objects, held)
        names = {node.name for node in objects}
        new = self._percepts.new(now, names, {camera.name for camera in self.memory.nodes("camera")})
        self._reconsider(now, names, jumped, held)
        self._take_in(new)
        self._expectations.update(now, new, jumped | held)
        with self.memory.batch():
            for node in objects:
                self._judge_object(node, now, held)
            for camera in self.memory.nodes("camera"):
                self._judge_camera(camera, now)
            if not self._nats_due - self.config.nats_period <= now < self._nats_due:
                self._nats_due = now + self.config.nats_period
                self._whereabouts.note(now, names)
                self._nats.update(self._improbabilities(objects, now, held))
        self._suspicions = {name: found for name, found in self._suspicions.items() if name in self.memory}

    def _improbabilities(self, objects: list[Node], now: float, held: set[str]) -> Iterator[tuple[str, float]]:
        """How improbable what is seen is, nats, of each thing, hand and camera."""
        for node in objects:
            tracks = [track for (_, name), track in self._tracks.items() if name == node.name and track.is_fresh(now)]
            start = min((track.start(track.last_stamp) for track in tracks), default=now - self.config.fresh)
            where = self._whereabouts.before(node.name, start, self._beliefs.since(node.name))
            if where is not None:
                expected = 0 if node.name in held else self._expectations.missed(node.name)
                hidden = node.name not in held and self._expectations.impossible(node.name) is not None
                yield node.name, improbability(where, LatelySeen(tracks, expected, hidden), self.config)
        for camera in self.memory.nodes("camera"):
            yield camera.name, silence(*self._expectations.silence(camera.name, now))
        for hand in self.memory.nodes("hand"):
            yield hand.name, self._of_hand(hand.name)

    def _of_hand(self, name: str) -> float:
        """How improbable the last motion of a hand is, nats."""
        edge = self.memory.get_edge(WORLD, name, "RT")
        pose = None if edge is None else edge.get("pose")
        before = self._hands.get(name)
        if pose is not None:
            self._hands[name] = pose
        if before is None or pose is None or before.stamp >= pose.stamp:
            return 0.0
        return jump(before, pose, self.config.hand_speed, self.config.hand_noise)

    @property
    def skipped(self) -> Counter[str]:
        """Percepts that could not be used, by reason."""
        return self._percepts.skipped

    def _note_held(self, now: float) -> set[str]:
        """Objects that the gripper holds, or has just released."""
        for edge in self.memory.edges("grasping"):
            self._held_until[edge.dst] = now + self.config.held_grace
        self._held_until = {name: until for name, until in self._held_until.items() if now < until}
        return set(self._held_until)

    def _reconsider(self, now: float, objects: set[str], jumped: set[str], held: set[str]) -> None:
        """See earlier percepts in the light of what is believed now; forget those of what is gone."""
        self._tracks = {key: track for key, track in self._tracks.items() if key[1] in objects}
        for (_, name), track in self._tracks.items():
            track.forget_old(now)
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

    def _judge_object(self, node: Node, now: float, held: set[str]) -> None:
        name = node.name
        tracks = [track for (_, other), track in self._tracks.items() if other == name]
        reasons = self._reasons(node, tracks, now, held)
        fresh = [track for track in tracks if track.is_fresh(now)]
        is_believed = self._beliefs.now(name) is not None
        suspicion = self._suspicion(node)
        agrees = suspicion.raised and bool(fresh) and all(track.agrees(now) for track in fresh)
        changed = suspicion.update(now, reasons, agrees=agrees or not is_believed, undecided=bool(fresh))
        if changed or (is_believed and "surprising" not in node):
            self._write(node, suspicion)

    def _reasons(self, node: Node, tracks: list[EvidenceTrack], now: float, held: set[str]) -> list[Reason]:
        """All that makes an object surprising."""
        name = node.name
        gone = self._seen_though_gone(node, now)
        if gone is not None or self._beliefs.now(name) is None:
            return [gone] if gone else []
        worst = max((track.contradictions(held=name in held) for track in tracks), key=len, default=[])
        reasons = list(worst)
        if name not in held:
            expectations = (self._expectations.unseen(name), self._expectations.impossible(name))
            reasons += [reason for reason in expectations if reason is not None]
        return reasons

    def _seen_though_gone(self, node: Node, now: float) -> Reason | None:
        """Whether an object is seen that is believed to be gone."""
        if is_present(node):
            self._gone_since.pop(node.name, None)
            return None
        since = self._gone_since.setdefault(node.name, now)
        if self._expectations.times_seen(node.name, since) >= self.config.needed:
            return Reason("gone", "seen, though believed gone")
        return None

    def _judge_camera(self, node: Node, now: float) -> None:
        """A camera that sees nothing is surprising until it delivers again, or nothing is expected of it any more."""
        reason = self._expectations.silent(node.name, now)
        suspicion = self._suspicion(node)
        delivers = self._expectations.delivers(node.name, now)
        waits = self._expectations.expects(node.name)
        if suspicion.update(now, [reason] if reason else [], agrees=delivers, undecided=waits):
            self._write(node, suspicion)

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
