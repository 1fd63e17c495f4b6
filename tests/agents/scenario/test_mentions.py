"""Expectations are about what can be there; a typo is refused, since what is not there is always absent."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.scenario.format.expectations import Edges
from agents.scenario.format.scenario import load_scenario, parse_scenario
from dsr.errors import ConfigError
from tests.agents.scenario.test_format import BASE, on_a_stand, refusal

PEOPLE = '\n[[person]]\nname = "anne"\nposition = [1, 0, 1]\nlook_at = [0, 0, 0]\n'
PLAN = '\n[[plan]]\nname = "swap"\ngoal = "on(a, b)"\nsteps = ["place a on b"]\n'
IMAGINED = BASE.replace("duration", 'system = "imagination"\nduration') + PEOPLE + PLAN


def expecting(check: str, **values: object) -> str:
    return f"\n[[expect]]\ncheck = '{check}'\n" + "".join(f"{name} = {value!r}\n" for name, value in values.items())


@pytest.mark.parametrize(
    ("check", "values", "message"),
    [
        ("edges", {"absent": [["a", "b"], ["aa", "table"]]}, "absent.2: unknown node 'aa'; did you mean 'a'?"),
        ("edges", {"present": [["a", "tabel"]]}, "present.1: unknown node 'tabel'; did you mean 'table'?"),
        ("edges", {"absent": [["human_hnd_0", "a"]]}, "absent.1: unknown node 'human_hnd_0'; did you mean 'human_h"),
        ("edges", {"absent": [["human_hand_2", "a"]]}, "absent.1: unknown node 'human_hand_2'"),
        ("edges", {"absent": [["arm_link_8", "a"]]}, "absent.1: unknown node 'arm_link_8'"),
        ("edges", {"absent": [["a", "a"]]}, "absent.1: ['a', 'a']: expected two different things"),
        ("inside", {"absent": [["b", "a"], ["a", "a"]]}, "absent.2: ['a', 'a']: expected two different things"),
        ("true_relations", {"absent": [["a", "a"]]}, "absent.1: ['a', 'a']: expected two different things"),
        ("edges", {"absent": [["a", "b"]], "world": "view_of_ann"}, "world: unknown world 'view_of_ann'; did you mean"),
        ("known_in", {"objects": ["a"], "world": "plan_"}, "world: unknown world 'plan_'; did you mean 'plan_swap'?"),
        ("worlds", {"absent": ["plan_swop"]}, "absent.1: unknown world 'plan_swop'; did you mean 'plan_swap'?"),
        ("worlds", {"absent": ["base"]}, "absent.1: unknown world 'base'; valid: plan_swap, view_of_anne"),
        ("attribute", {"node": "aa", "name": "mass", "value": 1}, "node: unknown node 'aa'; did you mean 'a'?"),
        ("attribute", {"node": "a", "name": "mas", "value": 1}, "name: unknown attribute 'mas'; did you mean 'mass'?"),
        (
            "attribute",
            {"node": "a", "name": "mass", "value": "1"},
            "value: the attribute 'mass' is a float; expected a",
        ),
        ("attribute", {"node": "a", "name": "perceived", "value": 1}, "value: the attribute 'perceived' is a bool;"),
        ("attribute", {"node": "a", "name": "size", "value": 1}, "name: the attribute 'size' is a vector, which no"),
        (
            "attribute",
            {"node": "camera_wrist", "name": "mount", "value": "study"},
            "value: unknown mount 'study'; did you mean 'steady'?",
        ),
        (
            "attribute",
            {"node": "action_0_1", "name": "status", "value": "reached"},
            "value: unknown status 'reached'; valid: done, failed, halted, planned, running",
        ),
        ("mission", {"status": "reachd"}, "status: unknown status 'reachd'; did you mean 'reached'?"),
        ("edges", {"present": [["a", "b"]], "absent": [["a", "b"]]}, "absent: ('a', 'b') is `present` too; expected"),
        ("worlds", {"present": ["plan_swap"], "absent": ["plan_swap"]}, "absent: 'plan_swap' is `present` too"),
        ("actions", {"objects": [], "absent": ["Pick"]}, "objects: expected at least one object; leave it out"),
        ("resting", {"objects": []}, "objects: expected at least one object; leave it out"),
        ("belief_error", {"angle": -0.1}, "angle: expected `float` >= 0.0 (rad), got -0.1"),
        ("camera_error", {"angle": -0.1}, "angle: expected `float` >= 0.0 (rad), got -0.1"),
        ("belief_error", {"share": 0.9}, "share: expected `after` (s) with `share`"),
        ("belief_error", {"share": 0.0, "after": 1.0}, "share: expected `float` > 0.0, got 0.0"),
    ],
)
def test_what_cannot_be_there_is_refused(check: str, values: dict[str, object], message: str):
    assert f"expect.1.{message}" in refusal(IMAGINED + expecting(check, **values))


NODES = (
    "a", "anne", "cube_1", "table", "world", "mind", "timeline", "robot", "arm", "arm_link_7", "gripper", "body",
    "human_hand_1", "human_hand_0_finger_4", "camera_overhead", "camera_wrist", "intention_0", "action_0_12",
)  # fmt: skip


def test_whatever_agents_write_may_be_asked_about():
    texts = [expecting("attribute", node=name, name="mass", value=0.5) for name in NODES]
    texts += [expecting("edges", type="sees", absent=[["anne", "b"]], world=world) for world in ("base", "plan_swap")]
    texts.append(expecting("worlds", present=["view_of_anne"], absent=["plan_swap"]))
    assert len(parse_scenario(IMAGINED + "".join(texts)).expectations) == len(texts)


def test_without_a_robot_there_are_no_nodes_of_it():
    seen = expecting("edges", type="sees", present=[["camera_fixed", "a"]])
    assert len(parse_scenario(on_a_stand() + seen).expectations) == 1
    for name in ("gripper", "arm_link_1", "camera_wrist"):
        wrong = expecting("edges", type="grasping", absent=[[name, "a"]])
        assert f"absent.1: unknown node '{name}'" in refusal(on_a_stand() + wrong)


def test_systems_of_ones_own_have_nodes_attributes_and_worlds_of_their_own(tmp_path: Path):
    (tmp_path / "mine.toml").write_text('graph = "mine"\n[[agent]]\nname = "plant"\nclass = "agents.plant:Plant"\n')
    file = tmp_path / "x.toml"
    text = BASE.replace("duration", "system = 'mine.toml'\nduration")
    own = expecting("edges", absent=[["dog", "a"]], world="dream") + expecting("worlds", absent=["dream"])
    file.write_text(text + own + expecting("attribute", node="dog", name="fur", value="brown"))
    assert isinstance(load_scenario(file).expectations[0], Edges)
    file.write_text(text + expecting("edges", absent=[["dog", "a"]], type="bites"))
    with pytest.raises(ConfigError, match="unknown edge type 'bites'"):
        load_scenario(file)
