"""Random episodes are valid by the plant alone, and always the same for a seed."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from agents.scenario.cli import app
from agents.scenario.format.layout import overlapping
from agents.scenario.format.scenario import Scenario, load_scenario, parse_scenario, scenario_files, start_poses
from agents.scenario.generate import episode as making
from agents.scenario.generate.bodies import VESSELS, bowl, cover, cup, inner_width, tray
from agents.scenario.generate.draft import ARENA, MOST_OBJECTS, CrowdedError, EpisodeDraft
from agents.scenario.generate.draw import Draw, NumberRange
from agents.scenario.generate.episode import generate
from agents.scenario.generate.registry import FAMILIES, FIRST_JUDGING_SEED, find_family, is_for_tuning
from agents.scenario.generate.validity import why_invalid
from agents.scenario.generate.writing import to_toml
from agents.scenario.generate_cli import complete_family, write_episodes
from agents.scenario.run.runner import true_course
from agents.scenario.run.staging import make_run
from agents.scenario.truth.history import History
from dsr.errors import ConfigError
from dsr.math3d.shapes import MOST_PARTS, bounds

STACK = """
name = "x"
title = "x"
system = "reasoner"
duration = 4.0
settle = 2.0
[robot]
model = "none"
[camera]
position = [-0.9, 0.0, 1.5]
look_at = [0.0, 0.0, 0.72]
[table]
position = [0.0, 0.0, 0.72]
[[object]]
name = "a"
marker_id = 1
position = [0.0, 0.0, 0.74]
[[object]]
name = "b"
marker_id = 2
position = [0.0, 0.2, 0.74]
"""


def course(text: str, folder: Path) -> History:
    file = folder / "x.toml"
    file.write_text(text)
    return true_course(make_run(file, sensor="poses"), sensor="poses")


@pytest.mark.parametrize("family", FAMILIES)
def test_each_family_gives_valid_episodes_and_the_same_bytes_for_a_seed(family: str) -> None:
    made = generate(family, 0)
    scenario = parse_scenario(made.text)
    assert scenario.name == made.name == f"{family}-0"
    assert 2 <= len(scenario.objects) <= MOST_OBJECTS
    assert overlapping(start_poses(scenario, np.random.default_rng(0))) is None
    assert [check.objects for check in scenario.expectations if hasattr(check, "objects")], "nothing is expected"
    assert generate(family, 0).text == made.text


def test_seeds_and_families_give_different_episodes() -> None:
    texts = {family: to_toml(drawn(family, seed), "") for family in ("stacks", "perturbations") for seed in (1, 2)}
    assert len(set(texts.values())) == len(texts)
    assert to_toml(drawn("stacks", 1), "") == to_toml(drawn("stacks", 1), "")


def drawn(family: str, seed: int, attempt: int = 0) -> Scenario:
    """A draw that nobody has judged."""
    draft = EpisodeDraft(Draw(family, seed, attempt))
    find_family(family).draw(draft)
    return draft.scenario(f"{family}-{seed}", "x")


def test_draws_keep_to_their_bounds_and_use_them() -> None:
    draw = Draw("stacks", 0, 0)
    numbers = [draw.number(NumberRange(0.2, 0.4)) for _ in range(400)]
    assert 0.2 <= min(numbers) < 0.22 and 0.38 < max(numbers) <= 0.4
    factors = [draw.factor(NumberRange(0.01, 1.0)) for _ in range(400)]
    assert 150 < sum(factor < 0.1 for factor in factors) < 250, "as many below 0.1 as above"
    assert {draw.count(2, 4) for _ in range(50)} == {2, 3, 4}
    radii = [np.hypot(*draw.within(2.0)) for _ in range(400)]
    assert max(radii) < 2.001 and 150 < sum(radius < np.sqrt(2.0) for radius in radii) < 250, "evenly over the disc"
    assert sorted(draw.some_of("abc", 5)) == ["a", "b", "c"]


@pytest.mark.parametrize("kind", [*VESSELS, cover], ids=lambda kind: kind.__name__)
def test_vessels_are_open_and_have_room(kind) -> None:
    for seed in range(20):
        body = kind(Draw("containers", seed, 0))
        assert 2 <= len(body.shape) <= MOST_PARTS
        low, high = bounds(body.shape)
        assert np.allclose(np.subtract(high, low), body.size, atol=1e-5)
        assert 0.03 < inner_width(body) < min(body.size[:2])
        inside = not any(part.contains((0.0, 0.0, 0.0)) for part in body.shape)
        assert inside or kind is tray, "its middle is free"


def test_walls_of_a_round_vessel_leave_no_gap() -> None:
    for kind in (cup, bowl):
        body = kind(Draw("containers", 3, 0))
        walls = body.shape[1:]
        rim = body.size[2] / 2 - 0.004
        for angle in np.linspace(0.0, 2 * np.pi, 97):
            ray = [(r * np.cos(angle), r * np.sin(angle), rim) for r in np.linspace(0.02, body.size[0], 400)]
            assert any(wall.contains(point) for wall in walls for point in ray), f"{kind.__name__} at {angle:.2f} rad"


def test_things_find_places_apart_or_the_draw_is_thrown_away() -> None:
    draft = EpisodeDraft(Draw("stacks", 5, 0))
    spots = []
    with pytest.raises(CrowdedError, match="no room"):
        while True:
            body = cover(draft.draw)
            name = draft.stand(body)
            spots.append((*draft.spot(name), body.radius))
    assert len(spots) > 2
    for index, (x, y, radius) in enumerate(spots):
        assert np.hypot(x, y) + radius <= ARENA + 1e-3
        assert all(np.hypot(x - a, y - b) > radius + r for a, b, r in spots[:index])


@pytest.mark.parametrize("name", ["put_down_unseen", "joint_action", "c_pour", "camera_bumped", "what_if_plan"])
def test_a_written_scenario_is_read_as_it_was(name: str) -> None:
    scenario = load_scenario(name)
    without_models = [msgspec.structs.replace(spec, model=None) for spec in scenario.objects]
    plain = msgspec.structs.replace(scenario, objects=without_models)
    assert parse_scenario(to_toml(plain, "written")) == plain
    assert name in scenario_files()


REFUSED = {
    "[[event]]\nat = 1.0\ndo = 'drop'\nobject = 'a'": "could not be carried out",
    "": "nothing happens",
    "[[event]]\nat = 1.0\ndo = 'push'\nobject = 'a'\nvelocity = [3.0, 0.0, 0.0]": "falls off the table",
    "[[event]]\nat = 1.0\ndo = 'slide'\nobject = 'a'\nspeed = 0.3\nto = [0.0, 0.4]": "goes through 'b'",
    "[[event]]\nat = 1.0\ndo = 'slide'\nobject = 'a'\nspeed = 0.01\nto = [0.1, 0.0]": "has not ended",
    "[[object]]\nname = 'c'\nmarker_id = 3\nposition = [0.3, 0.0, 0.9]": "c falls at the start",
    "[[object]]\nname = 'c'\nmarker_id = 3\nlean = [0.5, 0.0, 0.0]\nposition = [0.3, 0.0, 0.76]": "does not stay as it",
    "[[object]]\nname = 'c'\nposition = [0.3, 0.0, 0.74]\n[[object]]\nname = 'd'\nposition = [-0.3, 0.0, 0.74]\n"
    "[[object]]\nname = 'e'\nposition = [-0.3, 0.3, 0.74]": "only 2 of 5 things are seen",
}


@pytest.mark.parametrize(("more", "why"), REFUSED.items())
def test_the_plant_alone_refuses_what_cannot_be_meant(more: str, why: str, tmp_path: Path) -> None:
    assert why in why_invalid(course(STACK + more, tmp_path), find_family("stacks"))


def test_what_falls_off_the_table_is_valid_where_that_belongs_to_the_family(tmp_path: Path) -> None:
    push = "[[event]]\nat = 1.0\ndo = 'push'\nobject = 'a'\nvelocity = [3.0, 0.0, 0.0]"
    assert why_invalid(course(STACK + push, tmp_path), find_family("rolling")) == ""


def test_a_family_that_gives_no_valid_draw_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "MOST_DRAWS", 2)
    monkeypatch.setattr(making, "why_invalid", lambda history, family: "it is Sunday")
    with pytest.raises(ConfigError, match=r"none of 2 draws is valid; the last: it is Sunday"):
        generate("stacks", 0)


def test_families_are_split_by_name_and_by_seed() -> None:
    assert is_for_tuning("stacks", 0) and is_for_tuning("stacks", FIRST_JUDGING_SEED - 1)
    assert not is_for_tuning("stacks", FIRST_JUDGING_SEED)
    assert not is_for_tuning("leaning", 0)
    assert {family.purpose for family in FAMILIES.values()} == {"tuning", "judging"}
    document = (Path(__file__).parents[3] / "docs/reference/episodes.md").read_text(encoding="utf-8")
    for family in FAMILIES.values():
        row = next(line for line in document.splitlines() if line.startswith(f"| `{family.name}` |"))
        assert row.endswith(f"| {family.purpose} |")
    with pytest.raises(ConfigError, match=r"unknown family 'stack'; did you mean 'stacks'"):
        find_family("stack")
    with pytest.raises(ConfigError, match="unknown family 'jumping'") as error:
        find_family("jumping")
    assert all(name in str(error.value) for name in FAMILIES)
    with pytest.raises(ConfigError, match=r"seed -1: expected 0 or more"):
        generate("stacks", -1)


def test_the_command_writes_a_file_that_can_be_played(tmp_path: Path) -> None:
    runner, file = CliRunner(), tmp_path / "episode.toml"
    printed = runner.invoke(app, ["generate", "perturbations", "--seed", "1"])
    written = runner.invoke(app, ["generate", "perturbations", "--seed", "1", "-o", str(file)])
    assert printed.exit_code == written.exit_code == 0
    assert "tuning" in written.output
    assert file.read_text() == printed.output == generate("perturbations", 1).text
    assert runner.invoke(app, ["truth", str(file)]).exit_code == 0
    assert complete_family("sta") == ["stacks"]


def test_a_sweep_generates_its_episodes(tmp_path: Path) -> None:
    (made,) = write_episodes(["perturbations:1", "perturbations:1"], tmp_path)
    assert (made.family, made.seed) == ("perturbations", 1)
    assert load_scenario(made.file).name == "perturbations-1"
    with pytest.raises(ConfigError, match=r"--generate 'stacks': expected a family and seeds"):
        write_episodes(["stacks"], tmp_path)
    with pytest.raises(ConfigError, match=r"--generate '3-1'"):
        write_episodes(["stacks:3-1"], tmp_path)
    nothing = CliRunner().invoke(app, ["sweep"])
    assert nothing.exit_code != 0 and "nothing to run" in str(nothing.exception)


def test_a_sweep_sums_its_episodes_up_by_family(tmp_path: Path) -> None:
    result = tmp_path / "sweep.json"
    done = CliRunner().invoke(
        app, ["sweep", "--generate", "perturbations:1", "--jobs", "1", "--json-file", str(result)]
    )
    assert done.exit_code in (0, 1), done.output
    (run,) = msgspec.json.decode(result.read_bytes())["runs"]
    assert (run["scenario"], run["seed"], run["crash"]) == ("perturbations", 1, "")
