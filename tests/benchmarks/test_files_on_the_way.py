"""Which files run on the way of a write: those that write, send, merge and report it, and no others."""

from __future__ import annotations

from benchmarks.files_on_the_way import Trace, of_a_write


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
