"""The pages about what the robot wants, does and thinks."""

from __future__ import annotations

import logging
from typing import Any

import pytest
import rerun as rr

from agents.viewer import palette
from agents.viewer.elapsed import Elapsed
from agents.viewer.mind import explanations_page, plan_page
from agents.viewer.texts import drawable, markdown

GOAL = "on(cube_3, cube_4)"


def want(stage: Any, **values: Any) -> None:
    memory = stage.memory
    memory.add_node("mind", "mind")
    memory.add_node("intention_0", "intention", goal=GOAL, **values)
    memory.add_edge("mind", "intention_0", "has")


def plan(stage: Any, *statuses: str) -> None:
    for order, status in enumerate(statuses):
        skill, destination = ("place", "cube_4") if order % 2 else ("pick", "")
        name = f"action_0_{order}"
        values = {"order": order, "skill": skill, "target": "cube_3", "destination": destination, "status": status}
        stage.memory.add_node(name, "action", **values)
        stage.memory.add_edge("intention_0", name, "has")


def explain(stage: Any, number: int, *rejected: str) -> None:
    values = {"time": 3600.0 + number, "score": 4.04, "policy": "hypotheses", "target": "cube_3, cube_4"}
    explanation = f"moved_with_supports(cube_{number}; cube_4)"
    values |= {"explanation": explanation, "alternatives": "\n".join(rejected)}
    stage.memory.add_node(f"event_{number}", "event", **values)


def explained_page(stage: Any) -> str:
    """The page of a view that has looked since time 3600."""
    elapsed = Elapsed(rr.RecordingStream("test"), False, logging.getLogger("test"))
    elapsed.set(3600.0)
    return explanations_page(stage.memory, elapsed)


def test_nothing_is_wanted_and_nothing_had_to_be_explained(stage: Any) -> None:
    assert "Nothing is wanted" in plan_page(stage.memory)
    assert "Nothing had to be explained" in explained_page(stage)


def test_the_plan_shows_each_action_with_its_status_in_order(stage: Any) -> None:
    want(stage, status="executing", explanation="action 2 of 3", replans=2)
    plan(stage, "done", "running", "planned")
    page = plan_page(stage.memory)
    assert r"**on(cube\_3, cube\_4)** *executing, planned again 2 times*: action 2 of 3" in page
    assert page.splitlines()[-3:] == [
        r"| pick cube\_3 | done |",
        r"| **place cube\_3 on cube\_4** | **running** |",
        r"| pick cube\_3 | planned |",
    ]


def test_what_is_done_takes_one_row_while_there_is_more_to_do(stage: Any) -> None:
    want(stage, status="executing")
    plan(stage, "done", "done", "done", "running", "planned")
    page = plan_page(stage.memory)
    assert page.count("done") == 1 and "| *3 actions* | done |" in page and "**running**" in page
    for number in (3, 4):
        stage.memory.update_node(f"action_0_{number}", status="done")
    assert plan_page(stage.memory).count("| done |") == 5


def test_a_failure_is_shown_with_its_reason_and_a_grip_by_name(stage: Any) -> None:
    want(stage, status="failed", explanation="no way")
    plan(stage, "planned")
    stage.memory.update_node("action_0_0", status="failed", explanation="out of reach")
    stage.memory.add_node("gripper", "gripper")
    stage.memory.add_node("cube_3", "cube")
    stage.memory.add_edge("gripper", "cube_3", "grasping")
    page = plan_page(stage.memory)
    assert r"| pick cube\_3 | failed: out of reach |" in page and page.startswith(r"Holds **cube\_3**." + "\n")


def test_what_hands_hold_the_robot_does_not_hold(stage: Any) -> None:
    for name, type in (("human_hand_0", "hand"), ("cup", "cup"), ("lid", "box")):
        stage.memory.add_node(name, type)
    for thing in ("cup", "lid"):
        stage.memory.add_edge("human_hand_0", thing, "grasping")
    assert plan_page(stage.memory).startswith(r"Holds nothing. human\_hand\_0 holds **cup and lid**." + "\n")


def test_only_the_last_of_many_actions_are_shown(stage: Any) -> None:
    want(stage, status="executing")
    plan(stage, *["done"] * 40)
    assert plan_page(stage.memory).count("| done |") == 12


def test_an_explanation_is_shown_with_what_was_rejected(stage: Any) -> None:
    explain(stage, 3, "5.0 held(cube_3)", "16.9 false_percept(cube_3)")
    page = explained_page(stage)
    assert r"3.0 s cube\_3, cube\_4, by hypotheses; the smallest score is the best" in page
    assert page.splitlines()[-3:] == [
        r"- **4.0 cube\_3 moved, and cube\_4 beneath it moved along** (chosen)",
        r"- 5.0 something holds cube\_3",
        r"- 16.9 what was seen of cube\_3 is false",
    ]


def test_the_newest_explanation_comes_first_and_old_ones_are_short(stage: Any) -> None:
    for number in range(12):
        explain(stage, number, "5.0 a", "6.0 b", "7.0 c", "8.0 d", "9.0 e", "10.0 f")
    page = explained_page(stage)
    order = [page.find(f"cube\\_{number} moved") for number in range(11, 3, -1)]
    assert order == sorted(order) and order[0] > 0
    assert page.count("chosen") == 3 and page.count("and 2 more") == 3 and r"cube\_3 moved" not in page


def test_what_is_surprising_comes_first(stage: Any) -> None:
    stage.memory.add_node("cube_3", "cube", surprising=True, surprise="seen 38 mm beside its belief")
    assert explained_page(stage).startswith(r"**Surprising: cube\_3**, seen 38 mm beside its belief")


@pytest.mark.parametrize("time", [1e12, -1e12])
def test_an_event_at_no_time_is_shown_all_the_same(stage: Any, time: float) -> None:
    explain(stage, 3)
    stage.memory.update_node("event_3", time=time)
    assert "at no time" in explained_page(stage)


def test_pages_are_logged_when_they_change(stage: Any) -> None:
    stage.start_viewer()
    want(stage, status="executing")
    plan(stage, "running")
    stage.run()
    stage.memory.update_node("action_0_0", status="done")
    stage.run()
    explain(stage, 3)
    stage.run()
    shown = stage.finish()
    pages = [value[0] for value in shown.values("/mind/plan", "TextDocument:text")]
    assert 2 <= len(pages) <= 3 and "**running**" in pages[-2] and "| done |" in pages[-1]
    assert shown.values("/mind/plan", "TextDocument:media_type")[-1] == ["text/markdown"]
    assert r"cube\_4 beneath it moved along" in shown.values("/mind/explanations", "TextDocument:text")[-1][0]


def test_surprises_and_explanations_stand_out_in_the_log(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.run(0.5)
    stage.memory.update_node("cube_3", surprising=True, surprise="seen 38 mm beside its belief")
    explain(stage, 3, *(f"{5 + number}.0 label_{number}" for number in range(5)))
    stage.run(0.5)
    stage.memory.update_node("cube_3", surprising=False)
    stage.run(0.5)
    shown = stage.finish()
    assert "cube_3 surprising: seen 38 mm beside its belief" in shown.texts()
    assert "cube_3 not surprising any more" in shown.texts()
    assert not any("event_3" in text for text in shown.texts())
    told = "cube_3 moved, and cube_4 beneath it moved along (score 4.0, 5 rejected)"
    assert shown.texts("/log/explained") == [told]
    red, green, blue = palette.SURPRISE
    marked = red << 24 | green << 16 | blue << 8 | 255
    assert [color for [color] in shown.values("/log/graph", "TextLog:color")].count(marked) == 1


def test_an_explanation_comes_after_its_surprise(stage: Any) -> None:
    """The percept that was explained is older than the surprise about it."""
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.run(0.5)
    seen = stage.clock.now() - 0.2
    stage.memory.update_node("cube_3", surprising=True, surprise="seen 38 mm beside its belief")
    explain(stage, 3)
    stage.memory.update_node("event_3", time=seen)
    stage.run(0.5)
    shown = stage.finish()
    [explained], [text] = shown.times("/log/explained"), shown.values("/log/explained", "TextLog:text")
    surprised = shown.times("/log/graph")[shown.texts().index("cube_3 surprising: seen 38 mm beside its belief")]
    assert explained == surprised and float(text[0].split()[0]) == pytest.approx(surprised - 0.2)


def test_letters_that_would_end_the_viewer_are_replaced(stage: Any) -> None:
    assert drawable("a ✖ 魔 é\n\x1b[2J") == "a ? ? é ?[2J"
    assert drawable("x" * 5000, 100) == f"{'x' * 100} ..."
    assert markdown("[a](b) <i> | `c` $x$") == r"\[a\](b) \<i\> \| \`c\` \$x\$"
    want(stage, status="✖")
    explain(stage, 3, "5.0 ✖ | a")
    for page in (plan_page(stage.memory), explained_page(stage)):
        assert "✖" not in page and max(page) < "\u0250"
