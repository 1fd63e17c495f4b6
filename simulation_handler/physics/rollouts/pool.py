"""Simulates many scenes at once, in worker processes, within a budget of time; or one after the other, right here."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Sequence
from itertools import count
from selectors import EVENT_READ, DefaultSelector
from types import TracebackType

from dsr.clock import WALL_CLOCK, Clock
from dsr.perception.scales import TICK_RATE
from simulation_handler.physics.rollouts.engine import Engine, RolloutOutcome
from simulation_handler.physics.rollouts.messages import RolloutJob
from simulation_handler.physics.rollouts.process import WorkerProcess
from simulation_handler.physics.rollouts.scene import RolloutScene
from simulation_handler.physics.simulator import SimulationError

_log = logging.getLogger("simulation_handler.physics.rollouts")
_HELP_AFTER = 1.0 / TICK_RATE  # s without an answer, longer than rollouts take, after which this process simulates
_MOST_DEATHS = 3  # in a row without an answer, after which a worker is given up


class Pool:
    """Simulates scenes; outcomes do not depend on where, on the number of workers, or on what ran before.

    Args:
        workers: processes. With 0, scenes are simulated in this process: repeatable bit by bit, for lockstep.
        budget: of each run, unless that is given its own. With workers: s on `clock`, after which what has not come
            back is given up. Without: how many scenes are simulated, the first ones.
        clock: measures the budget.

    Workers start with `start`, or the first run; they end with this process, however it ends. While none of them
    answers, because they are still starting, or the machine is busy, scenes are simulated here, one by one, within the
    same budget. Only what has killed a worker is left to workers. One that dies is started again; if that fails time
    after time, it is given up.
    """

    def __init__(self, workers: int, budget: float = math.inf, clock: Clock = WALL_CLOCK) -> None:
        if workers < 0 or math.isnan(budget):
            raise SimulationError(f"{workers} workers, budget {budget}; expected at least 0, and a number")
        self._clock = clock
        self._budget = budget
        self._numbers = count(1)
        self._engine: Engine | None = None
        self._is_here = workers == 0
        self._to_start = workers
        self._workers: list[WorkerProcess] = []

    def __enter__(self) -> Pool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self) -> None:
        """Start the workers: a run that comes some tenths of a second later finds them ready. Harmless when repeated.

        Each takes about 45 MB from then on.
        """
        now = self._clock.monotonic()
        self._workers += [WorkerProcess(now) for _ in range(self._to_start)]
        self._to_start = 0

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        return tuple(worker.pid for worker in self._workers)

    def run(
        self, scenes: Sequence[RolloutScene], seconds: float, budget: float | None = None
    ) -> list[RolloutOutcome | None]:
        """Simulate scenes for `seconds`, and return outcomes in their order; None for scenes beyond the budget.

        Raises:
            SimulationError: for a scene or time that cannot be simulated.
        """
        budget = self._budget if budget is None else budget
        if self._is_here:
            return self._run_here(scenes, seconds, lambda index: index < budget)
        deadline = self._clock.monotonic() + budget
        self.start()
        if self._workers:
            jobs = [RolloutJob(next(self._numbers), scene.bodies, seconds) for scene in scenes]
            run = _Run(self._workers, jobs, lambda index: self._simulate(scenes[index], seconds), self._clock)
            outcomes = run.until(deadline)
            self._give_up_the_hopeless()
            return outcomes
        return self._run_here(scenes, seconds, lambda _: self._clock.monotonic() < deadline)

    def _run_here(
        self, scenes: Sequence[RolloutScene], seconds: float, may_go_on: Callable[[int], bool]
    ) -> list[RolloutOutcome | None]:
        return [self._simulate(scene, seconds) if may_go_on(index) else None for index, scene in enumerate(scenes)]

    def _simulate(self, scene: RolloutScene, seconds: float) -> RolloutOutcome:
        self._engine = self._engine or Engine()
        return self._engine.run(scene, seconds)

    def _give_up_the_hopeless(self) -> None:
        for worker in [worker for worker in self._workers if worker.deaths >= _MOST_DEATHS]:
            self._workers.remove(worker)
            worker.close()
            _log.error("a worker for rollouts died %d times in a row and is given up", worker.deaths)

    def close(self) -> None:
        """End the workers and free the simulation; harmless when repeated."""
        self._to_start = 0
        while self._workers:
            self._workers.pop().close()
        if self._engine is not None:
            self._engine.close()


class _Run:
    """The jobs of one run on their way through the workers, and through this process if those do not answer."""

    def __init__(
        self,
        workers: Sequence[WorkerProcess],
        jobs: Sequence[RolloutJob],
        simulate: Callable[[int], RolloutOutcome],
        clock: Clock,
    ) -> None:
        """`simulate` does the job of an index in this process."""
        self._workers = workers
        self._jobs = jobs
        self._simulate = simulate
        self._clock = clock
        self._outcomes: list[RolloutOutcome | None] = [None] * len(jobs)
        self._waiting = deque(range(len(jobs)))
        self._under_way: dict[int, int] = {}  # number of the job -> its index
        self._lost: set[int] = set()  # indexes of jobs whose worker died

    def until(self, deadline: float) -> list[RolloutOutcome | None]:
        """The outcomes that are here at the deadline."""
        self._take_all(_readable(self._workers, 0.0))  # ready since it was started, or late with an earlier run
        self._restart_stuck()
        answered_at = self._clock.monotonic()
        while self._waiting or self._under_way:
            self._hand_out()
            now, here = self._clock.monotonic(), self._for_here()
            alive = [worker for worker in self._workers if worker.deaths < _MOST_DEATHS]
            if now >= deadline or not (alive or here is not None):
                break
            help_at = answered_at + _HELP_AFTER if self._under_way else now
            wait_until = min(deadline, now + _HELP_AFTER if here is None else help_at)
            if answered := _readable(alive, max(wait_until - now, 0.0)):
                self._take_all(answered)
                answered_at = self._clock.monotonic()
            elif here is not None and self._clock.monotonic() < deadline:
                self._simulate_here(here)
        return self._outcomes

    def _for_here(self) -> int | None:
        """Index of the job that this process can do: one that waits, else the one that is under way for longest."""
        return next((index for index in (*self._waiting, *self._under_way.values()) if index not in self._lost), None)

    def _simulate_here(self, index: int) -> None:
        """Do a job in this process; what a worker may still answer about that is not needed any more."""
        if index in self._waiting:
            self._waiting.remove(index)
        self._under_way = {number: other for number, other in self._under_way.items() if other != index}
        self._outcomes[index] = self._simulate(index)

    def _hand_out(self) -> None:
        for worker in self._workers:
            if self._waiting and worker.job is None:
                job = self._jobs[index := self._waiting.popleft()]
                self._under_way[job.number] = index
                try:
                    worker.give(job, self._clock.monotonic())
                except OSError:
                    self._bury(worker)

    def _take_all(self, workers: Sequence[WorkerProcess]) -> None:
        for worker in workers:
            self._take(worker)

    def _take(self, worker: WorkerProcess) -> None:
        try:
            reply = worker.take()
        except OSError:
            self._bury(worker)
            return
        index = self._under_way.pop(reply.number, None)
        if index is None:  # it has just started, or this is an answer to an earlier run
            return
        if reply.outcome is None:
            raise SimulationError(reply.error)
        self._outcomes[index] = reply.outcome

    def _bury(self, worker: WorkerProcess) -> None:
        """Start a dead worker again; its job gets one more try, for it may be what killed it."""
        index = self._under_way.pop(worker.job, None) if worker.job is not None else None
        if index is not None and index not in self._lost:
            self._lost.add(index)
            self._waiting.appendleft(index)
        _log.warning(
            "a worker for rollouts has died (%s); it is started again", worker.restart(self._clock.monotonic())
        )

    def _restart_stuck(self) -> None:
        now = self._clock.monotonic()
        stuck = [worker for worker in self._workers if worker.is_stuck(now)]
        answered = _readable(stuck, 0.0)  # who has just done the job rests, too
        for worker in stuck:
            if worker not in answered:
                _log.warning("a worker for rollouts was stuck; it is started again")
                worker.restart(now)


def _readable(workers: Sequence[WorkerProcess], timeout: float) -> list[WorkerProcess]:
    """Those that have said something, or have died, within `timeout` s."""
    with DefaultSelector() as selector:
        for worker in workers:
            selector.register(worker.connection, EVENT_READ, worker)
        return [key.data for key, _ in selector.select(timeout)]
