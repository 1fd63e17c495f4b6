"""What all tests share: no time limit for single examples of hypothesis, and a cache folder that is no user's."""

from __future__ import annotations

import gc
import os
import tempfile

from hypothesis import settings

settings.register_profile("dsr", deadline=None)
settings.load_profile("dsr")

gc.set_threshold(100_000, 20, 100)  # as in a sweep: looking for garbage takes time, and there is little

_CACHE = tempfile.TemporaryDirectory(prefix="dsr-test-cache-")
os.environ["XDG_CACHE_HOME"] = _CACHE.name
