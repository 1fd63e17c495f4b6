"""Expectations of the working memory: one struct per check, told apart by `check`.

A check is judged `at` a time (default: the end). Those with `after` look at the whole window from there on;
its default is the scenario's `settle`. `objects` defaults to all objects that are then in the true world.
"""

from __future__ import annotations

from typing import Annotated, get_args

import msgspec
from msgspec import Meta

from agents.scenario.format.units import Count, Noise, Seconds, Share, Turn, Vector3
from dsr.network.keys import BASE


class Expectation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="check"):
    """A check of the working memory, and the time when it is judged."""

    at: Seconds | None = None
    """s after the start, or after `event`; default: the end"""
    event: int | None = None
    """Number of an event in the file, from 1: times of this check count from when its motion has ended."""

    @property
    def named_objects(self) -> tuple[str, ...]:
        """Names of the objects that the check mentions."""
        return ()


class OfObjects(Expectation, frozen=True, kw_only=True):
    """A check of each of some objects."""

    objects: tuple[str, ...] | None = None
    """Default: all objects that are in the true world at that time."""

    @property
    def named_objects(self) -> tuple[str, ...]:
        """The objects listed."""
        return self.objects or ()


class Windowed(OfObjects, frozen=True, kw_only=True):
    """A check of all moments from `after` until it is judged."""

    after: Seconds | None = None
    """s after the start, or after `event`; default: the scenario's `settle`, or when the event has ended"""


class BeliefCloser(Windowed, frozen=True, kw_only=True, tag="belief_closer_than_percept"):
    """While seen, the belief is closer to the truth than the percept on average over the window."""


class NoInterpenetration(Windowed, frozen=True, kw_only=True, tag="no_interpenetration"):
    """No belief overlaps another one, or the table, deeper than `tolerance` at any moment of the window."""

    tolerance: Noise = 0.0005
    """m, greatest depth of an overlap"""


class NoDrift(Windowed, frozen=True, kw_only=True, tag="no_drift"):
    """The belief never gets further than `tolerance` from where it was when the window began."""

    tolerance: Noise = 0.001
    """m, greatest distance from the first place"""


class Resting(OfObjects, frozen=True, kw_only=True, tag="resting"):
    """The belief stands on the table or on another belief, gap at most `tolerance`, and is still."""

    tolerance: Noise = 0.001
    """m, greatest gap"""


class RestingHeight(OfObjects, frozen=True, kw_only=True, tag="resting_height"):
    """The height of the belief differs from the true one by at most `tolerance`."""

    tolerance: Noise = 0.001
    """m, greatest difference of height"""


class BeliefError(OfObjects, frozen=True, kw_only=True, tag="belief_error"):
    """The belief is within `tolerance` of the truth, and within `angle` if that is given."""

    tolerance: Noise = 0.005
    """m, greatest distance from the truth"""
    angle: Turn | None = None
    """rad; default: the rotation is not judged"""
    after: Seconds | None = None
    """If given, this holds at every moment from then on."""
    at_rest: bool = False
    """Only moments count at which the true object lies still and nobody holds it; there must be one."""
    share: Share = 1.0
    """Share of the moments that count, in which the belief must be right."""


class Perceived(OfObjects, frozen=True, kw_only=True, tag="perceived"):
    """The attribute `perceived` of the objects is `value`."""

    value: bool = True


EXACT = 1e-9
"""Difference up to which numbers of an attribute are equal, whatever its unit: the rounding of a few operations."""


class Attribute(Expectation, frozen=True, kw_only=True, tag="attribute"):
    """The attribute `name` of `node` equals `value` (numbers: within `tolerance`)."""

    node: str
    name: str
    value: bool | int | float | str
    tolerance: Annotated[float, Meta(ge=0)] = EXACT
    """Greatest difference of numbers, in the unit of the attribute."""


class Edges(Expectation, frozen=True, kw_only=True, tag="edges"):
    """All edges `present` are in the graph and none that is `absent`; each is a pair source, destination."""

    after: Seconds | None = None
    """If given, this holds at every moment from then on."""

    type: str = "on"
    present: tuple[tuple[str, str], ...] = ()
    absent: tuple[tuple[str, str], ...] = ()
    world: str = BASE
    """Name of the world with the edges."""


class KnownIn(OfObjects, frozen=True, kw_only=True, tag="known_in"):
    """In a world, each of the objects has a place; of what is not given here, nothing is asked."""

    world: str
    objects: tuple[str, ...]
    after: Seconds | None = None
    """If given, this holds at every moment from then on."""
    value: bool = True
    """False: none of them has a place there, whether they have a node or not."""
    position: Vector3 | None = None
    """m, where they are there, in the frame `world`"""
    right: bool | None = None
    """Whether the objects are at their true places; None if this does not matter."""
    tolerance: Noise = 0.03
    """m, of `position` and `right`"""
    perceived: bool | None = None
    """The attribute `perceived` there."""


class WorldsCheck(Expectation, frozen=True, kw_only=True, tag="worlds"):
    """The worlds `present` are in the list of worlds, and none that is `absent`."""

    ever: bool = False
    """Whether one moment from the start, or from `after`, is enough."""

    after: Seconds | None = None
    """If given, this holds at every moment from then on."""
    present: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()


class Inside(Expectation, frozen=True, kw_only=True, tag="inside"):
    """The memory holds an edge `in` for each pair (object, container) of `present`, and none of `absent`."""

    after: Seconds | None = None
    """If given, this holds at every moment from then on."""
    present: tuple[tuple[str, str], ...] = ()
    absent: tuple[tuple[str, str], ...] = ()

    @property
    def named_objects(self) -> tuple[str, ...]:
        """Both of each pair."""
        return tuple(name for pair in (*self.present, *self.absent) for name in pair)


class ActionsCheck(OfObjects, frozen=True, kw_only=True, tag="actions"):
    """The actions that were inferred about the objects (default: all of the file) until it is judged.

    Terms are `Pick(cup)`, `Pick(cup, human_hand_0)`, or `Release` for one of anything.
    """

    after: Seconds | None = None
    """s after the start, or after `event`, from when on they count; default: 0"""
    sequence: tuple[str, ...] | None = None
    """All actions in the order in which they happened: neither one more nor one less."""
    present: tuple[str, ...] = ()
    """Each was inferred, whatever else."""
    absent: tuple[str, ...] = ()
    """Actions of which none was inferred."""

    @property
    def terms(self) -> tuple[tuple[str, int, str], ...]:
        """All terms of the check, each with its field and index there."""
        fields = {"sequence": self.sequence or (), "present": self.present, "absent": self.absent}
        return tuple((field, index, term) for field, terms in fields.items() for index, term in enumerate(terms))


class Recovered(Expectation, frozen=True, kw_only=True, tag="recovered"):
    """The agent, killed by an event, runs again no later than `within` seconds after."""

    agent: str
    within: Seconds = 10.0


class ArmsApart(Expectation, frozen=True, kw_only=True, tag="arms_apart"):
    """In the true world, no two arms, with what they hold, come closer to one another than `least`."""

    least: Noise = 0.02
    """m, least distance between two arms"""
    after: Seconds = 0.0
    """s after the start"""


class TrueRelationsCheck(Expectation, frozen=True, kw_only=True, tag="true_relations"):
    """In the true world, what is `present` rests on one another and what is `absent` does not."""

    present: tuple[tuple[str, str], ...] = ()
    absent: tuple[tuple[str, str], ...] = ()


class RelationsRight(OfObjects, frozen=True, kw_only=True, tag="relations_right"):
    """The edges `on` of the objects are those of the true world: neither one more nor one less."""


class BeliefRecovered(OfObjects, frozen=True, kw_only=True, tag="belief_recovered"):
    """After each perturbation has ended, all beliefs are within `tolerance` of the truth no later than `within`,
    and stay there until the object is moved again. Every event of the file must have happened.
    """

    within: Seconds = 1.5
    tolerance: Noise = 0.005
    """m, greatest distance from the truth"""


class Gone(OfObjects, frozen=True, kw_only=True, tag="gone"):
    """The objects are believed to have left the scene: `present` is false; no belief of a pose, no edge `on`."""

    objects: tuple[str, ...]


class Surprising(OfObjects, frozen=True, kw_only=True, tag="surprising"):
    """The attribute `surprising` of the objects is `value`; a node without it is not surprising."""

    value: bool = False


class SurprisesCheck(OfObjects, frozen=True, kw_only=True, tag="surprises"):
    """The number of times the objects have become surprising, all together, from `after` until the check is judged."""

    after: Seconds | None = None
    """s after the start, or after `event`; default: 0"""
    least: Count = 0
    most: Count | None = None


class CameraError(Expectation, frozen=True, kw_only=True, tag="camera_error"):
    """The scenario's camera is believed to be within `tolerance` and `angle` of where it truly is."""

    tolerance: Noise = 0.003
    """m, greatest distance from the truth"""
    angle: Turn = 0.00524
    """rad, greatest angle to the truth"""


class Calibrations(Expectation, frozen=True, kw_only=True, tag="calibrations"):
    """The number of times a pose of a camera was adopted, or taken back, until the check is judged."""

    least: Count = 0
    most: Count | None = None


class MissionCheck(Expectation, frozen=True, kw_only=True, tag="mission"):
    """The last status of the mission is `status`."""

    status: str = "reached"


class Replans(Expectation, frozen=True, kw_only=True, tag="replans"):
    """The number of new plans for the mission until the check is judged."""

    least: Count = 0
    most: Count | None = None


Check = (
    BeliefCloser
    | NoInterpenetration
    | NoDrift
    | Resting
    | RestingHeight
    | BeliefError
    | Perceived
    | Attribute
    | Edges
    | KnownIn
    | WorldsCheck
    | Recovered
    | TrueRelationsCheck
    | RelationsRight
    | BeliefRecovered
    | Gone
    | Surprising
    | SurprisesCheck
    | MissionCheck
    | Replans
    | Inside
    | ActionsCheck
    | CameraError
    | Calibrations
    | ArmsApart
)
CHECKS: dict[str, type[Check]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Check)}
"""The kinds of expectation by their `check`."""
