"""docs/reference/scenarios.md describes the format as it is."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec
import pytest

from agents.scenario.format.events import EVENTS
from agents.scenario.format.expectations import CHECKS
from agents.scenario.format.model import (
    ObjectSpec,
    PersonSpec,
    PlanSpec,
    RandomSpec,
    RobotSpec,
    Scenario,
    SensorSpec,
    TableSpec,
)
from agents.scenario.format.scenario import PREDICATES, parse_scenario

ROOT = Path(__file__).parents[3]
DOCUMENT = (ROOT / "docs/reference/scenarios.md").read_text()
EXAMPLES = re.findall(r"```toml\n(?!# excerpt)(.*?)```", DOCUMENT, re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_example_is_a_valid_scenario(example: str):
    scenario = parse_scenario(example)
    assert scenario.name == "my_stack"
    assert len(scenario.objects) == 2 and len(scenario.events) == 1 and len(scenario.expectations) == 4


def test_there_is_an_example_and_its_wrong_line_is_explained_as_written():
    (example,) = EXAMPLES
    wrong = example.replace("marker_id = 3", "markr_id = 3")
    shown = re.search(r"`my\.toml:\d+: (.*?\?)`", DOCUMENT)
    assert shown
    with pytest.raises(Exception) as caught:
        parse_scenario(wrong, "my.toml")
    assert str(caught.value) == shown[0].strip("`")


@pytest.mark.parametrize("section", [RobotSpec, TableSpec, SensorSpec, RandomSpec, ObjectSpec, PersonSpec, PlanSpec])
def test_every_field_of_a_section_is_documented_with_its_default(section: type[msgspec.Struct]):
    title = section.__name__.removesuffix("Spec").lower()
    heading = f"### `[[{title}]]`" if section in (ObjectSpec, PersonSpec, PlanSpec) else f"### `[{title}]`"
    text = DOCUMENT.partition(heading)[2].partition("\n#")[0]
    rows = {
        cells[1].strip().strip("`"): cells[2].strip() for line in text.splitlines() if (cells := line.split("|"))[1:]
    }
    for field in msgspec.structs.fields(section):
        assert field.encode_name in rows, f"{field.encode_name} is not described under {heading}"
        shown = rows[field.encode_name].strip("`")
        if shown.startswith(('"', "[")) or shown[0].isdigit():
            assert msgspec.convert(tomllib.loads(f"x = {shown}")["x"], field.type) == field.default


def test_every_top_level_field_is_documented():
    top, sections = (
        DOCUMENT.partition("## Top level")[2].partition("###")[0],
        DOCUMENT,
    )
    for field in msgspec.structs.fields(Scenario):
        name = field.encode_name
        assert f"`{name}`" in top or f"`[{name}]`" in sections or f"`[[{name}]]`" in sections, name


@pytest.mark.parametrize(("name", "kind"), [*EVENTS.items(), *CHECKS.items()])
def test_every_event_and_check_has_a_row_with_its_fields(name: str, kind: type[msgspec.Struct]):
    (row,) = re.findall(rf"^\| `{name}` \|.*$", DOCUMENT, re.MULTILINE)
    common = {"at", "when", "delay", "event"}
    for field in msgspec.structs.fields(kind):
        assert field.encode_name in common or f"`{field.encode_name}`" in row, field.encode_name


@pytest.mark.parametrize("predicate", PREDICATES)
def test_every_predicate_has_a_row(predicate: str):
    assert re.search(rf"^\| `{predicate}\(", DOCUMENT, re.MULTILINE)


def test_the_built_in_scenarios_are_listed():
    _, _, listed = DOCUMENT.partition("## What is built in")
    rows = re.findall(r"^\|.*", listed.partition("\n## ")[0], re.MULTILINE)
    names = re.findall(r"`(\w+)`", "".join(rows))
    assert sorted(names) == sorted(file.stem for file in (ROOT / "etc/scenarios").glob("*.toml"))
