"""What all tests share: no time limit for single examples of hypothesis, a cache folder that is no user's, and that no
thread of the memory outlives its test.
"""

from __future__ import annotations

import gc
import os
import tempfile
import threading
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("dsr", deadline=None)
settings.load_profile("dsr")

gc.set_threshold(100_000, 20, 100)  # as in a sweep: looking for garbage takes time, and there is little

_CACHE = tempfile.TemporaryDirectory(prefix="dsr-test-cache-")
os.environ["XDG_CACHE_HOME"] = _CACHE.name

_PATIENCE = 5.0  # s that a thread may take to end after what it works for has closed


@pytest.fixture(autouse=True)
def no_thread_is_left() -> Iterator[None]:
    """Fail a test that leaves a thread of the memory: what the thread logs later would fail another test."""
    before = set(threading.enumerate())
    yield
    left = [one for one in threading.enumerate() if one not in before and one.name.startswith("dsr-")]
    for thread in left:
        thread.join(_PATIENCE)
    assert not [thread.name for thread in left if thread.is_alive()]
