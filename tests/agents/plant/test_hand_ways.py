"""No fingertip of a hand that takes something or lets go of it goes through a body: in all grips, from all sides."""

from __future__ import annotations

from itertools import product

import pytest

from agents.plant.config import PlantConfig
from agents.plant.hand_figure import TIP_RADIUS, TIPS
from agents.plant.reality import Reality
from agents.plant.world import RATE_HZ, STEP
from agents.scenario.format.scenario import parse_scenario
from simulation_handler.shapes.geometry import Solid

SIDES = ((1.0, 0.0), (0.0, 1.0), (-0.6, -0.8))
LOOKS = 4  # steps of physics between two looks
PRESSED = 0.0015
"""m, by which a fingertip may be in what it touches: the contact of the physics engine, and how it is found"""
ALONE = {
    "a cube": 'name = "thing", marker_id = 3, position = [0.35, 0.0, 0.02]',
    "a cover": 'name = "thing", model = "cover_large", known = true, position = [0.35, 0.0, 0.075]',
    "a container": 'name = "thing", model = "container_blue", known = true, position = [0.35, 0.0, 0.06]',
    "a cup": 'name = "thing", model = "cup", known = true, position = [0.35, 0.0, 0.05]',
    "a ball": 'name = "thing", model = "ball", known = true, position = [0.35, 0.0, 0.03]',
    "a board": 'name = "thing", size = [0.16, 0.08, 0.03], color = [0.1, 0.2, 0.9], position = [0.35, 0.0, 0.015]',
}
AMONG = {
    "in a box": '{name = "box", shape = [["box", [0.26, 0.26, 0.01], [0, 0, -0.055], [0, 0, 0, 1]], '
    '["box", [0.01, 0.26, 0.11], [0.125, 0, 0.005], [0, 0, 0, 1]], '
    '["box", [0.01, 0.26, 0.11], [-0.125, 0, 0.005], [0, 0, 0, 1]], '
    '["box", [0.24, 0.01, 0.11], [0, 0.125, 0.005], [0, 0, 0, 1]], '
    '["box", [0.24, 0.01, 0.11], [0, -0.125, 0.005], [0, 0, 0, 1]]], '
    "color = [0.1, 0.2, 0.9], known = true, position = [0.35, 0.0, 0.06]}",
    "under a beam": '{name = "beam", marker_id = 5, position = [0.35, 0.0, 0.06]}',
    "behind a cover": '{name = "cover", model = "cover_large", known = true, position = [0.55, 0.0, 0.075]}',
    "beside a cube": '{name = "other", marker_id = 5, position = [0.35, 0.075, 0.02]}',
}


def played(things: str, events: str, seed: int = 0) -> Reality:
    """The reality of a scene with events in which hands act."""
    text = f'name = "ways"\ntitle = "Ways of a hand"\nduration = 20.0\nobject = [{things}]\nevent = [{events}]\n'
    return Reality(parse_scenario(text), PlantConfig(sensor="poses"), seed)


def grasp(style: str, side: tuple[float, float], hand: int, moved: float = 0.02) -> str:
    """Events: a hand takes the thing, draws it to its side (m), lets go of it, and leaves to another side."""
    common = f"hand = {hand}"
    x, y = side
    return ", ".join([
        f'{{at = 0.1, do = "hand_grasp", object = "thing", style = "{style}", side = [{x}, {y}], {common}}}',
        f'{{at = 5.0, do = "hand_move", by = [{moved * x}, {moved * y}, 0.0], {common}}}',
        f'{{at = 7.0, do = "hand_release", {common}}}',
        f'{{at = 9.0, do = "hand_leave", side = [{-y}, {x}], {common}}}',
    ])  # fmt: skip


def deepest(reality: Reality, seconds: float = 13.0) -> tuple[float, str]:
    """How deep (m) a fingertip of a hand that holds nothing ever was in a body, and which when."""
    found = [(0.0, "none")]
    for step in range(round(seconds * RATE_HZ)):
        reality.step(step * STEP)
        for hand in reality.hands.present if step % LOOKS == 0 else ():
            if hand.held is not None:
                continue
            points = hand.landmarks[list(TIPS)]
            for name, (finger, point) in product(reality.world, enumerate(points.tolist())):
                pose, spec = reality.world.pose(name), reality.world.specs[name]
                solid = Solid(name, spec.size, pose.t, pose.q, shape=spec.shape)
                depth = TIP_RADIUS - solid.signed_distance(point)[0]
                found.append((depth, f"fingertip {finger} in {name} at {step * STEP:.2f} s"))
            found.append((TIP_RADIUS - float(points[:, 2].min()), f"a fingertip in the table at {step * STEP:.2f} s"))
    assert not reality.experimenter.given_up
    reality.close()
    return max(found)


@pytest.mark.parametrize("hand", [0, 1])
@pytest.mark.parametrize("side", SIDES, ids=str)
@pytest.mark.parametrize("style", ["pinch", "touch"])
@pytest.mark.parametrize("thing", ALONE)
def test_fingertips_stay_outside_what_they_take_and_let_go_of(
    thing: str, style: str, side: tuple[float, float], hand: int
) -> None:
    depth, where = deepest(played(f"{{{ALONE[thing]}}}", grasp(style, side, hand)))
    assert depth < PRESSED, where


@pytest.mark.parametrize("side", SIDES, ids=str)
@pytest.mark.parametrize("place", AMONG)
def test_fingertips_stay_outside_what_is_about_what_they_take(place: str, side: tuple[float, float]) -> None:
    height = 0.03 if place == "in a box" else 0.02
    thing = f"{{{ALONE['a cube']}}}".replace("0.02]", f"{height}]")
    depth, where = deepest(played(f"{AMONG[place]}, {thing}", grasp("pinch", side, 0, moved=0.001)))
    assert depth < PRESSED, where


def test_a_hand_that_took_one_thing_goes_round_it_to_the_next() -> None:
    things = f'{{{ALONE["a cover"]}}}, {{name = "next", marker_id = 4, position = [0.05, 0.0, 0.02]}}'
    events = grasp("pinch", (1.0, 0.0), 0).rsplit(", {at = 9.0", 1)[0]
    after = '{at = 9.0, do = "hand_grasp", object = "next", hand = 0}'
    depth, where = deepest(played(things, f"{events}, {after}"), 14.0)
    assert depth < PRESSED, where


def test_fingertips_that_went_through_a_wall_would_be_found() -> None:
    """The measure itself: a hand that enters in the middle of a cover is in that."""
    enter = '{at = 0.0, do = "hand_enter", position = [0.35, 0.0, 0.1], speed = 0.4, hand = 0}'
    assert deepest(played(f"{{{ALONE['a cover']}}}", enter), 3.0)[0] > PRESSED
