"""What is remembered of days past: bytes after so many days, and questions answered from summaries, against the truth.

    python -m benchmarks.days
    python -m benchmarks.days --days 1 7 30 --moves 60 --json days.json

A made-up lab (benchmarks/lab_life.py) has ten things that four hands move between six places, on working days. The
questions go through `dsr ask`: where a thing was at a time, who moved it on a day, and whether it surprised. An answer
is right, wrong, or the memory says that it does not know. Who names only some of those who moved it is partly right.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.lab_life import DAY, HOUR, START, THINGS, Lab, chosen
from dsr.narration import Moment
from dsr.narration.answer import Response
from dsr.narration.answers import answer_alone
from dsr.timeline import EVENT, SITUATION, SUMMARY

RIGHT, PARTLY, WRONG, UNKNOWN = "right", "partly", "wrong", "does not know"
AGES = (("1 to 2 days", 1, 2), ("3 to 28 days", 3, 28), ("29 to 364 days", 29, 364), ("older", 365, 10_000))
"""Ages of the days that are asked about, and days from which to which they reach."""


class AskedOfDays(NamedTuple):
    """A question and what came of it."""

    kind: str
    """`where`, `who` or `surprising`"""
    age: str
    worth: str
    question: str
    answer: str


def size_of(lab: Lab) -> dict[str, int]:
    """Bytes of summaries, and the number of summaries and of entries."""
    summaries = list(lab.memory.nodes(SUMMARY))
    return {
        "bytes": sum(len(str(node.get("content", ""))) for node in summaries), "summaries": len(summaries),
        "entries": len(lab.memory.nodes(EVENT)) + len(lab.memory.nodes(SITUATION)), "moves": len(lab.moves),
    }  # fmt: skip


def asked(lab: Lab, count: int, seed: int) -> Iterator[AskedOfDays]:
    """Ask so many questions of each kind and age."""
    rng = np.random.default_rng(seed)
    now = lab.clock.now()
    lived = int((now - START) // DAY)
    for age, youngest, oldest in AGES:
        for _ in range(count if lived >= youngest else 0):
            midnight = START + (lived - int(rng.integers(youngest, min(oldest, lived), endpoint=True))) * DAY
            day = f"on {datetime.fromtimestamp(midnight, UTC):%Y-%m-%d}"
            thing, hour = chosen(rng, THINGS), int(rng.integers(8, 20))
            yield _where(lab, age, thing, midnight + hour * HOUR, f"where was {thing} {day} at {hour}:00?")
            yield _who(lab, age, thing, midnight, f"who moved {thing} {day}?")
            yield _surprising(lab, age, thing, midnight, f"did {thing} surprise you {day}?")


def _ask(lab: Lab, question: str) -> Response:
    return answer_alone(Moment(lab.memory, lab.clock.now(), zone=UTC), question, "nobody simulates")


def _where(lab: Lab, age: str, thing: str, time: float, question: str) -> AskedOfDays:
    response, true = _ask(lab, question), lab.place(thing, time)
    worth = UNKNOWN if not response.names else RIGHT if response.names == (true,) else WRONG
    return AskedOfDays("where", age, worth, question, f"{response.text} [true: {true}]")


def _who(lab: Lab, age: str, thing: str, midnight: float, question: str) -> AskedOfDays:
    response = _ask(lab, question)
    true = {move.by for move in lab.during(midnight, midnight + DAY, thing) if not move.is_unseen}
    named = set(response.names)
    worth = RIGHT if named == true else WRONG if named - true else PARTLY if named else UNKNOWN
    return AskedOfDays("who", age, worth, question, f"{response.text} [true: {', '.join(sorted(true))}]")


def _surprising(lab: Lab, age: str, thing: str, midnight: float, question: str) -> AskedOfDays:
    response = _ask(lab, question)
    true = any(move.is_unseen for move in lab.during(midnight, midnight + DAY, thing))
    worth = RIGHT if (thing in response.names) == true else WRONG if response.names else UNKNOWN
    return AskedOfDays("surprising", age, worth, question, f"{response.text} [true: {true}]")


def main(arguments: Sequence[str] | None = None) -> int:
    """Live, measure and ask; returns 1 if an answer is wrong about where a thing was."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--days", type=int, nargs="+", default=[1, 7, 30, 365], help="after which it is measured")
    parser.add_argument("--moves", type=float, default=60.0, help="of things on a working day, on average")
    parser.add_argument("--questions", type=int, default=40, help="of each kind and age")
    parser.add_argument("--seed", type=int, default=0, help="of the life and the questions")
    parser.add_argument("--json", type=Path, help="write figures and answers to this file")
    options = parser.parse_args(arguments)
    lab, rows = Lab(options.moves, options.seed), list[dict[str, Any]]()
    heads = f"{'days':>5} {'moves':>6} {'summaries':>9} {'bytes':>8} {'entries':>7}"
    print(f"{heads}   {RIGHT} / {PARTLY} / {WRONG} / {UNKNOWN}")
    lived = 0
    for days in sorted(options.days):
        lab.live(days - lived)
        lived, size = days, size_of(lab)
        found = list(asked(lab, options.questions, options.seed))
        print(f"{days:5} {size['moves']:6} {size['summaries']:9} {size['bytes']:8} {size['entries']:7}", flush=True)
        for kind, age in dict.fromkeys((one.kind, one.age) for one in found):
            worth = Counter(one.worth for one in found if (one.kind, one.age) == (kind, age))
            counts = " / ".join(str(worth[word]) for word in (RIGHT, PARTLY, WRONG, UNKNOWN))
            print(f"{'':12}{kind:11} {age:15} {counts}")
        rows.append({"days": days, **size, "answers": [one._asdict() for one in found]})
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2), encoding="utf-8")
    where = Counter(answer["worth"] for row in rows for answer in row["answers"] if answer["kind"] == "where")
    return 1 if where[WRONG] else 0


if __name__ == "__main__":
    sys.exit(main())
