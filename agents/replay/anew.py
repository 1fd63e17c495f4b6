"""Runs some agents of a recording anew, in lockstep with it, and compares both runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import msgspec

from agents.drivers import drivers_in
from agents.recorder.agent import ABOUT
from agents.recorder.opening import RecordingSource
from agents.replay.beginnings import beginnings
from agents.replay.compare import ReplayOutcome, RunComparison
from agents.replay.feed import Feed, feeder_for
from agents.replay.source import ReplayedGraph
from dsr.clock import ManualClock
from dsr.config.toml import convert
from dsr.errors import ConfigError, WireError, suggest
from dsr.graph.schema import Schema
from dsr.network.decoding import decoded
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec, known_systems, load_system

DEFAULT_SYSTEM = "tabletop"
_ROUNDING = 1e-6  # s; stamps in a file are rounded
_YEAR = 365 * 86400.0  # s; where nothing was recorded for so long, a clock was set
_MOST_DIGITS = 19  # of a seed, 64 bits
_configs_decoder = msgspec.json.Decoder(dict[str, dict[str, object]])

OnProgress = Callable[[float, float], None]
"""Called with the time and the duration, s."""


def run_anew(
    path: Path | str,
    agents: Sequence[str],
    *,
    system: str | None = None,
    seed: int | None = None,
    settings: Mapping[str, Mapping[str, object]] | None = None,
    until: float | None = None,
    tolerance: float = 0.0,
    turn_tolerance: float = 0.0,
    on_progress: OnProgress = lambda time, duration: None,
) -> ReplayOutcome:
    """Run agents on a recording and compare.

    They get all that was recorded at the time at which it was, without what they had written themselves, and tick on a
    clock that follows the recording, as fast as this machine allows. Of a recording made in lockstep, unchanged
    agents do exactly the same again; of a live one, they tick at slightly other moments.

    Args:
        path: a file, the folder of a run, or a bag of ROS.
        agents: names of agents of the system.
        system: name or file of the system that configures them; by default that of the recording, or `tabletop`. That
            of the recording configures them as they were recorded, apart from those whose drivers it does not have.
        seed: of the run; by default the recorded one.
        settings: fields of the agents' configurations to change, by agent.
        until: s since the first message, where to end.
        tolerance: m, up to which positions count as equal.
        turn_tolerance: rad, likewise.
        on_progress: called with the time since the first message and the duration, s.

    Raises:
        RecordingError: if it is no recording.
        ConfigError: for an unknown agent, or one that cannot be run on recorded data.
        AgentError: if an agent fails.
    """
    settings = dict(settings or {})
    reference = ReplayedGraph(path, settings, system)
    index = reference.index
    settings.pop(index.settings_of, None)
    specs = _specs(index, agents, system, settings)
    feed = Feed(index, agents, [pattern for spec in specs for pattern in spec.kind.publishes])
    ordered = sorted(specs, key=lambda spec: feed.rank(spec.name))
    clock = ManualClock(index.begin)
    fastest = max(specs, key=lambda spec: spec.kind.rate_hz)
    pairs = {spec.name: (_feeder(spec, feed), spec) for spec in ordered}
    seats = [seat for pair in pairs.values() for seat in pair]
    starts = beginnings(index, {spec.name: spec.kind.rate_hz for spec in ordered})
    later = {seat.name: starts[name] for name, pair in pairs.items() for seat in pair if starts[name] > index.begin}
    seats.append(AgentSpec("feeder", feeder_for(fastest.kind, feed)))
    seed = _recorded_seed(index) if seed is None else seed
    end = index.begin + (reference.duration if until is None else min(until, reference.duration))
    graph = reference.memory.graph_name
    with Lockstep(seats, graph=graph, clock=clock, seed=seed, later=later) as lockstep:
        feed.memory = lockstep.memory
        for mesh in index.meshes():
            lockstep.memory.put_mesh(mesh)
        comparison = RunComparison(
            reference.memory, lockstep.memory, _geometric(specs), index.begin, tolerance, turn_tolerance
        )

        def on_step(now: float) -> bool:
            reference.forward(now - index.begin + _ROUNDING)
            comparison.sample(now)
            on_progress(now - index.begin, end - index.begin)
            return _YEAR < reference.next_time - reference.time < math.inf

        def run_until(time: float) -> None:
            """All sleep through the years that a clock left out when it was set."""
            while lockstep.run_until(time, on_step):
                wakes = min(time, index.begin + reference.next_time)
                lockstep.suspend(max(0.0, wakes - clock.now()))

        for name in sorted(later, key=lambda name: later[name]):  # of equal ones, the feeder comes first
            if later[name] < end:
                run_until(later[name])
                lockstep.restart(name)
        run_until(end + _ROUNDING)
        outcome = comparison.outcome(agents, _notes(reference, feed, agents))
        outcome.failures = _failures(lockstep, [name for name in pairs if starts[name] < end])
        return outcome


def _specs(
    index: RecordingSource, agents: Collection[str], system: str | None, settings: Mapping[str, Mapping[str, object]]
) -> list[AgentSpec]:
    """The agents, configured as they were recorded if the recording tells."""
    told = index.metadata.get("system", DEFAULT_SYSTEM)
    if system is None and told not in known_systems():
        hint = "its file may run any program, so say that it is to be read: --system FILE"
        raise ConfigError(f"{index.path}: recorded with the system {told!r}, which is none of this machine; {hint}")
    loaded = load_system(told if system is None else system)
    recorded = _recorded_configs(index) if system in (None, told) else {}
    for name in sorted(settings.keys() - set(agents)):
        raise ConfigError(f"agent {name!r} is not run anew, and cannot be configured; {suggest(name, agents)}")
    specs = []
    for name in dict.fromkeys(agents):
        own = settings.get(name, {})
        fields = {**recorded.get(name, {}), **own}
        if strange := drivers_in(fields) - drivers_in(own) - _drivers_of(loaded.agent(name)):
            if system is None:
                hint = f"if you trust it, give it with --set {name}.FIELD=VALUE; --system {told} does without it"
                raise ConfigError(f"{index.path}: {name!r} had the driver {min(strange)!r}, which {told} lacks; {hint}")
            fields = dict(own)
        loaded = loaded.with_config(name, **fields)
        spec = loaded.agent(name)
        if not spec.kind.uses_memory:
            raise ConfigError(f"agent {name!r} does not use the memory: there is nothing to compare")
        specs.append(spec)
    if not specs:
        raise ConfigError("--agents: expected names of agents, separated by commas")
    return specs


def _drivers_of(spec: AgentSpec) -> set[str]:
    """The drivers of an agent as its system configures it: programs, which no recording may name."""
    return drivers_in(msgspec.to_builtins(convert(spec.config, spec.kind.Config, f"configuration of {spec.name!r}")))


def _recorded_seed(index: RecordingSource) -> int:
    """The seed of the run; 0 if the recording does not tell it. Raises `ConfigError`."""
    told = index.metadata.get("seed", "0")
    if not (told.isascii() and told.isdigit() and len(told) <= _MOST_DIGITS):
        raise ConfigError(f"{index.path}: the seed {told[:_MOST_DIGITS]!r} is no number; give one with --seed")
    return int(told)


def _recorded_configs(index: RecordingSource) -> dict[str, dict[str, object]]:
    try:
        return decoded(index.metadata.get(ABOUT, "{}"), "configurations", _configs_decoder.decode)
    except WireError as error:
        raise ConfigError(f"{index.path}: the configurations of its agents cannot be read ({error})") from error


def _feeder(spec: AgentSpec, feed: Feed) -> AgentSpec:
    return AgentSpec(f"feeder_{spec.name}"[:64], feeder_for(spec.kind, feed, spec.name))


def _geometric(specs: Collection[AgentSpec]) -> set[str]:
    """Types of edges with poses that the agents write."""
    return {type for spec in specs for type in spec.kind.writes.edges if type in Schema().geometric}


def _failures(lockstep: Lockstep, agents: Collection[str]) -> list[str]:
    """What went wrong in the agents' ticks."""
    statuses = [lockstep.runner(name).status() for name in agents]
    return [f"{s.agent}: {s.errors} ticks failed, the last with {s.last_error}" for s in statuses if s.errors]


def _notes(reference: ReplayedGraph, feed: Feed, agents: Collection[str]) -> list[str]:
    notes = [*reference.problems, *reference.index.notes]
    unheard = [name for name in agents if feed.rank(name) == feed.rank("")]
    if unheard:
        notes.append(f"never heard in the recording: {', '.join(unheard)}")
    if feed.kept_past:
        notes.append("the agents had been at work before the recording began: they go on from what they had written")
    for writer, count in sorted(feed.lost.items()):
        notes.append(f"{count} changes of {writer} concern what the agents had made, and did not make anew")
    if feed.malformed:
        notes.append(f"{feed.malformed} recorded messages were malformed, and left out")
    return [*notes, *reference.index.findings()]
