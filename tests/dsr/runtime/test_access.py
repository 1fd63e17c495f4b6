"""Declarations for some worlds only, and who may write beside whom."""

from __future__ import annotations

import pytest

from dsr.errors import AgentError, ConfigError
from dsr.graph.access import Access, WriteGuard, check_writers
from dsr.network.keys import BASE


@pytest.mark.parametrize(
    ("worlds", "other", "meet"),
    [
        (None, None, True),
        (None, (BASE,), True),
        (None, ("stable",), False),
        (("view_of_*",), None, False),
        (("view_of_*",), ("view_of_anne",), True),
        (("view_of_*",), ("view_*",), True),
        (("view_of_*",), ("idea_*",), False),
        (("view_of_*",), ("view_of",), False),
        ((), None, False),
    ],
)
def test_writers_exclude_each_other_where_their_worlds_meet(
    worlds: tuple[str, ...] | None, other: tuple[str, ...] | None, meet: bool
) -> None:
    writes = {
        "one": Access(edges=("on",), exclusive=("on",), worlds=worlds),
        "two": Access(edges=("on",), worlds=other),
    }
    assert writes["one"].meets(writes["two"]) is writes["two"].meets(writes["one"]) is meet
    if meet:
        with pytest.raises(ConfigError, match="cannot run together"):
            check_writers(writes)
    else:
        check_writers(writes)


def test_a_guard_lets_pass_what_is_declared_for_a_world() -> None:
    guard = WriteGuard("viewer", Access(edges=("on",), worlds=("view_of_*",)))
    guard.in_world("view_of_anne")("edge", "on", ())
    for world in (BASE, "view", "stable"):
        with pytest.raises(AgentError, match="does not declare"):
            guard.in_world(world)("edge", "on", ())
