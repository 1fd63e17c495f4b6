"""What is only looked at is not run: modules beside the file of a system."""

from __future__ import annotations

from pathlib import Path

import pytest

from dsr.errors import ConfigError
from dsr.runtime.system import load_class, load_system

SYSTEM = '''graph = "g"
[[agent]]
name = "plant"
class = "{module}:Plant"
'''


def write(folder: Path, module: str) -> Path:
    (folder / f"{module}.py").write_text(f"open({str(folder / 'ran')!r}, 'w')\n")
    file = folder / "system.toml"
    file.write_text(SYSTEM.format(module=module))
    return file


def test_a_module_beside_the_file_is_not_imported_if_that_is_forbidden(tmp_path: Path) -> None:
    file = write(tmp_path, "beside_forbidden")
    with pytest.raises(ConfigError, match=r"system\.toml:4: .*--no-import"):
        load_system(file, beside=False)
    assert not (tmp_path / "ran").exists()


def test_nor_one_where_the_process_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write(tmp_path, "beside_here")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ConfigError, match="--no-import"):
        load_system(file, beside=False)
    assert not (tmp_path / "ran").exists()


def test_it_is_imported_otherwise(tmp_path: Path) -> None:
    file = write(tmp_path, "beside_allowed")
    with pytest.raises(ConfigError, match="beside_allowed:Plant"):
        load_system(file)
    assert (tmp_path / "ran").exists()


def test_own_classes_are_loaded_in_any_case() -> None:
    assert load_class("agents.recorder:Recorder", beside=False).__name__ == "Recorder"
