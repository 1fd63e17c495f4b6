"""What is gone is found out where cameras should see a part of it, and what is hidden in part is still believed."""

from __future__ import annotations

import pytest

from benchmarks.absence import outcomes_of, table_of


@pytest.mark.parametrize(("seed", "thing", "share"), [(108, "ball_1", 0.42), (122, "cube_1", 0.73)])
def test_what_is_gone_behind_something_is_found_out(seed: int, thing: str, share: float) -> None:
    found = {one.thing: one for one in outcomes_of(seed)}
    gone = found.pop(thing)
    assert gone.is_gone and gone.share == pytest.approx(share, abs=0.02)
    assert gone.told_after is not None and gone.told_after < 1.0
    assert not [one for one in found.values() if not one.is_gone and one.told_after is not None]
    assert table_of([gone, *found.values()]).row_count == 4
