"""A security folder with two agents that may write different things, and a member that only reads."""

from __future__ import annotations

from pathlib import Path

import pytest

from dsr.clock import WALL_CLOCK
from dsr.security.authority import SecurityFolder
from dsr.security.policy import AccessPolicy, Grant, checked, standard_grants, write_policy

GRANTS = {
    "arm": Grant(("arm", "world"), ("RT",), ("status",), ("device/arm/command", "blob/*")),
    "scene": Grant(("cube", "table", "world"), ("on",), ("size", "mass", "target_joints")),
    "hub": Grant(relay=True),
    **standard_grants(),
}
DAY = 86400.0


def make_folder(path: Path) -> SecurityFolder:
    """A new authority with certificates for `GRANTS`."""
    folder = SecurityFolder(path)
    folder.create(WALL_CLOCK.now())
    for name in GRANTS:
        folder.issue(name, WALL_CLOCK.now())
    write_policy(folder.policy, checked(GRANTS))
    return folder


@pytest.fixture(scope="session")
def keys(tmp_path_factory: pytest.TempPathFactory) -> SecurityFolder:
    """Shared by all tests: do not change it."""
    return make_folder(tmp_path_factory.mktemp("security") / "keys")


@pytest.fixture
def own_keys(tmp_path: Path) -> SecurityFolder:
    """For a test that changes it."""
    return make_folder(tmp_path / "own_keys")


@pytest.fixture
def policy() -> AccessPolicy:
    return checked(GRANTS)
