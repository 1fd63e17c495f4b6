"""Finds faults and doubts in a true course: things in one another, moves that overlap, things put in the air."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import msgspec
import numpy as np

from agents.scenario.format.events import (
    Carry,
    Event,
    FalsePercept,
    HandEvent,
    HandGraspEvent,
    HandMove,
    Lift,
    PlaceEvent,
    Slide,
    Swap,
    Tilt,
)
from agents.scenario.format.geometry import ScenarioBox, overlap, pieces
from agents.scenario.format.layout import TOUCH, table_box
from agents.scenario.format.model import Scenario
from agents.scenario.judge.course import why_missing
from agents.scenario.truth.actions import FALLEN
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.measures import Piece
from agents.scenario.truth.phases import PAUSE, Phase, phases
from agents.scenario.truth.relations import true_relations
from dsr.config.toml_lines import Path
from dsr.math3d import quaternions
from dsr.math3d.shapes import Part, Shape
from dsr.math3d.transforms import Pose

TABLE = "table"
_TURNS = 4  # squares within a circle, turned against each other, whose union is 0.98 of it and never more


def deepest(name: str, pose: Pose, others: dict[str, Pose], scenario: Scenario) -> tuple[str, float]:
    """Name the body that an object at `pose` is deepest in, with the depth (m).

    The body is another object or the table; ("", 0.0) for none.

    Args:
        name: of the object.
        pose: world_from_object.
        others: likewise, of those that it may be in.
        scenario: says what they are made of.
    """
    body = _body(name, pose, scenario)
    found = {
        other: _body(other, there, scenario)
        for other, there in others.items()
        if _are_near(name, other, pose, there, scenario)
    }
    found[TABLE] = [table_box(scenario.table)]
    depths = {other: max(overlap(a, b) for a in body for b in parts) for other, parts in found.items()}
    worst = max(depths, key=depths.__getitem__)
    return (worst, depths[worst]) if depths[worst] > 0 else ("", 0.0)


def _are_near(name: str, other: str, pose: Pose, there: Pose, scenario: Scenario) -> bool:
    reach = (math.hypot(*scenario.object(name).size) + math.hypot(*scenario.object(other).size)) / 2
    return math.dist(pose.t, there.t) < reach


def _body(name: str, pose: Pose, scenario: Scenario) -> list[Piece]:
    spec = scenario.object(name)
    return pieces(
        _without_cylinders(spec.shape), ScenarioBox(pose.translation, pose.rotation_matrix, np.array(spec.size))
    )


def _without_cylinders(shape: Shape) -> Shape:
    """The shape with boxes within each cylinder instead of it."""
    return tuple(piece for part in shape for piece in (_within(part) if part.kind == "cylinder" else (part,)))


def _within(cylinder: Part) -> Shape:
    side = cylinder.size[0] / math.sqrt(2.0)
    turns = (quaternions.from_rotvec((0.0, 0.0, math.pi / 2 * k / _TURNS)) for k in range(_TURNS))
    rotations = (quaternions.product(cylinder.rotation, turn) for turn in turns)
    return tuple(Part("box", (side, side, cylinder.size[2]), cylinder.position, turn) for turn in rotations)


_STEP = 0.05
"""s from one sample of the course to the next"""
DRIVEN_INTO = 0.005
"""m, how deep what is held may be in something else: what it pushes gives way within a few steps of physics"""


class Fault(msgspec.Struct, frozen=True):
    """A fault or doubt that a scenario file brings about."""

    path: Path
    """Place in the file that brings the fault about: `("event", 0)` is the first event."""
    text: str


class _Move(msgspec.Struct, frozen=True):
    """An event that happened."""

    number: int
    event: Event
    begin: float
    end: float
    objects: frozenset[str]
    """What it moves."""

    @property
    def name(self) -> str:
        return str(self.event.__struct_config__.tag)


def faults(history: History) -> list[Fault]:
    """List the faults of a course that was played without any agent:

    contents that cannot be meant. There is one fault for each event, in their order.

    One for each event, in their order.

    Where a robot has something to do, things may be elsewhere when it acts: then only hands are looked at.
    """
    found = [
        _of_event(number, f"{event.__struct_config__.tag}: {why_missing(history, number)}")
        for number, event in enumerate(history.scenario.events, start=1)
        if number in history.given_up
    ]
    moves = list(_moves(history))
    robot_acts = _robot_acts(history.scenario)
    found += _overlaps(moves, hands_only=robot_acts)
    for move in moves if not robot_acts else ():
        found += _of_one_move(move, moves, history)
    firsts = {fault.path: fault for fault in reversed(found)}
    return sorted(firsts.values(), key=lambda fault: fault.path[1])


def doubts(history: History) -> list[Fault]:
    """List the doubts of a course that was played without any agent: things fall where they are put, events wait.

    Where a robot has something to do, only the start is looked at.
    """
    found = list(_falls_at_the_start(history))
    if _robot_acts(history.scenario):
        return found
    found += _waits_in_vain(history)
    moves = list(_moves(history))
    for phase in phases(history):
        if put := [move for move in moves if _puts_down(move, phase)]:
            how = f"falls {_mm(phase.fell)}: it does not stay where it is put"
            found.append(_of_event(put[-1].number, f"{put[-1].name}: {phase.object!r} {how}"))
    return found


def _falls_at_the_start(history: History) -> Iterator[Fault]:
    """Things come to rest before the first sample."""
    rest = history.samples[0].truth
    for index, spec in enumerate(history.scenario.objects):
        fell = spec.position[2] - rest[spec.name].t[2] if spec.name in rest else 0.0
        if fell > FALLEN:
            text = f"{spec.name!r} falls {_mm(fell)} before the start: nothing holds it there"
            yield Fault(("object", index, "position"), text)


def _waits_in_vain(history: History) -> Iterator[Fault]:
    """Events whose condition does not come true though nobody but the experimenter acts."""
    for number, event in enumerate(history.scenario.events, start=1):
        if event.when is not None and number not in history.spans and number not in history.kills:
            text = f"{event.__struct_config__.tag}: does not begin: {event.when!r} does not come true"
            yield _of_event(number, f"{text}, and there is no [mission] and no [[plan]] by which a robot would act")


def _robot_acts(scenario: Scenario) -> bool:
    """Whether things may be elsewhere than in a course without any agent."""
    return scenario.mission is not None or bool(scenario.plans)


def _of_event(number: int, text: str) -> Fault:
    """A fault of the event of that number, from 1."""
    return Fault(("event", number - 1), text)


def _puts_down(move: _Move, phase: Phase) -> bool:
    """Whether an object fell since this move put it down, without a rest in between."""
    if not isinstance(move.event, PlaceEvent | Carry) or phase.fell_at is None:
        return False
    return phase.object in move.objects and phase.begin <= move.end + PAUSE and move.begin <= phase.fell_at + _STEP


def _moves(history: History) -> Iterator[_Move]:
    for number, (begin, end) in sorted(history.spans.items(), key=lambda item: item[1][0]):
        event = history.scenario.events[number - 1]
        if number not in history.given_up:
            objects = _objects_of(event, history.before(begin) or history.samples[0])
            yield _Move(number, event, begin, history.end if end is None else end, objects)


def _objects_of(event: Event, before: Sample) -> frozenset[str]:
    """What an event moves; a hand that takes something does not."""
    if isinstance(event, HandMove):
        hand = f"human_hand_{event.hand}"
        return frozenset(name for held in (before.grasped, before.touched) for name in held if held[name] == hand)
    if isinstance(event, HandGraspEvent | FalsePercept):
        return frozenset()
    names = {"object": getattr(event, "object", None)} | ({"other": event.other} if isinstance(event, Swap) else {})
    return frozenset(name for name in names.values() if name is not None)


def _hand_of(event: Event) -> int | None:
    return event.hand if isinstance(event, HandEvent) else getattr(event, "hand", None)


def _overlaps(moves: Sequence[_Move], *, hands_only: bool) -> Iterator[Fault]:
    """Moves that begin while an earlier one of the same hand or the same object is still going on."""
    for index, later in enumerate(moves):
        for earlier in moves[:index]:
            if earlier.end <= later.begin and not _at_once(earlier, later):
                continue
            hand = _hand_of(later.event)
            both = sorted(earlier.objects & later.objects)
            who = f"hand {hand}" if hand is not None and hand == _hand_of(earlier.event) else ""
            who = who or (f"{both[0]!r}" if both and not hands_only else "")
            if who:
                text = (
                    f"{later.name}: {who} is still in event {earlier.number} ({earlier.name}, {earlier.begin:.2f} to "
                    f"{earlier.end:.2f} s) when this begins at {later.begin:.2f} s; expected one after the other"
                )
                yield _of_event(later.number, text)


def _at_once(earlier: _Move, later: _Move) -> bool:
    """Whether both begin in the same step of physics, and neither takes none."""
    return earlier.begin == later.begin and earlier.end > earlier.begin and later.end > later.begin


def _of_one_move(move: _Move, moves: Sequence[_Move], history: History) -> Iterator[Fault]:
    before = history.before(move.begin) or history.samples[0]
    scenario, event = history.scenario, move.event
    if isinstance(event, PlaceEvent | Swap):
        yield from _put_into(move, scenario, before)
    if isinstance(event, Slide):
        busy = {
            name for other in moves if other.begin <= move.end and move.begin <= other.end for name in other.objects
        }
        yield from _slid_into(move, history, before, busy | {*event.pushes})
    if isinstance(event, Slide | Carry | Lift | Tilt | HandMove):
        yield from _driven_into(move, history)


def _put_into(move: _Move, scenario: Scenario, before: Sample) -> Iterator[Fault]:
    """What is put somewhere at once must find the place free."""
    after = _goals(move.event, scenario, before.truth)
    others = {name: pose for name, pose in before.truth.items() if name not in after}
    for name in sorted(after):
        other, depth = deepest(name, after[name], others, scenario)
        if depth > TOUCH:
            text = f"{move.name}: {name!r} would be {_mm(depth)} inside {other!r} at {move.begin:.2f} s"
            yield _of_event(move.number, f"{text}; expected a free place")


def _goals(event: Event, scenario: Scenario, truth: dict[str, Pose]) -> dict[str, Pose]:
    """Where `place` and `swap` put things, and what comes along."""
    goals: dict[str, Pose] = {}
    if isinstance(event, PlaceEvent):
        goals[event.object] = _place_goal(event, scenario, truth)
    elif isinstance(event, Swap) and event.object in truth and event.other in truth:
        for name, other in ((event.object, event.other), (event.other, event.object)):
            x, y, z = truth[other].t
            rise = (scenario.object(name).size[2] - scenario.object(other).size[2]) / 2
            goals[name] = Pose((x, y, z + rise), truth[name].q)
    if getattr(event, "contents", False):
        for leader in [name for name in goals if name in truth]:
            moved = goals[leader] @ truth[leader].inverse()
            goals |= {name: moved @ truth[name] for name in _along(leader, scenario, truth) if name not in goals}
    return goals


def _place_goal(event: PlaceEvent, scenario: Scenario, truth: dict[str, Pose]) -> Pose:
    yaw = event.yaw if event.yaw is not None else _yaw(truth[event.object]) if event.object in truth else 0.0
    position = event.position
    if event.onto is not None:
        x, y, z = truth[event.onto].t
        height = (scenario.object(event.onto).size[2] + scenario.object(event.object).size[2]) / 2
        position = (x + event.offset[0], y + event.offset[1], z + height)
    assert position is not None  # the format demands one of both
    return Pose(position, quaternions.from_rotvec((0.0, 0.0, yaw)))


def _slid_into(move: _Move, history: History, before: Sample, excused: set[str]) -> Iterator[Fault]:
    """What is slid must find its way free of what stood there when it began, but for what it shall push."""
    scenario = history.scenario
    (name,) = move.objects
    if name not in before.truth:
        return
    along = {name, *_along(name, scenario, before.truth), *excused}
    standing = {other: pose for other, pose in before.truth.items() if other not in along}
    for sample in history.window(move.begin, move.end):
        if name in sample.truth:
            other, depth = deepest(name, sample.truth[name], standing, scenario)
            if depth > TOUCH and other != TABLE:
                text = f"slide: {name!r} goes through {other!r}, which stands in its way at {sample.time:.2f} s"
                yield _of_event(move.number, f'{text}; expected a free way, or `pushes = ["{other}"]` if that is meant')
                return


def _driven_into(move: _Move, history: History) -> Iterator[Fault]:
    """What is held must not be forced into what cannot give way."""
    scenario = history.scenario
    for sample in history.window(move.begin, move.end):
        for name in sorted(move.objects & sample.truth.keys() & sample.grasped.keys()):
            others = {other: pose for other, pose in sample.truth.items() if other != name}
            other, depth = deepest(name, sample.truth[name], others, scenario)
            if depth > DRIVEN_INTO:
                text = f"{move.name}: {name!r} is driven {_mm(depth)} into {other!r} at {sample.time:.2f} s"
                yield _of_event(move.number, f"{text}; expected a free way")
                return


def _along(leader: str, scenario: Scenario, truth: dict[str, Pose]) -> Iterable[str]:
    """What is on an object, on that, or within its bounding box."""
    on = true_relations(scenario, truth)
    half = np.array(scenario.object(leader).size) / 2
    inside = truth[leader].inverse()
    found = [name for name, pose in truth.items() if name != leader and np.all(np.abs(inside.apply(pose.t)) < half)]
    found.append(leader)
    for base in found:
        found += [upper for upper, lower in on if lower == base and upper not in found]
    return [name for name in found if name != leader]


def _yaw(pose: Pose) -> float:
    x, y, _ = quaternions.rotate(pose.q, (1.0, 0.0, 0.0))
    return float(np.arctan2(y, x))


def _mm(metres: float) -> str:
    return f"{metres * 1000:.1f} mm"
