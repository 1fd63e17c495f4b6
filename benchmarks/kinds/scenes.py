"""Random episodes in which a kind of failure may show: families beside those of `agents/scenario/generate`."""

from __future__ import annotations

import math

from agents.scenario.format.scenario import HandMove, Roll, Topple
from agents.scenario.generate.bodies import SOLIDS, ball, box, can, cup, wall
from agents.scenario.generate.draft import ARENA, TOP, CrowdedError, EpisodeDraft
from agents.scenario.generate.draw import NumberRange
from agents.scenario.generate.families.handling import LIFTED, OUTSIDE
from agents.scenario.generate.families.motions import behind
from agents.scenario.generate.families.piles import TOPPLING, lean_against, lie, maybe_hand, prop_up, shove
from agents.scenario.generate.registry import Family

AWAY = NumberRange(0.25, 0.7)
"""m/s, of a ball that rolls behind something: fast enough to go on there"""
FALL = NumberRange(0.05, 0.25)
"""m above the table from which a hand drops a thing: more than a thing that is put down may fall"""
HIDDEN = NumberRange(0.8, 2.5)
"""s for which a thing lies behind something before it comes out"""
OUT = NumberRange(0.15, 0.35)
"""m that a thing moves sideways out of its hiding: beyond the edge of what hides it"""
OVER = 0.3
"""m above the table at which what is put behind a wall is carried: higher than any wall"""


def lying(draft: EpisodeDraft) -> None:
    """Plain cans lie on their side from the start, are shoved, and others are toppled in view."""
    draw = draft.draw
    cans = [lie(draft) for _ in range(draw.count(1, 2))]
    upright = draft.stand(can(draw))
    _others(draft)
    if draw.chance():
        draft.do(Topple(at=draft.now, object=upright, direction=draw.direction()), TOPPLING)
    shove(draft, draw.one_of(cans), None)


def leaning(draft: EpisodeDraft) -> None:
    """A board leans against a box, or a thing lies aslant on the edge of another one; one that stands by is shoved."""
    draw = draft.draw
    if draw.chance():
        lean_against(draft, draft.stand(draw.one_of((box, wall))(draw), yaw=0.0))
    else:
        prop_up(draft)
    others = draft.bystanders(least=1)
    shove(draft, draw.one_of(others), None)


def rolling_away(draft: EpisodeDraft) -> None:
    """Balls are set rolling towards where something hides them from the camera."""
    draw = draft.draw
    screens = [draft.stand(wall(draw)) for _ in range(draw.count(1, 2))]
    balls = [draft.stand(ball(draw)) for _ in range(draw.count(1, 2))]
    _others(draft)
    for name in balls:
        (x, y), goal = draft.spot(name), behind(draft, draw.one_of(screens))
        way, speed = math.dist((x, y), goal) or 1.0, draw.number(AWAY)
        velocity = (round(speed * (goal[0] - x) / way, 4), round(speed * (goal[1] - y) / way, 4))
        draft.do(Roll(at=draft.now, object=name, velocity=velocity), 1.0)  # s until it is out of sight, at least


def emerging(draft: EpisodeDraft) -> None:
    """A thing is put behind something that hides it, and later slides, rolls or is carried out of there."""
    draw = draft.draw
    screen = draft.stand(wall(draw))
    name = draft.stand(draw.one_of((*SOLIDS, ball))(draw))
    _others(draft)
    x, y = behind(draft, screen, draft.bodies[name].radius + 0.01)  # m, that it does not touch the wall
    draft.carry(name, (x, y, draft.on_table(name)), hand=maybe_hand(draw), height=OVER)
    draft.occupy(name, (x, y))
    draft.now = round(draft.now + draw.number(HIDDEN), 2)
    a, b = _sideways(draft, (x, y))
    way = draw.number(OUT)
    goal = (round(x + way * a, 4), round(y + way * b, 4))
    if max(map(abs, goal)) > ARENA:
        raise CrowdedError("what comes out of hiding would leave the table")
    if draft.bodies[name].what == "ball":
        speed = draw.number(AWAY)
        draft.do(Roll(at=draft.now, object=name, velocity=(round(speed * a, 4), round(speed * b, 4))), 1.0)
    elif draw.chance():
        draft.slide(name, goal, hand=maybe_hand(draw))
    else:
        draft.carry(name, (*goal, draft.on_table(name)), hand=maybe_hand(draw))


def letting_go(draft: EpisodeDraft) -> None:
    """A hand puts a thing down or drops it, in view, behind something or out of the picture, and comes back empty."""
    draw = draft.draw
    screen = draft.stand(wall(draw))
    name = draft.stand(draw.one_of((*SOLIDS, cup, ball))(draw))
    _others(draft)
    hand, side = draw.count(0, 1), draw.direction()
    where = draw.one_of(("behind", "behind", "in view", "outside"))
    draft.grasp(name, hand, side)
    draft.do(HandMove(at=draft.now, hand=hand, by=(0.0, 0.0, draw.number(LIFTED)), speed=draft.speed), 1.7)
    high, lies = TOP + OVER, draft.on_table(name)
    if where == "outside":
        draft.vacate(name)
        draft.move(hand, (OUTSIDE * side[0], OUTSIDE * side[1], high), OUTSIDE + ARENA)
    else:
        radius = draft.bodies[name].radius
        x, y = behind(draft, screen, radius + 0.01) if where == "behind" else draft.free_spot(radius)
        drop = draw.number(FALL) if where == "in view" or draw.chance() else 0.0
        draft.move(hand, (x, y, high), 2 * ARENA)
        draft.move(hand, (x, y, lies + drop), OVER)
        draft.occupy(name, (x, y))
    draft.let_go(hand)
    draft.do(HandMove(at=draft.now, hand=hand, by=(0.0, 0.0, draw.number(LIFTED)), speed=draft.speed), 1.7)
    for _ in range(draw.count(1, 2)):
        x, y = draw.within(ARENA)
        draft.move(hand, (x, y, high), OUTSIDE + ARENA)
    draft.leave(hand)


SCENES: dict[str, Family] = {
    scene.name: scene
    for scene in (
        Family("lying", "Cans lie on their side", lying, "tuning", may_fall=True),
        Family("leaning", "Things lean on others", leaning, "tuning", may_fall=True),
        Family("rolling_away", "Balls roll out of sight", rolling_away, "tuning", may_fall=True),
        Family("emerging", "Things come out of hiding while they move", emerging, "tuning", may_fall=True),
        Family("letting_go", "A hand lets go and is empty", letting_go, "tuning", may_fall=True),
    )
}
"""By name. Seeds from 1000 on are for judging alone, as of all families."""


def _others(draft: EpisodeDraft) -> None:
    """Let up to two solid things stand beside what it is about."""
    for _ in range(draft.draw.count(0, 2)):
        draft.stand(draft.draw.one_of(SOLIDS)(draft.draw))


def _sideways(draft: EpisodeDraft, spot: tuple[float, float]) -> tuple[float, float]:
    """A unit vector over the table, to the left or right as the camera sees it."""
    eye, sign = draft.camera.position, draft.draw.one_of((-1.0, 1.0))
    x, y = spot[0] - eye[0], spot[1] - eye[1]
    length = math.hypot(x, y)
    return -sign * y / length, sign * x / length
