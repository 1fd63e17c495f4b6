"""Shows by mutation what the tests catch.

    python -m benchmarks.mutants --seed 0 --count 100
    python -m benchmarks.mutants --packages surprise --count 20 --jobs 2 --json mutants.json
    python -m benchmarks.mutants --only planner/pddl.py:30:17:delete --tests-from HEAD~3

Each mutant is a small change at a random place: a comparison flipped, a statement deleted, arguments swapped, and so
on. It is written into a copy of the checkout, and tests run there until one fails: first those that are named after
the module or import it, then others of its package, then those that play scenarios. Of the later two, only tests that
run the changed function count. A mutant that survives is a hole in the tests, or changes nothing that matters.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections import Counter
from pathlib import Path

import msgspec

from benchmarks.mutants.drawing import Mutant, draw, every
from benchmarks.mutants.sandbox import MutationError
from benchmarks.mutants.trial import Trials, Verdict

PACKAGES = ("dsr/crdt", "dsr/replication", "simulation_handler", "planner", "surprise")
_ROOT = Path(__file__).parents[2]


class Report(msgspec.Struct, frozen=True):
    """What `--json` writes."""

    seed: int
    packages: tuple[str, ...]
    tests_from: str | None
    mutants: list[Verdict]
    unusable: list[str]
    """Tests that do not pass without a mutant, and did not count."""


def main(arguments: list[str] | None = None) -> int:
    """Draw, try, print. Returns the exit code: 0 whatever survives, 130 after Ctrl-C."""
    parser = _parser()
    options = parser.parse_args(arguments)
    packages = tuple(package.rstrip("/") for package in options.packages)
    try:
        mutants = _chosen(options.root, packages, options.seed, options.count, options.only)
    except (FileNotFoundError, KeyError) as error:
        parser.error(str(error.args[0]))
    verdicts: list[Verdict] = []
    unusable: list[str] = []
    is_interrupted = False
    before = signal.signal(signal.SIGINT, _interrupt)
    try:
        with Trials(
            options.root,
            packages,
            jobs=options.jobs,
            seconds=options.seconds,
            tests_from=options.tests_from,
            survey=options.survey,
            say=_progress,
        ) as trials:
            for verdict in trials.run(mutants):
                verdicts.append(verdict)
                unusable = sorted(trials.unusable)
                _tell(verdict, len(verdicts), len(mutants))
    except MutationError as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        is_interrupted = True
    finally:
        signal.signal(signal.SIGINT, before)
    for test in unusable:
        print(f"did not count, it does not pass without a mutant: {test}")
    _summarise(verdicts, packages)
    if options.json:
        report = Report(options.seed, packages, options.tests_from, verdicts, unusable)
        options.json.write_bytes(msgspec.json.format(msgspec.json.encode(report)))
    return 130 if is_interrupted else 0


def _chosen(root: Path, packages: tuple[str, ...], seed: int, count: int, only: list[str]) -> list[Mutant]:
    """Raises `KeyError` for a mutant that there is not, `FileNotFoundError` for such a package."""
    if not only:
        return draw(root, packages, seed, count)
    known = every(root, packages)
    for name in only:
        if name not in known:
            raise KeyError(f"{name}: no such mutant in {' '.join(packages)}")
    return [known[name] for name in only]


def _interrupt(*_: object) -> None:
    """Ends the command at the first Ctrl-C. Further ones do not disturb the removal of the copies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


def _tell(verdict: Verdict, number: int, count: int) -> None:
    by = f"by {verdict.test} ({verdict.stage})" if verdict.test else f"{verdict.tests} tests"
    print(f"{number}/{count} {verdict.verdict}: {verdict.mutant}  {by}, {verdict.seconds:.1f} s")
    print(f"    {verdict.diff}", flush=True)


def _progress(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _summarise(verdicts: list[Verdict], packages: tuple[str, ...]) -> None:
    for package in packages:
        kinds = Counter(one.verdict for one in verdicts if one.mutant.startswith(f"{package}/"))
        print(f"{package}: {_counts(kinds)}")
    print(f"all: {_counts(Counter(one.verdict for one in verdicts))}")
    untried = [one.mutant for one in verdicts if one.tests == 0]
    if untried:
        print(f"no test runs these: {' '.join(untried)}")


def _counts(kinds: Counter[str]) -> str:
    caught, timed_out = kinds["caught"] + kinds["timed out"], kinds["timed out"]
    return f"{caught} of {kinds.total()} caught ({timed_out} of these timed out), {kinds['survived']} survived"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.mutants",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=0, help="of the draw (default: %(default)s)")
    parser.add_argument("--count", type=_positive, default=100, help="mutants to draw (default: %(default)s)")
    parser.add_argument(
        "--packages", nargs="+", default=PACKAGES, metavar="FOLDER", help=f"default: {' '.join(PACKAGES)}"
    )
    parser.add_argument("--jobs", type=_positive, default=1, help="mutants at a time (default: %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything into this file, too")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="ID", help="try these (path:line:column:kind), draw none"
    )
    parser.add_argument("--tests-from", metavar="REVISION", help="take tests/ and benchmarks/ from there")
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="tests of a stage for a mutant take so long (default: %(default)s)"
    )
    parser.add_argument(
        "--survey", type=Path, metavar="FILE", help="keep there what tests do without mutants: the next run is quicker"
    )
    parser.add_argument("--root", type=Path, default=_ROOT, help="the checkout (default: this one)")
    return parser


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("at least 1")
    return number


if __name__ == "__main__":
    sys.exit(main())
