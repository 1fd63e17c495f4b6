"""Where one unseen object may be instead of where the simulation has it: alternatives with weights, over time.

Each alternative is a mode of a hidden Markov model. Mass flows from mode to mode by rates; that the object is not
seen where it should be lowers a mode in proportion to what cameras should see of it there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from dsr.believing.absence import missed_after
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from simulation_handler.contact.relations import SupportedPose
from simulation_handler.hands.state import HAND_REACH
from simulation_handler.perception.paths import between
from simulation_handler.scales import ROUNDING
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.carriers import Carriers
from simulation_handler.worlds.circumstances import FOUND_ANEW, HELD_OUT_OF_SIGHT, HOVERS, ON_ITS_WAY, RESTS, held
from simulation_handler.worlds.elsewhere import LOOKED_AT, HiddenPlaces, PossiblePlaces, places_about
from simulation_handler.worlds.evidence import Evidence, HandEvidence, ObjectEvidence
from simulation_handler.worlds.lying import let_go
from simulation_handler.worlds.parameters import Rates, WorldParameters

FOLLOWED = "followed"
"""The mode in which the simulation is right"""
LEFT = "left"
"""The mode in which it is where it was recognised last"""
ELSEWHERE = "elsewhere"
"""The mode in which something unknown moved it"""
ASTRAY = "astray"
"""The mode in which it vanished on its way, and something unknown stopped it or turned it"""
GONE = "gone"
"""The mode in which it is not in the scene"""
IN_HAND, INSIDE_OF = "in ", "inside "
"""The modes in which it is in a hand, or in a container: followed by the name of that"""
COURSE = "course "
"""The modes in which it went on by itself when it vanished on its way, each as fast as it may have been: numbered"""

_NOTHING = Carriers(())
_AS_GOOD_AS_SURE = 1.0 - ROUNDING  # 1, of somebody who was at work: what is sure cannot be doubted later


@dataclass
class Mode:
    """One alternative."""

    weight: float
    """1, probability"""
    pose: Pose | None
    """world_from_object; None: gone"""
    missed: float = 0.0
    """1, how often it should have been recognised there, and was not"""
    hand: str = ""
    """Name of the hand that holds it; empty for none"""
    container: str = ""
    """Name of the container that it is in; empty for none"""
    supports: tuple[str, ...] = ()
    """Names of what it rests on there, but for the floor"""
    anchored: Pose | None = None
    """hand_from_object or container_from_object, if it goes along with one of these"""
    since: float = -math.inf
    """s, since when it may have been so"""
    elsewhere: HiddenPlaces | None = None
    """The places about the pose, of a mode in which something unknown moved it, or stopped it"""
    worked: float = 0.0
    """1, probability in this mode that somebody was at work while cameras saw nothing at all"""


class Alternatives:
    """The modes of one object from when it is not seen any more until it is seen again.

    Args:
        parameters: rates and probabilities.
        thing: the object when it was recognised last.
        before: its circumstance then.
        now: s, that time.
        worked: probability that somebody has been at work in this gap, but not at this object.
    """

    def __init__(
        self,
        parameters: WorldParameters,
        thing: ObjectEvidence,
        before: str,
        now: float,
        worked: float = 0.0,
    ) -> None:
        assert thing.believed is not None
        self._parameters = parameters
        self.before = before
        self.left = thing.believed
        """world_from_object when it was recognised last"""
        mode = Mode(1.0, thing.believed, since=now, supports=thing.supports, worked=worked)
        self.modes: dict[str, Mode] = {FOLLOWED: mode}
        self.unshown = 0.0
        """nats, how improbable it is that cameras do not show it in this gap, if they do not fail"""
        self._container = thing.container
        self._supports = thing.supports
        self._was_aloft = thing.aloft
        self._solid = thing.solid
        self.looked = now
        """s, when it was last worked out what cameras should see of it"""
        self._now = now
        self._told_gone = False
        self._is_new = True
        self._vanishes = before in (RESTS, FOUND_ANEW)
        self._has_courses = False

    @property
    def moved(self) -> float:
        """How far (m) the simulation has moved the object since it was recognised."""
        pose = self.modes[FOLLOWED].pose
        assert pose is not None
        return math.dist(pose.t, self.left.t)

    @property
    def odds(self) -> float | None:
        """Log odds by this object alone that somebody was at work in the last gap; None if it has seen no gap."""
        worked = sum(mode.weight * mode.worked for mode in self.modes.values())
        idle = sum(mode.weight * (1.0 - mode.worked) for mode in self.modes.values())
        return math.log(worked / idle) if worked > 0.0 and idle > 0.0 else None

    def weights(self, ratio: float) -> dict[str, float]:
        """Probability of each mode if what other objects tell makes it `ratio` times as probable that somebody was
        at work.
        """
        weights = {key: mode.weight * (1.0 + mode.worked * (ratio - 1.0)) for key, mode in self.modes.items()}
        total = sum(weights.values())
        return {key: weight / total for key, weight in weights.items()}

    def settle(self, ratio: float) -> None:
        """Keep what other objects tell, and ask anew from now on whether somebody is at work."""
        for key, weight in self.weights(ratio).items():
            self.modes[key].weight, self.modes[key].worked = weight, 0.0
        self.unshown = 0.0

    def step(self, name: str, evidence: Evidence, work: float = 0.0) -> None:
        """Bring the modes of an object to the time of the evidence; `balance` them after that.

        Args:
            name: of the object.
            evidence: of a moment that is not before the last one.
            work: probability that somebody began to work since the last step, while cameras saw nothing.
        """
        thing, step = evidence.objects[name], evidence.now - self._now
        self._now = evidence.now
        self._go_along(evidence)
        self._follow(name, evidence)
        self._flow(name, evidence, step)
        self._work(thing, work)
        if self._is_new:
            self._enter(name, evidence)
            self._is_new = False
        self._go_on(thing)

    def balance(self) -> None:
        """Let the weights of all modes be 1 together."""
        total = sum(mode.weight for mode in self.modes.values())
        for key, mode in list(self.modes.items()):
            mode.weight /= total
            if 0.0 < mode.weight < ROUNDING and key != FOLLOWED:
                del self.modes[key]

    def _go_along(self, evidence: Evidence) -> None:
        """Objects in hands and containers go along with these."""
        for mode in self.modes.values():
            holder = _holder(mode, evidence)
            if holder is not None and mode.anchored is not None:
                mode.pose = holder @ mode.anchored

    def _follow(self, name: str, evidence: Evidence) -> None:
        """The simulation moves the object: perhaps it did not go along, or is still in its container."""
        thing, rates, followed = evidence.objects[name], self._parameters.rates, self.modes[FOLLOWED]
        before, pose = _placed(followed.pose), thing.believed
        if thing.gone and not self._told_gone:
            self._pass(FOLLOWED, GONE, rates.missed, Mode(0.0, None))
        self._told_gone = thing.gone
        if pose is None:
            if self._container in _names_of(self.modes, INSIDE_OF):
                followed.pose = self.modes[INSIDE_OF + self._container].pose
            return
        stay = _probability(rates.stayed * math.dist(before.t, pose.t))
        if self._container and thing.container != self._container:
            inside = self.modes.get(INSIDE_OF + self._container)
            if inside is not None:
                self._pass(FOLLOWED, INSIDE_OF + self._container, rates.kept, inside)
        self._container = thing.container
        followed.pose, followed.supports = pose, thing.supports
        if stay > 0.0:
            self._pass(FOLLOWED, LEFT, stay, self.modes.get(LEFT) or self._let_go(name, evidence))

    def _let_go(self, name: str, evidence: Evidence) -> Mode:
        """The mode in which it is where it was recognised last, or beneath that: nothing stays in the air by itself."""
        there = self.lying(name, self.left, evidence) if self._was_aloft else None
        pose, supports = (self.left, self._supports) if there is None else there
        return Mode(0.0, pose, supports=supports)

    def lying(self, name: str, pose: Pose, evidence: Evidence) -> SupportedPose | None:
        """Where the object lies once no hand has it any more at a place; None if nothing is known beneath."""
        solid = self.solid_at(pose)
        return None if solid is None else let_go(solid, evidence.beneath(name))

    def _flow(self, name: str, evidence: Evidence, step: float) -> None:
        """Events that nobody sees."""
        thing, rates, followed = evidence.objects[name], self._parameters.rates, self.modes[FOLLOWED]
        if thing.container and thing.believed is not None:  # remember where in it the object is, should it get out
            solid = evidence.objects[thing.container].solid
            if solid is not None:
                anchored = solid.pose.inverse() @ thing.believed
                self._mode(INSIDE_OF + thing.container, Mode(0.0, thing.believed, container=thing.container))
                self.modes[INSIDE_OF + thing.container].anchored = anchored
        hands = evidence.hands_free_of_others(name)
        near = [hand for hand, known in hands.items() if _is_near(known.pose, followed.pose)]
        for key, mode in list(self.modes.items()):
            if mode.pose is None:
                continue
            self._pass(key, GONE, _probability(rates.removed * step), Mode(0.0, None))
            if mode.elsewhere is not None:
                continue
            is_held = bool(mode.hand or (key == FOLLOWED and thing.hand))
            rate = rates.put_down if is_held else self._moving_rate(mode.pose, hands, rates)
            self._move(key, _probability(rate * step))
        for hand in near:
            if hand != thing.hand:
                known = hands[hand]
                taken = Mode(0.0, followed.pose, hand=hand, anchored=known.pose.inverse() @ _placed(followed.pose))
                self._pass(FOLLOWED, IN_HAND + hand, _probability(rates.taken * step), taken)

    def _work(self, thing: ObjectEvidence, begins: float) -> None:
        """With some probability, somebody begins to work, whom no camera sees, and may remove or move the object."""
        rates = self._parameters.rates
        for key, mode in list(self.modes.items()) if begins > 0.0 else ():
            before = mode.worked
            mode.worked = min(before + (1.0 - before) * begins, _AS_GOOD_AS_SURE)
            if mode.pose is None or mode.hand or (key == FOLLOWED and (thing.hand or thing.gripper)):
                continue
            new = (1.0 - before) * begins
            self._pass(key, GONE, new * rates.work_removed, Mode(0.0, None), worked=_AS_GOOD_AS_SURE)
            if mode.elsewhere is None:
                moved = (1.0 - rates.work_removed) * rates.work_moved
                self._move(key, new * moved, worked=_AS_GOOD_AS_SURE)

    def _move(self, source: str, share: float, worked: float | None = None, *, before: bool = False) -> None:
        """As `_pass`, to somewhere near; `before`: it went there before cameras began to look for it."""
        self._pass(source, ELSEWHERE, share, self._about(ELSEWHERE, self.modes[source].pose), worked, before=before)

    def _about(self, key: str, pose: Pose | None) -> Mode:
        """How a mode begins of places about a pose."""
        elsewhere = None if key in self.modes else HiddenPlaces(self._now)
        return Mode(0.0, pose, since=self._now, elsewhere=elsewhere)

    def _moving_rate(self, pose: Pose, hands: Mapping[str, HandEvidence], rates: Rates) -> float:
        is_near = any(_is_near(known.pose, pose) for known in hands.values())
        return rates.moved_by_hand if is_near else rates.moved

    def _enter(self, name: str, evidence: Evidence) -> None:
        """What vanishes on its way beside a container may be in it."""
        if self.before not in ON_ITS_WAY:
            return
        thing = evidence.objects[name]
        hollows = [
            (other, solid)
            for other, solid in ((other, known.solid) for other, known in sorted(evidence.objects.items()))
            if solid is not None and solid.is_hollow and other not in thing.containers and other != name
            if thing.solid is None or thing.solid.radius < solid.radius
            if _is_over(solid, self.left.t, 0.0 if thing.solid is None else thing.solid.radius)
        ]
        for other, solid in hollows:
            inside = Mode(0.0, Pose.unchecked(solid.position, self.left.q), container=other)
            inside.anchored = solid.pose.inverse() @ _placed(inside.pose)
            self._pass(FOLLOWED, INSIDE_OF + other, self._parameters.rates.entered / len(hollows), inside)

    def _go_on(self, thing: ObjectEvidence) -> None:
        """What vanished on its way may have gone on in any of many courses, and not as the simulation has it."""
        begins = thing.courses and not self._has_courses
        if begins:
            self._pass(FOLLOWED, ASTRAY, self._parameters.rates.astray, self._about(ASTRAY, self.left))
        if thing.courses and ASTRAY in self.modes:
            ways = [math.dist(pose.t[:2], self.left.t[:2]) for pose, _ in thing.courses]
            _elsewhere(self.modes[ASTRAY]).reach = math.sqrt(0.5 * fmean(way**2 for way in ways))
        for number, (pose, supports) in enumerate(thing.courses):
            key = f"{COURSE}{number}"
            if key in self.modes:
                self.modes[key].pose, self.modes[key].supports = pose, supports
            elif begins:
                share = self._parameters.rates.went_on / (len(thing.courses) - number * self._parameters.rates.went_on)
                self._pass(FOLLOWED, key, share, Mode(0.0, pose, supports=supports))
        self._has_courses |= bool(thing.courses)

    def _pass(
        self, source: str, target: str, share: float, new: Mode, worked: float | None = None, *, before: bool = False
    ) -> None:  # fmt: skip
        """Let a share of the weight of a mode go over to another one, which begins as `new`.

        What goes over has not been missed there yet: it loses weight as all that was there before did. But if it went
        `before` cameras began to look for it, it was missed as well.

        `worked` is the probability in that share that somebody was at work; None: as in the mode that it leaves.
        """
        origin = self.modes[source]
        amount = origin.weight * share
        if amount <= 0.0 or source == target:
            return
        mode = self._mode(target, new)
        worked = origin.worked if worked is None else worked
        if origin.weight > amount:
            origin.worked = min(
                max((origin.weight * origin.worked - amount * worked) / (origin.weight - amount), 0.0), 1.0
            )
        origin.weight -= amount
        if before and mode.elsewhere is not None:
            amount *= mode.elsewhere.hidden
        mode.worked = (mode.weight * mode.worked + amount * worked) / (mode.weight + amount)
        ratio = amount / (mode.weight + amount)
        if mode.hand and mode.anchored is not None and new.anchored is not None:  # taken at any time that counts
            mode.anchored = between(mode.anchored, new.anchored, ratio)
        if mode.elsewhere is not None and mode.pose is not None and new.pose is not None:
            (x, y, z), (to_x, to_y, to_z) = mode.pose.t, new.pose.t
            mode.pose = Pose.unchecked((x + ratio * (to_x - x), y + ratio * (to_y - y), max(z, to_z)), mode.pose.q)
            if before:
                mode.elsewhere.join_before(ratio)
            else:
                mode.elsewhere.join(ratio)
        else:
            whole = mode.weight * math.exp(mode.missed) + amount
            mode.missed = math.log(whole / (mode.weight + amount))
        mode.weight += amount

    def _mode(self, key: str, new: Mode) -> Mode:
        if key not in self.modes:
            new.since = self._now
            self.modes[key] = new
        return self.modes[key]

    def asked(self, name: str, evidence: Evidence, *, blind: bool) -> list[Solid]:
        """The object at all places of which it counts if cameras should see it there; `blind`: they see nothing."""
        thing = evidence.objects[name]
        self._solid = thing.solid or self._solid  # it may still be there, though the simulation has taken it away
        places = [_placed(mode.pose) for mode in self._asked(name, evidence, blind=blind).values()]
        for mode in () if blind else self._spread():
            about = self.places_about(name, mode, evidence, _elsewhere(mode).asked())
            places += [Pose.unchecked((x, y, z), _placed(mode.pose).q) for x, y, z in about.positions.tolist()]
        return [solid for solid in map(self.solid_at, places) if solid is not None]

    def _spread(self) -> list[Mode]:
        """The modes in which something unknown moved it, or stopped it."""
        return [mode for mode in self.modes.values() if mode.elsewhere is not None]

    def places_about(
        self, name: str, mode: Mode, evidence: Evidence, numbers: NDArray[np.intp] | None = None
    ) -> PossiblePlaces:  # fmt: skip
        """Where it may be in a mode of `HiddenPlaces`: all places, or some of these numbers."""
        pose = _placed(mode.pose)
        solid = self.solid_at(pose) or Solid(name, (0.0, 0.0, 0.0), pose.t, pose.q)
        carriers = _NOTHING if self.before == HOVERS else evidence.carriers  # whoever has it may still hold it
        return places_about(solid, self.deviation(mode, evidence.now), carriers, evidence.not_beneath(name), numbers)

    def deviation(self, mode: Mode, now: float) -> float:
        """Standard deviation (m) in each horizontal direction, of where it is in a mode of `HiddenPlaces`."""
        broad = self._parameters.elsewhere
        grown = broad.level**2 + broad.growth**2 * (now - mode.since)
        return math.sqrt(grown + _elsewhere(mode).reach ** 2)

    def solid_at(self, pose: Pose) -> Solid | None:
        """The object at a place; None if its size is unknown."""
        return None if self._solid is None else self._solid.at(pose.t, pose.q)

    def _asked(self, name: str, evidence: Evidence, *, blind: bool) -> dict[str, Mode]:
        """The modes of places. What is in a hand out of sight is with that, wherever that is, and not missing there."""
        placed = {key: mode for key, mode in self.modes.items() if mode.pose is not None and mode.elsewhere is None}
        if blind:
            is_there = FOLLOWED in placed and not evidence.objects[name].gone
            return {FOLLOWED: placed[FOLLOWED]} if is_there else {}
        return {
            key: mode for key, mode in placed.items() if not _is_with_hand_out_of_sight(key, mode, name, evidence)
        }

    def miss(self, name: str, evidence: Evidence, shares: Sequence[float], *, blind: bool) -> None:
        """The object is not seen: that speaks against all places where cameras should see it.

        That nothing is seen at all speaks against cameras that do not fail, and not against places.

        Args:
            name: of the object.
            evidence: of this moment.
            shares: of the places as of `asked`, how much cameras should see.
            blind: whether nothing is seen at all.
        """
        absence = self._parameters.absence
        step, self.looked = evidence.now - self.looked, evidence.now
        asked = self._asked(name, evidence, blind=blind)
        thing = evidence.objects[name]
        if self._vanishes and (blind or (thing.gone and evidence.has_vanished_alone(name))):
            self._vanishes = False
            if not (blind or evidence.hands):
                self._vanish(dict(zip(asked, shares, strict=False)).get(FOLLOWED, 0.0))
        for mode, share in zip(asked.values(), shares, strict=False):
            if blind:
                before = mode.missed + self.unshown
                self.unshown += missed_after(before, share, step, absence) - before
            else:
                missed = missed_after(mode.missed, share, step, absence)
                mode.weight *= math.exp(mode.missed - missed)
                mode.missed = missed
        about = shares[len(asked) :]
        for number, mode in enumerate(self._spread()):
            if told := about[number * LOOKED_AT : (number + 1) * LOOKED_AT]:
                mode.weight *= _elsewhere(mode).miss(told, evidence.now, absence)
            else:
                _elsewhere(mode).pass_over(step)

    def _vanish(self, share: float) -> None:
        """What rested in view is missing, and cameras should see a `share` (1) of it: it is somewhere near, or gone."""
        rates = self._parameters.rates
        self._move(FOLLOWED, rates.slipped * share, before=True)
        self._pass(FOLLOWED, GONE, rates.vanished * share, Mode(0.0, None))


def mode_circumstance(mode: Mode, evidence: Evidence) -> str:
    """The circumstance of an object in the hand of a mode."""
    return held(mode.hand, evidence) if mode.hand in evidence.hands else HELD_OUT_OF_SIGHT


def _is_with_hand_out_of_sight(key: str, mode: Mode, name: str, evidence: Evidence) -> bool:
    """Whether an object in a mode, or what it is in, is in a hand of which nobody knows where it is."""
    thing = evidence.objects[name]
    containers, hand = (thing.containers, thing.hand) if key == FOLLOWED else ((mode.container,), mode.hand)
    hands = {hand} | {evidence.objects[container].hand for container in containers if container in evidence.objects}
    return any(hand in evidence.hands and not evidence.hands[hand].is_seen for hand in hands)


def _holder(mode: Mode, evidence: Evidence) -> Pose | None:
    """world_from_holder of the hand or container of a mode; None without one."""
    if mode.hand:
        known = evidence.hands.get(mode.hand)
        return None if known is None else known.pose
    if mode.container:
        thing = evidence.objects.get(mode.container)
        return None if thing is None or thing.solid is None else thing.solid.pose
    return None


def _names_of(modes: dict[str, Mode], prefix: str) -> Iterator[str]:
    return (key.removeprefix(prefix) for key in modes if key.startswith(prefix))


def _is_near(palm: Pose, pose: Pose | None) -> bool:
    return pose is not None and math.dist(palm.t, pose.t) <= HAND_REACH


def _is_over(container: Solid, point: Vector3, radius: float) -> bool:
    """Whether a thing of that radius (m) there is over a container, or beside it so that they may touch; not below."""
    is_about = math.dist(point[:2], container.position[:2]) <= 0.5 * max(container.size[:2]) + radius
    return is_about and container.bottom <= point[2] + radius


def _elsewhere(mode: Mode) -> HiddenPlaces:
    assert mode.elsewhere is not None
    return mode.elsewhere


def _placed(pose: Pose | None) -> Pose:
    assert pose is not None
    return pose


def _probability(expected: float) -> float:
    """Probability of at least one of so many expected events."""
    return -math.expm1(-expected)


def speed_of(before: Pose | None, after: Pose | None) -> np.ndarray:
    """(3,) m/s between two stamped poses; zero if one is missing or no time has passed."""
    if before is None or after is None or after.stamp <= before.stamp:
        return np.zeros(3)
    velocity: np.ndarray = (np.array(after.t) - before.t) / (after.stamp - before.stamp)
    return velocity
