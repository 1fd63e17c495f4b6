"""What counts as a number that is set by hand, and where its meaning is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import hand_set_numbers
from benchmarks.hand_set_numbers import numbers_in

MOST = 120
"""Numbers that are set by hand, as of now"""

SOURCE = '''
# nats for each
MOVED = 3.0
RIDES = 1.0

FAR = 0.25
"""m beyond which nothing is seen"""
_TURN = 0.1  # rad
_NOWHERE = (0.0, 0.0, 0.0)


class Config:
    rate: float = 20.0
    wait: float = 1.0
    """s until it begins"""


class State:
    last: float = 0.0
    """s, when it was seen; nothing yet"""
    probability: float = 1.0
    """1, that it is so"""
    strength: float = 1.0
    """1, ratio to that of others"""


_DRAWS = np.random.default_rng(7).standard_normal((12, 9))
_DRAWS[:3] = 0.0


@lru_cache(maxsize=256)
def known(name):
    return name


def near(points, limit=0.02, *, count=5):
    """Whether any is near.

    Args:
        limit: m, from centre
            to centre.
    """
    return points[3] < 0.5 * limit + 0.7 * count - 1 and zeros(3)
'''


def test_numbers_and_what_is_told_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hand_set_numbers, "_ROOT", tmp_path)
    (tmp_path / "a.py").write_text(SOURCE, encoding="utf-8")
    found = [(number.name, number.value, number.unit, number.meaning) for number in numbers_in(tmp_path / "a.py")]
    assert found == [
        ("MOVED", "3.0", "nats", "nats for each"),
        ("RIDES", "1.0", "nats", "nats for each"),
        ("FAR", "0.25", "m", "m beyond which nothing is seen"),
        ("_TURN", "0.1", "rad", "rad"),
        ("rate", "20.0", "", ""),
        ("wait", "1.0", "s", "s until it begins"),
        ("strength", "1.0", "", "1, ratio to that of others"),
        ("limit", "0.02", "m", "m, from centre to centre."),
        ("count", "5", "", ""),
        ("", "0.7", "", ""),
    ]


def test_every_package_that_reasons_has_some_but_the_inference_of_actions() -> None:
    packages = {number.file.split("/")[0] for number in hand_set_numbers.hand_set_numbers()}
    assert packages == {"simulation_handler", "surprise", "planner", "dsr"}
    with pytest.raises(FileNotFoundError, match="nowhere: no such package"):
        hand_set_numbers.hand_set_numbers(("nowhere",))


def test_there_are_no_more_of_them() -> None:
    """One more needs a reason why it follows from no other one."""
    assert len(hand_set_numbers.hand_set_numbers()) <= MOST


def test_each_has_a_meaning_and_the_page_shows_them_all() -> None:
    found = hand_set_numbers.hand_set_numbers()
    assert [number for number in found if not number.meaning] == []
    page = Path(__file__).parents[2] / "docs/reference/numbers.md"
    assert page.read_text(encoding="utf-8") == hand_set_numbers.as_markdown(found), (
        "run python -m benchmarks.hand_set_numbers --markdown > docs/reference/numbers.md"
    )


def test_a_constant_of_one_name_means_one_thing() -> None:
    places: dict[str, set[str]] = {}
    for number in hand_set_numbers.hand_set_numbers():
        if number.name.isupper():
            places.setdefault(number.name, set()).add(number.file)
    assert {name: files for name, files in places.items() if len(files) > 1} == {}
