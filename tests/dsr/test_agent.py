"""An agent's declarations, configuration and life."""

from __future__ import annotations

import logging
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr import LocalNetwork, ManualClock, Memory
from dsr.agent import Agent, make_agent
from dsr.errors import AgentError, ConfigError
from dsr.graph.access import Access, WriteGuard, check_writers
from dsr.graph.schema import Schema
from dsr.network.keys import Keys
from dsr.runtime.runner import Runner, Schedule
from dsr.runtime.status import State, Status, decode_status


class FlakyConfig(msgspec.Struct, frozen=True):
    fail_at: tuple[int, ...] = ()
    rate: float = 10.0


class Flaky(Agent):
    """Fails in the ticks it is told to."""

    name = "flaky"
    most_failures = 3
    uses_memory = False
    Config = FlakyConfig

    def setup(self) -> None:
        self.calls: list[str] = ["setup"]
        self.count = 0

    def tick(self, now: float) -> None:
        self.count += 1
        self.calls.append("tick")
        if self.count in self.config.fail_at:
            raise ValueError(f"tick {self.count}")

    def teardown(self) -> None:
        self.calls.append("teardown")


class Heard:
    """A flaky agent with what it publishes."""

    def __init__(self, **config: Any) -> None:
        self.clock = ManualClock()
        network = LocalNetwork(self.clock)
        self.network = network
        keys = Keys("test")
        self.statuses: list[Status] = []
        network.connect("listener").subscribe(
            keys.status(), lambda key, payload: self.statuses.append(decode_status(payload))
        )
        bus = network.connect("agent")
        agent = make_agent(
            Flaky, name="flaky", config=config, bus=bus, keys=keys, clock=self.clock, memory=None, seed=1
        )
        self.runner = Runner(agent, rid="flaky-1", pid=7)

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.clock.advance(0.1)
            self.runner.tick(self.clock.now())
        self.network.deliver()


@given(
    rate=st.floats(0.1, 1000.0),
    start=st.sampled_from([0.0, 12.5, 1e9]),
    late=st.lists(st.floats(0.0, 0.9), max_size=60),
)
def test_a_schedule_does_not_drift_however_late_its_ticks_are(rate: float, start: float, late: list[float]) -> None:
    schedule = Schedule(start, rate)
    for n, lateness in enumerate(late):
        assert schedule.due == pytest.approx(start + n / rate, abs=1e-6)
        assert schedule.take(schedule.due + lateness / rate - 1e-6) == 0


def test_a_schedule_leaves_out_what_it_cannot_make_up_and_counts_it() -> None:
    schedule = Schedule(0.0, 10.0)
    assert schedule.take(0.0) == 0
    assert schedule.take(0.45) == 3  # 0.1 late; 0.2, 0.3 and 0.4 left out
    assert schedule.due == 0.5


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_must_be_positive(rate: float) -> None:
    with pytest.raises(ConfigError, match="positive"):
        Schedule(0.0, rate)


def test_the_guard_lets_declared_writes_pass_and_names_what_is_not_declared() -> None:
    guard = WriteGuard("estimator", Access(nodes=("cube",), edges=("RT",), attributes=("perceived",)))
    guard("node", "cube", ("perceived",))
    guard("edge", "RT", ("pose",))
    with pytest.raises(AgentError, match=r"'estimator' writes nodes of type 'cup'.*declared: cube"):
        guard("node", "cup", ())
    with pytest.raises(AgentError, match=r"'mass' of a cube.*declared: perceived"):
        guard("node", "cube", ("perceived", "mass"))
    with pytest.raises(AgentError, match="edges of type 'on'"):
        guard("edge", "on", ())


def test_the_default_declaration_writes_nothing_and_a_star_writes_everything() -> None:
    with pytest.raises(AgentError, match="declared: none"):
        WriteGuard("reader", Agent.writes)("node", "cube", ())
    WriteGuard("importer", Access(nodes="*", edges="*", attributes="*"))("edge", "on", ("since",))


def test_exclusive_names_must_be_declared() -> None:
    with pytest.raises(AgentError, match="Virtual_RT"):
        Access(edges=("RT",), exclusive=("Virtual_RT",))


def test_two_writers_of_an_exclusive_thing_are_refused_and_others_are_not() -> None:
    believer = Access(edges=("Virtual_RT", "RT"), exclusive=("Virtual_RT",))
    check_writers({"simulation": believer, "estimator": Access(edges=("RT",))})
    with pytest.raises(ConfigError, match="'simulation' must be the only writer of 'Virtual_RT', and 'intruder'"):
        check_writers({"simulation": believer, "intruder": Access(edges=("Virtual_RT",))})


def test_declared_names_must_be_in_the_schema() -> None:
    Access(nodes=("cube",), edges=("RT",), attributes=("perceived",)).check_names(Schema())
    with pytest.raises(ConfigError, match=r"'percieved'.*did you mean 'perceived'"):
        Access(attributes=("percieved",)).check_names(Schema())


@pytest.mark.parametrize(
    ("config", "expected"),
    [({"rat": 5.0}, "unknown field 'rat'.*did you mean 'rate'"), ({"rate": "fast"}, "rate: expected `float`")],
)
def test_a_wrong_configuration_names_agent_and_field(config: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError, match=f"agent 'flaky': {expected}"):
        Heard(**config)


def test_agents_of_one_run_draw_different_random_numbers_and_the_same_again() -> None:
    network, keys, clock = LocalNetwork(), Keys("test"), ManualClock()

    def seed_of(name: str, seed: int) -> int:
        bus = network.connect(name)
        return make_agent(Flaky, name=name, bus=bus, keys=keys, clock=clock, memory=None, seed=seed).seed

    assert seed_of("a", 1) == seed_of("a", 1)
    assert len({seed_of("a", 1), seed_of("b", 1), seed_of("a", 2)}) == 3


def test_an_agent_that_needs_a_memory_does_not_start_without() -> None:
    with pytest.raises(AgentError, match="needs a memory"):
        make_agent(Agent, name="a", bus=LocalNetwork().connect("a"), keys=Keys("g"), clock=ManualClock(), memory=None)


def test_a_life_without_trouble() -> None:
    heard = Heard()
    heard.runner.setup()
    heard.tick(25)
    heard.runner.teardown()
    heard.network.deliver()
    assert heard.runner.agent.calls == ["setup", *["tick"] * 25, "teardown"]  # type: ignore[attr-defined]
    states = [status.state for status in heard.statuses]
    assert states == [State.STARTING, State.READY, State.READY, State.READY, State.STOPPED]
    last = heard.statuses[-1]
    assert (last.agent, last.rid, last.pid, last.errors) == ("flaky", "flaky-1", 7, 0)
    assert last.rate_hz == pytest.approx(10.0, rel=1e-6)


def test_a_failed_tick_is_counted_told_and_got_over(caplog: pytest.LogCaptureFixture) -> None:
    heard = Heard(fail_at=(3, 4))
    heard.runner.setup()
    with caplog.at_level(logging.ERROR):
        heard.tick(3)
        assert heard.statuses[-1].state is State.DEGRADED
        assert heard.statuses[-1].last_error == "ValueError: tick 3"
        heard.tick(2)
    assert heard.runner.state is State.READY
    assert heard.runner.status().errors == 2
    assert [record.message for record in caplog.records] == ["ValueError: tick 3 (logged once)"]


def test_it_is_not_ready_before_its_first_good_tick() -> None:
    heard = Heard(fail_at=(1, 2))
    heard.runner.setup()
    heard.tick(2)
    assert heard.runner.state is State.STARTING
    heard.tick()
    assert heard.runner.state is State.READY


def test_it_gives_up_after_too_many_failures_in_a_row() -> None:
    heard = Heard(fail_at=tuple(range(2, 20)))
    heard.runner.setup()
    heard.tick(3)
    with pytest.raises(AgentError, match="3 ticks failed in a row; the last: ValueError: tick 4"):
        heard.tick()
    heard.runner.teardown()
    heard.network.deliver()
    assert heard.statuses[-1].state is State.FAILED


def test_an_agent_can_say_that_it_is_degraded() -> None:
    heard = Heard()
    heard.runner.setup()
    heard.runner.agent.degraded = "no hand model: looking for skin colour"
    heard.tick()
    assert heard.statuses[-1].state is State.DEGRADED
    assert heard.statuses[-1].last_error == "no hand model: looking for skin colour"


class Twin(Agent):
    """Does nothing, by a name that somebody else may have."""

    name = "twin"


def test_of_two_processes_of_one_name_the_later_gives_up(caplog: pytest.LogCaptureFixture) -> None:
    clock = ManualClock()
    network = LocalNetwork(clock)

    def twin(process: str) -> Runner:
        memory = Memory("test", "twin", transport=network.connect(process), clock=clock)
        agent = make_agent(Twin, name="twin", bus=memory.transport, keys=Keys("test"), clock=clock, memory=memory)
        return Runner(agent, rid=memory.rid)

    def live(*alive: Runner, seconds: int = 3) -> None:
        for _ in range(10 * seconds):
            clock.advance(0.1)
            network.deliver()
            for runner in alive:
                runner.agent.memory.poll()
                runner.tick(clock.now())

    one = twin("one")
    live(one, seconds=1)
    other = twin("other")
    live(one, other, seconds=1)
    assert one.state is other.state is State.READY
    with pytest.raises(AgentError, match=rf"'twin', too \({one.agent.memory.rid}\), and was here first.*--name"):
        live(one, other)
    live(one, seconds=1)
    assert one.state is State.DEGRADED
    assert f"another process has the name 'twin', too ({other.agent.memory.rid})" in one.status().last_error
    assert len([record for record in caplog.records if "--name" in record.getMessage()]) == 1
    other.agent.memory.close()
    live(one)
    assert one.state is State.READY and one.status().last_error == ""


@pytest.mark.parametrize("rate", [0.1, 2.0, 60.0])
def test_the_rate_is_measured_for_slow_and_fast_agents(rate: float) -> None:
    heard = Heard()
    heard.runner.setup()
    for _ in range(10):
        heard.clock.advance(1 / rate)
        heard.runner.tick(heard.clock.now())
    assert heard.runner.status().rate_hz == pytest.approx(rate, rel=1e-3)


def test_a_misspelt_declaration_fails_the_setup() -> None:
    class Misspelt(Agent):
        reads = Access(nodes=("cub",))

    network, clock = LocalNetwork(), ManualClock()
    memory = Memory("test", "a", transport=network.connect("a"), clock=clock, rid="a-1")
    agent = make_agent(Misspelt, name="a", bus=memory.transport, keys=memory.keys, clock=clock, memory=memory)
    with pytest.raises(ConfigError, match="'cub' is not in the schema; did you mean 'cube'"):
        Runner(agent, rid="a-1").setup()
