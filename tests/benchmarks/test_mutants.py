"""Mutants: what is changed and what is not, which tests are tried, and what the command says of a small package."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import msgspec
import pytest

from benchmarks.mutants import trial
from benchmarks.mutants.__main__ import Report, main
from benchmarks.mutants.drawing import by_statement, draw, every
from benchmarks.mutants.nearness import stages

ROOT = Path(__file__).parents[2]
COUNTING = '''import logging

_log = logging.getLogger("toy")


def clamp(value, least):
    """At least 3."""
    _log.warning("below %d", 4)
    return max(value, least)


def down(count):
    while count > 0:
        count = count - 1
    return f"{count + 5}"


def forgotten(value):
    return value + 2
'''
TESTS = """
import pytest
from toy.counting import clamp, down

def test_less():
    assert clamp(1, 2) == 2

def test_down():
    assert down(3) == "5"

def test_wrong():
    assert clamp(1, 2) == 1
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """A checkout with a package, and tests of it, one of which fails."""
    for name, text in {"toy/counting.py": COUNTING, "tests/toy/test_counting.py": TESTS, "benchmarks/x": ""}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def tried(toy: Path, *options: str) -> Report:
    """What the command reports."""
    file = toy / "report.json"
    assert main(["--root", str(toy), "--packages", "toy", "--json", str(file), *options]) == 0
    return msgspec.json.decode(file.read_bytes(), type=Report)


def changes(tmp_path: Path, statement: str) -> set[tuple[str, str]]:
    """Kind and result of all mutants of a statement in a function."""
    (tmp_path / "one.py").write_text(f"def f():\n{statement}\n")
    found = [one for of_statement in by_statement(tmp_path, "one.py") for one in of_statement]
    return {(one.kind, one.diff.partition("  + ")[2]) for one in found}


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        (" if a < b: raise", {("flip", "if (a >= b): raise"), ("boundary", "if (a <= b): raise")}),
        (" if not a: raise", {("negate", "if a: raise")}),
        (" x = a if b else c", {("delete", "pass"), ("negate", "x = a if (not b) else c")}),
        (" x += a * b", {("delete", "pass"), ("operator", "x -= a * b"), ("operator", "x += (a / b)")}),
        (" return a or b", {("return-none", "return None"), ("and-or", "return (a and b)")}),
        (" del a[2:], b[0]", {(kind, f"del a[{n}:], b[0]") for kind, n in [("double", 4), ("plus-one", 3), ("zero", 0)]}
         | {("plus-one", "del a[2:], b[1]")}),
        (" f(min(a, b), c)", {("delete", "pass"), ("min-max", "f(max(a, b), c)"),
                              ("swap-arguments", "f(c, min(a, b))")}),
        (" with a.min(): pass", {("min-max", "with a.max(): pass")}),
        (' "ä"; a is b', {("flip", '"ä"; (a is not b)')}),
    ],
)  # fmt: skip
def test_each_kind_of_change(tmp_path: Path, statement: str, expected: set[tuple[str, str]]) -> None:
    assert changes(tmp_path, statement) == expected


@pytest.mark.parametrize(
    "statement",
    [
        ' """A docstring of 3."""',
        " a: tuple[int, 3]",
        ' self._log.info("%d", a + 1)',
        " console.print(a + 1)",
        " raise ValueError(a + 1)",
        ' yield f"{a + 1}"',
        " if TYPE_CHECKING: a = 1",
        " def __repr__(self): return a + 1",
        " isinstance(a, int | str).b",
    ],
)
def test_what_only_describes_is_left_alone(tmp_path: Path, statement: str) -> None:
    assert changes(tmp_path, statement) == set()


def test_every_mutant_of_a_module_is_valid_and_another_program() -> None:
    source = (ROOT / "dsr/crdt/store.py").read_bytes()
    mutants = [one for of_statement in by_statement(ROOT, "dsr/crdt/store.py") for one in of_statement]
    assert len({one.name for one in mutants}) == len(mutants) > 100
    before = ast.dump(ast.parse(source))
    assert all(ast.dump(ast.parse(one.applied(source))) != before for one in mutants)


def test_a_seed_draws_the_same_and_a_smaller_count_its_beginning() -> None:
    packages = ("surprise", "dsr/crdt")
    assert draw(ROOT, packages, 3, 20)[:5] == draw(ROOT, packages, 3, 5) != draw(ROOT, packages, 4, 5)
    assert {one.name for one in draw(ROOT, packages, 3, 20)} <= every(ROOT, packages).keys()


def test_the_nearest_tests_come_first() -> None:
    near, package, scenarios = stages(ROOT, "dsr/crdt/store.py")
    assert near[0] == "tests/dsr/crdt/test_store.py"
    assert "tests/dsr/geometry/test_store.py" not in near
    assert Path(package[0]).parent == Path("tests/dsr/crdt")
    assert all(file.startswith("tests/replay/") for file in scenarios)
    assert not {*near} & {*package}
    _, package, _ = stages(ROOT, "simulation_handler/physics/rollouts/worker.py")
    assert Path(package[0]).parent == Path("tests/simulation_handler/rollouts")


def test_mutants_are_caught_by_tests_that_pass_without_them(toy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {file: file.read_bytes() for file in toy.rglob("*.py")}
    report = tried(toy, "--only", "toy/counting.py:9:12:min-max", "toy/counting.py:19:20:zero")
    assert [(one.verdict, one.stage, one.test) for one in report.mutants] == [
        ("caught", "near", "tests/toy/test_counting.py::test_less"),
        ("survived", "near", ""),
    ]
    assert report.unusable == ["tests/toy/test_counting.py::test_wrong"]
    assert "all: 1 of 2 caught (0 of these timed out), 1 survived" in capsys.readouterr().out
    assert {file: file.read_bytes() for file in toy.rglob("*.py")} == before


def test_measurements_are_kept_for_the_next_run_and_made_anew_for_changed_tests(
    toy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    only = ("--only", "toy/counting.py:9:12:min-max", "--survey", str(toy / "survey.json"))
    first, again = tried(toy, *only), tried(toy, *only)
    assert [one.verdict for one in first.mutants + again.mutants] == ["caught", "caught"]
    assert first.unusable == again.unusable != []
    assert capsys.readouterr().err.count("measuring") == 1
    (toy / "tests/toy/test_counting.py").write_text("from toy.counting import clamp\ndef test_it(): clamp(1, 2)")
    assert [one.verdict for one in tried(toy, *only).mutants] == ["survived"]


def test_what_runs_in_child_processes_only_is_tried_with_all_tests_of_its_package(toy: Path) -> None:
    child = "import subprocess, sys\n\ndef test_it(): subprocess.run([sys.executable, '-m', 'toy.program'], check=True)"
    (toy / "tests/toy/test_all.py").write_text(child)
    (toy / "toy/program.py").write_text("def main():\n    code = max(0, 1)\n    raise SystemExit(code - 1)\n\nmain()\n")
    (mutant,) = tried(toy, "--only", "toy/program.py:2:12:min-max").mutants
    assert (mutant.verdict, mutant.stage, mutant.test) == ("caught", "package", "tests/toy/test_all.py::test_it")


def test_what_does_not_end_is_caught(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "_BEYOND", 4.0)
    (mutant,) = tried(toy, "--only", "toy/counting.py:14:9:delete").mutants
    assert (mutant.verdict, mutant.test) == ("timed out", "tests/toy/test_counting.py::test_down")


def test_tests_of_another_revision(toy: Path) -> None:
    for command in ("init -q", "add .", "-c user.name=a -c user.email=b commit -qm first"):
        subprocess.run(["git", *command.split()], cwd=toy, check=True)
    (toy / "tests/toy/test_counting.py").write_text("from toy.counting import clamp\ndef test_it(): clamp(1, 2)")
    only = ("--only", "toy/counting.py:9:12:min-max")
    assert [one.verdict for one in tried(toy, *only).mutants] == ["survived"]
    assert [one.verdict for one in tried(toy, *only, "--tests-from", "HEAD").mutants] == ["caught"]


@pytest.mark.parametrize("options", [["--packages", "nowhere"], ["--only", "a.py:1:1:delete"], ["--tests-from", "no"]])
def test_wrong_arguments(toy: Path, options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--root", str(toy), "--packages", "toy", *options])
    assert options[1] in capsys.readouterr().err
