"""What native libraries print."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import ctypes
from dsr.runtime.native_output import silenced
libc = ctypes.CDLL(None)
libc.puts(b"before")
with silenced():
    libc.puts(b"inside")
libc.puts(b"after")
"""


def test_only_what_is_printed_inside_disappears_even_if_it_is_buffered() -> None:
    result = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["before", "after"]
