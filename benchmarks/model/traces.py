"""Traces of the model: random ones, and those that show what is wrong without one of its rules."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from benchmarks.model.checker import MODEL, Bounds, CheckerError, Verdict, check, wander
from benchmarks.model.replay import Step, holds_in_model

SMALL = Bounds(changes=3, fetches=1, restarts=1)
WRONG: dict[str, Bounds] = {
    "late additions resurrect": Bounds(),
    "removals that come first are forgotten": Bounds(),
    "writes that came too early count as seen": Bounds(),
    "the last to arrive wins": Bounds(),
    "dead edges are kept": Bounds(),
    "what lives is said of all, not of an interval": SMALL,
    "a first piece accounts for the whole": SMALL,
    "answers remove nothing": SMALL,
    "who differs does not ask for all": SMALL,
    "a replica id is used again": SMALL,
}
"""Rules that can be left out, by what becomes of it, and bounds within which that is seen."""
CLAIM = "SameHistorySameState"
"""What one might think, and is not so; its trace shows why."""
LONG = Bounds(changes=8, fetches=4, restarts=2)
NUMBER, STEPS = 40, 30
"""Random traces, and their steps: with more than checked histories have of all"""


class Trace(msgspec.Struct):
    """One history of the model."""

    why: str
    steps: list[Step]


class Traces(msgspec.Struct):
    """Histories of the model to be run against the real code."""

    model: str
    """SHA-256 of the model that made them."""
    sites: int
    traces: list[Trace]


class Found(NamedTuple):
    """What the checker says of a model without one of its rules."""

    wrong: str
    verdict: Verdict


def fingerprint() -> str:
    """SHA-256 of the model."""
    return hashlib.sha256(MODEL.read_bytes()).hexdigest()


def without(wrong: str) -> Found:
    """Check the model without a rule."""
    return Found(wrong, check(WRONG[wrong], wrong))


def made(seed: int) -> Traces:
    """Make traces anew. Raises `CheckerError` if a rule can be left out and nothing is broken."""
    histories = wander(LONG, NUMBER, STEPS, seed)
    traces = [Trace(f"random {number}", steps_of(states)) for number, states in enumerate(histories)]
    for found in map(without, WRONG):
        if not found.verdict.broken:
            raise CheckerError(f"nothing is broken without a rule: {found.wrong}")
        traces.append(Trace(found.wrong, right_steps(found.verdict.states)))
    claim = check(Bounds(changes=2, fetches=2, restarts=1, edges=False), promises=(CLAIM,))
    traces.append(Trace(CLAIM, steps_of(claim.states)))
    return Traces(fingerprint(), LONG.sites, traces)


def right_steps(states: list[dict[str, Any]]) -> list[Step]:
    """The actions of a wrong model, with what the right one comes to; as many of them as are possible in it."""
    script = [[state["last"]["do"], state["last"]["site"], state["last"]["with"]] for state in states[1:]]
    while script:
        verdict = check(Bounds(changes=9, fetches=9, restarts=9), promises=("Unfinished",), script=script)
        if verdict.broken:
            return steps_of(verdict.states)
        script.pop()
    raise CheckerError("the first action is not possible")


def steps_of(states: list[dict[str, Any]]) -> list[Step]:
    """Steps from the states of the model."""
    steps = []
    for state in states[1:]:
        last = state["last"]
        steps.append((last["do"], last["site"], last["with"], holds_in_model(state["site"][last["site"] - 1])))
    return steps


def read(file: Path) -> Traces:
    """Read traces. Raises `msgspec.MsgspecError`."""
    return msgspec.json.decode(file.read_bytes(), type=Traces)


def write(file: Path, traces: Traces) -> None:
    """Write traces, one on each line."""
    head = msgspec.json.encode(Traces(traces.model, traces.sites, [])).removesuffix(b"[]}")
    lines = b",\n".join(msgspec.json.encode(trace) for trace in traces.traces)
    file.write_bytes(head + b"[\n" + lines + b"\n]}\n")
