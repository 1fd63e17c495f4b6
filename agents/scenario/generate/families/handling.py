"""Episodes of hands and persons: taking, putting down unseen, handing over, leaving with things, being watched."""

from __future__ import annotations

from agents.scenario.format.model import PersonSpec
from agents.scenario.format.scenario import (
    HandEnter,
    HandGraspEvent,
    HandMove,
    PersonEnter,
    PersonLeave,
    PersonTurn,
    PersonWalk,
)
from agents.scenario.generate.bodies import SOLIDS, ball, cup, wall
from agents.scenario.generate.draft import ARENA, TOP, EpisodeDraft
from agents.scenario.generate.draw import NumberRange
from agents.scenario.generate.families.motions import behind
from agents.scenario.generate.families.piles import perturb

LIFTED = NumberRange(0.12, 0.25)
"""m above the table at which hands carry things"""
OUTSIDE = 1.1
"""m from the middle of the table, where no camera that is drawn sees a hand"""
EYES = NumberRange(0.5, 0.8)
"""m above the table, of eyes of people who sit or stand at it"""
_TAKEN = (*SOLIDS, cup, ball)


def hands(draft: EpisodeDraft) -> None:
    """Hands take things and put them down, also out of sight; they touch things and leave with or without them."""
    draw = draft.draw
    screen = draft.stand(wall(draw)) if draw.chance(0.7) else None
    names = [draft.stand(draw.one_of(_TAKEN)(draw)) for _ in range(draw.count(1, 3))]
    draft.bystanders()
    for number, name in enumerate(draw.some_of(names, draw.count(1, 2))):
        hand, side = number % 2, draw.direction()
        what = draw.one_of(("put", "away", "touch", "beside"))
        if what == "touch":
            event = HandGraspEvent(at=draft.now, object=name, hand=hand, side=side, style="touch")
            draft.do(event, 3.0)  # s at most, of a hand that comes and touches
            if draw.chance():
                draft.do(HandMove(at=draft.now, hand=hand, by=(*_step(draft), 0.0), speed=draft.speed), 1.0)
            draft.leave(hand)
            continue
        draft.grasp(name, hand, side)
        if what == "away":
            _carry_away(draft, name, hand, side)
        else:
            hide = screen is not None and what == "put"
            _put_down(draft, name, hand, _hidden_spot(draft, name, screen) if hide and screen else None)
        draft.leave(hand)
    if draw.chance(0.3):  # a hand that comes for nothing
        x, y = draw.within(ARENA)
        draft.do(HandEnter(at=draft.now, hand=1, position=(x, y, TOP + 0.2), side=draw.direction()), 1.5)
        draft.leave(1)


def handing(draft: EpisodeDraft) -> None:
    """A thing goes from one hand to the other, and is put down by that."""
    draw = draft.draw
    body = draw.one_of((cup, *SOLIDS))(draw)
    name = draft.stand(body)
    screen = draft.stand(wall(draw)) if draw.chance(0.4) else None
    draft.bystanders()
    first = draw.count(0, 1)
    second = 1 - first
    a, b = draw.direction()
    height = TOP + draw.number(LIFTED) + body.size[2] / 2
    draft.grasp(name, first, (a, b))
    draft.move(first, (*draft.spot(name), height), LIFTED.high)
    draft.vacate(name)
    x, y = draw.within(0.5 * ARENA)
    draft.move(first, (x, y, height), 2 * ARENA)
    draft.grasp(name, second, (-a, -b))
    draft.leave(first)
    _put_down(draft, name, second, _hidden_spot(draft, name, screen) if screen else None)
    draft.leave(second)


def persons(draft: EpisodeDraft) -> None:
    """People look on, look away, walk and leave while hands and chance move things."""
    draw = draft.draw
    names = [draft.stand(draw.one_of(_TAKEN)(draw)) for _ in range(draw.count(2, 3))]
    if draw.chance():
        draft.stand(wall(draw))
    draft.bystanders()
    people = ["ann", "ben"][: draw.count(1, 2)]
    for person in people:
        draft.persons.append(
            PersonSpec(name=person, position=_eyes(draft), look_at=(0.0, 0.0, TOP), present=draw.chance(0.8))
        )
    for person in people:
        _let_person_act(draft, person)
    name, *others = draw.some_of(names, len(names))
    draft.grasp(name, 0, draw.direction())
    _put_down(draft, name, 0, None)
    draft.leave(0)
    if draw.chance():
        perturb(draft, draw.one_of(others), [])


def _let_person_act(draft: EpisodeDraft, person: str) -> None:
    draw = draft.draw
    spec = next(spec for spec in draft.persons if spec.name == person)
    if not spec.present:
        draft.do(PersonEnter(at=draft.now, person=person), 0.0)
        return
    what = draw.one_of(("turn", "walk", "leave"))
    if what == "turn":
        x, y, z = spec.position
        away = (2 * x, 2 * y, z)  # m, world: away from the table
        draft.do(PersonTurn(at=draft.now, person=person, look_at=away), 2.0)
    elif what == "walk":
        draft.do(PersonWalk(at=draft.now, person=person, to=_eyes(draft), look_at=(0.0, 0.0, TOP)), 3.0)
    else:
        draft.do(PersonLeave(at=draft.now, person=person), 0.0)


def _eyes(draft: EpisodeDraft) -> tuple[float, float, float]:
    """Where somebody at the table has the eyes (m, world)."""
    a, b = draft.draw.direction()
    away = draft.draw.number(NumberRange(0.7, 1.1))  # m from the middle of the table
    return round(away * a, 4), round(away * b, 4), round(TOP + draft.draw.number(EYES), 4)


def _put_down(draft: EpisodeDraft, name: str, hand: int, spot: tuple[float, float] | None) -> None:
    """Let a hand that holds a thing lift it and put it down somewhere else; it holds it still then."""
    body, draw = draft.bodies[name], draft.draw
    x, y = spot or draft.free_spot(body.radius)
    top = TOP + body.size[2] / 2 + draw.number(LIFTED)
    draft.do(HandMove(at=draft.now, hand=hand, by=(0.0, 0.0, draw.number(LIFTED)), speed=draft.speed), 1.7)
    draft.move(hand, (x, y, top), 2 * ARENA)
    draft.move(hand, (x, y, draft.on_table(name)), LIFTED.high)
    draft.occupy(name, (x, y))


def _hidden_spot(draft: EpisodeDraft, name: str, screen: str) -> tuple[float, float]:
    """Where a thing stands that another one hides from the camera (m, world)."""
    return behind(draft, screen, draft.bodies[name].radius + 0.01)


def _carry_away(draft: EpisodeDraft, name: str, hand: int, side: tuple[float, float]) -> None:
    """Let a hand carry a thing out of the picture, and come back with it."""
    draw = draft.draw
    a, b = side
    z = TOP + draft.bodies[name].size[2] / 2 + draw.number(LIFTED)
    draft.vacate(name)
    draft.do(HandMove(at=draft.now, hand=hand, by=(0.0, 0.0, draw.number(LIFTED)), speed=draft.speed), 1.7)
    draft.move(hand, (OUTSIDE * a, OUTSIDE * b, z), OUTSIDE + ARENA)
    _back_down(draft, name, hand, z)


def _back_down(draft: EpisodeDraft, name: str, hand: int, z: float) -> None:
    x, y = draft.free_spot(draft.bodies[name].radius)
    draft.move(hand, (x, y, z), OUTSIDE + ARENA)
    draft.move(hand, (x, y, draft.on_table(name)), z - TOP)
    draft.occupy(name, (x, y))


def _step(draft: EpisodeDraft) -> tuple[float, float]:
    """A short way over the table, m."""
    a, b = draft.draw.direction()
    way = draft.draw.number(NumberRange(0.03, 0.1))
    return round(way * a, 4), round(way * b, 4)


