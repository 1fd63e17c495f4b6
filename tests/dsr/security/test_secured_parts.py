"""Parts of a secured graph: who may write into one is granted by its name, and others drop what is not."""

from __future__ import annotations

from pathlib import Path

import pytest

import dsr
from dsr import AgentError, Memory
from dsr.clock import WALL_CLOCK
from dsr.security.authority import SecurityFolder
from dsr.security.policy import Grant, checked, standard_grants, write_policy
from tests.dsr.security.test_secured_network import PATIENCE, eventually, wait

GRANTS = {
    "cook": Grant(("part_record", "world", "cube"), ("on",), ("mass",), trusted=True),
    "guest": Grant(("cube",), ("on",), ("mass",), parts=("hall",)),
    **standard_grants(),
}


@pytest.fixture
def folder(tmp_path: Path) -> SecurityFolder:
    keys = SecurityFolder(tmp_path / "keys")
    keys.create(WALL_CLOCK.now())
    for name in GRANTS:
        keys.issue(name, WALL_CLOCK.now())
    write_policy(keys.policy, checked(GRANTS))
    return keys


def joined(agent: str, folder: SecurityFolder, *parts: str) -> Memory:
    return dsr.connect(
        "parts", agent=agent, security=folder.path, timeout=PATIENCE, must_exist=False, interest=parts
    )


def test_a_part_is_written_by_who_is_granted_it_and_read_by_all(folder: SecurityFolder) -> None:
    with joined("cook", folder) as cook:
        for part in ("kitchen", "hall"):
            cook.create_part(part)
            cook.add_node(f"{part}_cup", "cube", part, mass=1.0)
        with joined("guest", folder, "kitchen", "hall") as guest, joined("dsr", folder, "kitchen") as reader:
            assert "kitchen_cup" in guest and "hall_cup" in guest
            assert "kitchen_cup" in reader and "hall_cup" not in reader
            guest.update_node("hall_cup", mass=2.0)
            assert eventually(lambda: cook.node("hall_cup")["mass"] == 2.0)
            with pytest.raises(AgentError, match="may not write into part 'kitchen'"):
                guest.update_node("kitchen_cup", mass=2.0)
            guest._held.graph.check_part = None  # type: ignore[union-attr]
            guest.update_node("kitchen_cup", mass=3.0)
            wait()
            assert cook.node("kitchen_cup")["mass"] == reader.node("kitchen_cup")["mass"] == 1.0
            cook.update_node("kitchen_cup", mass=4.0)
            assert eventually(lambda: reader.node("kitchen_cup")["mass"] == 4.0)
