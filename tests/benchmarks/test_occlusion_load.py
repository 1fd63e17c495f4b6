"""The benchmark of loads runs those that it is told, and says so if there is none of a name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import occlusion_load


def test_a_load_of_another_name_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["occlusion_load", "--loads", "crowdy"])
    with pytest.raises(SystemExit) as ended:
        occlusion_load.main()
    assert ended.value.code == 2 and "crowdy" in capsys.readouterr().err


@pytest.mark.parametrize(("load", "limit"), [("crowded", occlusion_load.LIMIT), ("told", occlusion_load.TICK)])
def test_a_whole_tick_may_take_longer_than_a_step(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, load: str, limit: float
) -> None:
    monkeypatch.setattr(occlusion_load, f"_{load}", lambda seconds: [0.045] * 3)
    monkeypatch.setattr("sys.argv", ["occlusion_load", "--loads", load, "--json", str(tmp_path / "rows.json")])
    with pytest.raises(SystemExit) as ended:
        occlusion_load.main()
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert (row["load"], row["limit_ms"]) == (load, pytest.approx(1e3 * limit))
    assert ended.value.code == (1 if limit < 0.045 else 0)
