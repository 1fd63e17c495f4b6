"""Which look tells most: by mutual information, with what hides things, and with covers that can be lifted."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator

import numpy as np
import pytest

from dsr import Pose
from dsr.believing.distribution import Alternative
from dsr.math3d.shapes import Part, to_numbers
from dsr.visibility import Body, Picture, VisibleFraction
from dsr.vocabulary.what_if import USUAL_WORLDS
from planner.arms import Arms
from planner.carried import carried_cameras
from planner.config import PlannerConfig
from planner.outlook import Look, Outlooks, expected_information
from planner.state import read_state
from tests.planner.table import Run, add_camera, add_cube, believe

CONFIG = PlannerConfig()
HERE, THERE = (0.42, 0.08), (0.30, 0.30)


def at(weight: float, x: float, y: float, z: float = 0.02, **more: object) -> Alternative:
    return Alternative(weight=weight, pose=Pose((x, y, z)), **more)  # type: ignore[arg-type]


@pytest.fixture
def run() -> Iterator[Run]:
    with Run() as run:
        add_camera(run.memory, "camera_wrist", "gripper", Pose((0.0, 0.05, 0.0)))
        yield run


def choosing(run: Run, *done: Look, cameras: bool = True) -> Generator[None, None, Look | None]:
    eyes = carried_cameras(run.memory, Arms(run.memory, CONFIG)) if cameras else []
    return Outlooks(run.memory, read_state(run.memory, CONFIG), eyes, ["cube_3"], CONFIG).best(done)


def drained(generator: Generator[None, None, Look | None]) -> tuple[Look | None, int]:
    """The look that is chosen, and after how many steps."""
    steps = 1
    while True:
        try:
            next(generator)
        except StopIteration as stop:
            return stop.value, steps
        steps += 1


def best(run: Run, *done: Look, cameras: bool = True) -> Look | None:
    return drained(choosing(run, *done, cameras=cameras))[0]


def test_information_is_that_of_what_is_seen() -> None:
    weights = np.array([0.5, 0.3, 0.2])
    whole = -(weights * np.log(weights)).sum()
    seen = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.5, 0.5]])
    told = expected_information(weights, seen)
    assert told[0] == told[1] == pytest.approx(whole) and told[3] == pytest.approx(0.0)
    assert told[2] == pytest.approx(math.log(2.0)), "a fair question"
    assert told[4] == pytest.approx(0.5 * whole), "half of the looks show nothing, and tell nothing"
    assert expected_information(np.array([1.0]), np.array([[1.0]]))[0] == 0.0


def test_the_camera_goes_above_where_a_look_tells_most(run: Run) -> None:
    believe(run.memory, "cube_3", at(0.4, *HERE), at(0.35, *THERE), at(0.25, 0.3, -0.3))
    look = best(run)
    assert look is not None and look.view is not None
    assert look.view.t[:2] == pytest.approx(HERE) and look.view.t[2] == pytest.approx(CONFIG.look_height)
    assert look.information == pytest.approx(0.673, abs=0.001), "the entropy of 0.4 and 0.6"
    second = best(run, look)
    assert second is not None and second.view is not None and second.view.t[:2] == pytest.approx(THERE)


def test_what_hides_a_place_makes_a_look_there_useless(run: Run) -> None:
    believe(run.memory, "cube_3", at(0.6, *HERE), at(0.4, *THERE))
    run.memory.add_node("lid", "box", size=(0.2, 0.2, 0.01))
    run.memory.add_edge("world", "lid", "Virtual_RT", pose=Pose((*HERE, 0.1)))
    look = best(run)
    assert look is not None and look.view is not None and look.view.t[:2] == pytest.approx(THERE)
    run.memory.add_node("lid_2", "box", size=(0.2, 0.2, 0.01))
    run.memory.add_edge("world", "lid_2", "Virtual_RT", pose=Pose((*THERE, 0.1)))
    assert best(run) is None


def test_there_is_no_look_for_what_is_sure_out_of_reach_or_without_a_camera(run: Run) -> None:
    assert best(run) is None
    believe(run.memory, "cube_3", at(0.6, 2.0, 0.0), at(0.4, 0.0, 2.0))
    assert best(run) is None
    believe(run.memory, "cube_3", at(0.6, *HERE), at(0.4, *THERE))
    assert best(run, cameras=False) is None


def test_a_cover_is_lifted_if_only_that_shows_the_thing(run: Run) -> None:
    run.memory.add_node("cup", "cup", size=(0.07, 0.07, 0.08))
    run.memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((*THERE, 0.04)))
    run.memory.add_edge("cup", "table", "on", source="contact")
    gone = Alternative(weight=0.4, pose=None)
    believe(run.memory, "cube_3", at(0.6, *THERE, containers=("cup",)), gone)
    look = best(run)
    assert look is not None and look.cover == "cup" and look.view is None
    assert look.information == pytest.approx(0.673, abs=0.001)
    assert best(run, look) is None, "once is enough"
    add_cube(run.memory, "cube_9", *THERE, 0.1, support="cup")
    assert best(run) is None, "what carries something is not lifted"


def test_lifting_what_hides_next_to_nothing_tells_next_to_nothing(run: Run) -> None:
    run.memory.add_node("cup", "cup", size=(0.07, 0.07, 0.08))
    run.memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((0.3, -0.3, 0.04)))
    run.memory.add_edge("cup", "table", "on", source="contact")
    believe(run.memory, "cube_3", at(0.58, *HERE), at(0.4, *THERE), at(0.02, 0.3, -0.3, containers=("cup",)))
    look = best(run)
    assert look is not None and look.view is not None
    assert best(run, look, Look(1.0, Pose((*THERE, CONFIG.look_height)))) is None


def test_a_vessel_that_is_open_above_is_not_lifted(run: Run) -> None:
    """The camera sees into it: with the vessel away, it would see no more."""
    wall = (0.005, 0.07, 0.06)
    parts = [(wall, (side * 0.0325, 0.0, 0.0)) for side in (-1, 1)]
    shape = to_numbers(tuple(Part("box", size, centre) for size, centre in parts))
    run.memory.add_node("tray", "container", size=(0.07, 0.07, 0.06), shape=shape)
    run.memory.add_edge("world", "tray", "Virtual_RT", pose=Pose((*THERE, 0.03)))
    run.memory.add_edge("tray", "table", "on", source="contact")
    believe(run.memory, "cube_3", at(0.6, *THERE, containers=("tray",)), Alternative(weight=0.4, pose=None))
    look = best(run)
    assert look is not None and look.cover == "" and look.view is not None


def test_what_may_be_anywhere_around_is_looked_at_too(run: Run) -> None:
    wide = Pose((*HERE, 0.02)).with_covariance(np.diag([0.06**2, 0.06**2, 1e-6, 1e-6, 1e-6, 1e-6]))
    believe(run.memory, "cube_3", Alternative(weight=1.0, pose=wide))
    look = best(run)
    assert look is not None and look.view is not None and look.information > 1.0


def test_a_choice_takes_many_short_steps_and_the_scene_of_its_beginning(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The planner's rate holds while the places of things are drawn; what changes meanwhile changes nothing of it."""
    wide = np.diag([0.05**2, 0.05**2, 1e-6, 1e-6, 1e-6, 1e-6])
    places = [(0.25 + 0.07 * column, 0.2 * row) for column in range(4) for row in (-1, 1)]
    spread = [Alternative(weight=1 / 8, pose=Pose((*place, 0.02)).with_covariance(wide)) for place in places]
    believe(run.memory, "cube_3", *spread)
    at_once, _ = drained(choosing(run))
    drawn: list[int] = [0]
    show = Picture.would_show

    def counting(self: Picture, body: Body) -> VisibleFraction:
        drawn[-1] += 1
        return show(self, body)

    monkeypatch.setattr(Picture, "would_show", counting)
    generator, look = choosing(run), None
    while look is None:
        try:
            next(generator)
        except StopIteration as stop:
            look = stop.value
        drawn.append(0)
        if len(drawn) == 3:
            run.memory.remove_node("cube_3")
            run.memory.remove_node("camera_wrist")
    assert look == at_once and len(drawn) > 4 and sum(drawn) == 8 * 8 * USUAL_WORLDS and max(drawn) <= 100
