"""All tolerances of the belief in one place."""

from __future__ import annotations

import math

import msgspec

from dsr.believing.worlds import MOST_WORLDS
from dsr.config.plugins import EXPLAINERS, REASONERS, checked_name
from dsr.perception.noise import PerceptNoise
from dsr.perception.scales import (
    AT_REST,
    CONFIRM_FRAMES,
    CONFIRMED_IN,
    CONTACT_DELAY,
    FRAME,
    LIKELY_SIGMAS,
    SAME_PLACE,
    STEADY,
    SURE_SIGMAS,
    UNSEEN_AFTER,
    WINDOW,
)
from dsr.vocabulary.nats import AS_GOOD, MOVED, SURPRISING
from simulation_handler.scales import FRICTION, GRAVITY, PLACE_FLOOR, TILTED, TURN_FLOOR


class BeliefConfig(PerceptNoise, frozen=True, forbid_unknown_fields=True):
    """How far percepts are trusted, and when the belief changes.

    The defaults are for a tabletop seen by an RGB-D camera at 0.3 to 1 m: systematic depth errors of 5-15 mm,
    noise of a few millimetres, 10 percepts a second.
    """

    tilt_tolerance: float = TILTED
    """rad that a percept may be tilted by noise alone."""

    gate: float = math.sqrt(2.0 * SURPRISING)
    """Standard deviations (Mahalanobis) beyond which a percept disagrees with the track: it is surprising there."""
    recent_gate: float = math.sqrt(2.0 * (SURPRISING - math.log(FRAME)))
    """Standard deviations beyond which the mean of some of the last ten percepts disagrees with the track.
    Each percept tests the means of the last three, four ... ten: up to eight tests, most of which tell the same. The
    gate is wider than that of a single percept for as many tests as there are percepts in a second.
    """
    regained_gate: float = math.sqrt(2.0 * (MOVED - math.log(FRAME)))
    """The same, beyond which what is seen again is not where it was: nobody would have seen that it was moved."""
    confirm_frames: int = CONFIRM_FRAMES
    """Percepts in a row that must disagree before the object has moved: fewer may be false."""
    window: int = WINDOW
    """Percepts over which a resting object is averaged."""
    perceived_max_age: float = UNSEEN_AFTER
    """s without a percept after which an object is unseen and left to physics (Sallami et al., Table I)."""

    divergence: float = PLACE_FLOOR
    """m that physics may move a body from where perception put it; beyond, they disagree."""
    divergence_angle: float = TURN_FLOOR
    """rad that physics may turn a body from where perception put it; beyond, they disagree."""
    strikes: int = confirm_frames
    """Disagreements between physics and steady perception after which the object is held where it is seen."""
    explain_after: float = STEADY
    """s that an object must hover before something unseen is put beneath it."""
    explain_sigmas: float = LIKELY_SIGMAS
    """Standard deviations of an object's height by which a stack beneath it may miss this height."""

    reasoner: str = "belief"
    """Name of the method that keeps the belief: "belief" for the built-in one, or one that a package provides."""
    parameters: dict[str, float] = msgspec.field(default_factory=dict)
    """Parameters of a reasoner that a package provides, by name."""

    policy: str = "hypotheses"
    """Name of the method that explains surprises: by simulated hypotheses, or one that a package provides."""
    surprise_distance: float = SAME_PLACE
    """m between percept and belief from which that is not noise but needs an explanation."""
    unflagged_after: float = AT_REST
    """s after which something surprising is explained even though nobody has flagged it."""
    follow_for: float = STEADY
    """s after an explanation in which the same object may go on moving without a new flag."""
    look_again_after: float = CONFIRMED_IN
    """s between two attempts to explain something that could not be explained: new percepts may tell more."""
    most_rollouts: int = 48
    """Hypotheses that are simulated for one explanation."""
    explain_margin: float = AS_GOOD
    """nats by which the best hypothesis must lead, while more evidence is to come."""
    explain_patience: float = STEADY
    """s of evidence after which the best hypothesis is taken, however small its lead."""
    explain_budget: float = 0.5 * explain_patience
    """s of wall time for the simulations of one explanation, on worker processes: two fit into the patience."""
    workers: int = 0
    """Processes that simulate hypotheses, live; 0 for none but the agent's own. In lockstep there are none."""

    worlds: int = MOST_WORLDS
    """Alternatives of the belief, at most, that are worlds of the memory: `belief_1`, `belief_2`, ... 0 for none."""

    relation_delay: float = CONTACT_DELAY
    """s that a contact must last (or be gone) before the relation `on` begins (or ends)."""
    floor_below_table: float = 0.72
    """m from the lowest table top (or from z = 0 without a table) down to the floor."""
    rollout_seconds: float = math.sqrt(2.0 * floor_below_table / GRAVITY)
    """s for which each hypothesis is simulated; by default as long as a fall from a table to the default floor."""
    default_mass: float = 0.1
    """kg, of an object whose node has no mass."""
    default_friction: float = FRICTION
    """Coulomb coefficient of a body whose node has none."""

    @property
    def hover_tolerance(self) -> float:
        """Metres that a percept may be above or below its support by noise alone; beyond, something else holds it."""
        return SURE_SIGMAS * math.hypot(self.depth_bias, self.depth_noise, PLACE_FLOOR)

    @property
    def surprise_angle(self) -> float:
        """Radians of rotation from the belief, from which an object needs an explanation; noise of its tilt is less."""
        return self.gate * math.hypot(TURN_FLOOR, self.tilt_noise)

    def __post_init__(self) -> None:
        checked_name(REASONERS, self.reasoner, ("belief",))
        checked_name(EXPLAINERS, self.policy, ("hypotheses",))
