"""Episodes of senses that fail: cameras that are bumped or covered, and sensors that err."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agents.scenario.format.model import SensorSpec
from agents.scenario.format.scenario import CameraBump, CameraCover, FalsePercept, HandEnter, PlaceEvent, Remove
from agents.scenario.generate.bodies import SOLIDS, ball, box, can, wall
from agents.scenario.generate.draft import GAP, CrowdedError, EpisodeDraft
from agents.scenario.generate.draw import NumberRange
from agents.scenario.generate.families.piles import perturb

BUMP, BUMP_TURN = NumberRange(-0.02, 0.02), NumberRange(-0.04, 0.04)
"""m and rad along each axis, of a stand that somebody bumps into"""
DARK = NumberRange(1.5, 5.0)
"""s for which a camera sees nothing"""
BIAS, JITTER = NumberRange(-0.015, 0.015), NumberRange(0.0, 0.005)
"""m, errors of depth of one object and of one frame: of an RGB-D camera at 0.3 to 1 m (dsr/perception/noise.py)"""
GHOST, GHOST_TURN = NumberRange(-0.15, 0.15), NumberRange(-0.6, 0.6)
"""m and rad along each axis, by which a false percept is off"""

HIDDEN = 0.3
"""1, share of the times in which nothing is seen because a hand is before the camera"""
NEAR = 0.1
"""m from the camera to the palm of such a hand: there its width spans all of the table"""
AGAIN = NumberRange(1.5, 3.0)
"""s, from one failure to the next: everything in view is seen again"""

BEHIND = NumberRange(0.0, 0.06)
"""m, beyond the least gap, that a thing stands behind what hides part of it"""
ASIDE = NumberRange(-1.0, 1.0)
"""Share of half of both widths, by which it stands aside: at 0 right behind, at 1 not hidden at all"""

MOST_FRAMES = 8
"""Frames in a row that show a thing falsely: 0.8 s, in which a belief may still wait for more evidence"""


def bumps(draft: EpisodeDraft) -> None:
    """The camera is bumped, and at times something is moved about the same time."""
    draw = draft.draw
    names = [draft.stand(draw.one_of(SOLIDS)(draw)) for _ in range(draw.count(2, 4))]
    names += draft.bystanders()
    if draw.chance(0.4):
        perturb(draft, draw.one_of(names), [])
    a, b, c = (draw.number(BUMP) for _ in range(3))
    turn_a, turn_b, turn_c = (draw.number(BUMP_TURN) for _ in range(3))
    bump = CameraBump(at=draft.now, translation=(a, b, c), rotation=(turn_a, turn_b, turn_c))
    draft.do(bump, draw.number(NumberRange(0.0, 4.0)))  # s in which nothing else happens
    if draw.chance(0.4):
        perturb(draft, draw.one_of([name for name in names if name in draft.standing]), [])


def blackouts(draft: EpisodeDraft) -> None:
    """The camera is covered, and meanwhile things are moved, shoved or taken away."""
    draw = draft.draw
    names = [draft.stand(draw.one_of((*SOLIDS, ball))(draw)) for _ in range(draw.count(2, 4))]
    names += draft.bystanders()
    begin = draft.now
    for name in draw.some_of(names, draw.count(1, 3)):
        draft.now = round(draft.now + 0.2, 2)  # s: the lens is covered before anything moves
        perturb(draft, name, [])
    dark = round(draft.now - begin + draw.number(DARK), 2)
    draft.events.insert(0, CameraCover(at=begin, duration=dark))
    draft.now = round(begin + dark, 2)


def failures(draft: EpisodeDraft) -> None:
    """The camera fails once or more often, or a hand hides all from it; things change in half of these times."""
    draw = draft.draw
    names = [draft.stand(draw.one_of((*SOLIDS, ball))(draw)) for _ in range(draw.count(2, 4))]
    names += draft.bystanders()
    for _ in range(draw.count(1, 3)):
        if draw.chance(HIDDEN):
            _hide_all(draft)
        else:
            _fail(draft, [name for name in names if name in draft.standing])


def _fail(draft: EpisodeDraft, names: Sequence[str]) -> None:
    """Let the camera fail, and in half of the cases let something happen meanwhile to some of what stands."""
    draw, begin, before = draft.draw, draft.now, len(draft.events)
    for name in draw.some_of(names, draw.count(1, 2) if draw.chance() else 0):
        draft.now = round(draft.now + 0.2, 2)  # s: the camera fails before anything moves
        perturb(draft, name, [])
    dark = round(draft.now - begin + draw.number(DARK), 2)
    draft.events.insert(before, CameraCover(at=begin, duration=dark))
    draft.now = round(begin + dark + draw.number(AGAIN), 2)


def _hide_all(draft: EpisodeDraft) -> None:
    """Let a hand come so close to the camera that it hides all, and leave again."""
    draw, camera = draft.draw, draft.camera
    away = [b - a for a, b in zip(camera.position, camera.look_at, strict=True)]
    near = NEAR / math.hypot(*away)
    x, y, z = (round(a + near * part, 4) for a, part in zip(camera.position, away, strict=True))
    draft.do(HandEnter(at=draft.now, hand=0, position=(x, y, z), side=draw.direction()), draw.number(DARK))
    draft.leave(0)
    draft.now = round(draft.now + draw.number(AGAIN), 2)


def sensors(draft: EpisodeDraft) -> None:
    """Depth is off and trembles, things are seen where they are not, and something is moved."""
    draw = draft.draw
    low, high = sorted((draw.number(BIAS), draw.number(BIAS)))
    draft.sensor = SensorSpec(depth_bias=(low, high), depth_jitter=draw.number(JITTER))
    names = [draft.stand(draw.one_of((*SOLIDS, ball))(draw)) for _ in range(draw.count(2, 4))]
    names += draft.bystanders()
    for name in draw.some_of(names, draw.count(1, 3)):
        shift = (draw.number(GHOST), draw.number(GHOST), abs(draw.number(GHOST)))
        turn, frames = (0.0, 0.0, draw.number(GHOST_TURN)), draw.count(1, MOST_FRAMES)
        ghost = FalsePercept(at=draft.now, object=name, frames=frames, translation=shift, rotation=turn)
        draft.do(ghost, 0.5)
    perturb(draft, draw.one_of(names), [])


def screens(draft: EpisodeDraft) -> None:
    """While the camera is covered, things are put before others; some of these others are taken away, and some stay."""
    draw = draft.draw
    pairs = []
    for _ in range(draw.count(1, 2)):
        behind = draft.stand(draw.one_of((*SOLIDS, ball))(draw))
        pairs.append((draft.stand(draw.one_of((wall, box, can))(draw)), behind))
    draft.bystanders(least=1)
    begin = draft.now
    for screen, behind in pairs:
        draft.now = round(draft.now + 0.2, 2)  # s: the lens is covered before anything moves
        _put_before(draft, screen, behind)
        if draw.chance():
            draft.vacate(behind)
            draft.do(Remove(at=draft.now, object=behind), 0.0)
    dark = round(draft.now - begin + draw.number(DARK), 2)
    draft.events.insert(0, CameraCover(at=begin, duration=dark))
    draft.now = round(begin + dark, 2)


def _put_before(draft: EpisodeDraft, screen: str, behind: str) -> None:
    """Put a thing between the camera and another one, so that it may hide part of that."""
    draw, (x, y) = draft.draw, draft.spot(behind)
    away = draft.camera.position[0] - x, draft.camera.position[1] - y
    a, b = (part / math.hypot(*away) for part in away)
    reach = draft.bodies[screen].radius + draft.bodies[behind].radius
    nearer, aside = reach + GAP + draw.number(BEHIND), draw.number(ASIDE) * reach
    spot = (round(x + nearer * a - aside * b, 4), round(y + nearer * b + aside * a, 4))
    draft.vacate(screen)
    if not draft.is_free(spot, draft.bodies[screen].radius):
        raise CrowdedError("no room for what hides part of another thing")
    draft.occupy(screen, spot)
    place = PlaceEvent(at=draft.now, object=screen, position=(*spot, draft.on_table(screen)), yaw=draw.angle())
    draft.do(place, 0.0)
