"""What Python costs at least: that all parts are measured, and that they do what they say. No figure is judged here."""

from __future__ import annotations

import pytest

from benchmarks import floors, workload
from benchmarks.pairs import Latencies
from benchmarks.ports import reserved_endpoint


@pytest.mark.parametrize("decoded", [False, True])
def test_messages_are_taken_from_a_ring(decoded: bool) -> None:
    with Latencies(floors.RingLink(reserved_endpoint(), 64, decoded)) as pair:
        pair.warm_up()
        assert all(0 < seconds < 10 for seconds in pair.burst(5))


def test_local_parts_are_measured_in_the_same_rounds() -> None:
    for times in (floors.updates(2), floors.inserts(2)):
        assert {len(taken) for taken in times.values()} == {2} and min(map(min, times.values())) > 0


def test_a_stamped_write_goes_beyond_the_last_one() -> None:
    program = floors._NoGraph()
    name = workload.name(0)
    program.stamped(name, order=1)
    program.stamped(name, order=2)
    first, second = program._sent
    assert first.stamp < second.stamp and (first.dot, second.dot) == (("w", 1), ("w", 2))
    assert program._elements[name].registers["order"].value == 2


def test_the_steps_of_a_late_join_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(floors, "_NODES", 50)
    times = floors.late_join(1)
    assert "the newcomer: pieces joined into a graph" in times and {len(taken) for taken in times.values()} == {1}
