"""What-if questions before something is put down: a bad place is rejected, and no answer keeps nobody from going on."""

from __future__ import annotations

import math

import msgspec
import pytest

from dsr import Pose
from dsr.believing.distribution import Alternative
from dsr.vocabulary.what_if import SERVICE, Answer, WorldOutcome, decode_question, encode_answer
from planner import foresight
from planner.config import PlannerConfig
from tests.planner.table import SIDE, Run, add_cube, believe, supports


def serve(run: Run, answers: list[Answer]) -> list[tuple[float, ...]]:
    """Let these be the answers, the last one again and again; returns the places asked about."""
    asked: list[tuple[float, ...]] = []

    def reply(_: str, payload: bytes) -> bytes:
        [change] = decode_question(payload).changes
        assert change.action == "place" and change.pose is not None
        asked.append(tuple(round(number, 3) for number in change.pose[:3]))
        return encode_answer(answers[min(len(asked), len(answers)) - 1])

    run.lockstep.bus.serve(run.lockstep.keys.service(SERVICE), reply)
    return asked


STAYS = Answer(seconds=0.2, at_rest=True, moved={"cube_3": 0.001, "cube_4": 0.0}, turned={"cube_3": 0.01})
SLIDES = Answer(seconds=1.0, moved={"cube_3": 0.04, "cube_4": 0.02}, turned={})
TURNS = Answer(seconds=1.0, moved={"cube_3": 0.004}, turned={"cube_3": 0.8})


def test_what_stays_is_put_down() -> None:
    with Run(what_if_patience=1.0) as run:
        asked = serve(run, [STAYS])
        run.want("on(cube_3,cube_4)")
        run.until("reached")
        assert asked == [(0.3, 0.08, 0.06)]


@pytest.mark.parametrize("bad", [SLIDES, TURNS])
def test_another_place_on_the_table_is_chosen_where_something_would_topple(bad: Answer) -> None:
    with Run(what_if_patience=1.0) as run:
        add_cube(run.memory, "cube_9", 0.42, 0.08, 0.06, "cube_3")
        asked = serve(run, [bad, bad, STAYS])
        run.want("clear(cube_3) & handempty")
        run.until("reached")
        assert len(set(asked)) == 3 and run.replans == 0
        x, y, _ = run.memory.transform("world", "cube_9", types=("Virtual_RT",)).t
        assert (round(x, 3), round(y, 3)) == asked[-1][:2]


def test_a_tower_that_would_topple_is_not_built() -> None:
    with Run(what_if_patience=1.0) as run:
        serve(run, [SLIDES])
        run.want("on(cube_3,cube_4)")
        run.until("failed", 120.0)
        assert run.explanation == "place cube_3 on cube_4 is not wise: cube_3 would move by 40 mm"
        assert "place cube_3 cube_4 done" not in run.arm.done


def test_without_an_answer_it_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    with Run(what_if_patience=1.0) as run:
        run.want()
        run.until("reached")
        assert supports(run.memory)["cube_3"] == "cube_4"
        assert caplog.text.count("without knowing what would topple") == 1


def test_a_refusal_is_no_verdict() -> None:
    with Run(what_if_patience=1.0) as run:
        serve(run, [Answer(refused="it has just started", weight=0.0)])
        run.want("on(cube_3,cube_4)")
        run.until("reached")


def test_the_worst_movement_is_told() -> None:
    config = PlannerConfig()
    assert foresight._problem(Answer(), config) == ""
    assert foresight._problem(STAYS, config) == ""
    assert foresight._problem(SLIDES, config) == "cube_3 would move by 40 mm"
    assert foresight._problem(TURNS, config) == "cube_3 would turn by 0.8 rad"


def test_what_moves_anyway_does_not_count_against_a_place() -> None:
    rolls = (0.5, 0.0, 0.03, 0.0, 0.0, 0.0, 1.0)
    alone = WorldOutcome(poses={"ball": rolls}, moved={"ball": 0.3}, turned={"ball": 3.0}, anyway={"ball": rolls})
    assert foresight._problem(alone, PlannerConfig()) == ""
    stopped = msgspec.structs.replace(alone, poses={"ball": (0.4, *rolls[1:])}, moved={"ball": 0.2})
    assert foresight._problem(stopped, PlannerConfig()) == "ball would move by 100 mm"


def test_a_place_without_room_in_most_worlds_is_bad_though_others_answer() -> None:
    """It is so, too, if the world that the graph shows is one of those; and if they all are."""
    for stays in (0.1, 0.0):
        answers = (WorldOutcome(weight=stays, moved=STAYS.moved),) if stays else ()
        refusal = Answer(refused="'cube_3' would be 20 mm inside 'cube_6' there", weight=1.0 - stays, others=answers)
        with Run(what_if_patience=1.0) as run:
            add_cube(run.memory, "cube_9", 0.42, 0.08, 0.06, "cube_3")
            asked = serve(run, [refusal, STAYS])
            run.want("clear(cube_3) & handempty")
            run.until("reached")
            assert len(set(asked)) == 2


def in_doubt(sliding: float) -> Answer:
    """In a world of this probability something slides, and not in the one that the graph shows."""
    other = WorldOutcome(weight=sliding, otherwise=("cube_4",), moved=SLIDES.moved)
    return msgspec.structs.replace(STAYS, weight=1.0 - sliding, others=(other,))


@pytest.mark.parametrize(("sliding", "is_bad"), [(0.1, False), (0.3, True)])
def test_a_place_on_the_table_has_to_be_safe_in_most_worlds(sliding: float, is_bad: bool) -> None:
    with Run(what_if_patience=1.0) as run:
        add_cube(run.memory, "cube_9", 0.42, 0.08, 0.06, "cube_3")
        asked = serve(run, [in_doubt(sliding), STAYS])
        run.want("clear(cube_3) & handempty")
        run.until("reached")
        assert len(asked) == 1 + is_bad


@pytest.mark.parametrize(("sliding", "end"), [(0.4, "reached"), (0.6, "failed")])
def test_something_is_put_on_a_thing_if_it_stays_there_more_probably_than_not(sliding: float, end: str) -> None:
    with Run(what_if_patience=1.0) as run:
        serve(run, [in_doubt(sliding)])
        run.want("on(cube_3,cube_4)")
        run.until(end, 120.0)
        assert end == "reached" or run.explanation.endswith("cube_3 would move by 40 mm (60 % probable)")


def test_a_place_where_something_may_be_is_not_even_asked_about() -> None:
    """The places beside it are as bad: of those that are nearest all would be tried in vain."""
    spots = []
    for may_be_there in (False, True):
        with Run(what_if_patience=1.0) as run:
            add_cube(run.memory, "cube_9", 0.42, 0.08, 0.06, "cube_3")
            asked = serve(run, [STAYS])
            if may_be_there:
                places = [(0.6, (0.42, -0.08, 0.02)), (0.4, (*spots[0], 0.02))]
                alternatives = [Alternative(weight=weight, pose=Pose(place)) for weight, place in places]
                believe(run.memory, "cube_6", *alternatives)
            run.want("clear(cube_3) & handempty")
            run.until("reached")
            [spot] = asked
            spots.append(spot[:2])
    assert math.dist(*spots) > SIDE + PlannerConfig().clearance
