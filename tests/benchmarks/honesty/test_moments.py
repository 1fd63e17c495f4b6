"""What is told at each moment is scored beside the truth, seen and unseen things apart."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console

from agents.scenario.format.scenario import Scenario, parse_scenario
from agents.scenario.truth.history import History, Inferred, Sample
from benchmarks.honesty import __main__ as command
from benchmarks.honesty.answers import Answer
from benchmarks.honesty.moments import RunScores, believed, last_percept, scores_of
from benchmarks.honesty.runs import Job, play_episode
from benchmarks.honesty.statement import log_score, stated
from benchmarks.honesty.summary import Report, kind_of, regions, summarise_runs, told_by
from benchmarks.honesty.tables import markdown, show_report
from benchmarks.honesty.watching import ToldWorlds, statement_of, told_relations
from dsr.math3d.transforms import Pose
from dsr.vocabulary.observed_actions import Action
from simulation_handler.worlds.model import Island, ObjectState, WeightedWorld

SCENARIO = """
name = "x"
title = "x"
duration = 6.0
settle = 1.0
[[object]]
name = "box"
marker_id = 1
position = [0.3, 0.0, 0.02]
[[object]]
name = "other"
known = true
color = [0.1, 0.2, 0.9]
position = [0.3, 0.2, 0.02]
"""
COVARIANCE = np.diag([0.002**2] * 3 + [0.02**2] * 3)
HERE, THERE = Pose((0.3, 0.0, 0.02)), Pose((0.4, 0.0, 0.02))
OTHER = Pose((0.3, 0.2, 0.02))


def scenario() -> Scenario:
    return parse_scenario(SCENARIO)


def history(samples: list[Sample]) -> History:
    made = History(scenario())
    for sample in samples:
        made.add(sample)
    return made


def sample(time: float, box: Pose | None, told: Pose | None, **more: object) -> Sample:
    truth = {"other": OTHER} | ({} if box is None else {"box": box})
    beliefs = {"other": OTHER.with_covariance(COVARIANCE)}
    beliefs |= {} if told is None else {"box": told.with_covariance(COVARIANCE)}
    edges = frozenset({("on", "box", "table"), ("on", "other", "table")})
    return Sample(time=time, truth=truth, beliefs=beliefs, edges=edges, **{"in_view": frozenset(truth), **more})  # type: ignore[arg-type]


def said(one: Sample) -> ToldWorlds:
    """What a belief says that is as sure as the edges of the memory."""
    names = one.beliefs.keys() | one.absent
    places = {name: stated(one.beliefs.get(name), gone=name in one.absent) for name in names}
    pairs = {kind: {(a, b): 1.0 for type, a, b in one.edges if type == kind} for kind in ("on", "in", "grasping")}
    return ToldWorlds(places, places, pairs, {})


def scores(family: str, seed: int, made: History) -> RunScores:
    return scores_of(family, seed, made, {one.time: said(one) for one in made.samples})


def of_box(scores: RunScores) -> list:
    return [moment for moment in scores.moments if moment.object == "box"]


def test_moments_are_ten_a_second_from_the_settling_on() -> None:
    found = scores("f", 3, history([sample(0.05 * k, HERE, HERE) for k in range(61)]))
    times = [moment.time for moment in of_box(found)]
    assert times == pytest.approx([1.0 + 0.1 * k for k in range(21)])
    assert (found.family, found.seed) == ("f", 3)


def test_what_is_told_is_scored() -> None:
    percept = THERE.with_covariance(COVARIANCE)
    one = sample(2.0, HERE, HERE, percepts={"box": percept, "other": OTHER})
    (moment,) = of_box(scores("f", 0, history([one])))
    belief, naive = told_by(moment, "belief"), told_by(moment, "percept")
    assert belief.log_score == log_score(stated(HERE.with_covariance(COVARIANCE)), HERE)
    assert belief.turned_log_score == log_score(stated(HERE.with_covariance(COVARIANCE)), HERE, turned=True)
    assert (belief.region, belief.error) == (pytest.approx(0.0), 0.0)
    assert naive.region == pytest.approx(1.0) and naive.error == pytest.approx(0.1)
    assert naive.log_score > belief.log_score + 10.0
    assert believed(one, said(one), "box").poses[0].pose.cov is not None
    assert last_percept(one, said(one), "other").open == 1.0, "a percept without a covariance says nothing"
    other = next(one for one in scores("f", 0, history([one])).moments if one.object == "other")
    assert told_by(other, "belief").turned_log_score is None, "nobody sees how it is turned"


def test_seen_unseen_and_not_yet_seen_are_told_apart() -> None:
    hidden = frozenset({"other"})
    course = [
        sample(1.0, HERE, None, in_view=hidden),
        sample(2.0, HERE, HERE),
        sample(3.0, HERE, HERE, in_view=hidden),
        sample(4.0, THERE, HERE, in_view=hidden),
        sample(4.5, THERE, HERE, in_view=hidden, moving=frozenset({"box"})),
        sample(5.0, None, HERE, in_view=hidden),
        sample(5.5, THERE, None, in_view=hidden, absent=frozenset({"box"})),
        sample(6.0, THERE, HERE, grasped={"box": "human_hand_0"}),
    ]
    moments = of_box(scores("f", 0, history(course)))
    assert [moment.seen for moment in moments] == ["never", "seen", *["unseen"] * 5, "seen"]
    assert [moment.untouched for moment in moments] == [False, False, True, *[False] * 5]
    told = [told_by(moment, "belief") for moment in moments]
    assert told[0].region is None and told[5].region == 1.0 and told[6].region == 1.0 and told[6].says_gone
    kinds = [kind_of(moment, one) for moment, one in zip(moments, told, strict=True)]
    assert kinds[2:] == [
        "rests unseen, untouched", "rests unseen, was moved", "moves unseen", "gone, believed there",
        "there (unseen), believed gone", "held in view",
    ]  # fmt: skip


def test_relations_and_actions_are_answers() -> None:
    before = sample(0.5, HERE, HERE)  # it counts not itself, but they are known from then on
    made = history([before, sample(2.0, HERE, HERE, grasped={"box": "human_hand_0"}), sample(3.0, None, HERE)])
    made.actions.append(Inferred(Action(2.5, "Pick", "other", "human_hand_0"), 2.6, 0.4))
    answers = {told.kind: told for told in scores("f", 0, made).answers}
    assert list(answers["grasping"].answers) == [Answer(0.0, True, 2.0, ("human_hand_0", "box"))]
    on = [answer[:2] for answer in answers["on"].answers]
    assert sorted(on) == [(1.0, False), (1.0, True), (1.0, True)], "what is held does not count; what is gone is not on"
    assert answers["on"].questions == 3
    assert list(answers["actions"].answers) == [Answer(0.4, False, 2.5, ("Pick", "other"))]


def test_holders_are_compared_by_where_hands_are() -> None:
    one = sample(2.0, HERE, HERE, grasped={"box": "human_hand_1"}, hands={"human_hand_1": (HERE.t,) * 21})
    held = {"grasping": {("human_hand_0", "box"): 1.0}}
    told = said(one)._replace(relations=said(one).relations | held, palms={"human_hand_0": THERE.t})
    made = history([sample(0.5, HERE, HERE), one])
    answers = {told.kind: told for told in scores_of("f", 0, made, {2.0: told}).answers}
    assert list(answers["grasping"].answers) == [Answer(1.0, True, 2.0, ("human_hand_1", "box"))]


def test_relations_of_what_no_camera_has_seen_are_kept_apart() -> None:
    unseen, seen = frozenset({"other"}), frozenset({"other", "box"})
    course = [sample(at, HERE, HERE, in_view=view) for at, view in ((2.0, unseen), (3.0, seen), (4.0, unseen))]
    on = next(told for told in scores("f", 0, history(course)).answers if told.kind == "on")
    assert len(on.never_seen) == 3 and len(on.answers) == 3, "each counts once it was seen before, also while hidden"
    assert on.questions == 3


def test_worlds_are_told_as_one_distribution_and_relations_with_their_weight() -> None:
    here, there = HERE.with_covariance(COVARIANCE), THERE.with_covariance(COVARIANCE)
    states = [
        (0.5, ObjectState(here, supports=("table",)), ObjectState(OTHER)),
        (0.2, ObjectState(here, supports=("table",)), ObjectState(None)),
        (0.2, ObjectState(there, hand="human_hand_0"), ObjectState(OTHER)),
        (0.1, ObjectState(None), ObjectState(OTHER)),
    ]
    worlds = tuple(WeightedWorld(weight, {"box": box, "other": other}) for weight, box, other in states)
    island = Island(("box", "other"), worlds)
    statement = statement_of(island, "box")
    assert [(round(one.weight, 9), one.pose) for one in statement.poses] == [(0.7, here), (0.2, there)]
    assert statement.gone == pytest.approx(0.1) and statement.open == pytest.approx(0.0)
    assert told_relations([island], "on") == pytest.approx({("box", "table"): 0.7})
    assert told_relations([island], "grasping") == pytest.approx({("human_hand_0", "box"): 0.2})
    assert told_relations([island], "in") == {}


def report() -> tuple[list[RunScores], Report]:
    hidden = frozenset({"other"})
    runs = []
    for seed, off in ((0, HERE), (1, THERE)):
        course = [sample(1.0 + 0.1 * k, HERE, HERE) for k in range(10)]
        course += [sample(2.0 + 0.1 * k, HERE, off, in_view=hidden) for k in range(10)]
        runs.append(scores("stacks", seed, history(course)))
    return runs, summarise_runs(runs)


def test_runs_are_summed_up() -> None:
    runs, summed = report()
    seen, unseen = (
        next(one for one in summed.places if (one.family, one.speaker, one.seen) == ("stacks", "belief", seen))
        for seen in ("seen", "unseen")
    )
    assert seen.coverage == {0.5: 1.0, 0.9: 1.0, 0.99: 1.0} and unseen.coverage == {0.5: 0.5, 0.9: 0.5, 0.99: 0.5}
    assert unseen.moments == 20 and unseen.silent == 0.0
    assert seen.median_error == 0.0 and unseen.p95_error == pytest.approx(0.1)
    assert seen.log_score_error == pytest.approx(0.0, abs=1e-9)
    assert unseen.log_score_error is not None and unseen.log_score_error > 5.0, "episodes differ"
    percept = next(one for one in summed.places if one.speaker == "percept")
    assert percept.silent == 1.0 and percept.coverage == {}
    assert regions(runs, "belief", "unseen") == pytest.approx([0.0] * 10 + [1.0] * 10)
    (near, _all) = summed.near
    assert (near.seen_at_rest, near.untouched) == ((1.0, 60), (0.5, 20))
    assert (near.contained, near.contained_never_seen) == (None, None)
    (failures, _all) = summed.failures
    assert failures.share == pytest.approx(10 / 80) and failures.kinds == [("rests unseen, untouched", 1.0)]
    assert [(seed, name) for seed, name, _ in failures.worst] == [(1, "box")]
    on = next(one for one in summed.relations if one.kind == "on")
    assert (on.brier, on.silent, on.sure_and_wrong) == (0.0, 1.0, 0.0)


def test_the_tables_name_every_family() -> None:
    _, summed = report()
    text = markdown(summed)
    assert text.count("### ") == 6 and "| stacks | unseen | 20 |" in text
    console = Console(width=200, record=True)
    show_report(summed, console)
    assert "rests unseen, untouched 100 %" in console.export_text()


def test_what_was_played_is_kept_and_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    runs, summed = report()
    kept, found = tmp_path / "kept", tmp_path / "scores.json"
    kept.write_bytes(msgspec.msgpack.encode(runs))
    monkeypatch.setattr("sys.argv", ["honesty", "--read", str(kept), "--markdown", "--json", str(found)])
    command.main()
    assert "### Places" in capsys.readouterr().out
    assert msgspec.json.decode(found.read_bytes(), type=Report) == summed


def test_what_is_read_is_of_the_families_and_seeds_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, chosen = tmp_path / "kept", tmp_path / "chosen"
    kept.write_bytes(msgspec.msgpack.encode([RunScores(f, s, [], []) for f in ("stacks", "hands") for s in (1, 2)]))
    read = ["honesty", "--read", str(kept), "--families", "hands"]
    monkeypatch.setattr("sys.argv", [*read, "--seeds", "2", "--write", str(chosen)])
    command.main()
    runs = msgspec.msgpack.decode(chosen.read_bytes(), type=list[RunScores])
    assert [(run.family, run.seed) for run in runs] == [("hands", 2)]
    monkeypatch.setattr("sys.argv", [*read, "--seeds", "7"])
    with pytest.raises(SystemExit, match="has nothing of these families and seeds"):
        command.main()
    kept.write_bytes(b"no scores")
    with pytest.raises(SystemExit, match="is not what --write wrote"):
        command.main()


def test_pictures_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from benchmarks.honesty.pictures import draw_pictures

    files = draw_pictures(*report(), tmp_path)
    assert len(files) == 3 and all(file.stat().st_size > 5000 for file in files)


def test_an_episode_is_played_and_scored() -> None:
    scores = play_episode(Job("perturbations", 1, "poses"))
    assert {moment.seen for moment in scores.moments} & {"seen"}
    seen = [told_by(moment, "belief") for moment in scores.moments if moment.seen == "seen"]
    assert np.median([told.error for told in seen if told.error is not None]) < 0.005
    assert {told.kind for told in scores.answers} == {"on", "in", "grasping", "actions"}
