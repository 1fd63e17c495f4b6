"""Has every command print its table, tree or lines, with names that are far too long.

What needs a whole system, or minutes, prints an outcome that is made up here, by the command's own functions.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import benchmarks.soak.cli as soak
from agents.calibrator.cli import _show as show_calibration
from agents.calibrator.hand_eye.report import HandEyeReport, ViewReport
from agents.calibrator.hand_eye_cli import _show as show_hand_eye
from agents.hand_tracker.cli import _table as hands_table
from agents.recorder.cli import _table as recordings_table
from agents.recorder.contents import ChannelContents, RecordingContents
from agents.replay.compare import Disagreement, PoseDifference, ReplayOutcome, Stretch
from agents.replay.compare import show as show_comparison
from agents.ros_bridge.looking_cli import _table as topics_table
from agents.ros_bridge.watching import TopicSeen
from agents.scenario.format.scenario import load_scenario
from agents.scenario.judge.result import Result, Verdict
from agents.scenario.run.report import show_result
from agents.scenario.run.statistics import RunSummary, Spread
from agents.scenario.run.sweep_report import MAIN, show_sweep
from benchmarks.report import rows_table
from benchmarks.rows import Peer, Row
from benchmarks.soak.faults import FAULTS
from benchmarks.soak.races import RACES
from dsr.cli import doctor, parts, status_table, topology, what_if
from dsr.cli.common import console
from dsr.clock import WALL_CLOCK
from dsr.crdt.delta import Delta, Write
from dsr.crdt.hlc import MAX_STAMP
from dsr.memory import Memory
from dsr.replication.wire import encode_delta
from dsr.runtime.activity import WorldUse
from dsr.runtime.launcher import AgentRow
from dsr.runtime.status import Heard, State, Status
from dsr.runtime.topology import ClientInfo, Topology, WorldEntry
from dsr.timeline import Event
from dsr.vocabulary.calibration import ObjectReport, Report
from dsr.vocabulary.what_if import Answer
from dsr.worlds.registry import WorldInfo
from planner.cli import _picture as mission_picture
from tests.commands.conftest import AGENT, CAMERA, CUBE, TABLE, WORLD

SCENARIO = """
name = "what_becomes_of_the_cube_of_many_colours_on_the_left_table"
title = "A cube of many colours that nobody has ever seen before falls on the table on the left side of the room"
duration = 12.0

[[object]]
name = "{cube}"
marker_id = 3
position = [0.36, 0.0, 0.32]

[[event]]
do = "carry"
object = "{cube}"
at = 2.0
to = [0.3, 0.2, 0.02]
hand = 0

[[expect]]
check = "resting"
"""


class Place(NamedTuple):
    """What a command may need to print something."""

    memory: Memory
    cli: Callable[..., str]
    folder: Path
    monkeypatch: pytest.MonkeyPatch

    def scenario(self) -> str:
        """A scenario file in which names are long."""
        file = self.folder / "etc" / "scenarios" / "what_becomes_of_the_cube_of_many_colours.toml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(SCENARIO.format(cube=CUBE), encoding="utf-8")
        return str(file)


def agent_rows() -> list[AgentRow]:
    """Three agents whose numbers are large."""
    rows = []
    for name in ("spatial_relations", AGENT, "arm"):
        status = Status(
            agent=name, rid=f"{name}-1", pid=70_000, state=State.DEGRADED, rate_hz=1234.5, tick_ms_p50=1023.4,
            tick_ms_p95=2047.8, missed=98_765, errors=43_210, restarts=123, stamp=WALL_CLOCK.now(),
        )  # fmt: skip
        rows.append(AgentRow(name, "restarting", 70_000, Heard(status, 0.0, 1.0239), 123, f"{CUBE}: no such file"))
    return rows


def _top(place: Place) -> None:
    place.cli("top")
    console.print(status_table.status_table(agent_rows(), f"graph {place.memory.graph_name}"))


def _topology(place: Place) -> None:
    place.cli("topology")
    use = WorldUse(world=WORLD, reads=True, writes=True, read_hz=1234.5, write_hz=987.6, last_read=0.0)
    clients = [ClientInfo(row.agent, "degraded", [use]) for row in agent_rows()]
    worlds = [WorldEntry(WorldInfo(WORLD, parent=CUBE, follows=True), True, [], [], None, 0.0)]
    console.print(topology._table(Topology(worlds, clients), "g", 3599.0))


def _parts(place: Place) -> None:
    place.cli("parts")
    rows = [{"name": WORLD, "types": [CUBE, TABLE], "creator": AGENT, "created": 1e9, "held_by": [AGENT, CAMERA]}]
    console.print(parts._table(rows))


def _stamps(place: Place) -> None:
    cube = place.memory.node(CUBE).created[0]
    write = Write(cube, "perceived", MAX_STAMP, f"{AGENT}-1", (f"{AGENT}-1", 1), False)
    place.memory.restore(encode_delta(Delta(writes=[write], context=[(f"{AGENT}-1", 1, 1)])))
    place.cli("stamps")


def _what_if(place: Place) -> None:
    numbers = (-12.3456, -23.4567, -34.5678, 0.0, 0.0, 0.0, 1.0)
    what_if._show(Answer(
        seconds=1.0, at_rest=True, poses={CUBE: numbers}, moved={CUBE: 12.3456}, turned={CUBE: 3.1},
        rests_on={CUBE: (TABLE, CAMERA)}, on_floor=(CUBE,),
    ))  # fmt: skip


def _doctor(place: Place) -> None:
    checks = [doctor.Check("packages", "ok", "eclipse-zenoh 1.10.0, msgspec 0.20.0, " * 5),
              doctor.Check("runtime folder", "missing", f"/{CUBE}" * 4)]  # fmt: skip
    place.monkeypatch.setattr(doctor, "run_checks", lambda: checks)
    place.cli("doctor")


def _security(place: Place) -> None:
    place.cli("security", "init", "keys", "--agent", AGENT, "--viewer", CAMERA)
    place.cli("security", "add", "keys", "another", "--writes", f"attribute:{CUBE}", "--writes", f"edge:{TABLE}")
    place.cli("security", "show", "keys")


def _timeline(place: Place) -> None:
    from agents.replay import timeline_cli

    events = [Event(1234.56, "surprised", CUBE, f"{CUBE} is not on {TABLE}", {"name": f"situation_{CUBE}_1"})]
    for named in (False, True):
        timeline_cli._show(events, 0.0, as_json=False, named=named)
    place.cli("timeline")


def _days(place: Place) -> None:
    from agents.replay import days_cli

    period = days_cli.RememberedPeriod("earlier", 1234.5, 1e9, 12345, 1234, 86400.0, 1e9, 12345)
    days_cli.show([period], None)
    place.cli("days")


def _replay(place: Place) -> None:
    stretch = Stretch(123.45, 123.45, 123.45)
    edge = f"world Virtual_RT {CUBE}"
    pose = PoseDifference(edge, 12.3456, 3.141, 10.9876, 1234.56, 100.0, stretch, stretch, stretch)
    held = Disagreement(f"{CUBE} on {TABLE}", stretch, stretch)
    event = Event(1234.56, "explained", CUBE, f"{CUBE} was put onto {TABLE}")
    outcome = ReplayOutcome(
        agents=[AGENT], seconds=1234.5, poses=[pose], relations=[held], surprising=[held],
        recorded_events=[event], anew_events=[event], notes=[f"{CUBE} was left out"],
    )  # fmt: skip
    show_comparison(outcome, outcome.differences(0.25), console)


def _record_info(place: Place) -> None:
    channels = [ChannelContents(f"dsr/v1/{CUBE}/blob/{CAMERA}", 12_345_678, 9_876_543_210, 8_765_432_109)]
    console.print(recordings_table(RecordingContents([], channels, 9_876_543_210, 1234.5, {"graph": CUBE})))


def _scenario_run(place: Place) -> None:
    names = ("percept_error", "belief_error", "belief_gap", "belief_drift")
    result = Result(
        scenario="what_becomes_of_the_cube_of_many_colours", seed=123_456, mode="lockstep", sensor="pixels",
        passed=False, expectations=[Verdict(f"{CUBE} rests on {TABLE}", False, f"{CUBE}: gap 1234.56 mm, " * 3)],
        metrics={f"{name}_{CUBE}_m": 12.34567 for name in names}, notes=[f"{CUBE} was never seen"],
    )  # fmt: skip
    show_result(result, load_scenario(place.scenario()), console)


def _sweep(place: Place) -> None:
    spread = Spread(40, 1234.5678, 2345.6789, 3456.789)
    names = (*MAIN, f"percept_error_{CUBE}_m")
    summaries = [
        RunSummary(
            scenario="what_becomes_of_the_cube_of_many_colours", policy=policy, runs=50, passed=3,
            metrics=dict.fromkeys(names, spread), curves={}, failures={f"{CUBE} rests": [1, 2]}, wall_s=123.4,
        ) for policy in ("hypotheses", "algorithm1", "published")
    ]  # fmt: skip
    show_sweep(summaries, console, metrics=True)


def _calibrate(place: Place) -> None:
    pose, covariance = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0), tuple(1e-6 * (i % 7 == 0) for i in range(36))
    show_calibration(Report(
        CAMERA, TABLE, "least_squares", True, f"{CAMERA} was 12.3 mm off", pose, pose, covariance, 0.0123, 0.1, 12.0,
        False, 1, 10, 9, (ObjectReport(CUBE, 12.3456, 3.1, 10.2345, 2.9, True),),
    ))  # fmt: skip


def _hand_eye(_: Place) -> None:
    pose, covariance = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0), tuple(1e-6 * (i % 7 == 0) for i in range(36))
    lens: dict[str, float | int | str | tuple[float, ...]] = {
        **dict.fromkeys(("fx", "fy", "cx", "cy"), 1234.56), "distortion": (0.1,) * 5
    }  # fmt: skip
    view = ViewReport(f"{CUBE}.png", 123.45, 123.45, 123.45, 12345.6, 0.01, f"{CUBE} disagrees with the others")
    show_hand_eye(HandEyeReport(
        f"chessboard of {CUBE}", True, pose, covariance, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), pose, 1.01, 0.01, lens,
        (1.0,) * 9, {"joint_2": 0.01}, 0.2, 0.1, {"position": 0.001, "rotation": 0.001}, (view, view), (f"{CUBE}.png",),
        f"turn {CUBE} about its axis", f"{CUBE} is weak",
    ))  # fmt: skip


def _mission(place: Place) -> None:
    action = {"name": "a", "skill": "Place", "target": CUBE, "destination": TABLE, "explanation": f"{CUBE} is not held"}
    actions = [action | {"status": status} for status in ("done", "running", "failed", "halted", "")]
    console.print(mission_picture({
        "intention": f"put_{CUBE}", "goal": f"on({CUBE},{TABLE})", "status": "running", "replans": 3,
        "explanation": f"the arm waits for {CUBE}", "actions": actions,
    }))  # fmt: skip
    place.cli("mission", "--list")


def _bench(place: Place) -> None:
    place.cli("bench", "--list")
    peers = [Peer("raw Zenoh", 1234.5678), Peer("Spark-DSG", 12345678.0)]
    console.print(rows_table([Row(f"row of {CUBE}", 1234567.8, "transforms/s", 1e6, peers, 0.00012345, False, CUBE)]))


def _soak(place: Place) -> None:
    row = {"rounds": 12_345, "heal_s_median": 1234.56, "heal_s_max": 12345.67}
    console.print(soak._fault_table({"faults": dict.fromkeys(FAULTS, row)}))
    numbers = {"rounds": 99_999, "equal": 99_999, "right": 9, "apart_ms_median": 1.0}
    race = {"meaning": f"two processes write {CUBE}", **numbers}
    place.monkeypatch.setattr(soak, "run_races", lambda *_: dict.fromkeys(RACES, race))
    soak._races(place.folder, 1, 0, console)


def _ros_list(_: Place) -> None:
    topic = f"/{CUBE}/image_rectified/compressed"
    camera = TopicSeen(topic, ["sensor_msgs/msg/CompressedImage"], [f"/{CAMERA}"], [f"/{TABLE}"], False, 1234.5, 1e9)
    reset = TopicSeen(f"/{TABLE}/reset", ["std_srvs/srv/Trigger"], [], [], True, note=CUBE)
    console.print(topics_table([camera, reset]))


def _hands_try(_: Place) -> None:
    hand = {"side": "right", "side_score": 0.98765, "landmarks_px": [[1234.5, 1234.5]] * 21}
    console.print(hands_table([{"picture": f"{CUBE}.png", "hands": [hand]}, {"picture": f"{TABLE}.png", "hands": []}]))


def _call(*arguments: str) -> Callable[[Place], Any]:
    return lambda place: place.cli(*arguments)


PRINTED: dict[str, Callable[[Place], Any]] = {
    "ls": lambda place: (place.cli("ls"), place.cli("ls", "--all")),
    "show": lambda place: (place.cli("show", CUBE), place.cli("show", CAMERA)),
    "tree": _call("tree"),
    "relations": _call("relations"),
    "visibility": _call("visibility", "--all"),
    "where": _call("where", CUBE),
    "worlds": _call("worlds"),
    "parts": _parts,
    "topology": _topology,
    "top": _top,
    "diff": _call("diff", "base", WORLD),
    "what-if": _what_if,
    "stamps": _stamps,
    "doctor": _doctor,
    "security show": _security,
    "timeline": _timeline,
    "days": _days,
    "replay": _replay,
    "record info": _record_info,
    "scenario list": lambda place: (place.scenario(), place.cli("scenario", "list")),
    "scenario check": lambda place: place.cli("scenario", "check", place.scenario(), "nothing_of_that_name"),
    "scenario truth": lambda place: place.cli("scenario", "truth", place.scenario()),
    "scenario run": _scenario_run,
    "scenario sweep": _sweep,
    "calibrate": _calibrate,
    "calibrate hand-eye": _hand_eye,
    "mission": _mission,
    "bench": _bench,
    "ros list": _ros_list,
    "drivers list": _call("drivers", "list"),
    "hands try": _hands_try,
    "robots list": _call("robots", "list"),
    "robots check": _call("robots", "check", "open_manipulator_p"),
    "soak": _soak,
}
"""Commands by what one types after `dsr`, with how to have them print."""

SENTENCES = {
    "new", "run", "stop", "logs", "halt", "watch", "save", "convert", "load", "hub", "record", "view", "demo",
    "record export", "security init", "security add", "ros run", "ros check", "drivers try", "hands fetch",
    "hands status", "tell", "ask", "assist serve", "assist confirm", "scenario generate",
}  # fmt: skip
"""Commands that print lines only, which the terminal breaks, or what one of `PRINTED` prints: `run`, `demo`."""
