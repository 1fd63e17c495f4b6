"""How probably an unseen thing is recognised at the places where it may be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from dsr.believing.absence import most_missed, somewhere
from simulation_handler.explaining.recognition import recognised_about
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.scales import UNSEEN_SLACK
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.occluded import SMALL, Occlusion, standing
from tests.simulation_handler.worlds import CUBE

HERE = Solid("cube", CUBE, (0.3, 0.0, 0.02))


class Gap:
    """A camera that sees a thing whole between two places (m) along x, and nothing of it elsewhere."""

    def __init__(self, first: float, last: float) -> None:
        self.first, self.last = first, last
        self.asked = 0

    def __call__(self, solids: Sequence[Solid], _: Sequence[Solid]) -> list[dict[str, ExpectedVisibility]]:
        self.asked += 1
        return [
            {"camera": ExpectedVisibility(float(self.first < solid.position[0] < self.last), "screen")}
            for solid in solids
        ]


@pytest.mark.parametrize(("half", "shown"), [(1.0, 4), (UNSEEN_SLACK, 2)])
def test_through_a_gap_all_places_count_where_it_may_be(half: float, shown: int) -> None:
    certain = ExpectedVisibility(1.0, "").recognised
    never = ExpectedVisibility(0.0, "").recognised
    (found,) = recognised_about([HERE], [], Gap(0.3 - half, 0.3 + half))
    assert sorted(found["camera"], reverse=True) == [certain] * shown + [never] * (4 - shown)


def test_what_is_hidden_where_it_is_believed_is_asked_of_once() -> None:
    gap = Gap(0.31, 0.4)
    assert recognised_about([HERE], [], gap) == [{"camera": (pytest.approx(0.0, abs=1e-9),)}] and gap.asked == 1


def test_many_places_take_two_questions_and_get_what_each_gets_alone() -> None:
    places = [HERE.moved((0.3 + 0.004 * step, 0.0, 0.02)) for step in range(-5, 6)]
    gap = Gap(0.29, 0.31)
    assert recognised_about(places, [], gap) == [recognised_about([place], [], gap)[0] for place in places]
    gap.asked = 0
    recognised_about(places, [], gap)
    assert gap.asked == 2


def test_a_place_where_it_is_never_recognised_explains_its_absence() -> None:
    """The thing stays where it is: frames do not take turns among places."""
    assert somewhere([1.0]) == pytest.approx(1.0) and somewhere([0.6, 0.6]) == pytest.approx(0.6)
    assert most_missed(somewhere([1.0, 1.0, 1.0, 0.0])) == pytest.approx(math.log(4.0), rel=1e-3)


@pytest.mark.parametrize("hides", [True, False])
def test_what_one_camera_does_not_show_another_one_may(hides: bool) -> None:
    """Each of two cameras sees a cube at all but one of the places where it may be. A place both miss explains it."""
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE), "ball": standing(0.3, 0.3, SMALL)})
    world.run(1.0)
    world.seen.discard("cube")

    def visibility(solids: Sequence[Solid], among: Sequence[Solid]) -> list[dict[str, ExpectedVisibility]]:
        aside = [solid.position[1] if solid.name == "cube" else 0.0 for solid in solids]
        seen, unseen = ExpectedVisibility(1.0, ""), ExpectedVisibility(0.0, "")
        other = 1.0 if hides else -1.0
        return [
            {"left": unseen if y > 0.01 else seen, "right": unseen if other * y > 0.01 else seen} for y in aside
        ]

    world.visibility = visibility
    world.run(5.0)
    assert ("cube" in world.belief._bodies.sim) is hides
