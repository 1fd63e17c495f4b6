"""Learning finds the parameters by which the truth was drawn, and leaves out what is for judging."""

from __future__ import annotations

import pickle
import tomllib
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmarks.learning import __main__ as command
from benchmarks.learning import learn
from benchmarks.learning.holding import HOLDING, learn_holding
from benchmarks.learning.judged import Episode, log_scores
from benchmarks.learning.judging import judge_episodes, table_of
from benchmarks.learning.learn import BEGUN, GROUPS, learn_some, toml_of
from benchmarks.learning.noise import START, Errors, errors_of, learn_noise
from benchmarks.learning.rates import ABSENCE, RATES, SHARES, learn_rates
from benchmarks.learning.recognition import CURVES, Look, learn_recognition, looks_at
from benchmarks.learning.recorded import Recorded
from dsr.believing.absence import Absence
from dsr.math3d.transforms import Pose
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.circumstances import DOUBTED, HELD, HELD_LYING, RESTLESS, RESTS, RIDES
from simulation_handler.worlds.displaced import Staying
from simulation_handler.worlds.evidence import Evidence, HandEvidence, ObjectEvidence
from simulation_handler.worlds.followed import Followed
from simulation_handler.worlds.parameters import learned_parameters
from simulation_handler.worlds.spread import odds_of_percepts, position_covariance
from simulation_handler.worlds.weighted import WeightedWorlds

HERE = Pose((0.3, 0.0, 0.02))
COVARIANCE = np.diag([0.001**2] * 3 + [0.01**2] * 3)
SOURCES = {"episodes": ["hands-1"]}
PARAMETERS = msgspec.structs.replace(BEGUN, holding={HELD_LYING: 0.5})


def course(gone: bool, *, hand: str = "", seconds: float = 6.0) -> Episode:
    """A box that is seen for a second and not any more, because it is gone, or because it is hidden."""
    moments = []
    for now in np.arange(0.0, seconds, 0.2).tolist():
        seen = now < 1.0
        things = {
            name: ObjectEvidence(
                Solid(name, (0.04, 0.04, 0.04), HERE.t), HERE.with_covariance(COVARIANCE), (0.0, 0.0, 0.0),
                HERE.with_stamp(now if seen or name == "other" else 0.8), True, 10, False,
                hand=hand if name == "box" else "",
            )
            for name in ("box", "other")
        }  # fmt: skip
        truth = {"other": HERE} if gone and not seen else {"box": HERE, "other": HERE}
        hands = {"hand": HandEvidence(Pose((0.0, 0.0, 5.0)), True, ())}
        evidence = Evidence(now, things, hands, None, frozenset())
        view = frozenset({"box", "other"} if seen else {"other"})
        moments.append(Recorded(now, evidence, truth, view, {"box": "hand"} if seen else {}, frozenset()))
    share = 1.0 if gone else 0.0
    return Episode(
        "hands-0", 0.0, moments, lambda _, places: {name: [share] * len(there) for name, there in places.items()}
    )


def still(places: np.ndarray, seen: np.ndarray | None = None, sigma: float = 0.001) -> Errors:
    """Errors of things at rest, each in an episode of its own; `seen` from the simulated to the perceived places."""
    count = len(places)
    none, unknown = np.zeros((count, 3, 3)), np.full((count, 3), np.nan)
    own = np.tile(sigma**2 * np.eye(3), (count, 1, 1))
    return Errors(
        none, none, np.zeros(count), np.zeros(count), np.zeros((count, 3)), np.full(count, np.inf), places, unknown,
        unknown if seen is None else seen, own, unknown, none, np.ones(count), np.full(count, -np.inf),
        np.arange(count),
    )  # fmt: skip


def test_noise_is_found_again() -> None:
    rng = np.random.default_rng(0)
    count, level, height = 3000, 0.008, 0.002
    errors = still(rng.normal(size=(count, 3)) * (level, level, height))
    found = learn_noise(errors)
    assert found.level == pytest.approx(level, rel=0.15) and found.height == pytest.approx(height, rel=0.15)
    assert learn_noise(errors.of(np.arange(3))) == START, "three moments tell nothing"


def test_where_percepts_tell_their_noise_there_is_no_level_beside_it() -> None:
    rng = np.random.default_rng(0)
    told, grain = rng.uniform(0.0001, 0.001, (3000, 1)) * (1.0, 1.0, 0.0), 0.0001
    errors = still(np.hypot(told, grain) * rng.normal(size=told.shape))
    found = learn_noise(replace(errors, own_places=told[:, :, None] ** 2 * np.eye(3)))
    assert found.level < 0.0001 and found.scale == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("right", ["percepts", "simulation"])
def test_who_is_right_where_percepts_and_simulation_differ_is_learned(right: str) -> None:
    rng = np.random.default_rng(1)
    count, apart = 600, 0.05
    shift = np.zeros((count, 3))
    shift[::10, 0] = apart
    truth = shift if right == "percepts" else np.zeros((count, 3))
    errors = still(truth + rng.normal(size=(count, 3)) * 0.001, shift + rng.normal(size=(count, 3)) * 0.001)
    found = learn_noise(errors)
    odds = float(odds_of_percepts(found, np.array((apart / 0.001) ** 2)))
    assert odds > 3.0 if right == "percepts" else odds < 0.3


def test_what_another_circumstance_explains_teaches_nothing_of_this_one() -> None:
    """Half of the things are where percepts have them. The others are not, for a camera moved: that explains them."""
    rng = np.random.default_rng(1)
    count, apart = 600, 0.05
    shift = np.tile((apart, 0.0, 0.0), (count, 1))
    moved = (np.arange(count) % 2 == 0)[:, None]
    errors = still(moved * shift + rng.normal(size=(count, 3)) * 0.001, shift + rng.normal(size=(count, 3)) * 0.001)
    half = replace(errors, probability=np.full(count, 0.5), otherwise=np.where(moved[:, 0], -100.0, 25.0))
    unsure, told = (
        float(odds_of_percepts(learn_noise(one), np.array((apart / 0.001) ** 2))) for one in (errors, half)
    )
    assert unsure < 2.0 and told > 5.0


def test_what_is_seen_displaced_is_counted_in_both_circumstances() -> None:
    """It stays with 30 %: the truth is 1 m off, and known to 1 mm if so."""
    known, thing = learned_parameters(), course(gone=False).moments[0].evidence.objects["box"]
    followed = Followed(RESTLESS, HERE.with_covariance(COVARIANCE), np.zeros(3), stays=Staying(0.3))
    truth = Pose((1.3, 0.0, 0.02))
    evidence = Evidence(0.0, {"box": thing}, {}, None, frozenset())
    moment = Recorded(0.0, evidence, {"box": truth}, frozenset(), {}, frozenset())

    class Worlds(WeightedWorlds):
        def followed(self, name: str) -> Followed:
            return followed

    exact = msgspec.structs.replace(START, level=0.001, height=0.001)
    found = [
        errors_of([([moment], Worlds(known))], {**known.noise, DOUBTED: noise})[RESTLESS]
        for noise in (exact, msgspec.structs.replace(START, level=1.0))
    ]
    assert [one.probability.tolist() for one in found] == [[pytest.approx(0.7)]] * 2
    assert found[0].otherwise[0] < found[1].otherwise[0] - 5.0


def test_what_leaves_the_scene_in_episodes_is_expected_to_leave() -> None:
    told: list[str] = []
    leaving, errors = learn_rates([course(gone=True) for _ in range(3)], PARAMETERS, told.append)
    staying, _ = learn_rates([course(gone=False) for _ in range(3)], PARAMETERS, told.append)
    assert leaving.rates.removed > 2.0 * staying.rates.removed
    assert errors["rates", "removed"] <= 1.5 and len(told) == 6
    before, after = (float(np.mean(log_scores(course(gone=True), tried))) for tried in (PARAMETERS, leaving))
    assert after < before - 0.5


def test_how_often_a_hand_holds_is_counted() -> None:
    episode = course(gone=False, hand="hand", seconds=60.0)
    one = episode.moments, WeightedWorlds(PARAMETERS, episode.shares)
    other = [moment for moment in episode.moments if moment.time < 1.0], WeightedWorlds(PARAMETERS, episode.shares)
    found, errors = learn_holding([one])
    assert found[HELD_LYING] == pytest.approx(15 / 26), "and one moment just after it was seen"
    assert found["held unseen"] < 0.1
    assert max(errors.values()) == pytest.approx(0.0, abs=1e-9), "the same episode again is no other"
    one = episode.moments, WeightedWorlds(PARAMETERS, episode.shares)
    _, errors = learn_holding([one, other])
    assert errors["held unseen"] > errors[HELD_LYING] > 0.0, "only one of them tells what is held unseen"


def test_the_file_tells_what_was_learned(tmp_path: Path) -> None:
    file = tmp_path / "worlds.toml"
    file.write_text(toml_of(PARAMETERS, {"rests unseen": {"level": 0.1}}, {("rates", "moved"): 0.2}, SOURCES))
    assert learned_parameters(file) == PARAMETERS
    assert '"episodes" = ["hands-1"]' in file.read_text()


def test_some_circumstances_are_learned_alone(tmp_path: Path) -> None:
    file, (settle, moments) = tmp_path / "worlds.toml", (0.0, [*course(gone=True).moments] * 2)
    errors = {(group, "any"): 0.5 for group in GROUPS}
    file.write_text(toml_of(PARAMETERS, {RESTS: {"level": 9.0}, HELD: {"level": 8.0}}, errors, SOURCES))
    (tmp_path / "stacks-7.pickle").write_bytes(pickle.dumps((settle, moments)))
    text = learn_some(tmp_path, [RESTS], file, lambda line: None)
    file = tmp_path / "anew.toml"
    file.write_text(text)
    found, told = learned_parameters(file), tomllib.loads(text)
    assert found.noise[RESTS].level < 0.5 * START.level, "everything is exactly where it is believed"
    kept = {**found.noise, RESTS: START}
    assert msgspec.structs.replace(found, noise=kept) == PARAMETERS
    assert told["errors"]["noise"][RESTS]["level"] < 9.0 and told["errors"]["noise"][HELD]["level"] == 8.0
    assert told["source"] == {**SOURCES, RESTS: ["stacks-7"]}


def test_what_hands_hold_is_learned_alone(tmp_path: Path) -> None:
    file = tmp_path / "worlds.toml"
    before = msgspec.structs.replace(PARAMETERS, holding={HELD_LYING: 0.1, RIDES: 0.2})
    errors = {(group, "any"): 0.5 for group in ("rates", "absence", "elsewhere", "within")}
    errors |= {(HOLDING, HELD_LYING): 9.0, (HOLDING, RIDES): 8.0}
    file.write_text(toml_of(before, {RESTS: {"level": 9.0}}, errors, SOURCES))
    (tmp_path / "hands-7.pickle").write_bytes(pickle.dumps((0.0, [*course(gone=False, hand="hand").moments])))
    text = learn_some(tmp_path, [HOLDING], file, lambda line: None)
    (anew := tmp_path / "anew.toml").write_text(text)
    found, told = learned_parameters(anew), tomllib.loads(text)
    assert found.holding[HELD_LYING] > 0.5 and msgspec.structs.replace(found, holding=before.holding) == before
    assert told["errors"][HOLDING][HELD_LYING] < 9.0
    assert found.holding[RIDES] == 0.2 and told["errors"][HOLDING][RIDES] == 8.0, "nothing new is known of these"
    assert told["errors"]["noise"] == {RESTS: {"level": 9.0}} and told["errors"]["rates"] == {"any": 0.5}
    assert told["source"] == {**SOURCES, HOLDING: ["hands-7"]}


def test_what_absence_tells_is_learned_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = msgspec.structs.replace(PARAMETERS, absence=Absence(rate=0.05, blind=0.4))
    errors = dict.fromkeys((("absence", "rate"), ("rates", "removed")), 9.0)
    (file := tmp_path / "worlds.toml").write_text(toml_of(before, {RESTS: {"level": 9.0}}, errors, SOURCES))
    monkeypatch.setattr(learn, "load_episodes", lambda folder: [course(gone=True)] * 3)
    text = learn_some(tmp_path, ["absence"], file, lambda line: None)
    (anew := tmp_path / "anew.toml").write_text(text)
    found, told = learned_parameters(anew), tomllib.loads(text)
    assert found.absence.rate > 1.0 and found.absence.blind < ABSENCE.blind, "what is missing is gone"
    assert msgspec.structs.replace(found, absence=before.absence) == before
    assert told["errors"]["absence"]["rate"] < 9.0 and told["errors"]["rates"]["removed"] == 9.0
    assert told["source"] == {**SOURCES, "absence": ["hands-0"] * 3}


def test_what_contradicts_a_place_bounds_how_unsure_it_is() -> None:
    near = msgspec.structs.replace(START, level=0.05, height=0.04)
    once, none = np.zeros(2), np.zeros((2, 3, 3))
    first, second = position_covariance(near, none, once, once, np.zeros((2, 3)), np.array((0.01, np.inf)))
    assert np.diag(first) == pytest.approx([0.01**2] * 3)
    assert np.diag(second) == pytest.approx([0.05**2] * 2 + [0.04**2])


def test_worlds_are_judged_beside_the_simulated_world() -> None:
    judged = judge_episodes([course(gone=True)], learned_parameters())
    assert {one.speaker for one in judged} == {"worlds", "one world"} and {one.seen for one in judged} == {True, False}
    sure = [one.region for one in judged if one.speaker == "one world" and not one.seen]
    assert set(sure) == {1.0}, "the simulated world is sure of what is gone"
    assert table_of(judged).row_count == 4


def test_seeds_for_judging_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["learning", "record", "--folder", str(tmp_path), "--seeds", "999-1001"])
    with pytest.raises(SystemExit, match="1000, 1001"):
        command.main()


def test_shares_stay_probabilities() -> None:
    learned = learned_parameters()
    assert all(0.0 < value < 1.0 for value in learned.holding.values())
    assert all(0.0 < getattr(getattr(learned, group), name) < 1.0 for group, name in SHARES)
    assert learned.absence.blind < 0.5
    assert all(noise.wide >= 2.0 for noise in learned.noise.values())
    assert msgspec.structs.asdict(learned.rates).keys() == msgspec.structs.asdict(RATES).keys()


def test_how_much_must_be_seen_is_learned_apart_for_tags_and_colours() -> None:
    shares = np.linspace(0.0, 1.0, 101).tolist()
    looks = [
        Look(f"thing {number}", tagged, share, share > half)
        for tagged, half in ((True, 0.8), (False, 0.3))
        for number, share in enumerate(shares)
    ]
    found, errors = learn_recognition(looks)
    assert found.tag == pytest.approx(0.8, abs=0.02) and found.color == pytest.approx(0.3, abs=0.02)
    assert max(found.tag_width, found.color_width) < 0.03
    assert found.probability(0.5, tagged=False) > 0.95 and found.probability(0.5, tagged=True) < 0.05
    few, unsure = learn_recognition(looks[::25])
    assert unsure["recognition", "tag"] > 2.0 * errors["recognition", "tag"], "little evidence, and so it is told"
    assert learn_recognition([])[0].tag == pytest.approx(CURVES.tag, abs=0.01)
    assert few.color < few.tag


def test_a_look_is_at_what_the_plant_shows() -> None:
    looks = looks_at("screens", 108)
    assert {look.thing.split()[0] for look in looks} == {"screens-108"}
    assert all(look.is_recognised for look in looks if look.share == 1.0)
    assert not any(look.is_recognised for look in looks if look.share == 0.0)
