"""Within pytest: runs chosen tests in a given order, and notes of each its outcome, its time and the functions it runs.

It is copied beside a checkout that may be of another revision, so it imports nothing of the project. The variable
`MUTANTS_ORDER` names a file with what to do, as JSON; of what happens, a line of JSON each is appended to `notes`.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import threading
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

MEMORY = 6 << 30
"""bytes that a process of the tests may have: a mutant that grows for ever fails instead of filling the machine."""


class Notes:
    """The plugin."""

    def __init__(self, order: dict[str, Any]) -> None:
        self._file = Path(order["notes"]).open("a", encoding="utf-8")  # noqa: SIM115 - until the process ends
        self._places = {test: place for place, test in enumerate(order["tests"])}
        self._limit: float | None = order["file_seconds"]
        self._root = f"{Path.cwd()}/"
        self._spent: dict[str, float] = defaultdict(float)
        self._seen: set[CodeType] = set()
        self._file_of_test = ""
        if self._limit is not None:
            threading.settrace(self._trace)
            sys.settrace(self._trace)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep what is chosen, in the order given; all, if nothing is."""
        if self._places:
            items[:] = sorted((i for i in items if i.nodeid in self._places), key=lambda i: self._places[i.nodeid])
        self._share("")

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, Any, Any]:
        """What a fixture of several tests runs belongs to them all."""
        before, self._seen = self._seen, set()
        result = yield
        if fixturedef.scope == "function":
            before |= self._seen
        else:
            self._share(self._file_of_test)
        self._seen = before
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Note a test's time and functions. Tests of a file that has had its time are skipped."""
        self._file_of_test = file = item.nodeid.partition("::")[0]
        if self._limit is not None and self._spent[file] > self._limit:
            item.add_marker(pytest.mark.skip("this file has had its time"))
        self._note(begun=item.nodeid)
        self._seen.clear()
        before = self._spent[file]
        result = yield
        seconds = round(self._spent[file] - before, 3)
        self._note(ended=item.nodeid, seconds=seconds, functions=self._functions(self._seen))
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add up its time, and note what did not pass."""
        self._spent[self._file_of_test] += report.duration
        if not report.passed:
            self._note(**{report.outcome: report.nodeid})

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note what cannot be imported."""
        if report.failed:
            self._note(failed=report.nodeid)

    def _trace(self, frame: FrameType, event: str, argument: Any) -> None:
        self._seen.add(frame.f_code)

    def _share(self, file: str) -> None:
        self._note(shared=self._functions(self._seen), file=file)
        self._seen.clear()

    def _functions(self, codes: set[CodeType]) -> list[str]:
        inside = [code for code in codes.copy() if code.co_filename.startswith(self._root)]
        names = {f"{code.co_filename.removeprefix(self._root)}:{code.co_firstlineno}" for code in inside}
        return sorted(name for name in names if not name.startswith("tests/"))

    def _note(self, **what: Any) -> None:
        self._file.write(json.dumps(what) + "\n")
        self._file.flush()


def pytest_configure(config: pytest.Config) -> None:
    """Read the order."""
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY if most == resource.RLIM_INFINITY else min(MEMORY, most), most))
    order = json.loads(Path(os.environ["MUTANTS_ORDER"]).read_text(encoding="utf-8"))
    config.pluginmanager.register(Notes(order))
