"""Agents run anew on a recording: they do the same again, or it is told what they do differently."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from agents.plant.driver import PlantArm
from agents.recorder.index import RecordingIndex
from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from agents.recorder.reader import read_recording
from agents.replay import ReplayedGraph
from agents.replay.anew import run_anew
from agents.replay.cli import app
from agents.replay.compare import ReplayOutcome, RunComparison
from agents.replay.feed import Feed
from agents.replay.listening import history_of
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run
from dsr import Memory
from dsr.clock import ManualClock
from dsr.errors import ConfigError
from dsr.graph.graph import Graph
from dsr.network.local_transport import LocalNetwork
from dsr.replication.wire import decode_delta
from simulation_handler import SimulationHandler
from tests.agents.replay.conftest import STEP, Studio

EXACT = {"tolerance": 0.0, "turn_tolerance": 1e-12}


@pytest.fixture(scope="session")
def perturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a lockstep run in which a cube is put on another."""
    run = make_run("tower_toppled", sensor="poses", seed=4, folder=tmp_path_factory.mktemp("perturbed"))
    scenario = msgspec.structs.replace(run.scenario, duration=7.0, expectations=[])
    run_lockstep(msgspec.structs.replace(run, scenario=scenario))
    assert run.folder is not None
    return run.folder


def test_hands_are_found_anew_from_what_a_sensor_told(tmp_path: Path) -> None:
    run = make_run("hand_carries", sensor="poses", seed=4, folder=tmp_path)
    scenario = msgspec.structs.replace(run.scenario, duration=7.0, expectations=[])
    run_lockstep(msgspec.structs.replace(run, scenario=scenario))
    outcome = run_anew(tmp_path, ["hand_tracker"], **EXACT)
    (hand,) = [pose for pose in outcome.poses if pose.edge == "RT world human_hand_0"]
    assert hand.both_s > 1.0 and outcome.differences(0.0) == []


def explanations(outcome: ReplayOutcome) -> tuple[list[str], list[str]]:
    recorded, anew = (
        [event.text for event in events if event.kind == "explained"]
        for events in (outcome.recorded_events, outcome.anew_events)
    )
    return recorded, anew


@pytest.mark.parametrize(
    "agents",
    [
        ["simulation_handler"],
        ["scene_estimator"],
        ["surprise", "simulation_handler"],
        ["scene_estimator", "surprise", "simulation_handler"],
    ],
)
def test_unchanged_agents_do_exactly_the_same_again(perturbed: Path, agents: list[str]) -> None:
    outcome = run_anew(perturbed, agents, **EXACT)
    assert outcome.differences(0.0) == []
    assert outcome.seconds > 7.0 and len(outcome.poses) >= 4
    assert [event.text for event in outcome.recorded_events] == [event.text for event in outcome.anew_events]
    recorded, anew = explanations(outcome)
    assert recorded == anew and len(recorded) >= 1
    assert outcome.notes == []


def test_two_replays_are_equal(perturbed: Path) -> None:
    agents = ["surprise", "simulation_handler"]
    assert run_anew(perturbed, agents) == run_anew(perturbed, agents)


def test_agents_that_do_otherwise_are_noticed(perturbed: Path) -> None:
    settings = {"simulation_handler": {"policy": "algorithm1"}}
    outcome = run_anew(perturbed, ["simulation_handler"], settings=settings)
    recorded, anew = explanations(outcome)
    assert "hypotheses" in recorded[0] and "algorithm1" in anew[0]
    found = outcome.differences(0.15)
    assert any(line.startswith("explanations") for line in found)


def test_a_recording_without_percepts_leaves_the_belief_empty(perturbed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of what the agents had written may reach them: all that they believe they made themselves."""
    take = Feed.take

    def without_estimator(self: Feed, now: float, rank: int) -> Any:
        return [item for item in take(self, now, rank) if "scene_estimator" not in item[0]]

    monkeypatch.setattr(Feed, "take", without_estimator)
    outcome = run_anew(perturbed, ["simulation_handler"])
    assert all(pose.both_s == 0.0 and pose.only_recorded.total_s > 5.0 for pose in outcome.poses)
    assert outcome.differences(0.15)


def fed(index: RecordingIndex, anew: list[str]) -> tuple[Feed, Graph]:
    """What agents that run anew find in the graph in the end."""
    feed, graph = Feed(index, anew), Graph("reader")
    for topic, payload in feed.take(index.end + 1.0, feed.last_rank):
        if topic.startswith(("d/", "rt/")) and isinstance(payload, bytes):
            graph.join(decode_delta(payload), index.end)
    return feed, graph


class TwoWriters(Studio):
    """The agent `thinker` beside the writer."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        transport = self._network.connect("thinker")
        self.thinker = Memory("tabletop", "thinker", transport=transport, clock=self.clock, rid="thinker-1")

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.thinker.poll()
            self.thinker.flush()
            super().run(STEP)


def test_what_the_agents_had_written_is_left_out_and_all_else_is_kept(tmp_path: Path) -> None:
    studio = TwoWriters(tmp_path)
    studio.memory.add_node("world", "world")
    studio.memory.add_node("cube_3", "cube", mass=1.0)
    studio.memory.add_node("cube_4", "cube")
    studio.run(3.0)
    studio.thinker.add_edge("world", "cube_3", "Virtual_RT", translation=(1.0, 0.0, 0.0))
    studio.thinker.add_node("event_0", "event", explanation="x")
    studio.thinker.update_node("cube_3", plausible=True, mass=2.0)
    studio.thinker.add_edge("world", "cube_4", "Virtual_RT", translation=(1.0, 0.0, 0.0))
    studio.run(1.0)
    studio.memory.update_node("event_0", note="of another agent")
    studio.memory.remove_node("cube_4")
    studio.run(40.0)
    feed, graph = fed(RecordingIndex(studio.finish()), ["thinker"])
    assert set(graph.nodes) == {"world", "cube_3"} and not graph.edges
    assert graph.node("cube_3").attributes == {"mass": 1.0}
    assert feed.lost["writer"] >= 1 and not feed.kept_past
    assert not any(rid == "thinker-1" for rid, _, _ in graph.store.context.ranges())


def test_agents_that_had_been_at_work_before_go_on_from_what_they_wrote(tmp_path: Path) -> None:
    class Late(TwoWriters):
        def __init__(self, folder: Path) -> None:
            super().__init__(folder)
            self.memory.replica.synchroniser.nobody_there()
            self.memory.add_node("world", "world")
            self.thinker.add_node("cube_3", "cube", mass=2.0)
            for _ in range(3):
                for memory in (self.memory, self.thinker, self._recorder.memory):
                    memory.poll()
                    memory.flush()
                self._network.deliver()
            self._recorder.memory.poll()
            self.clock.advance(60.0)

    studio = Late(tmp_path)
    studio.run(2.0)
    studio.thinker.update_node("cube_3", mass=3.0)
    studio.run(2.0)
    feed, graph = fed(RecordingIndex(studio.finish()), ["thinker"])
    assert feed.kept_past
    assert graph.node("cube_3").attributes == {"mass": 2.0}


def test_what_only_a_snapshot_tells_to_be_removed_is_removed(tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    studio.memory.add_node("world", "world")
    studio.memory.add_node("cube_3", "cube")
    studio.run(1.0)
    studio.finish()
    later = Studio(tmp_path)
    later.memory.restore(studio.memory.snapshot())
    later.memory.remove_node("cube_3")
    later.clock.advance(10.0)
    later.run(4.0)
    _, graph = fed(RecordingIndex(later.finish()), ["thinker"])
    assert set(graph.nodes) == {"world"}


def test_the_comparison_measures_what_differs() -> None:
    clock = ManualClock()
    one, other = (Memory("a", name, transport=LocalNetwork(clock).connect(name), clock=clock) for name in ("x", "y"))
    for memory, shift in ((one, 0.0), (other, 0.01)):
        for name, kind in (("world", "world"), ("table", "table"), ("cube_3", "cube"), ("cube_4", "cube")):
            memory.add_node(name, kind)
        memory.add_edge("world", "cube_3", "Virtual_RT", translation=(shift, 0.0, 0.0))
        memory.add_edge("world", "table", "Virtual_RT", translation=(shift, 0.0, 0.0))
    begin = clock.now()
    comparison = RunComparison(one, other, ["Virtual_RT"], begin, tolerance=0.02)
    for second in range(1, 7):
        if second == 3:
            other.add_edge("cube_3", "cube_4", "on", source="contact")
        one.update_node("cube_4", surprising=second in (2, 4))
        if second == 4:
            other.add_edge("world", "cube_3", "Virtual_RT", translation=(0.03, 0.0, 0.0))
        if second == 6:
            other.remove_edge("world", "cube_3", "Virtual_RT")
        comparison.sample(begin + second)
    outcome = comparison.outcome(["y"], [])
    (pose,) = outcome.poses
    assert pose.edge == "Virtual_RT world cube_3" and pose.both_s == 5.0
    assert pose.max_m == pytest.approx(0.03) and pose.mean_m == pytest.approx(0.018) and pose.max_at_s == 4.0
    assert (pose.beyond.total_s, pose.beyond.longest_s, pose.only_recorded.total_s) == (2.0, 2.0, 1.0)
    (relation,) = outcome.relations
    assert (relation.what, relation.only_anew.total_s) == ("cube_3 on cube_4", 4.0)
    (flag,) = outcome.surprising
    assert (flag.only_recorded.total_s, flag.only_recorded.longest_s) == (2.0, 1.0)
    assert [line.partition(":")[0] for line in outcome.differences(0.5)] == [
        "Virtual_RT world cube_3", "Virtual_RT world cube_3", "cube_3 on cube_4", "cube_4 surprising"
    ]  # fmt: skip
    assert len(outcome.differences(1.5)) == 2
    assert outcome.differences(4.0) == []


def test_the_command_tells_and_its_exit_code_says_whether_they_are_equal(hovering: Path, tmp_path: Path) -> None:
    def run(*options: str) -> Any:
        return CliRunner().invoke(app, ["--agents", "simulation_handler", str(hovering), *options])

    found = run("--json")
    assert found.exit_code == 0 and json.loads(found.stdout)["equal"]
    file = hovering / "recording.mcap"
    (tmp_path / "cut.mcap").write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    cut = CliRunner().invoke(app, ["--agents", "simulation_handler", str(tmp_path / "cut.mcap")])
    assert cut.exit_code == 0 and "cut off" in cut.stdout and "equal" in cut.stdout


def test_an_agent_that_does_otherwise_is_told_in_the_exit_code(perturbed: Path) -> None:
    options = ["--agents", "simulation_handler", str(perturbed), "--set", "simulation_handler.policy=algorithm1"]
    found = CliRunner().invoke(app, options)
    assert found.exit_code == 1 and "✗ explanations: recorded" in found.stdout
    assert CliRunner().invoke(app, [*options, "--report"]).exit_code == 0


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"agents": ["simulation_handlr"]}, "did you mean 'simulation_handler'"),
        ({"agents": ["plant"]}, "does not use the memory"),
        ({"agents": []}, "expected names"),
        ({"agents": ["surprise"], "system": "nowhere"}, "unknown system"),
        ({"agents": ["surprise"], "settings": {"planner": {}}}, "is not run anew"),
        ({"agents": ["surprise"], "settings": {"surprise": {"nonsense": 1}}}, "nonsense"),
    ],
)
def test_wrong_input_is_told(hovering: Path, options: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        run_anew(hovering, **options)


@pytest.mark.parametrize("text", ["x", "a=1", ".b=2", "a.=2"])
def test_settings_that_make_no_sense_are_told(hovering: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=r"expected AGENT\.FIELD=VALUE"):
        CliRunner().invoke(app, ["--agents", "surprise", str(hovering), "--set", text], catch_exceptions=False)


@pytest.mark.parametrize("seed", range(8))
def test_agents_run_anew_on_any_garbled_recording(hovering: Path, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray((hovering / "recording.mcap").read_bytes())
    for position in rng.integers(200, len(data), 3):
        data[position] ^= 1 << int(rng.integers(8))
    (tmp_path / "a.mcap").write_bytes(data[: int(rng.integers(len(data) // 2, len(data)))])
    outcome = run_anew(tmp_path / "a.mcap", ["simulation_handler"], until=2.0)
    assert any("damaged" in note or "cut off" in note or "not readable" in note for note in outcome.notes)


@pytest.mark.parametrize("seed", range(6))
def test_agents_run_anew_on_messages_of_nonsense(hovering: Path, tmp_path: Path, seed: int) -> None:
    """Payloads are damaged within an intact file, as a broken writer would leave it."""
    rng = np.random.default_rng(seed)
    writer = RecordingWriter(tmp_path / "a.mcap", {"graph": "tabletop"})
    for record in read_recording(hovering):
        payload = bytearray(record.payload)
        if payload and rng.random() < 0.2:
            payload[int(rng.integers(len(payload)))] ^= 1 << int(rng.integers(8))
        writer.write(record._replace(payload=bytes(payload)))
    writer.close()
    outcome = run_anew(tmp_path / "a.mcap", ["simulation_handler"], until=2.0)
    assert outcome.seconds == pytest.approx(2.0, abs=0.1)
    graph = ReplayedGraph(tmp_path / "a.mcap")
    for time in rng.uniform(0.0, 6.0, 5):
        graph.at(time)
    assert graph.malformed > 0
    assert history_of(graph).events


def test_an_agent_whose_ticks_fail_is_told(hovering: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: SimulationHandler, now: float) -> None:
        if round((now - 1e9) * 20) == 20:
            raise RuntimeError("changed for the worse")

    monkeypatch.setattr(SimulationHandler, "tick", fail)
    outcome = run_anew(hovering, ["simulation_handler"], until=2.0)
    assert "simulation_handler: 1 ticks failed, the last with RuntimeError: changed for the worse" in (
        outcome.differences(10.0)
    )


def test_a_scenario_in_lockstep_tells_its_recording_how_its_agents_were_configured(perturbed: Path) -> None:
    metadata = RecordingIndex(perturbed).metadata
    assert (metadata["scenario"], metadata["seed"], metadata["sensor"]) == ("tower_toppled", "4", "poses")
    assert "scene_estimator" in json.loads(metadata["agents"]) and metadata["system"] == "tabletop"


# ---- recordings of strangers

BEGUN = RecordedMessage(1e9, "truth", b"")


def stranger(folder: Path, *records: RecordedMessage, **metadata: str) -> Path:
    """A recording that says of itself what it likes."""
    writer = RecordingWriter(folder / "stranger.mcap", {"graph": "tabletop", **metadata})
    for record in records or (BEGUN,):
        writer.write(record)
    writer.close()
    return writer.path


def test_a_recording_does_not_say_which_modules_are_imported(tmp_path: Path) -> None:
    """Its system was any file before, and modules beside that file are programs."""
    (tmp_path / "found_beside.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    system = tmp_path / "evil.toml"
    system.write_text('graph = "x"\n[[agent]]\nname = "surprise"\nclass = "found_beside:Agent"\n')
    recording = stranger(tmp_path, system=str(system))
    with pytest.raises(ConfigError, match=r"none of this machine.*--system"):
        run_anew(recording, ["surprise"])
    assert not (tmp_path / "ran").exists()
    with pytest.raises(ConfigError, match="found_beside"):
        run_anew(recording, ["surprise"], system=str(system))
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize("place", ["driver", "deeper"])
def test_a_recording_does_not_say_which_drivers_are_loaded(tmp_path: Path, place: str) -> None:
    camera = {"driver": "antigravity:fly", "name": "x"}
    config = {"driver": "antigravity:fly"} if place == "driver" else {"cameras": {"camera_x": camera}}
    recording = stranger(tmp_path, system="tabletop", agents=json.dumps({"arm_controller": config}))
    with pytest.raises(ConfigError, match="antigravity:fly"):
        run_anew(recording, ["arm_controller"])
    assert "antigravity" not in sys.modules


class OtherArm(PlantArm):
    """A driver that no system has."""


PLANT_ARM, OTHER_ARM = "agents.plant.driver:PlantArm", f"{__name__}:OtherArm"


@pytest.mark.parametrize(
    ("recorded", "system", "own"),
    [
        ("antigravity:fly", None, {"driver": PLANT_ARM}),
        ("antigravity:fly", "tabletop", {}),
        (OTHER_ARM, None, {"driver": OTHER_ARM}),
    ],
)
def test_a_recorded_driver_is_replaced_or_given(
    tmp_path: Path, recorded: str, system: str | None, own: dict[str, str]
) -> None:
    """The refusal told to give it with `--set`, and then came again."""
    recording = stranger(tmp_path, system="tabletop", agents=json.dumps({"arm_controller": {"driver": recorded}}))
    outcome = run_anew(recording, ["arm_controller"], system=system, settings={"arm_controller": own})
    assert not outcome.failures and "antigravity" not in sys.modules


@pytest.mark.parametrize("seed", ["x", "-1", "9" * 5000, "", "²"])
def test_a_recorded_seed_that_is_none_is_told(tmp_path: Path, seed: str) -> None:
    with pytest.raises(ConfigError, match="--seed"):
        run_anew(stranger(tmp_path, seed=seed), ["surprise"])


@pytest.mark.parametrize("agents", ["[", "[]", '{"surprise": 1}', '{"surprise": ' + "[" * 100_000])
def test_recorded_configurations_that_are_none_are_told(tmp_path: Path, agents: str) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        run_anew(stranger(tmp_path, agents=agents), ["surprise"])


def test_decades_without_a_message_are_slept_through(tmp_path: Path) -> None:
    """As where a clock was set after the recording began. Agents ticked through all of them before."""
    late = BEGUN._replace(stamp=1e9 + 1e10)
    recording = stranger(tmp_path, BEGUN, BEGUN._replace(stamp=1e9 + 0.5), late, late._replace(stamp=late.stamp + 0.5))
    outcome = run_anew(recording, ["surprise"])
    assert outcome.seconds == pytest.approx(1e10, rel=1e-6) and not outcome.failures


def test_agents_tick_through_hours_without_a_message(tmp_path: Path) -> None:
    """No agent tells its status in a recording without statuses, or in a bag of ROS, and yet they were at work."""

    def on_progress(time: float, _duration: float) -> None:
        if 1.0 < time < 9999.0:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        run_anew(stranger(tmp_path, BEGUN, BEGUN._replace(stamp=1e9 + 1e4)), ["surprise"], on_progress=on_progress)
