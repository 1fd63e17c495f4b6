"""Wrong options of benchmarks are told in a line, before anything is played."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.adept import __main__ as adept
from benchmarks.honesty import __main__ as honesty
from benchmarks.kinds import __main__ as kinds
from benchmarks.options import seeds, whole_number


@pytest.mark.parametrize(
    ("command", "arguments", "told"),
    [
        (kinds, ["--episodes", "0"], "--episodes: 0: expected 1 or more"),
        (kinds, ["--first", "-4"], "--first: -4: expected 0 or more"),
        (kinds, ["--processes", "0"], "--processes: 0: expected 1 or more"),
        (honesty, ["--seeds", "5-2"], "--seeds: '5-2': '5-2' ends before it begins"),
        (honesty, ["--seeds=-3"], "--seeds: '-3': expected numbers and ranges, like 0-49"),
        (honesty, ["--processes", "none"], "--processes: invalid whole number value: 'none'"),
        (adept, ["--seed", "-1"], "--seed: -1: expected 0 or more"),
    ],
)
def test_a_wrong_option_is_told_with_what_was_expected(
    command: object, arguments: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        command._parser().parse_args(arguments)  # type: ignore[attr-defined]
    said = capsys.readouterr().err
    assert exit_.value.code == 2 and told in said and "usage: python -m benchmarks." in said


def test_kinds_tell_what_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other"
    other.write_text("nothing that was kept", encoding="utf-8")
    for file in (tmp_path / "missing", other):
        monkeypatch.setattr("sys.argv", ["kinds", "--read", str(file)])
        with pytest.raises(SystemExit, match=f"{file} is not what --write wrote"):
            kinds.main()


def test_right_ones_are_taken() -> None:
    assert seeds("0-2,7") == [0, 1, 2, 7]
    assert whole_number(1)("3") == 3
