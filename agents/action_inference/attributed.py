"""The default policy: infers actions from motions, percepts and grasps, with actor and time.

A thing that something holds is picked when the belief says that it was taken up; any other when it rises above where
it lay, by its percepts. It is not when what it is in or on rises with it. It is held until whoever holds it lets go:
it is placed then if it rests where it was let go, released if it has come down, unless it may have been put down where
nobody saw it. A thing that is merely not seen has not been released. What is first seen in a hand is held too,
wherever it was picked. What a camera sees that may have been bumped lifts nothing.
"""

from __future__ import annotations

import math

from agents.action_inference.attribution import REMEMBERED, Attribution
from agents.action_inference.bumps import FRESH, Bumps
from agents.action_inference.config import ActionInferenceConfig
from agents.action_inference.heights import Height, Heights
from agents.action_inference.observation import FOUND_OUT, ObservedEnd, ObservedThing, Snapshot
from agents.action_inference.policy import Inference
from agents.action_inference.track import ThingTrack
from dsr.clock import ROUNDING
from dsr.math3d import quaternions
from dsr.perception.scales import HAND_REACH, RESOLUTION, SLOW, STANDING, UNSEEN_AFTER
from dsr.vocabulary.handling import Handling
from dsr.vocabulary.observed_actions import PICK, PLACE, RELEASE, UNKNOWN, Action

_LIKELY, _GUESSED = 0.85, 0.7
"""Confidences: a hand is near, or it is seen to rest; nothing but its motion tells."""
_FASTER_THAN_PUT = -0.7  # m/s, faster than anybody puts things down
_PUT_DOWN = 0.3  # m that a thing may have come down unseen and yet have been put down: more often than dropped
_LEFT_WITHIN = 0.05  # m from where it rested in the hand, within which it was left there


class AttributedPolicy:
    """Infers actions by percepts and grasps, and attributes each to a hand or gripper; see the module.

    Args:
        config: tolerances.
    """

    name = "attributed"

    def __init__(self, config: ActionInferenceConfig | None = None) -> None:
        self._config = config or ActionInferenceConfig()
        self._moved = 2.0 * self._config.lifted  # m, between two places that are both known with errors
        self._attribution = Attribution(self._config.reach)
        self._bumps = Bumps()
        self._tracks: dict[str, ThingTrack] = {}

    def update(self, snapshot: Snapshot) -> list[Inference]:
        """Take in the snapshot, and return the actions that have become known."""
        self._attribution.update(snapshot)
        self._bumps.update(snapshot)
        self._tracks = {name: track for name, track in self._tracks.items() if name in snapshot.things}
        for thing in snapshot.things.values():
            self._note(thing, snapshot)
        inferences = []
        for name in self._from_below(snapshot):
            thing, track = snapshot.things[name], self._track(name)
            found = (
                self._end_of_hold(thing, track, snapshot) if track.held else self._begin_of_hold(thing, track, snapshot)
            )
            if found is not None:
                inferences.append(found)
        return inferences

    def recall(self, action: Action) -> None:
        """A thing that was picked and not put down is still held."""
        track = self._track(action.thing)
        track.held, track.by, track.recalled, track.lifted = action.kind == PICK, action.by, True, action.time

    def _track(self, name: str) -> ThingTrack:
        if name not in self._tracks:
            config = self._config
            seen = Heights(config.lifted, config.lifted_frames, config.steady)
            self._tracks[name] = ThingTrack(seen, Heights(config.lifted, config.lifted_frames, config.steady))
        return self._tracks[name]

    def _note(self, thing: ObservedThing, snapshot: Snapshot) -> None:
        """Take in where it is, and what carries it."""
        track, now = self._track(thing.name), snapshot.now
        if thing.seen is not None:
            last = track.seen.last
            if last is not None and thing.seen.stamp > last.time + UNSEEN_AFTER:
                track.returned, track.returned_at = True, thing.seen.stamp
            track.seen.add(Height.seen(thing.bottom(thing.seen), thing.seen))
        if thing.believed is not None:
            track.believed.add(Height(now, thing.bottom(thing.believed), thing.believed.t))
        beneath = thing.on | thing.inside
        if beneath and not (thing.grasps and track.held):
            track.beneath = (now, beneath)
        if thing.grasps:
            track.note_probability(thing.grasps[-1], now)
            track.last_grasp, track.let_go = now, track.believed.last
            if track.held and thing.on and track.believed.is_steady():
                self._note_rest(track, now)
            track.palm_height = snapshot.palm_height(thing.grasps[-1].holder)
        if thing.grasps or (track.held and track.last_grasp is None):
            self._note_hidden(thing, track, snapshot)

    def _note_rest(self, track: ThingTrack, now: float) -> None:
        """It stays on something in the hand. The lowest place counts: it may be on that still when it seems to rise."""
        last, rested = track.believed.last, track.rested
        if last is None:
            return
        if rested is None or last.bottom < rested.bottom + RESOLUTION or now - rested.time > FOUND_OUT:
            track.rested = last

    def _note_hidden(self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot) -> None:
        """Whether nobody sees what whoever holds it does with it."""
        holder = thing.grasps[-1].holder if thing.grasps else track.by
        if self._is_seen_now(thing, snapshot.now):
            track.hidden = None
        elif holder != UNKNOWN and not snapshot.shows_fingers(holder):
            track.hidden = track.believed.last

    def _from_below(self, snapshot: Snapshot) -> list[str]:
        """All names, what carries others first."""

        def height(name: str) -> tuple[float, str]:
            last = self._track(name).believed.last or self._track(name).seen.last
            return (last.bottom if last else 0.0, name)

        return sorted(snapshot.things, key=height)

    def _begin_of_hold(self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot) -> Inference | None:
        """`Pick`, if it has been taken up: as is believed of what something holds, else by its percepts."""
        before = track.lifted
        if thing.grasps and thing.lifted is not None:
            track.lifted = max(before, thing.lifted)
        if self._is_carried(thing, snapshot):
            track.hovers_since = None
            if self._is_carried(thing, snapshot, surely=True):
                track.seen.forget()
                track.believed.forget()
            return None
        if track.lifted > before:
            return self._pick(thing, track, track.lifted, snapshot)
        is_doubted = thing.in_doubt or self._bumps.may_be(snapshot.now)
        if self._is_seen_now(thing, snapshot.now) and track.seen.lies and track.seen.is_lifted and not thing.grasps:
            if is_doubted:
                if snapshot.now - track.seen.departed() > 2.0 * FOUND_OUT:
                    track.seen.forget()
                return None
            if not track.returned or not thing.plausible:
                return self._pick(thing, track, track.seen.departed(), snapshot)
            track.seen.forget()
        if not is_doubted:  # where it lay is what it will be compared with when the camera is put right
            self._lie(thing, track)
        self._find(thing, track, snapshot)
        return None

    def _find(self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot) -> None:
        """It is held from now on if it hovers in a hand, and nobody knows where that took it."""
        hovers = thing.grasps and not (thing.plausible or thing.on or thing.inside or track.seen.lies)
        if not hovers or track.believed.lies or not self._is_seen_now(thing, snapshot.now):
            track.hovers_since = None
        elif track.hovers_since is None:
            track.hovers_since = snapshot.now
        elif snapshot.now - track.hovers_since >= FRESH - ROUNDING:
            track.held, track.by, track.found, track.hovers_since = True, thing.grasps[-1].holder, track.seen.last, None
            track.resting_since, track.returned = None, False

    def _lie(self, thing: ObservedThing, track: ThingTrack) -> None:
        """It is not held: note where it lies."""
        if track.seen.last is not None and (track.seen.lies or (thing.plausible and not thing.grasps)):
            track.seen.lie()
            if thing.plausible and not thing.grasps:
                track.returned = track.returned and not track.seen.lie_anew(track.returned_at)
            else:
                track.returned = track.returned and track.seen.is_rising
        if track.believed.last is not None and not thing.grasps and thing.plausible:
            track.believed.lie()

    def _is_carried(self, thing: ObservedThing, snapshot: Snapshot, *, surely: bool = False) -> bool:
        """Whether what it is in or on is held or rises, itself or by what that is in or on.

        With `surely`, not by a percept alone, which may be noise.
        """
        checked: set[str] = set()
        waiting = [thing.name]
        while waiting:
            when, beneath = self._track(waiting.pop()).beneath
            if snapshot.now - when > REMEMBERED:
                continue
            for name in sorted(beneath - checked):
                checked.add(name)
                if name in snapshot.things:
                    track = self._track(name)
                    is_seen = not surely and self._is_seen_now(snapshot.things[name], snapshot.now)
                    if track.held or (is_seen and track.seen.is_rising) or track.believed.is_rising:
                        return True
                    waiting.append(name)
        return False

    def _pick(self, thing: ObservedThing, track: ThingTrack, time: float, snapshot: Snapshot) -> Inference:
        by, confidence, why = UNKNOWN, _GUESSED, "it is lifted"
        if thing.grasps:
            by, why = thing.grasps[-1].holder, f"{thing.grasps[-1].holder} grasps and lifts it"
            confidence = thing.grasps[-1].probability
        elif thing.seen is not None:
            by = self._attribution.nearest(thing, thing.seen, snapshot.now)
            if by != UNKNOWN:
                confidence, why = _LIKELY, f"it is lifted, and {by} is near"
        elif not thing.plausible:
            confidence = _LIKELY
        track.held, track.by, track.resting_since, track.returned, track.hidden = True, by, None, False, None
        track.last_grasp = snapshot.now if thing.grasps else None
        return Inference(Action(min(time, snapshot.now), PICK, thing.name, by), confidence, why)

    def _end_of_hold(self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot) -> Inference | None:
        """`Place` or `Release`, if it has been let go."""
        track.lifted = track.lifted if thing.lifted is None else max(track.lifted, thing.lifted)
        if thing.grasps:
            track.by, track.resting_since = thing.grasps[-1].holder, None
            return None
        if thing.let_go is not None and thing.let_go.holder == track.by and thing.let_go != track.told:
            self._take_in(thing.let_go, track, snapshot)
        if track.last_grasp is not None and track.let_go is not None:
            return self._after_grasp(thing, track, snapshot, track.last_grasp, track.let_go)
        return self._by_motion(thing, track, snapshot)

    def _take_in(self, end: ObservedEnd, track: ThingTrack, snapshot: Snapshot) -> None:
        """Note when and how a hand let go, and where it and the thing were then."""
        track.told = end
        if track.last_grasp is None:
            return
        track.last_grasp, track.how = min(end.time, track.last_grasp), end.how
        seen, believed = track.seen.before(end.time), track.believed.before(end.time)
        is_fresh = seen is not None and end.time - seen.time <= FRESH
        track.let_go = (seen if is_fresh else believed) or track.let_go
        if snapshot.now - end.time < REMEMBERED:
            track.palm_height = self._attribution.palm_height(track.by, end.time)
        if track.rested is not None and track.rested.time > end.time:
            track.rested = None

    def _after_grasp(
        self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot, let_go_at: float, let_go: Height
    ) -> Inference | None:
        """Something held it, and does no longer."""
        now, config = snapshot.now, self._config
        believed = track.believed.last
        seen = track.seen.last if self._is_seen_now(thing, now) and track.seen.last is not None else None
        current = seen if seen is not None and seen.time > let_go_at else believed
        if current is None:
            return None
        if track.how == Handling.DROPPED:
            return self._let_go(thing, track, RELEASE, let_go_at, 1.0, f"it fell when {track.by} let go of it")
        lowered = let_go.bottom - current.bottom
        if seen is not None and seen.time > let_go_at and track.seen.speed() < _FASTER_THAN_PUT:
            track.hidden = None
        if lowered - self._palm_lowered(track, snapshot) > config.lifted and track.how != Handling.PUT_DOWN:
            inference = self._came_down(thing, track, snapshot, let_go_at, current)
        elif self._rests(thing, track, snapshot) and thing.plausible:
            settled = track.believed.settled() if track.believed.last is not None else let_go_at
            time = settled if lowered > config.lifted else min(settled, let_go_at)  # the hand may have held on unseen
            inference = self._let_go(thing, track, PLACE, time, 1.0, f"{track.by} let go of it where it rests")
        else:
            inference = None
        if inference is None and seen is not None and min(now, seen.time) - let_go_at > UNSEEN_AFTER:
            track.last_grasp = None  # the grasp was lost sight of, not ended: motion tells from here
        return inference

    def _came_down(
        self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot, let_go_at: float, current: Height
    ) -> Inference | None:
        """It is lower than where it was let go of: dropped, or put down where nobody saw it."""
        rests, rested = self._rests(thing, track, snapshot), self._rested_in_hand(track, let_go_at)
        if rested is not None and not rests:
            return None
        if rested is not None and math.dist(rested.position, current.position) < _LEFT_WITHIN:
            why = f"{track.by} left it where it had come to rest"
            return self._let_go(thing, track, PLACE, rested.time, _LIKELY, why)
        unseen = self._put_down_unseen(thing, track, current)
        goes_on_down = self._palm_lowered(track, snapshot) > self._config.lifted and not self._is_seen_now(
            thing, snapshot.now
        )
        if unseen is None and goes_on_down:  # it may hold on, although its fingertips seem apart
            unseen = self._lowered_out_of_sight(thing, track, current)
        if unseen is None and (rests or track.hidden is None):
            told = 1.0 if self._is_seen_now(thing, snapshot.now) else _GUESSED
            return self._let_go(thing, track, RELEASE, let_go_at, told, f"{track.by} let go of it, and it came down")
        if unseen is not None and self._rests(thing, track, snapshot, FOUND_OUT) and thing.plausible:
            return self._let_go(thing, track, PLACE, unseen, _GUESSED, "it was put down out of sight")
        return None

    def _rested_in_hand(self, track: ThingTrack, let_go_at: float) -> Height | None:
        """Where it rested shortly before it was let go of, unless it was seen to be lifted again."""
        rested, last = track.rested, track.seen.last
        if rested is None or let_go_at - rested.time > FOUND_OUT:
            return None
        is_seen_lifted = last is not None and last.time > rested.time and last.bottom > rested.bottom + self._moved
        return None if is_seen_lifted else rested

    def _put_down_unseen(self, thing: ObservedThing, track: ThingTrack, current: Height) -> float | None:
        """When (s) it may have been put down where nobody saw it, if it stands about there now; else None."""
        hidden = track.hidden
        if hidden is None or hidden.bottom - current.bottom > _PUT_DOWN or not self._stands(thing):
            return None
        return hidden.time if math.dist(hidden.position[:2], current.position[:2]) < HAND_REACH else None

    def _lowered_out_of_sight(self, thing: ObservedThing, track: ThingTrack, current: Height) -> float | None:
        """When (s) it came down to where it stands now, if it was being lowered when it was last seen; else None."""
        last, speed = track.seen.last, track.seen.lowering()
        if last is None or not SLOW < speed < -_FASTER_THAN_PUT or last.bottom - current.bottom > _PUT_DOWN:
            return None
        return min(last.time + (last.bottom - current.bottom) / speed, current.time) if self._stands(thing) else None

    def _stands(self, thing: ObservedThing) -> bool:
        """Whether it is believed to be upright, or has the same height on every side."""
        if thing.believed is None or max(thing.size) - min(thing.size) < RESOLUTION:
            return thing.believed is not None
        return abs(quaternions.to_matrix(thing.believed.q)[2][2]) > math.cos(STANDING)

    def _palm_lowered(self, track: ThingTrack, snapshot: Snapshot) -> float:
        """How far the hand that held it has come down since, m, if it has: it may still hold it, unseen."""
        palm_height = snapshot.palm_height(track.by)
        return 0.0 if palm_height is None or track.palm_height is None else max(0.0, track.palm_height - palm_height)

    def _by_motion(self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot) -> Inference | None:
        """Nothing is known to hold it but that it was lifted."""
        last, near = track.seen.last, _GUESSED if track.by == UNKNOWN else _LIKELY
        if last is None:
            return None
        if self._is_seen_now(thing, snapshot.now):
            if track.seen.speed() < _FASTER_THAN_PUT:
                return self._let_go(thing, track, RELEASE, self._last_high(track), near, "it falls")
            if track.seen.is_steady() and thing.plausible and self._rests(thing, track, snapshot):
                return self._let_go(thing, track, PLACE, track.seen.settled(), _LIKELY, "it rests again")
            return None
        return self._out_of_sight(thing, track, snapshot, last)

    def _out_of_sight(
        self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot, last: Height
    ) -> Inference | None:
        """Nobody sees it since `last`: it has been let go of if it is believed to lie below that."""
        believed = track.believed.last
        lies = thing.plausible or (bool(thing.on) and track.believed.is_steady())
        if believed is None or not lies or last.bottom - believed.bottom <= self._moved:
            return None
        if self._is_hidden_with_holder(track, snapshot):
            return None
        unseen = self._put_down_unseen(thing, track, believed)
        least = 0.0 if unseen is None else FOUND_OUT
        if unseen is None and (unseen := self._lowered_out_of_sight(thing, track, believed)) is None:
            near = _GUESSED if track.by == UNKNOWN else _LIKELY
            return self._let_go(thing, track, RELEASE, self._last_high(track), near, "it is gone from where it was")
        if self._rests(thing, track, snapshot, least):
            return self._let_go(thing, track, PLACE, unseen, _GUESSED, "it was put down out of sight")
        return None

    def _last_high(self, track: ThingTrack) -> float:
        """When it was last seen before it came down, s; half a frame later is as likely as any moment."""
        last = track.seen.last
        assert last is not None
        if track.seen.speed() < _FASTER_THAN_PUT:
            before = track.seen.before(last.time - ROUNDING)
            return last.time if before is None else before.time
        return last.time

    def _is_hidden_with_holder(self, track: ThingTrack, snapshot: Snapshot) -> bool:
        """Whether the hand that had it is out of sight too."""
        holder = snapshot.holders.get(track.by)
        return track.by != UNKNOWN and (holder is None or not holder.perceived)

    def _rests(self, thing: ObservedThing, track: ThingTrack, snapshot: Snapshot, least: float = 0.0) -> bool:
        """Whether it has been on or in something, or on the floor, for long enough, and for `least` s."""
        on_floor = thing.believed is not None and thing.bottom(thing.believed) < snapshot.floor_below
        if not (thing.on or thing.inside or (on_floor and track.believed.is_steady())):
            track.resting_since = None
            return False
        if track.resting_since is None:
            track.resting_since = snapshot.now
        return snapshot.now - track.resting_since >= max(self._config.settle, least) - ROUNDING

    def _is_seen_now(self, thing: ObservedThing, now: float) -> bool:
        return thing.perceived and thing.seen is not None and now - thing.seen.stamp <= FRESH

    def _let_go(
        self, thing: ObservedThing, track: ThingTrack, kind: str, time: float, confidence: float, why: str
    ) -> Inference | None:
        action = Action(time, kind, thing.name, track.by)
        confidence *= track.held_at(time) * thing.lies
        found, last = track.found, track.believed.last or track.seen.last
        stayed = found is not None and last is not None and math.dist(found.position, last.position) < self._moved
        track.held, track.by, track.last_grasp, track.let_go, track.resting_since = False, UNKNOWN, None, None, None
        track.returned, track.found, track.rested = False, None, None
        track.holds.clear()
        track.how = Handling.FREE
        track.seen.forget()
        track.believed.forget()
        return None if stayed else Inference(action, confidence, why)
