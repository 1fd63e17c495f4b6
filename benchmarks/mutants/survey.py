"""What tests do in the unmutated checkout: whether they pass, how long they take, which functions they run."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from benchmarks.mutants.drawing import Mutant
from benchmarks.mutants.nearness import stages
from benchmarks.mutants.sandbox import Sandbox

FILE_SECONDS = 120.0
"""s that a test file is measured; tests that come later are left out. Most files need less than 20."""
_PATIENCE = 60.0
"""s beyond that for starting and for one slow test."""


class Test(msgspec.Struct, frozen=True):
    """A test that passes."""

    name: str
    seconds: float
    """With the noting of functions, which makes it slower."""


class Measured(msgspec.Struct):
    """A test file."""

    digest: str
    """Of its content."""
    tests: list[Test] = []
    unusable: list[str] = []
    """Tests that do not pass."""
    users: dict[str, list[str]] = {}
    """Names of tests by function, as path:line; the file's own name for what imports and shared fixtures run."""


class Kept(msgspec.Struct):
    """What a file keeps for other runs."""

    sources: str
    """A digest of what is tested: with other sources, all is measured anew."""
    files: dict[str, Measured] = {}


class Survey:
    """Measures test files when they are needed first. Several threads may ask.

    Args:
        sandbox: unmutated, and used by nobody else.
        packages: that are tested.
        file: where measurements are kept for other runs, if anywhere. Test files that changed are measured again.
        say: is told what is measured.
    """

    def __init__(
        self, sandbox: Sandbox, packages: Iterable[str], file: Path | None, say: Callable[[str], None]
    ) -> None:
        self._sandbox = sandbox
        self._file = file
        self._say = say
        self._lock = threading.Lock()
        tops = sorted({package.partition("/")[0] for package in packages})
        self._kept = Kept(_digest(path for top in tops for path in sorted((sandbox.root / top).rglob("*.py"))))
        if file is not None and file.exists():
            kept = msgspec.json.decode(file.read_bytes(), type=Kept)
            if kept.sources == self._kept.sources:
                self._kept = kept

    @property
    def unusable(self) -> set[str]:
        """Tests that do not pass unmutated: no mutant is tried with them."""
        return {name for measured in self._kept.files.values() for name in measured.unusable}

    def tests(self, mutant: Mutant, stage: int, seconds: float) -> list[Test]:
        """The tests of a stage that run the mutated function, nearest first, that take so many s together.

        Those that run the function come first; in a file, the quickest. In the first stage there are also tests that do
        not seem to run the function, and in the second if none of the package does: what runs in child processes is not
        seen.
        """
        near, package, _ = found = stages(self._sandbox.root, mutant.path)
        files = found[stage]
        function = f"{mutant.path}:{mutant.function}"
        chosen: list[Test] = []
        with self._lock:
            self._measure(files)
            known = self._kept.files
            is_open = stage == 0 or (stage == 1 and all(function not in known[file].users for file in near + package))
            for is_user in (True, False) if is_open else (True,):
                for file in files:
                    users = known[file].users.get(function, [])
                    tests = [test for test in known[file].tests if (test.name in users or file in users) == is_user]
                    for test in sorted(tests, key=lambda test: test.seconds):
                        if sum(one.seconds for one in chosen) + test.seconds <= seconds:
                            chosen.append(test)
        return chosen

    def _measure(self, files: list[str]) -> None:
        """Measure those that are not known as they are now."""
        digests = {file: _digest([self._sandbox.root / file]) for file in files}
        known = self._kept.files
        files = [file for file in files if file not in known or known[file].digest != digests[file]]
        if not files:
            return
        self._say(f"measuring {len(files)} test files without mutants: {files[0]} ...")
        limit = _PATIENCE + (FILE_SECONDS + _PATIENCE) * len(files)
        outcome = self._sandbox.pytest(files, seconds=limit, file_seconds=FILE_SECONDS)
        known.update((file, Measured(digests[file])) for file in files)
        failed = {*outcome.failed, outcome.last_begun if outcome.code is None else ""} - {""}
        skipped = {note["skipped"] for note in outcome.notes if "skipped" in note}
        for name in sorted(name for name in failed if _file(name) in known):
            known[_file(name)].unusable.append(name)
        for note in outcome.notes:
            for function in note.get("shared", ()):
                for file in [note["file"]] if note["file"] else files:
                    known[file].users.setdefault(function, []).append(file)
            if "ended" in note and note["ended"] not in failed | skipped:
                name = note["ended"]
                known[_file(name)].tests.append(Test(name, note["seconds"]))
                for function in note["functions"]:
                    known[_file(name)].users.setdefault(function, []).append(name)
        if self._file is not None:
            self._file.write_bytes(msgspec.json.encode(self._kept))


def _file(test: str) -> str:
    return test.partition("::")[0]


def _digest(files: Iterable[Path]) -> str:
    """Of the content of files."""
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()
