"""Which files run on the way of a write: those that write, send, merge and report it, and no others."""

from __future__ import annotations

from pathlib import Path

from benchmarks.files_on_the_way import OBSERVATION, WRITE, Trace, documented, of_a_write


def test_the_way_of_a_write_leads_through_graph_replication_and_watch() -> None:
    files = of_a_write()
    assert {"dsr/memory.py", "dsr/graph/graph.py", "dsr/replication/sync.py", "dsr/graph/watch.py"} <= set(files)
    assert not [file for file in files if file.startswith(("agents/", "dsr/cli/", "dsr/persistence/"))]


def test_nothing_is_noted_after_the_end() -> None:
    trace = Trace()
    with trace:
        pass
    of_a_write()
    assert trace.files() == []


def test_the_documented_walks_are_short_and_their_files_exist() -> None:
    root = Path(__file__).parents[2]
    write, observation = documented(WRITE), documented(OBSERVATION)
    assert 10 <= len(write) <= 15 and 40 <= len(observation) <= 60
    assert [name for name in write + observation if not (root / name).is_file()] == []
    assert set(write) <= set(of_a_write())
