"""An episode in the making: its camera, its things and where they stand, and what happens when."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence

from agents.colors import APART, FLOOR, GREY, SKIN, SLEEVE, TABLE, spectral_angle
from agents.scenario.format.model import (
    NO_ROBOT,
    CameraSpec,
    ObjectSpec,
    PersonSpec,
    RobotSpec,
    Scenario,
    SensorSpec,
    TableSpec,
)
from agents.scenario.format.scenario import Carry, Event, HandGraspEvent, HandLeave, HandMove, HandRelease, Slide
from agents.scenario.generate.bodies import SOLIDS, LooseBody, floor_of
from agents.scenario.generate.draw import Draw, NumberRange
from dsr.errors import ConfigError
from dsr.math3d.quaternions import Vector3
from dsr.vocabulary import tags

TOP = 0.72
"""m, world z of the table's top: the floor is at 0"""
WIDTH, LENGTH = NumberRange(0.8, 1.0), NumberRange(1.0, 1.3)
"""m, of the table along x and y"""
ARENA = 0.34
"""m from the middle of the table, within which things stand: any camera that is drawn sees them there"""
DISTANCE, ELEVATION = NumberRange(1.0, 1.4), NumberRange(0.5, 1.1)
"""m and rad, of a camera from the middle of the table and above its top: tags are read up to 1.5 m"""
GAP = 0.015
"""m, least gap between things that stand side by side: for fingers, and for the noise of percepts"""
CLEARANCE = 0.0005
"""m, by which things are put down above what they are put on, so that nothing is pressed into anything"""
HAND_SPEED = NumberRange(0.15, 0.35)
"""m/s, of hands that move things: from careful to quick"""
FIRST = NumberRange(2.5, 3.5)
"""s after the start, of the first event: everything in view was seen for 2 s before"""
PAUSE = NumberRange(0.3, 2.0)
"""s between two events"""
LAST = NumberRange(2.5, 4.5)
"""s from the end of the last event to the end of the episode: what rolls comes to rest"""
SETTLE = 2.0
"""s from which on the belief is judged: ten percepts at least of all that is in view"""
MOST_OBJECTS = 9
"""Objects in one episode; the fewest are two."""
TAGGED = 0.5
"""Share of the things with room for a tag that have one; the others are recognised by their colour"""

_COMING, _GOING_ON = 2.6, 4.0  # s at most, of a hand that comes, or is elsewhere, until it holds something
_LETTING_GO, _LEAVING = 0.8, 1.3  # s at most
_TURNING = 2.0  # rad/s at which what is carried turns
_TRIES = 200  # draws of a place or a colour before the whole episode is drawn anew


class CrowdedError(ConfigError):
    """An episode in which a thing found no place, or no colour of its own: it is drawn anew."""


class EpisodeDraft:
    """An episode in the making.

    Args:
        draw: source of chance.
        system: which agents take part.
    """

    def __init__(self, draw: Draw, system: str = "reasoner") -> None:
        self.draw = draw
        self.system = system
        self.table = TableSpec(size=(draw.number(WIDTH), draw.number(LENGTH), 0.04), position=(0.0, 0.0, TOP))
        self.camera = _camera(draw)
        self.sensor = SensorSpec()
        self.persons: list[PersonSpec] = []
        self.objects: list[ObjectSpec] = []
        self.events: list[Event] = []
        self.bodies: dict[str, LooseBody] = {}
        """Those that stand somewhere, by name."""
        self.now = draw.number(FIRST)
        """s after the start, when the next event may begin"""
        self.speed = draw.number(HAND_SPEED)
        """m/s, of hands that move things"""
        self._spots: dict[str, tuple[float, float, float]] = {}
        self._present: set[int] = set()

    def scenario(self, name: str, title: str) -> Scenario:
        """The finished episode."""
        last = max([self.now, *(event.at or 0.0 for event in self.events)])
        return Scenario(
            name=name,
            title=title,
            system=self.system,
            duration=round(last + self.draw.number(LAST), 1),
            settle=SETTLE,
            camera=self.camera,
            robot=RobotSpec(model=NO_ROBOT),
            table=self.table,
            sensor=self.sensor,
            persons=self.persons,
            objects=self.objects,
            events=self.events,
        )

    def free_spot(self, radius: float, within: float = ARENA) -> tuple[float, float]:
        """A free place (m, world) for something of that radius (m), at most `within` m from the table's middle."""
        for _ in range(_TRIES):
            x, y = self.draw.within(max(within - radius, 0.0))
            if self.is_free((x, y), radius):
                return x, y
        raise CrowdedError("no room on the table")

    def is_free(self, spot: tuple[float, float], radius: float) -> bool:
        """Whether something of that radius (m) may stand at a place (m, world) beside all that stands."""
        x, y = spot
        return all(math.hypot(x - a, y - b) >= radius + r + GAP for a, b, r in self._spots.values())

    @property
    def standing(self) -> list[str]:
        """Names of the things that stand on the table by themselves when the drawn events are over."""
        return list(self._spots)

    def spot(self, name: str) -> tuple[float, float]:
        """Where a thing stands when the drawn events are over (m, world)."""
        x, y, _ = self._spots[name]
        return x, y

    def occupy(self, name: str, spot: tuple[float, float]) -> None:
        """A thing stands there from now on."""
        self._spots[name] = (*spot, self.bodies[name].radius)

    def vacate(self, name: str) -> None:
        """A thing is not on the table any more."""
        self._spots.pop(name, None)

    def stand(self, body: LooseBody, spot: tuple[float, float] | None = None, *, yaw: float | None = None) -> str:
        """Let a body stand on the table, at `spot` (m, world) or anywhere; returns its name."""
        x, y = spot or self.free_spot(body.radius)
        name = self.add(body, (x, y, TOP + body.size[2] / 2), yaw=yaw)
        self.occupy(name, (x, y))
        return name

    def put_on(self, body: LooseBody, lower: str) -> str:
        """Let a body stand on another one from the start, not quite in its middle; returns its name."""
        below = next(spec for spec in self.objects if spec.name == lower)
        x, y, z = below.position
        dx, dy = self.draw.within(0.15 * min(below.size[:2]))  # of the edge: the centre stays over the support
        top = z + below.size[2] / 2 + body.size[2] / 2
        return self.add(body, (x + dx, y + dy, top))

    def put_in(self, body: LooseBody, vessel: str) -> str:
        """Let a body lie in a vessel from the start, or stand under a cover; returns its name."""
        around = next(spec for spec in self.objects if spec.name == vessel)
        x, y, z = around.position
        bottom = z - around.size[2] / 2 + floor_of(self.bodies[vessel])
        return self.add(body, (x, y, bottom + body.size[2] / 2))

    def add(
        self, body: LooseBody, position: Vector3, *, yaw: float | None = None, lean: Vector3 = (0.0, 0.0, 0.0)
    ) -> str:
        """Add a body somewhere in the air or on something; returns its name."""
        name = f"{body.what}_{1 + sum(other.what == body.what for other in self.bodies.values())}"
        self.bodies[name] = body
        tagged = body.can_have_tag and not any(lean) and self.draw.chance(TAGGED)
        self.objects.append(
            ObjectSpec(
                name=name,
                type=body.type,
                size=body.size,
                shape=body.shape,
                mass=body.mass,
                friction=body.friction,
                rolling_friction=body.rolling_friction,
                marker_id=self._free_marker() if tagged else None,
                color=self._free_color(),
                position=(round(position[0], 4), round(position[1], 4), round(position[2], 4)),
                yaw=self.draw.angle() if yaw is None else yaw,
                lean=lean,
                known=True,
            )
        )
        return name

    def bystanders(self, least: int = 0) -> list[str]:
        """Some more solid things that nothing need happen to; returns their names. At least two things stand then."""
        most = min(MOST_OBJECTS - len(self.objects), 4)
        fewest = max(least, 2 - len(self.objects))
        wanted = self.draw.count(fewest, max(fewest, most))
        return [self.stand(self.draw.one_of(SOLIDS)(self.draw)) for _ in range(wanted)]

    def on_table(self, name: str) -> float:
        """World z (m) of a thing's centre when it is put down on the table."""
        return TOP + self.bodies[name].size[2] / 2 + CLEARANCE

    def do(self, event: Event, seconds: float) -> None:
        """Let an event happen that takes at most so long, and a pause after it."""
        self.events.append(event)
        self.now = round(self.now + seconds + self.draw.number(PAUSE), 2)

    def carry(self, name: str, to: Vector3, *, hand: int | None, height: float = 0.15) -> None:
        """Let a thing be carried somewhere (m, world), by a hand or by nobody who is seen."""
        place = (round(to[0], 4), round(to[1], 4), round(to[2], 4))
        event = Carry(at=self.now, object=name, to=place, height=height, speed=self.speed, hand=hand)
        self.do(event, self._taking(hand) + (2 * height + 3 * ARENA) / self.speed)

    def slide(
        self, name: str, to: tuple[float, float], *, hand: int | None, turn: float = 0.0, pushes: Sequence[str] = ()
    ) -> None:
        """Let a thing be pushed over the table (m, world); it stands there from then on."""
        x, y = self.spot(name)
        way = math.hypot(to[0] - x, to[1] - y)
        event = Slide(
            at=self.now, object=name, to=to, turn=turn, speed=self.speed, hand=hand, pushes=tuple(pushes)
        )  # fmt: skip
        self.occupy(name, to)
        self.do(event, self._taking(hand) + max(way / self.speed, abs(turn) / _TURNING))

    def grasp(self, name: str, hand: int, side: tuple[float, float]) -> None:
        """Let a hand take a thing, coming from `side`."""
        self.do(HandGraspEvent(at=self.now, object=name, hand=hand, side=side), self._coming(hand))

    def move(self, hand: int, to: Vector3, way: float) -> None:
        """Let a hand go somewhere (m, world), with what it holds, over at most `way` m."""
        place = (round(to[0], 4), round(to[1], 4), round(to[2], 4))
        self.do(HandMove(at=self.now, hand=hand, to=place, speed=self.speed), way / self.speed)

    def let_go(self, hand: int) -> None:
        """Let a hand open."""
        self.do(HandRelease(at=self.now, hand=hand), _LETTING_GO)

    def leave(self, hand: int) -> None:
        """Let a hand leave the scene."""
        self._present.discard(hand)
        self.do(HandLeave(at=self.now, hand=hand), _LETTING_GO + _LEAVING)

    def _taking(self, hand: int | None) -> float:
        """S at most, of a hand to come, take and let go; 0 without a hand"""
        return 0.0 if hand is None else self._coming(hand) + _LETTING_GO

    def _coming(self, hand: int) -> float:
        known = hand in self._present
        self._present.add(hand)
        return _GOING_ON if known else _COMING

    def _free_marker(self) -> int:
        taken = {spec.marker_id for spec in self.objects}
        return next(number for number in iter(lambda: self.draw.count(0, tags.COUNT - 1), None) if number not in taken)

    def _free_color(self) -> tuple[float, float, float]:
        """A colour that can be told from all others in the picture."""
        others = [TABLE, FLOOR, GREY, SKIN, SLEEVE, *(spec.color for spec in self.objects if spec.color is not None)]
        for _ in range(_TRIES):
            hue = self.draw.number(NumberRange(0.0, 1.0))
            saturation, value = self.draw.number(NumberRange(0.55, 1.0)), self.draw.number(NumberRange(0.6, 1.0))
            red, green, blue = (round(part, 3) for part in colorsys.hsv_to_rgb(hue, saturation, value))
            if all(spectral_angle((red, green, blue), other) > APART for other in others):
                return red, green, blue
        raise CrowdedError("no colour is left")


def _camera(draw: Draw) -> CameraSpec:
    """A camera on a stand, anywhere around the table, that looks at about its middle."""
    distance, elevation, azimuth = draw.number(DISTANCE), draw.number(ELEVATION), draw.angle()
    x, y = draw.within(0.03)  # m, by which people aim badly
    across = distance * math.cos(elevation)
    position = (
        round(across * math.cos(azimuth), 4),
        round(across * math.sin(azimuth), 4),
        round(TOP + distance * math.sin(elevation), 4),
    )
    return CameraSpec(position=position, look_at=(x, y, TOP))
