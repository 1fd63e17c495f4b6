"""`dsr what-if`: how a place is written, and the scenes of other worlds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from dsr import Memory, Pose
from dsr.cli.what_if import parsed_placing
from dsr.errors import ConfigError
from dsr.vocabulary.what_if import SERVICE, Answer, Supposed, WorldOutcome, decode_question, encode_answer


@pytest.mark.parametrize("text", ["cube_3", "=1,2,3", "cube_3=0.3,0.1", "cube_3=0.3,x,0.1", "cube_3=1,2,3,4,5"])
def test_what_is_no_place_says_how_one_is_written(text: str) -> None:
    with pytest.raises(ConfigError, match="expected NAME=X,Y,Z in m"):
        parsed_placing(text)


@pytest.mark.parametrize(("text", "why"), [("a=nan,0,0", "finite"), ("a=0,0,0,0,0,0,0", "norm 0")])
def test_numbers_that_are_no_pose_are_told(text: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        parsed_placing(text)


def test_a_yaw_and_a_quaternion_are_read() -> None:
    assert parsed_placing("a=1,2,3,0").pose == parsed_placing("a=1,2,3,0,0,0,1").pose


def test_the_scene_of_another_world_is_simulated(memory: Memory, cli_json: Callable[..., Any]) -> None:
    asked: list[tuple[Supposed, ...]] = []
    answer = Answer(seconds=1.0, at_rest=True, poses={"cube_3": (0.4, 0.0, 0.02, 0.0, 0.0, 0.0, 1.0)})

    def reply(_key: str, payload: bytes) -> bytes:
        asked.append(decode_question(payload).changes)
        return encode_answer(answer)

    memory.transport.serve(memory.keys.service(SERVICE), reply)
    idea = memory.fork("idea")
    idea.add_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.2, 0.0, 0.02)))
    idea.add_node("cube_9", "cube", size=(0.04, 0.04, 0.04))
    idea.add_edge("world", "cube_9", "Virtual_RT", pose=Pose((0.5, 0.0, 0.02)))
    assert cli_json("what-if", "--hold", "cube_3")["poses"].keys() == {"cube_3"}
    cli_json("what-if", "--world", "idea", "--hold", "cube_9")
    plain, imagined = asked
    assert plain == (Supposed.hold("cube_3"),)
    assert [(change.action, change.object) for change in imagined] == [
        ("place", "cube_3"), ("add", "cube_9"), ("hold", "cube_9")
    ]  # fmt: skip
    assert imagined[0].pose == (0.2, 0.0, 0.02, 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(ConfigError, match="cube_9"):
        cli_json("what-if", "--hold", "cube_9")


def test_each_world_is_told_with_what_moves_anyway_or_why_it_refuses(memory: Memory, cli: Callable[..., str]) -> None:
    rolls, stops = (0.5, 0.0, 0.03, 0.0, 0.0, 0.0, 1.0), (0.4, 0.0, 0.03, 0.0, 0.0, 0.0, 1.0)
    anyway = {"ball": rolls}
    others = (
        WorldOutcome(weight=0.3, otherwise=("ball",), poses={"ball": rolls}, moved={"ball": 0.3}, anyway=anyway),
        WorldOutcome(weight=0.2, otherwise=("ball",), poses={"ball": stops}, moved={"ball": 0.2}, anyway=anyway),
        WorldOutcome(weight=0.1, otherwise=("cube_3",), moved={"cube_4": 0.04}),
    )
    answer = Answer(refused="no room", weight=0.4, others=others)
    memory.transport.serve(memory.keys.service(SERVICE), lambda *_: encode_answer(answer))
    text = " ".join(cli("what-if", "--hold", "cube_3", "--worlds", "4").split())
    assert "where things are believed to be: no room" in text
    assert "30 % ball ball moves by 300 mm anyway" in text
    assert "20 % ball ball moves by 200 mm, 100 mm from where it moves anyway" in text
    assert "10 % cube_3 cube_4 moves by 40 mm" in text
