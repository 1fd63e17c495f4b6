"""A pool gives the same outcomes wherever they are computed, keeps to its budget, and leaves nothing behind."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from dsr.clock import WALL_CLOCK
from simulation_handler.physics.rollouts import pool as pool_module
from simulation_handler.physics.rollouts import process as process_module
from simulation_handler.physics.rollouts.messages import READY, RolloutJob
from simulation_handler.physics.rollouts.pool import Pool
from simulation_handler.physics.simulator import SimulationError
from tests.simulation_handler.rollouts.scenes import cube, random_scene, scene_of
from tests.simulation_handler.rollouts.slowed import slow_down

SCENES = [random_scene(seed) for seed in range(8)]
PLENTY = 60.0


@pytest.fixture(scope="module")
def shared() -> Iterator[Pool]:
    """A pool that is ready."""
    with Pool(2, PLENTY) as pool:
        pool.run(SCENES[:2], 0.1)
        yield pool


def wait_until(is_true: Callable[[], bool], timeout: float = 20.0) -> bool:
    end = WALL_CLOCK.monotonic() + timeout
    while not is_true() and WALL_CLOCK.monotonic() < end:
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return is_true()


def wait_until_ready(pool: Pool) -> None:
    """Until all workers have said that they are."""
    pool.start()
    pool.start()
    assert wait_until(lambda: all(select.select([worker.connection], [], [], 0)[0] for worker in pool._workers))


def test_outcomes_are_bit_identical_here_and_in_workers(shared: Pool):
    with Pool(0) as here:
        expected = here.run(SCENES, 0.5)
        assert here.run(SCENES[::-1], 0.5) == expected[::-1]
    assert None not in expected
    assert shared.run(SCENES, 0.5) == expected
    assert shared.run(SCENES[::-1], 0.5) == expected[::-1]


def test_without_workers_the_budget_is_a_number_of_scenes():
    with Pool(0, 3) as pool:
        assert [outcome is not None for outcome in pool.run(SCENES, 0.1)] == [True] * 3 + [False] * 5
        assert [outcome is not None for outcome in pool.run(SCENES, 0.1, budget=1)] == [True] + [False] * 7


def test_what_is_not_back_in_time_is_none_and_does_not_disturb_the_next_run(shared: Pool):
    late = shared.run(SCENES * 20, 2.0, budget=0.1)
    assert late[-1] is None
    with Pool(0) as here:
        assert shared.run(SCENES, 0.3) == here.run(SCENES, 0.3)


def test_nothing_to_do_and_no_time_to_do_it(shared: Pool):
    assert shared.run([], 0.5) == []
    assert shared.run(SCENES[:2], 0.5, budget=0.0) == [None, None]


def test_a_scene_that_cannot_be_is_an_error_and_the_pool_goes_on(shared: Pool):
    bad = scene_of(cube("a", 0.0, 0.0)._replace(size=(0.0, 0.0, 0.0)))
    for _ in range(2):
        with pytest.raises(SimulationError, match="body 'a': size"):
            shared.run([SCENES[0], bad, SCENES[1]], 0.1)
    assert None not in shared.run(SCENES, 0.1)


def test_a_worker_answers_with_the_error_what_cannot_be_simulated_and_goes_on():
    worker = process_module.WorkerProcess(0.0)
    bad = scene_of(cube("a", 0.0, 0.0)._replace(size=(0.0, 0.0, 0.0)))
    replies = []
    try:
        for job in (None, RolloutJob(1, bad.bodies, 0.1), RolloutJob(2, SCENES[0].bodies, 0.1)):
            if job is not None:
                worker.give(job, 0.0)
            assert select.select([worker.connection], [], [], PLENTY)[0]
            replies.append(worker.take())
    finally:
        worker.close()
    ready, refused, done = replies
    assert ready == READY
    assert (refused.number, refused.outcome) == (1, None) and "body 'a': size" in refused.error
    assert done.number == 2 and done.outcome is not None


def test_workers_start_when_they_may_be_needed_and_only_once():
    with Pool(2, PLENTY) as pool:
        assert pool.pids == ()
        pool.start()
        pids = pool.pids
        assert len(set(pids)) == 2
        pool.start()
        pool.run(SCENES, 0.3)
        assert pool.pids == pids
    pool.start()
    assert pool.pids == (), "a closed pool starts nobody"


def test_a_worker_that_dies_is_replaced_and_its_scene_is_not_lost():
    with Pool(1, PLENTY) as pool:
        expected = pool.run(SCENES, 0.3)
        for number in (signal.SIGKILL, signal.SIGSEGV):
            os.kill(pool.pids[0], number)
            assert pool.run(SCENES, 0.3) == expected


def test_a_worker_that_stops_holds_up_nothing_and_is_replaced(monkeypatch: pytest.MonkeyPatch):
    with Pool(2, PLENTY) as pool:
        wait_until_ready(pool)
        expected = pool.run(SCENES, 0.3)
        stopped = pool.pids[0]
        os.kill(stopped, signal.SIGSTOP)
        assert pool.run(SCENES, 0.3) == expected, "what it was given is simulated here"
        assert stopped in pool.pids
        monkeypatch.setattr(process_module, "_MOST_REST", 0.0)
        pool.run([], 0.3)
        assert stopped not in pool.pids
        assert pool.run(SCENES, 0.3) == expected


def test_a_worker_that_waits_for_a_processor_is_not_stuck_however_long(monkeypatch: pytest.MonkeyPatch):
    with Pool(1, PLENTY) as pool:
        wait_until_ready(pool)
        os.kill(pool.pids[0], signal.SIGSTOP)  # one that waits for a processor does as little
        pids = pool.pids
        pool.run(SCENES, 0.3)
        monkeypatch.setattr(process_module, "_MOST_REST", 0.0)
        monkeypatch.setattr(process_module, "_AT_WORK", (psutil.STATUS_STOPPED,))
        pool.run([], 0.3)
        assert pool.pids == pids
        os.kill(pool.pids[0], signal.SIGCONT)


def test_a_worker_that_works_for_too_long_on_a_job_is_replaced(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    slow_down(monkeypatch, tmp_path, jobs="spin")
    with Pool(1, PLENTY) as pool, Pool(0) as here:
        wait_until_ready(pool)
        pids, expected = pool.pids, here.run(SCENES, 0.3)
        assert pool.run(SCENES, 0.3) == expected
        pool.run([], 0.3)
        assert pool.pids == pids
        monkeypatch.setattr(process_module, "_MOST_WORK", 0.01)
        assert wait_until(lambda: not pool.run([], 0.3) and pool.pids != pids)


def test_workers_that_start_slowly_are_not_stuck_and_meanwhile_scenes_are_simulated_here(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    start = slow_down(monkeypatch, tmp_path, starts=True)
    monkeypatch.setattr(process_module, "_MOST_REST", 0.0)
    monkeypatch.setattr(process_module, "_MOST_WORK", 0.0)
    with Pool(2, PLENTY) as pool, Pool(0) as here:
        pool.start()
        pids, expected = pool.pids, here.run(SCENES, 0.3)
        for _ in range(3):
            assert pool.run(SCENES, 0.3) == expected
        assert pool.pids == pids
        start()
        wait_until_ready(pool)
        monkeypatch.undo()
        assert pool.run(SCENES, 0.3) == expected
        assert pool.pids == pids


def test_workers_that_are_slow_with_each_job_hold_up_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    go_on = slow_down(monkeypatch, tmp_path, jobs="wait")
    with Pool(2, PLENTY) as pool, Pool(0) as here:
        wait_until_ready(pool)
        pids, expected = pool.pids, here.run(SCENES, 0.3)
        for _ in range(2):
            assert pool.run(SCENES, 0.3) == expected
        go_on()
        assert pool.run(SCENES, 0.3) == expected, "late answers to earlier runs are nothing of this one"
        assert pool.pids == pids


def test_workers_that_have_waited_for_long_are_not_stuck(monkeypatch: pytest.MonkeyPatch):
    with Pool(2, PLENTY) as pool:
        wait_until_ready(pool)
        pids = pool.pids
        monkeypatch.setattr(process_module, "_MOST_REST", 0.0)
        pool.run([], 0.1)
        assert pool.pids == pids


def test_what_has_killed_a_worker_is_left_to_workers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    slow_down(monkeypatch, tmp_path, jobs="die")
    monkeypatch.setattr(pool_module, "_HELP_AFTER", PLENTY)
    with Pool(1, PLENTY) as pool:
        wait_until_ready(pool)
        assert pool.run(SCENES[:1], 0.3) == [None]


def test_workers_that_cannot_live_are_given_up_and_the_work_is_done_here(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(process_module.sys, "executable", "/bin/false")
    with Pool(2, PLENTY) as pool, Pool(0) as here:
        expected = here.run(SCENES, 0.2)
        assert wait_until(lambda: pool.run(SCENES, 0.2) != expected or pool.pids == ())
        assert pool.run(SCENES, 0.2) == expected


def test_closing_ends_the_workers_and_leaves_no_descriptor():
    before = set(Path("/proc/self/fd").iterdir())
    with Pool(2, PLENTY) as pool:
        pool.run(SCENES[:2], 0.1)
        pids = pool.pids
        assert len(pids) == 2
    assert not any(map(psutil.pid_exists, pids))
    assert len(set(Path("/proc/self/fd").iterdir()) - before) == 0
    pool.close()


USER = """
import signal, sys
from simulation_handler.physics.rollouts import Pool
from tests.simulation_handler.rollouts.scenes import random_scene
pool = Pool(2, 1000.0)
pool.run([random_scene(seed) for seed in range(4)], 0.1)
print(*pool.pids, flush=True)
pool.run([random_scene(seed) for seed in range(100_000)], 10.0)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT], ids=["killed", "Ctrl-C"])
def test_workers_end_with_the_process_that_uses_them(number: signal.Signals):
    command = [sys.executable, "-c", USER]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True, "start_new_session": True}
    with subprocess.Popen(command, cwd=Path(__file__).parents[3], **options) as user:
        pids = [int(word) for word in user.stdout.readline().split()]
        assert len(pids) == 2 and all(map(psutil.pid_exists, pids))
        os.killpg(user.pid, number)
        user.wait(20)
    assert wait_until(lambda: not any(map(is_running, pids)))


def is_running(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_workers_load_nothing_of_the_network(shared: Pool):
    for pid in shared.pids:
        assert "zenoh" not in Path(f"/proc/{pid}/maps").read_text()


def test_a_pool_of_less_than_nothing_is_refused():
    with pytest.raises(SimulationError, match="-1 workers"):
        Pool(-1)
