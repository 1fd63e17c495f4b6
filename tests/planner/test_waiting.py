"""Goals about things that are nowhere: said at once, waited for as long as it makes sense, and then given up."""

from __future__ import annotations

import pytest

from dsr import Agent
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.status import State
from dsr.runtime.system import AgentSpec
from planner.config import PlannerConfig
from tests.planner.table import Run, add_cube, move

CANNOT_LOOK = "and cannot look for it: the arm carries no camera that sends images"
PATIENCE = PlannerConfig().patience


class Estimator(Agent):
    """Stands for who sees things."""

    name = "estimator"
    rate_hz = 1.0

    def tick(self, now: float) -> None:
        pass


def known(run: Run, name: str, **attributes: object) -> None:
    """An object that somebody has told the graph about, and that is nowhere."""
    run.memory.add_node(name, "cube", size=(0.04, 0.04, 0.04), **attributes)


def planner_status(lockstep: Lockstep) -> tuple[State, str]:
    status = lockstep.runner("planner").status()
    return status.state, status.last_error


def test_a_thing_that_was_never_seen_is_told_at_once_and_given_up_in_time() -> None:
    with Run() as run:
        known(run, "cube_9")
        run.want("on(cube_3,cube_9)")
        run.until("waiting", 0.5)
        assert run.explanation == f"never seen: cube_9; gives up after {PATIENCE:g} s"
        assert planner_status(run.lockstep) == (State.DEGRADED, f"intention_0: {run.explanation}")
        run.go(PATIENCE - 0.5)
        assert run.status == "waiting"
        run.until("failed", 1.5)
        assert run.explanation == f"never seen: cube_9; waited {PATIENCE:.0f} s, {CANNOT_LOOK}"
        run.go(0.5)
        assert planner_status(run.lockstep) == (State.READY, "")


def test_the_patience_is_configured() -> None:
    with Run(patience=3.0) as run:
        known(run, "cube_9")
        run.want("on(cube_3,cube_9)")
        run.go(2.5)
        assert run.status == "waiting"
        run.until("failed", 1.5)


def test_what_appears_after_all_is_gone_on_with() -> None:
    with Run() as run:
        known(run, "cube_9")
        run.want("on(cube_3,cube_9)")
        run.until("failed")
        add_cube(run.memory, "cube_9", 0.4, 0.2)
        run.until("reached")


def test_all_that_is_lacking_is_named_with_the_reason() -> None:
    with Run() as run:
        known(run, "cube_7")
        known(run, "cube_8")
        known(run, "cube_9", present=False)
        run.memory.add_edge("world", "cube_8", "RT", pose=run.memory.transform("world", "table"))
        run.want("on(cube_7,cube_8) & clear(cube_9)")
        run.until("waiting", 0.5)
        reasons = "never seen: cube_7, seen, but not believed to be anywhere: cube_8, believed to be gone: cube_9"
        assert run.explanation.startswith(f"{reasons}; ")


@pytest.mark.parametrize(
    ("reason", "remove_node", "present"),
    [("believed to be gone", False, False), ("no longer known where", False, True), ("removed", True, True)],
)
def test_a_thing_that_vanishes_meanwhile_is_named(reason: str, remove_node: bool, present: bool) -> None:
    with Run() as run:
        run.want()
        run.until_running("pick", "cube_3")
        run.memory.remove_edge("cube_6", "table", "on")
        run.memory.remove_edge("world", "cube_6", "Virtual_RT")
        if remove_node:
            run.memory.remove_node("cube_6")
        else:
            run.memory.update_node("cube_6", present=present)
        run.until("failed")
        assert run.explanation.startswith(reason) and ": cube_6; waited 10 s" in run.explanation


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ("on(cub_3,cube_4)", "nothing is called 'cub_3'; did you mean 'cube_3'?"),
        ("on(cube_3,tabel)", "nothing is called 'tabel'; did you mean 'table'?"),
        ("on(cube_3,cube_9999)", "nothing is called 'cube_9999'; valid: cube_3, cube_4, cube_5, cube_6, table"),
        ("on(cube_3,cube_04)", "nothing is called 'cube_04'; did you mean 'cube_4'?"),
    ],
)
def test_a_name_that_nothing_can_get_is_refused_at_once(goal: str, reason: str) -> None:
    with Run() as run:
        run.want(goal)
        run.until("invalid", 0.5)
        assert run.explanation == reason
        assert run.arm.done == []


def test_a_name_that_was_refused_and_comes_to_be_is_gone_on_with() -> None:
    with Run() as run:
        run.want("on(lego,cube_4)")
        run.until("invalid")
        add_cube(run.memory, "lego", 0.4, 0.2)
        run.until("reached")


def test_a_tag_that_nobody_knows_may_still_be_seen() -> None:
    with Run() as run:
        run.want("on(cube_33,cube_4)")
        run.until("waiting", 0.5)
        names = "valid: cube_3, cube_4, cube_5, cube_6, table"
        assert run.explanation == f"never seen or heard of: cube_33 ({names}); gives up after {PATIENCE:g} s"
        run.until("failed")
        add_cube(run.memory, "cube_33", 0.4, 0.2)
        run.until("reached")


def test_a_tag_that_something_else_carries_does_not_make_the_name() -> None:
    with Run() as run:
        run.memory.update_node("cube_5", marker_id=33)
        run.want("on(cube_33,cube_4)")
        run.until("invalid", 0.5)


def test_while_nothing_is_known_no_name_is_refused() -> None:
    with Run(start_up=12.0) as run:
        for node in (*run.memory.nodes("cube"), *run.memory.nodes("table")):
            run.memory.remove_node(node.name)
        run.want("on(lego,brick)")
        run.go(PATIENCE + 1.0)
        assert (run.status, run.explanation) == ("waiting", "never seen or heard of: lego, brick; gives up after 12 s")
        run.until("failed", 2.0)


def test_an_agent_that_does_not_run_is_named_and_its_absence_does_not_count() -> None:
    with Run(agents_too=[AgentSpec("estimator", Estimator)], belief_agents=("estimator", "simulator")) as run:
        known(run, "cube_9")
        run.want("on(cube_3,cube_9)")
        run.go(PATIENCE + 2.0)
        assert (run.status, run.explanation) == ("waiting", "never seen: cube_9; agent 'simulator' does not run")
        run.lockstep.kill("arm_controller")
        run.go(1.0)
        assert run.explanation == "never seen: cube_9; agents 'arm_controller', 'simulator' do not run"


def test_nothing_is_begun_while_nobody_sees() -> None:
    with Run(agents_too=[AgentSpec("estimator", Estimator)], belief_agents=("estimator",)) as run:
        run.lockstep.kill("estimator")
        run.want()
        run.go(5.0)
        assert (run.status, run.explanation) == ("waiting", "agent 'estimator' does not run")
        assert run.memory.nodes("action") == []
        assert planner_status(run.lockstep) == (State.DEGRADED, "intention_0: agent 'estimator' does not run")
        run.lockstep.restart("estimator")
        run.until("reached")


def test_waiting_repeats_in_lockstep() -> None:
    def play() -> list[str]:
        with Run() as run:
            known(run, "cube_9")
            run.want("on(cube_3,cube_9)")
            watch, lines = run.memory.watch(), list[str]()
            for step in range(40):
                run.go(0.5)
                if step == 10:
                    move(run.memory, "cube_3", "cube_4")
                lines += [repr(change) for change in watch.poll()]
            return lines

    assert play() == play()
