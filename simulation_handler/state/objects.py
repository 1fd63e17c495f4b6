"""The record of each believed object: its percepts, and where its body was put because of them."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dsr.math3d.quaternions import Quaternion, Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.perception.consensus import tells_rotation
from dsr.perception.scales import LIKELY_SIGMAS, RECENT_PERCEPTS, STEADY
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.perceived import PerceivedBody
from simulation_handler.contact.placement import Placement
from simulation_handler.contact.stances import OtherStance, Stance, is_sure, other_stances
from simulation_handler.contact.supports import UNKNOWN
from simulation_handler.perception.estimate import Estimate, RayError
from simulation_handler.perception.paths import Path
from simulation_handler.perception.percepts import Array, WeighedPercept
from simulation_handler.perception.systematic import ErrorOfAnother, KnownError
from simulation_handler.perception.tracking import PerceptTrack
from simulation_handler.scales import TILTED
from simulation_handler.shapes.geometry import Solid

_SURE_OF_TILT = 2.0 * (TILTED / LIKELY_SIGMAS) ** 2  # rad^2, likewise, about the two horizontal axes


@dataclass
class BelievedObject:
    """An object that exists, seen or not."""

    name: str
    size: Vector3
    """Edge lengths of its bounding box, m."""
    mass: float
    """Mass of the object, kg."""
    friction: float
    """Coulomb coefficient."""
    track: PerceptTrack
    shape: Shape = ()
    """Pieces of the object's shape; none for a solid box."""
    was_followed: bool = False
    """Whether its way from where it rested last to where it was seen last was followed: what hovers there was lifted.
    """
    rolling_friction: float | None = None
    """m, lever arm of the resistance to rolling; None if that is not known"""
    tagged: bool = True
    """Whether it has a tag; percepts that tell no rotation are by its colour all the same."""
    path: Path = field(default_factory=Path)
    """The path of the object as it was seen."""
    noise: float = 0.0
    """m, root mean square error of the newest percept, beside systematic errors"""
    driven: bool = False
    """Whether the object is on its way, and its body is driven along the seen path."""
    rides: bool = False
    """Whether the object is in or on a driven one: contact takes it along, and percepts count less."""
    placement: Placement | None = None
    """Placement to which perception last led; None if there is none."""
    put: Pose | None = None
    """Pose at which the body was last put; physics may have moved it since."""
    static: bool = False
    """Whether the body is held in place: it hovers, and nothing known carries it."""
    learned_error: RayError | None = None
    """Systematic error of its percepts, learned when it rests on something; None as long as nothing is known of it"""
    stance: Quaternion | None = None
    """How it is believed to be turned in the world, for percepts that do not tell; None as long as it has no place."""
    is_sure_of_stance: bool = True
    """Whether it is clear which of its sides is down, if that makes a difference of its height."""
    may_lean: bool = False
    """Whether something is beside it on which it may lean."""
    leans: bool = False
    """Whether it is believed to lean: its systematic error is then that of the others."""
    is_told_to_rest: bool = False
    """Whether its way, or an explanation, told that it rests where it is seen: percepts have yet to tell how."""
    is_recalled: bool = False
    """Whether its placement is where an earlier run has left it."""
    aslant: tuple[float, PerceivedBody] | None = None
    """Probability that it leans, known how or not, and where it is perceived then; None if nothing says so."""
    otherwise: tuple[OtherStance, ...] = ()
    """How it may rest instead of in `stance`, as far as percepts tell"""
    hovering_since: float | None = None
    """Time (s) since when the object hovers; None if it does not."""
    prop: Solid | None = None
    """An unknown support that explains why the object hovers; None if there is none."""
    strikes: int = 0
    """Number of recent times when physics moved the body from its percept."""
    last_strike: float = 0.0
    """Time (s) of the last strike."""
    restarts: int = 0
    """Number of restarts of the track when it was last looked at."""
    holder: str = ""
    """Name of the gripper that holds the object; percepts then say nothing of it. Empty for none."""
    hand: str = ""
    """Name of the human hand that holds the object: while the object is unseen, it goes with the hand.

    Empty for none.
    """
    let_go_at: float = -math.inf
    """Time (s) when a hand was last known to let go of the object"""
    shows_rotation: bool = True
    """Whether percepts tell the object's rotation."""
    shows_tilt: bool = True
    """Whether percepts tell how the object leans, if not its yaw."""
    turned_by_hand: Quaternion | None = None
    """Rotation in the world that the hand tells, for objects whose percepts tell none, such as those by colour; None
    without one.
    """
    place_by_hand: Vector3 | None = None
    """Position (m, world) where the visible hand that holds the object has it; None otherwise."""
    confirmed: Solid | None = None
    """Where perception last agreed that it is, unless it has moved since with something, or in a gripper."""
    gone: bool = False
    """Whether the object was taken out of the scene."""
    seen_by: dict[str, float] = field(default_factory=dict)
    """Stamp (s) of the newest percept from each camera."""
    seen_from: Vector3 | None = None
    """(3,) m, world: where the camera of the newest percept is believed to be; None if nobody knows"""
    agreed: tuple[Solid, Solid] | None = None
    """Percept and body that were found at the same place last, but for noise"""
    _percept: tuple[tuple[Array, Array, Quaternion, float], Solid] | None = None
    """What `percept` was worked out of the last time, and what it was"""

    def estimate_at(self, now: float) -> Estimate | None:
        """The estimate from percepts at `now` (s); None while the object is not seen."""
        return self.track.estimate_at(now)

    def cameras_at(self, now: float) -> frozenset[str]:
        """Names of the cameras that have lately seen the object, at `now` (s)."""
        return frozenset(camera for camera, stamp in self.seen_by.items() if self.track.is_recent(stamp, now))

    def note(self, percept: WeighedPercept, camera: str, seen_from: Vector3 | None = None) -> None:
        """Take note of a percept from a camera that is there (m, world), which its track has taken in."""
        self.seen_by[camera], self.seen_from = percept.stamp, seen_from
        x, y, z = self.corrected(percept).tolist()
        place, turn = percept.covariances.tolist()
        self.noise = math.sqrt(place[0][0] + place[1][1] + place[2][2])
        self.shows_rotation = tells_rotation(percept.rotation_covariance)
        self.shows_tilt = turn[0][0] + turn[1][1] < _SURE_OF_TILT
        rotation = percept.rotation if self.shows_stance else self.turned_by_hand or self.stance or percept.rotation
        self.path.add(Pose.unchecked((x, y, z), rotation, percept.stamp))

    def note_lateness(self, late: Mapping[str, float]) -> None:
        """Take note of the seconds by which cameras are late, by name; of those that saw it last, the best counts."""
        self.track.late = min((late.get(camera, 0.0) for camera in self.cameras_at(self.track.last_stamp)), default=0.0)

    def is_shown(self, now: float, late: float) -> bool:
        """Whether it has an estimate from percepts, and was seen lately if cameras are so late (s)."""
        return self.track.estimate_at(now) is not None and self.track.is_recent(self.track.last_stamp + late, now)

    def recall_seen(self, world_pose: Pose, stamp: float, camera: str) -> None:
        """Know where and when (s) a camera last saw it on its way; for where it is now that counts no more."""
        self.path.add(Pose.unchecked(world_pose.t, world_pose.q, stamp))
        self.track.last_stamp = max(self.track.last_stamp, stamp)
        self.seen_by[camera] = max(self.seen_by.get(camera, -math.inf), stamp)

    @property
    def falls(self) -> bool:
        """Whether the object was falling when it was last seen: its way in a hand since then does not tell that."""
        return self.path.is_falling and self.path.newest <= self.track.last_stamp

    @property
    def is_in_air(self) -> bool:
        """Whether the object was seen where nothing known carries it, when it was last seen."""
        return self.static or self.hovering_since is not None

    @property
    def vanished_when_let_go(self) -> bool:
        """Whether the object was not seen any more after a hand had let go of it."""
        return self.track.last_stamp <= self.let_go_at

    @property
    def is_led(self) -> bool:
        """Whether its body goes where something else goes: percepts do not put it anywhere by themselves."""
        return bool(self.holder) or self.driven or self.rides

    @property
    def error_mean(self) -> float:
        """m, the likeliest systematic error of its percepts along the viewing ray."""
        return 0.0 if self.learned_error is None else self.learned_error.mean

    def error_std(self, config: BeliefConfig) -> float:
        """m, what is not known of the systematic error of its percepts: standard deviation."""
        return config.depth_bias if self.learned_error is None else self.learned_error.std

    def corrected(self, percept: WeighedPercept) -> Array:
        """(3,) m, where a percept has it, without the likeliest systematic error."""
        return np.subtract(percept.position, self.error_mean * percept.ray)

    @property
    def shows_stance(self) -> bool:
        """Whether percepts tell which of its sides is down."""
        return self.shows_rotation or self.shows_tilt

    def take_stances(self, found: Sequence[Stance], config: BeliefConfig) -> None:
        """Take in how it may rest, the likeliest first; as it is perceived, for sure, if nothing can carry it."""
        if not found:
            self.stance, self.is_sure_of_stance, self.otherwise = self.percept().rotation, True, ()
            return
        self.stance, self.is_sure_of_stance = found[0].solid.rotation, is_sure(found, config)
        self.otherwise = other_stances(found)

    def percept(self) -> Solid:
        """The object at its perceived pose, without the known systematic error; turned as it is believed to be, if
        percepts do not tell that.
        """
        estimate = self.track.estimate
        assert estimate is not None
        rotation = estimate.rotation if self.shows_stance else self.stance or estimate.rotation
        told = estimate.position, estimate.ray, rotation, self.error_mean
        if self._percept is None or not all(map(operator.is_, told, self._percept[0])):
            x, y, z = estimate.corrected(self.error_mean).tolist()
            self._percept = told, self.solid((x, y, z), rotation)
        return self._percept[1]

    def solid(self, position: Vector3, rotation: Quaternion) -> Solid:
        """The object there."""
        return Solid(self.name, self.size, position, rotation, shape=self.shape)

    def percept_covariance(self, config: BeliefConfig) -> Array:
        """(3, 3) m^2 of the position of `percept`."""
        assert self.track.estimate is not None
        return self.track.estimate.total_covariance(self.error_std(config))

    def known_error(self) -> KnownError | None:
        """The systematic error of its percepts, if it rests on something as is believed for sure."""
        error = self.learned_error
        if error is None or not error.is_known or self.leans or not self.is_sure_of_stance:
            return None
        return KnownError(error.mean, self.may_lean)

    def told_by_others(self, error: ErrorOfAnother) -> PerceivedBody:
        """Where it is perceived by what other objects tell of the systematic error.

        What its own percepts told was learned from how it was taken to rest.
        """
        estimate, (mean, std, freedom) = self.track.estimate, error
        assert estimate is not None
        x, y, z = estimate.corrected(mean).tolist()
        turning = self.turning() if self.shows_stance else self.turning_of_one()
        return PerceivedBody(self.percept().moved((x, y, z)), estimate.total_covariance(std), turning, freedom)

    def turning(self) -> Array:
        """(3, 3) rad^2 of the rotation of `percept`."""
        assert self.track.estimate is not None
        return self.track.estimate.total_turning()

    def turning_of_one(self) -> Array:
        """(3, 3) rad^2 of the rotation of its newest percept: what none of them tells, their average does not tell."""
        covariance: Array = self.track.trail[-1].rotation_covariance
        return covariance

    def is_carried(self) -> bool:
        """Whether a body of the simulation carries the object, so that it needs no holding."""
        if self.placement is None or self.placement.is_held:
            return False
        return any(name != UNKNOWN for name in self.placement.supports)

    def adopt(self, placement: Placement) -> None:
        """Take over a new placement."""
        if self.placement is not None and self.placement.supports != placement.supports:
            self.strikes = 0
        self.placement, self.is_recalled = placement, False
        if UNKNOWN not in placement.supports:
            self.prop = None

    def know(self, placement: Placement) -> None:
        """Take in how well perception knows by now where the object is, whose body stays at its placement.

        The covariance is about that: it has the noise of all percepts so far, and how far they are from there. Once
        its height is known, noise across the viewing ray is all that is left. The scatter of percepts tells how much
        that is.
        """
        assert self.placement is not None and self.track.estimate is not None
        off = np.subtract(placement.solid.position, self.placement.solid.position)
        share = self.track.estimate.noise_shares[0] if placement.rests else 1.0
        covariance = share * placement.covariance + off[:, None] * off
        self.placement = self.placement._replace(covariance=covariance)

    def rest(self, placement: Placement, solid: Solid, now: float) -> None:
        """Take over the placement of an explanation, put at `solid` at time `now` (s).

        If perception had not changed, it was physics that moved the object from where it is seen.
        """
        self.adopt(placement._replace(solid=solid))
        if self.restarts == self.track.restarts:
            self.strike(now)
        self.notice_restart()
        self.hovering_since, self.gone, self.is_told_to_rest = None, False, True

    def leave_to_physics(self) -> None:
        """Forget all percepts of the object, and leave its body to physics."""
        self.track.forget()
        self.placement = self.prop = self.confirmed = None
        self.gone = False

    def learn_error(self, placement: Placement) -> None:
        """Learn the systematic error of its percepts, if it has been resting on something known for a while."""
        estimate = self.track.estimate
        if self.is_carried() and estimate is not None and estimate.count >= RECENT_PERCEPTS:
            self.learned_error = estimate.error_given(placement.solid.position[2])

    def strike(self, now: float) -> None:
        """Physics moved it from where it is seen."""
        self.strikes = self.strikes + 1 if now - self.last_strike <= STEADY else 1
        self.last_strike = now

    def notice_restart(self) -> None:
        """Forget what counts for percepts until now, if the object has moved since the last call."""
        if self.restarts != self.track.restarts:
            self.restarts, self.strikes, self.is_told_to_rest = self.track.restarts, 0, False

    def has_left(self, pose: Pose, config: BeliefConfig) -> bool:
        """Whether the object's body, now at `pose`, has left the pose at which it was put."""
        if self.put is None or self.static:
            return False
        return not PoseTolerance(config.divergence, config.divergence_angle).covers(self.put, pose)

    def covariances(self) -> tuple[Array, Array] | None:
        """(3, 3) m^2 and rad^2 of the believed position and rotation, in the world frame, once it was perceived."""
        estimate = self.track.estimate
        if self.placement is None or estimate is None:
            return None
        return self.placement.covariance, estimate.noise_shares[1] * estimate.rotation_covariance
