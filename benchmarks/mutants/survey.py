"""What tests do in the unmutated checkout: whether they pass, how long they take, which functions they run."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.mutants.drawing import Mutant
from benchmarks.mutants.nearness import stages
from benchmarks.mutants.sandbox import Sandbox

FILE_SECONDS = 30.0
"""s that a test file is measured; tests that come later are left out. Most files need less than ten."""
_PATIENCE = 60.0
"""s beyond that for starting and for one slow test."""


@dataclass(frozen=True)
class Test:
    """A test that passes."""

    name: str
    seconds: float
    """With the noting of functions, which makes it slower."""


class Survey:
    """Measures test files when they are needed first. Several threads may ask."""

    def __init__(self, sandbox: Sandbox, say: Callable[[str], None]) -> None:
        self._sandbox = sandbox
        self._say = say
        self._lock = threading.Lock()
        self._tests: dict[str, list[Test]] = {}
        """By file."""
        self._users: dict[str, set[str]] = defaultdict(set)
        """Names of tests by function; and of files, for what imports and shared fixtures run."""
        self.unusable: set[str] = set()
        """Tests that do not pass unmutated: no mutant is tried with them."""

    def tests(self, mutant: Mutant, stage: int, seconds: float) -> list[Test]:
        """The tests of a stage that run the mutated function, nearest first, that take so many s together.

        Among files that are equally near, and in a file, the quickest come first. In the first stage also tests that do
        not seem to run the function, after the others: child processes are not looked into.
        """
        files = stages(self._sandbox.root, mutant.path)[stage]
        with self._lock:
            self._measure([file for file in files if file not in self._tests])
            users = self._users[f"{mutant.path}:{mutant.function}"]
            chosen: list[Test] = []
            for is_user in (True, False) if stage == 0 else (True,):
                for file in files:
                    found = [t for t in self._tests[file] if (t.name in users or file in users) == is_user]
                    for test in sorted(found, key=lambda test: test.seconds):
                        if sum(one.seconds for one in chosen) + test.seconds <= seconds:
                            chosen.append(test)
        return chosen

    def _measure(self, files: list[str]) -> None:
        if not files:
            return
        self._say(f"measuring {len(files)} test files without mutants: {files[0]} ...")
        for file in files:
            self._tests[file] = []
        limit = _PATIENCE + (FILE_SECONDS + _PATIENCE) * len(files)
        outcome = self._sandbox.pytest(files, seconds=limit, file_seconds=FILE_SECONDS)
        failed = {*outcome.failed, outcome.last_begun if outcome.code is None else ""} - {""}
        skipped = {note["skipped"] for note in outcome.notes if "skipped" in note}
        self.unusable |= failed
        for note in outcome.notes:
            for function in note.get("shared", ()):
                self._users[function].update([note["file"]] if note["file"] else files)
            if "ended" in note and note["ended"] not in failed | skipped:
                name = note["ended"]
                self._tests[name.partition("::")[0]].append(Test(name, note["seconds"]))
                for function in note["functions"]:
                    self._users[function].add(name)
