"""The resources that the operating system gives a process."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

_FAULTS = """
import resource, sys
import numpy as np
from dsr.runtime.resources import keep_freed_memory

if sys.argv[1] == "keep":
    keep_freed_memory()

def use() -> None:
    several = [np.ones(300_000, np.float32) for _ in range(4)]

use()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(100):
    use()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="only glibc keeps freed memory when told so")
def test_freed_memory_is_used_again() -> None:
    """Without that, each use of an image's memory takes its pages anew."""
    kept, given_back = (
        int(subprocess.run([sys.executable, "-c", _FAULTS, how], capture_output=True, check=True).stdout)
        for how in ("keep", "")
    )
    assert kept < 1000 < given_back
