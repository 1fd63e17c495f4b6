"""Hostile files: each reader takes or refuses them within little memory and time."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.attacks.files.bombs import BOMBS, Bomb
from benchmarks.attacks.files.limited import read_limited

_SMALL = [bomb for bomb in BOMBS if bomb.name != "lists.json"]
"""A quarter of a gigabyte is for `python -m benchmarks.attacks file-bombs`."""


@pytest.mark.parametrize("bomb", _SMALL, ids=[bomb.name for bomb in _SMALL])
def test_a_bomb_is_read_or_refused_in_little_memory_and_time(bomb: Bomb, tmp_path: Path) -> None:
    file = tmp_path / bomb.name
    file.write_bytes(bomb.make())
    reading = read_limited(file)
    assert reading.ended_well, reading.said
