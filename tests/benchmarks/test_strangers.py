"""The scenes by strangers are right scenario files."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.scenario.format.scenario import load_scenario

FILES = sorted((Path(__file__).parents[2] / "benchmarks" / "strangers").glob("*.toml"))


@pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
def test_a_scene_by_a_stranger_is_a_right_file(file: Path) -> None:
    assert load_scenario(file).expectations
