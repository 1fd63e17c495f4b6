"""Questions over 27 scenarios, each with when it is asked and how the truth tells a right answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from agents.scenario.truth.actions import true_actions
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.relations import true_contents, true_relations
from dsr.narration.answer import Response

SOON = 1.0
"""s by which the time of an answer may be off: what is noticed is noticed by then"""


class Truth(NamedTuple):
    """What the judge knows of the moment of a question."""

    history: History
    time: float
    """s after the start"""
    start: float
    """s, time 0 of the run on the memory's clock"""

    def sample(self, time: float | None = None) -> Sample:
        """The last sample until a time (s after the start); that of the question if None."""
        until = self.time if time is None else time
        return [one for one in self.history.samples if one.time <= until + 1e-6][-1]

    def under(self, thing: str, time: float | None = None) -> set[str]:
        """What a thing truly rests on or is in."""
        return {lower for _, upper, lower in self.relations(time) if upper == thing}

    def relations(self, time: float | None = None) -> set[tuple[str, str, str]]:
        """All true relations: `on` or `in`, the thing, what it is on or in."""
        sample, scenario = self.sample(time), self.history.scenario
        resting = {("on", *pair) for pair in true_relations(scenario, sample.truth, sample.gripped)}
        return resting | {("in", *pair) for pair in true_contents(scenario, sample.truth)}

    def action(self, kind: str, thing: str) -> tuple[float, str]:
        """When (s after the start) the last true action of a kind on a thing was, and by whom."""
        found = [one for one in true_actions(self.history) if (one.kind, one.thing) == (kind, thing)]
        last = [one for one in found if one.time <= self.time][-1]
        return last.time, last.by


Check = Callable[[Response, Truth], bool]
"""Whether a response that was understood is right."""


class Asked(NamedTuple):
    """A question of the benchmark."""

    scenario: str
    time: float
    """s after the start"""
    question: str
    is_right: Check


def rests(thing: str, time: float | None = None) -> Check:
    """The answer names all that a thing truly is in, and nothing that it is not on or in."""

    def check(response: Response, truth: Truth) -> bool:
        true = truth.under(thing, time)
        inside = {lower for kind, upper, lower in truth.relations(time) if (kind, upper) == ("in", thing)}
        return bool(response.names) and inside <= set(response.names) <= true

    return check


def contents(relation: str, lower: str, time: float | None = None) -> Check:
    """The answer names just the things that are truly on or in something."""

    def check(response: Response, truth: Truth) -> bool:
        true = {upper for kind, upper, below in truth.relations(time) if (kind, below) == (relation, lower)}
        return set(response.names) == true

    return check


def yes(true: Callable[[Truth], bool]) -> Check:
    """The verdict is what is true."""
    return lambda response, truth: response.verdict is true(truth)


def related(relation: str, upper: str, lower: str, time: float | None = None) -> Check:
    """The verdict is whether the relation truly holds."""
    return yes(lambda truth: (relation, upper, lower) in truth.relations(time))


def gone(thing: str) -> Check:
    """The verdict is whether a thing has truly left."""
    return yes(lambda truth: thing not in truth.sample().truth)


def held_by(thing: str) -> Check:
    """The answer names who truly holds a thing, or nobody."""

    def check(response: Response, truth: Truth) -> bool:
        holder = truth.sample().grasped.get(thing)
        return list(response.names) == ([holder] if holder else [])

    return check


def done_at(kind: str, thing: str) -> Check:
    """The time of the answer is that of the true action, or spans it where the answer says that nobody saw it."""

    def check(response: Response, truth: Truth) -> bool:
        true = truth.action(kind, thing)[0] + truth.start
        if response.time is None:
            return False
        begin = response.time if response.since is None else response.since
        return begin - SOON <= true <= response.time + SOON

    return check


def done_by(kind: str, thing: str) -> Check:
    """The answer names who truly did it."""
    return lambda response, truth: response.names == (truth.action(kind, thing)[1],)


def named(*names: str) -> Check:
    """The answer names just these things: for what follows from the scenario, as whom somebody saw when."""
    return lambda response, truth: set(response.names) == set(names)


def verdict(value: bool) -> Check:
    """The verdict is this: for what follows from the scenario and physics."""
    return lambda response, truth: response.verdict is value


def says(*words: str) -> Check:
    """The text has all of these words, and there is evidence: for causes, which the scenario's file tells."""
    return lambda response, truth: bool(response.evidence) and all(word in response.text for word in words)


def count(number: int) -> Check:
    """The answer names so many things."""
    return lambda response, truth: len(response.names) == number


def seen_until(time: float) -> Check:
    """The time of the answer is one until which the scenario shows the thing (s after the start)."""
    return lambda response, truth: response.time is not None and abs(response.time - truth.start - time) <= SOON


def nearest(thing: str) -> Check:
    """The answer names the thing whose centre is truly closest."""

    def check(response: Response, truth: Truth) -> bool:
        poses = truth.sample().truth
        here = poses[thing]
        far = {name: here.distance(pose)[0] for name, pose in poses.items() if name != thing}
        return response.names == (min(far, key=lambda name: far[name]),)

    return check


def first(check: Check) -> Check:
    """Of two questions in one, the answer to the first is right."""
    return lambda response, truth: bool(response.parts) and check(response.parts[0], truth)


QUESTIONS = (
    Asked("cubes_swapped", 9.0, "where is cube_3?", rests("cube_3")),
    Asked("cubes_swapped", 9.0, "How many cubes are there?", count(4)),
    Asked("cubes_swapped", 9.0, "is cube_4 on cube_5", related("on", "cube_4", "cube_5")),
    Asked("cubes_swapped", 9.0, "why did cube_3 move?", says("cube_3", "changed places")),
    Asked("cubes_swapped", 9.0, "what happened in the last 5 s?", says("changed places")),
    Asked("cubes_swapped", 9.0, "are cube_3 and cube_5 where they were?", verdict(False)),
    Asked("c_pour", 6.0, "who holds the ball?", held_by("ball")),
    Asked("c_pour", 9.0, "where is the ball?", rests("ball")),
    Asked("c_pour", 9.0, "when was the ball picked up?", done_at("Pick", "ball")),
    Asked("c_pour", 27.0, "what is in the blue box?", contents("in", "blue")),
    Asked("c_pour", 27.0, "was the ball in the green box 17 s ago?", related("in", "ball", "green", 10.0)),
    Asked("c_pour", 27.0, "which box is the ball in?", named("blue")),
    Asked("false_belief", 42.0, "where does sally think the cube is?", named("first_cup", "table")),
    Asked("false_belief", 42.0, "where will Sally look for the cube?", named("first_cup", "table")),
    Asked("false_belief", 42.0, "does anne know where the cube is?", verdict(True)),
    Asked("false_belief", 42.0, "Is Sally wrong about the cube?", verdict(True)),
    Asked("false_belief", 42.0, "is sally there?", verdict(False)),
    Asked("false_belief", 42.0, "who put the second cup down?", done_by("Place", "second_cup")),
    Asked("false_belief", 42.0, "Where's the cube?", rests("cube")),
    Asked("false_belief", 42.0, "can anne see the cube?", verdict(False)),
    Asked("three_cube_tower", 18.0, "what is under cube_3?", named("cube_4")),
    Asked("three_cube_tower", 18.0, "what does the robot want?", says("cube_3 on cube_4", "cube_6 on cube_5")),
    Asked("three_cube_tower", 18.0, "would cube_3 fall if cube_4 were removed?", verdict(True)),
    Asked("three_cube_tower", 18.0, "what if cube_5 were taken away?", named("cube_6")),
    Asked("three_cube_tower", 18.0, "what does the gripper hold?", named()),
    Asked("three_cube_tower", 28.0, "where is cube_6?", rests("cube_6")),
    Asked("three_cube_tower", 28.0, "why do you think that cube_6 is on cube_3?", says("cube_6", "explanation")),
    Asked("three_cube_tower", 28.0, "what was on cube_5 10 s ago?", contents("on", "cube_5", 18.0)),
    Asked("b_drop_in_box", 6.0, "is the ball in the box?", related("in", "ball", "box")),
    Asked("b_drop_in_box", 11.0, "is the ball in the box?", related("in", "ball", "box")),
    Asked("b_drop_in_box", 11.0, "what hides the ball?", named("box")),
    Asked("b_drop_in_box", 11.0, "who dropped the ball?", done_by("Release", "ball")),
    Asked("b_drop_in_box", 11.0, "what happened to the ball?", says("picked ball up", "ball came to be in box")),
    Asked("b_drop_in_box", 11.0, "how long has the ball been in the box?", seen_until(8.0)),
    Asked("d_carried_inside", 20.0, "who holds the blue box", held_by("blue")),
    Asked("d_carried_inside", 20.0, "what is in blue?", contents("in", "blue")),
    Asked("d_carried_inside", 27.0, "where is the ball now?", rests("ball")),
    Asked("d_carried_inside", 27.0, "when did the ball fall?", done_at("Release", "ball")),
    Asked("d_carried_inside", 27.0, "is the ball visible?", verdict(False)),
    Asked("e_held_behind_back", 10.0, "where is the cup?", held_by("cup")),
    Asked("e_held_behind_back", 10.0, "who has the cup?", held_by("cup")),
    Asked("e_held_behind_back", 10.0, "why is the cup hidden?", says("does not know", "human_hand_0 took it")),
    Asked("e_held_behind_back", 10.0, "is the cup gone?", gone("cup")),
    Asked("e_held_behind_back", 19.0, "where is the cup?", rests("cup")),
    Asked("e_held_behind_back", 19.0, "is anybody behind the box?", verdict(False)),
    Asked("cube_removed", 12.0, "is cube_5 gone?", gone("cube_5")),
    Asked("cube_removed", 12.0, "why is cube_5 gone?", says("cube_5 was taken away")),
    Asked("cube_removed", 12.0, "is cube_6 gone?", gone("cube_6")),
    Asked("cube_removed", 12.0, "when was cube_5 last seen?", seen_until(6.0)),
    Asked("cube_removed", 12.0, "which things are there?", named("cube_3", "cube_4", "cube_6")),
    Asked("cube_removed", 12.0, "what colour is cube_5?", named()),
    Asked("lid", 17.0, "what is on the blue box?", contents("on", "blue")),
    Asked("lid", 17.0, "does the robot see the ball?", verdict(False)),
    Asked("lid", 17.0, "what is under the lid?", named("blue")),
    Asked("lid", 28.0, "who picked up the lid?", done_by("Pick", "lid")),
    Asked("lid", 28.0, "where was the lid 10 s ago?", rests("lid", 18.0)),
    Asked("put_down_unseen", 15.0, "where is the cup?", rests("cup")),
    Asked("put_down_unseen", 15.0, "what hides the cup?", named("wall")),
    Asked("put_down_unseen", 15.0, "when was the cup put down?", done_at("Place", "cup")),
    Asked("put_down_unseen", 23.0, "is the cup visible?", verdict(True)),
)
"""All of them were written down before any was asked, and none was changed since but for errors in its check."""
NAIVE = (
    Asked("cubes_swapped", 9.0, "Where's cube_3 got to?", rests("cube_3")),
    Asked("cubes_swapped", 9.0, "Can you tell me where cube_5 is right now?", rests("cube_5")),
    Asked("three_cube_tower", 18.0, "What's sitting on top of cube_4?", contents("on", "cube_4")),
    Asked("three_cube_tower", 18.0, "Is there anything under cube_3?", yes(lambda truth: bool(truth.under("cube_3")))),
    Asked("lid", 28.0, "Did somebody move the lid?", verdict(True)),
    Asked("c_pour", 9.0, "Who took the ball?", done_by("Pick", "ball")),
    Asked("b_drop_in_box", 11.0, "Is the ball still in the box?", related("in", "ball", "box")),
    Asked("cube_removed", 12.0, "how many cubes are there", count(3)),
    Asked("lid", 17.0, "Which things can't the camera see?", named("ball")),
    Asked("b_drop_in_box", 11.0, "When was the ball last seen?", seen_until(8.0)),
    Asked("three_cube_tower", 28.0, "Why isn't the robot doing anything?", says("cube_3 on cube_4")),
    Asked("c_pour", 27.0, "What just happened?", says("ball came to be in blue")),
    Asked("three_cube_tower", 18.0, "What is the robot holding?", named()),
    Asked("false_belief", 42.0, "Does Anne know where the cube is?", verdict(True)),
    Asked("false_belief", 42.0, "Where would Sally look for the cube?", named("first_cup", "table")),
    Asked("three_cube_tower", 18.0, "If I took cube_4 away, would anything fall over?", verdict(True)),
    Asked("b_drop_in_box", 11.0, "How sure are you about where the ball is?", verdict(False)),
    Asked("put_down_unseen", 23.0, "What's the closest thing to the cup?", nearest("cup")),
    Asked("cubes_swapped", 9.0, "Has anything changed in the last five seconds?", says("changed places")),
    Asked("d_carried_inside", 27.0, "Did the ball fall, or did somebody put it there?", first(verdict(True))),
)
"""Worded by somebody who did not know the grammar. Names are those of the scenarios; the checks came later."""
FRESH = (
    Asked("shell_game", 15.0, "Under which box is the ball hidden?", named("small")),
    Asked("shell_game", 48.0, "So where did the ball end up?", rests("ball")),
    Asked("nested_carried", 20.0, "What's inside the green box?", contents("in", "green")),
    Asked("nested_carried", 31.0, "Is the cube still inside the crate?", related("in", "cube", "crate")),
    Asked("nested_carried", 31.0, "What was the last thing somebody picked up?", named("green")),
    Asked("pour_twice", 47.0, "In which box did the ball end up?", named("red")),
    Asked("pour_twice", 47.0, "Has the ball ever been in the blue box?", verdict(True)),
    Asked("joint_action", 4.0, "What is human_2 looking at?", named("green_box")),
    Asked("joint_action", 18.0, "Does human_1 know that the cube was moved?", verdict(False)),
    Asked("joint_action", 18.0, "Can either of the two people see the cube?", verdict(False)),
    Asked("tower_toppled", 20.0, "How come cube_3 isn't on cube_4 any more?", says("cube_3", "fell")),
    Asked("brought_in", 19.0, "Who brought the cup?", done_by("Place", "cup")),
    Asked("brought_in", 19.0, "How long has the cup been standing there?", done_at("Place", "cup")),
    Asked("pushed_while_hidden", 12.5, "Is the cup still where it used to be?", verdict(False)),
    Asked("pushed_while_hidden", 21.0, "What pushed the cup?", named("box")),
    Asked("dropped_behind_box", 18.0, "Is there something behind the large box?", verdict(True)),
    Asked("dropped_behind_box", 16.0, "Is the hand empty now?", verdict(True)),
    Asked("laid_in_box", 15.0, "What did the hand do with the ball?", says("picked ball up", "put ball down")),
    Asked("camera_bumped", 15.0, "Has the camera moved?", verdict(True)),
    Asked("camera_bumped", 15.0, "Have any of the cubes moved?", verdict(False)),
)
"""Over ten other scenarios, worded as people talk, by somebody who knew the grammar. All were written before any was
asked."""
LATER = (
    Asked("hand_carries", 7.0, "Who is holding cube_3?", held_by("cube_3")),
    Asked("hand_carries", 15.0, "What did somebody do with cube_3?", says("picked cube_3 up", "put cube_3 down")),
    Asked("hand_carries", 15.0, "Which of the cubes was moved?", named("cube_3")),
    Asked("hand_carries", 15.0, "Is anybody still holding cube_3?", verdict(False)),
    Asked("cube_rotated", 14.0, "What happened with cube_3?", says("cube_3", "turned")),
    Asked("cube_rotated", 14.0, "Did cube_4 stay where it was?", verdict(True)),
    Asked("cube_rotated", 14.0, "How sure are you that cube_3 is on the table?", verdict(True)),
    Asked("cubes_moved_alike", 15.0, "Which cubes have been moved?", named("cube_3", "cube_6")),
    Asked("cubes_moved_alike", 15.0, "Has anybody bumped into the camera?", verdict(False)),
    Asked("carried_under_hand", 11.0, "What's the hand holding at the moment?", named("cube")),
    Asked("carried_under_hand", 11.0, "Why can't you see the cube?", says("human_hand_0")),
    Asked("carried_under_hand", 19.0, "Is the cube back on the table?", related("on", "cube", "table")),
    Asked("carried_under_hand", 19.0, "When was the cube put down?", done_at("Place", "cube")),
    Asked("hovering_unseen_2", 30.0, "What's the bottom cube of the stack?", named("cube_4")),
    Asked("hovering_unseen_2", 30.0, "Have you ever seen cube_4?", verdict(False)),
    Asked("blackout_put", 8.0, "Can you see anything right now?", verdict(False)),
    Asked("blackout_put", 18.0, "Which cube is on top of another one?", named("cube_3")),
    Asked("blackout_put", 18.0, "How many cubes are standing on the table?", count(3)),
    Asked("false_percept", 14.0, "Did anything move?", verdict(False)),
    Asked("false_percept", 14.0, "Was there anything odd?", says("cube_3")),
)
"""Over seven more scenarios, by the same, after the grammar had been mended for those before."""
