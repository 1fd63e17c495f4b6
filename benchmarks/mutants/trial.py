"""Tries mutants: each is written into a copy of the checkout, and the tests that concern it run there."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from pathlib import Path

import msgspec

from benchmarks.mutants.drawing import Mutant
from benchmarks.mutants.nearness import STAGES
from benchmarks.mutants.sandbox import Outcome, Sandbox
from benchmarks.mutants.survey import Survey, Test
from benchmarks.timing import monotonic

_SLOWER = 4.0
"""Times as long as without the mutant, after which a run counts as endless: the machine may be busy meanwhile."""
_BEYOND = 30.0
"""s beyond that, for what the first test does for all."""


class Verdict(msgspec.Struct, frozen=True):
    """What became of a mutant."""

    mutant: str
    """Its path:line:column:kind."""
    diff: str
    verdict: str
    """"caught", "timed out" (caught, too) or "survived"."""
    stage: str
    """In which it was caught, or the last that had tests."""
    test: str
    """That caught it or, of a time-out, that ran then; "" if it survived."""
    tests: int
    """How many were chosen, over all stages that ran."""
    seconds: float
    """That its tests took, without what was measured before."""


class Trials:
    """Copies of the checkout for some jobs. A context manager: leaving it ends everything and leaves nothing behind.

    Raises `MutationError` if there is no revision `tests_from`.
    """

    def __init__(
        self,
        checkout: Path,
        packages: tuple[str, ...],
        *,
        jobs: int,
        seconds: float,
        tests_from: str | None,
        survey: Path | None,
        say: Callable[[str], None],
    ) -> None:
        self._stack = ExitStack()
        self._seconds = seconds
        self._free: queue.Queue[Sandbox] = queue.Queue()
        with ExitStack() as made:
            pristine, *copies = [made.enter_context(Sandbox(checkout, tests_from)) for _ in range(jobs + 1)]
            self._stack = made.pop_all()
        for sandbox in copies:
            self._free.put(sandbox)
        self._survey = Survey(pristine, packages, survey, say)
        self._jobs = jobs

    def __enter__(self) -> Trials:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def unusable(self) -> set[str]:
        """Tests that do not pass without a mutant."""
        return self._survey.unusable

    def run(self, mutants: list[Mutant]) -> Iterator[Verdict]:
        """Verdicts as they become known."""
        with ThreadPoolExecutor(self._jobs) as pool:
            pending = [pool.submit(self._try, mutant) for mutant in mutants]
            try:
                for done in as_completed(pending):
                    yield done.result()
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                if not all(future.done() for future in pending):
                    self._stack.close()  # ends what runs

    def _try(self, mutant: Mutant) -> Verdict:
        sandbox = self._free.get()
        file = sandbox.root / mutant.path
        source = file.read_bytes()
        file.write_bytes(mutant.applied(source))
        try:
            return self._judge(mutant, sandbox)
        finally:
            if file.exists():
                file.write_bytes(source)
            self._free.put(sandbox)

    def _judge(self, mutant: Mutant, sandbox: Sandbox) -> Verdict:
        last, test, verdict, count, seconds = "", "", "survived", 0, 0.0
        for number, stage in enumerate(STAGES):
            chosen = self._survey.tests(mutant, number, self._seconds)
            if chosen:
                last, count, begin = stage, count + len(chosen), monotonic()
                verdict, test = _verdict(self._run(sandbox, chosen))
                seconds += monotonic() - begin
            if verdict != "survived":
                break
        return Verdict(mutant.name, mutant.diff, verdict, last, test, count, round(seconds, 1))

    @staticmethod
    def _run(sandbox: Sandbox, chosen: list[Test]) -> Outcome:
        files = dict.fromkeys(test.name.partition("::")[0] for test in chosen)
        seconds = _BEYOND + _SLOWER * sum(test.seconds for test in chosen)
        return sandbox.pytest(files, [test.name for test in chosen], seconds=seconds)


def _verdict(outcome: Outcome) -> tuple[str, str]:
    """What a run says, and by which test."""
    if outcome.code is None:
        return "timed out", outcome.last_begun
    if outcome.code == 0:
        return "survived", ""
    return "caught", outcome.failed[0] if outcome.failed else outcome.last_begun
