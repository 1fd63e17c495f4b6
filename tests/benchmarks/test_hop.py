"""What one change costs on its way: that each step does its work, and is counted."""

from __future__ import annotations

import pytest

from benchmarks import hop


@pytest.mark.parametrize("kind", hop.CHANGES)
def test_each_step_of_a_change_is_counted(kind: str) -> None:
    pair = hop._Pair()
    for number in range(3):
        hop.CHANGES[kind](pair.writer, number)
        pair.writer.replica.flush()
        assert not pair.watch.poll()
        pair.receive()()
        assert len(pair.watch.poll()) == 1
    costs = hop.measure(hop.CHANGES[kind], 3)
    assert list(costs) == list(hop.STEPS) and all(cost.calls > 5 and cost.time > 0 for cost in costs.values())
