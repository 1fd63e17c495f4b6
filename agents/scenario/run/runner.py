"""Runs a scenario under the eyes of the judge: in lockstep, or live with every agent a process."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from typing import Protocol

import msgspec

from agents.scenario.format.events import Kill
from agents.scenario.format.model import Scenario
from agents.scenario.judge.judge import Judge
from agents.scenario.judge.result import Result
from agents.scenario.run.mission_giver import MissionGiver
from agents.scenario.run.staging import PlantSensor, Run, plant_alone, staged_system, without
from agents.scenario.run.story import Line, Story
from agents.scenario.truth.history import History
from dsr.errors import AgentError
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.runtime.launcher import POLL_PERIOD, AgentRow, Launcher
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.status import State
from dsr.runtime.system import System
from dsr.vocabulary.scenario_start import LEAD, Start, start_key

RESTART_AFTER = 1.0
"""s that a killed agent stays away in lockstep, about as long as a process needs"""
_READY_WITHIN = 10.0  # s of simulated time
_START_PERIOD = 1.0  # s between two messages that tell the start
_TAIL = 0.2  # s, so that the last sample arrives


class RunObserver(Protocol):
    """Follows the progress of a run."""

    def starting(self, rows: list[AgentRow]) -> None:
        """Agents are being started."""

    def running(self, elapsed: float) -> None:
        """`elapsed` s of the scenario have passed; negative before the start."""

    def happened(self, elapsed: float, line: Line) -> None:
        """Something worth telling happened."""


class Silent:
    """An observer that does nothing."""

    def starting(self, rows: list[AgentRow]) -> None:
        """Ignored."""

    def running(self, elapsed: float) -> None:
        """Ignored."""

    def happened(self, elapsed: float, line: Line) -> None:
        """Ignored."""


class Teller:
    """Tells an observer the events of a run.

    Args:
        observer: who is told.
        scenario: what is played.
        memory: a replica; only read.
        judge: knows which events have begun.
    """

    def __init__(self, observer: RunObserver, scenario: Scenario, memory: Memory, judge: Judge) -> None:
        self._observer = observer
        self._story = None if isinstance(observer, Silent) else Story(memory, scenario.events)
        self._judge = judge

    def tell(self, elapsed: float) -> None:
        """Tell what is new, `elapsed` s after the start."""
        if self._story is not None:
            for line in self._story.news({**self._judge.history.spans, **self._judge.history.kills}):
                self._observer.happened(elapsed, line)
        self._observer.running(elapsed)


class Conductor:
    """Does the runner's work at each moment: tells the start, kills agents, lets the judge look.

    Args:
        scenario: what is played.
        start: s, time 0 of the scenario.
        judge: takes a sample at each step.
        bus: to the plant.
        keys: of the graph.
        kill: ends an agent without warning.
        giver: gives the mission, if nobody else does.
    """

    def __init__(
        self,
        scenario: Scenario,
        start: float,
        judge: Judge,
        bus: Transport,
        keys: Keys,
        kill: Callable[[str], None],
        giver: MissionGiver | None = None,
    ) -> None:
        self._giver = giver
        self._start = start
        self._judge = judge
        self._bus = bus
        self._start_key = start_key(keys)
        self._kill = kill
        self._kills = {n: event for n, event in enumerate(scenario.events, start=1) if isinstance(event, Kill)}
        self._tell_at = start - LEAD
        self.is_over = False
        """Whether the run may end early."""
        judge.begin(start)

    def step(self, now: float) -> float:
        """Do what is due at `now` (s); returns the time of the scenario."""
        if now >= self._tell_at:
            self._tell_at = now + _START_PERIOD
            self._bus.publish(self._start_key, msgspec.msgpack.encode(Start(self._start)))
        elapsed = now - self._start
        for begun, number in self._due(elapsed):
            self._judge.history.kills[number] = begun
            self._kill(self._kills.pop(number).agent)
        self._judge.sample()
        if self._giver is not None:
            self._giver.ask()
        self.is_over = self._judge.is_over(elapsed)
        return elapsed

    def _due(self, elapsed: float) -> list[tuple[float, int]]:
        """When and which kills were to happen until now, in order: at their time, or when the plant has told so."""
        begun = {number: event.at + event.delay for number, event in self._kills.items() if event.at is not None}
        begun |= self._judge.triggered
        return sorted((time, number) for number, time in begun.items() if number in self._kills and time <= elapsed)


Onlooker = Callable[[float, Memory, History], None]
"""Called at each step of a lockstep run with s since the start, the runner's replica, and the truth: both only read."""


def run_lockstep(run: Run, observer: RunObserver | None = None, onlooker: Onlooker | None = None) -> Result:
    """Run in one process as fast as the machine allows; the same seed gives the same metrics.

    Args:
        run: what is run.
        observer: is told what happens.
        onlooker: looks at memory and truth at each step.

    Raises:
        ConfigError: if the scenario does not fit its system.
        AgentError: if an agent cannot be started.
    """
    system = staged_system(run)
    return run_system(run, system if run.viewer else without(system, "viewer"), observer, onlooker)


def run_system(
    run: Run, system: System, observer: RunObserver | None = None, onlooker: Onlooker | None = None
) -> Result:
    """Run as `run_lockstep` does, with a system that the caller has made of `staged_system`."""
    return play(run, system, observer, onlooker).result(run.seed, "lockstep", run.sensor, run.policy, run.hands)


def play(run: Run, system: System, observer: RunObserver | None = None, onlooker: Onlooker | None = None) -> Judge:
    """Play as `run_system` does; the judge with all that it has seen, for those who measure something else."""
    observer = observer or Silent()
    scenario = run.scenario
    with Lockstep(system.agents, graph=system.graph, seed=run.seed) as lockstep:
        away: list[tuple[float, str]] = []

        restarts = {spec.name: spec.restart for spec in system.agents}
        gone: set[str] = set()

        def kill(agent: str) -> None:
            """What is just being restarted, stays away, or does not run in lockstep, cannot be killed."""
            if agent in restarts.keys() - {name for _, name in away} - gone:
                lockstep.kill(agent)
                if restarts[agent]:
                    away.append((lockstep.clock.now() + RESTART_AFTER, agent))
                else:
                    gone.add(agent)

        judge = Judge(scenario, lockstep.memory, lockstep.bus, lockstep.keys)
        _get_ready(lockstep, [spec.name for spec in system.agents])
        start = lockstep.clock.now() + LEAD
        giver = mission_giver_of(run, lockstep.memory, judge)
        conductor = Conductor(scenario, start, judge, lockstep.bus, lockstep.keys, kill, giver)

        teller = Teller(observer, scenario, lockstep.memory, judge)

        def on_step(now: float) -> bool:
            elapsed = conductor.step(now)
            teller.tell(elapsed)
            if onlooker is not None:
                onlooker(elapsed, lockstep.memory, judge.history)
            while away and away[0][0] <= now:
                lockstep.restart(away.pop(0)[1])
            return conductor.is_over

        lockstep.run_until(start + scenario.duration + _TAIL, on_step)
        return judge


def mission_giver_of(run: Run, memory: Memory, judge: Judge) -> MissionGiver | None:
    """Who gives the mission of a run without tags: nobody knows beforehand what things will be called."""
    mission = run.scenario.mission
    return MissionGiver(mission, memory, judge.names) if run.untagged and mission is not None else None


def true_course(run: Run, sensor: PlantSensor = "none") -> History:
    """Play the true course without any agent: the plant alone, with the experimenter's moves. `kill` is only noted.

    Args:
        run: what is played.
        sensor: with `poses`, the samples tell what the camera could recognise; that takes longer.

    Raises:
        ConfigError: if the scenario cannot be played.
    """
    scenario, system = run.scenario, plant_alone(run, sensor)
    with Lockstep(system.agents, graph=system.graph, seed=run.seed) as lockstep:
        judge = Judge(scenario, lockstep.memory, lockstep.bus, lockstep.keys)
        _get_ready(lockstep, [spec.name for spec in system.agents])
        start = lockstep.clock.now() + LEAD
        conductor = Conductor(scenario, start, judge, lockstep.bus, lockstep.keys, lambda agent: None)

        def on_step(now: float) -> bool:
            conductor.step(now)
            return conductor.is_over

        lockstep.run_until(start + scenario.duration + _TAIL, on_step)
        return judge.history


def _get_ready(lockstep: Lockstep, agents: list[str]) -> None:
    """Run until every agent had a good tick."""
    end = lockstep.clock.now() + _READY_WITHIN
    while waiting := [name for name in agents if lockstep.runner(name).state not in (State.READY, State.DEGRADED)]:
        if lockstep.clock.now() > end:
            errors = "; ".join(f"{name}: {lockstep.runner(name).status().last_error}" for name in waiting)
            raise AgentError(f"not ready after {_READY_WITHIN} s: {errors}")
        lockstep.run_for(POLL_PERIOD)


def run_live(run: Run, observer: RunObserver | None = None) -> Result:
    """Run with the agents in processes, on the wall clock. Ctrl-C stops them all.

    Raises:
        ConfigError: if the scenario does not fit its system.
        AgentError: if an agent cannot be started.
    """
    if run.folder is None:
        raise ValueError("a live run needs a folder for the agents' logs")
    observer = observer or Silent()
    with Launcher(staged_system(run), run.folder, seed=run.seed) as launcher:
        memory = launcher.memory
        judge = Judge(run.scenario, memory, memory.transport, memory.keys, live=True)
        launcher.wait_ready(observer.starting)
        start = launcher.clock.now() + LEAD
        conductor = Conductor(
            run.scenario,
            start,
            judge,
            memory.transport,
            memory.keys,
            lambda agent: _kill_process(launcher, agent),
            mission_giver_of(run, memory, judge),
        )
        teller = Teller(observer, run.scenario, memory, judge)
        while (elapsed := conductor.step(launcher.clock.now())) < run.scenario.duration + _TAIL:
            teller.tell(elapsed)
            if conductor.is_over:
                break
            launcher.poll()
            launcher.clock.wait(threading.Event(), POLL_PERIOD)
        judge.close()
        return judge.result(run.seed, "live", run.sensor, run.policy, run.hands)


def _kill_process(launcher: Launcher, agent: str) -> None:
    """Kill the agent's process; if it is just being restarted there is nothing to kill."""
    pid = next((row.pid for row in launcher.rows() if row.agent == agent), None)
    if pid is not None:
        os.kill(pid, signal.SIGKILL)
