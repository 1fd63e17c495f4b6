"""Zeros are given back to the kernel, and everything else stays as it was."""

from __future__ import annotations

import ctypes
import mmap
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.plant.renderer import egl_works
from agents.plant.zero_pages import zeros_given_back

pytestmark = pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="only Linux tells what is in memory")
MIB = 1 << 20
SIZE = 64 * MIB


def resident(buffer: mmap.mmap) -> int:
    """Bytes of a buffer that are in memory, by `mincore`."""
    pages = (ctypes.c_uint8 * (SIZE // mmap.PAGESIZE))()
    place = ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(buffer)))
    assert ctypes.CDLL(None).mincore(place, ctypes.c_size_t(SIZE), pages) == 0
    return sum(page & 1 for page in pages) * mmap.PAGESIZE


def buffer_of_zeros() -> mmap.mmap:
    """A buffer of `SIZE` bytes into which zeros were written, as a library may do."""
    buffer = mmap.mmap(-1, SIZE, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    buffer.write(bytes(SIZE))
    assert resident(buffer) == SIZE
    return buffer


def test_zeros_take_no_memory_any_more_and_what_is_written_stays() -> None:
    with zeros_given_back():
        buffer = buffer_of_zeros()
        buffer[0], buffer[20 * MIB + 7], buffer[SIZE - 1] = 1, 2, 3
    assert resident(buffer) <= 6 * MIB  # a block or two for each value
    expected = np.zeros(SIZE, np.uint8)
    expected[[0, 20 * MIB + 7, SIZE - 1]] = 1, 2, 3
    assert (np.frombuffer(buffer, np.uint8) == expected).all()
    buffer[40 * MIB] = 4
    assert buffer[40 * MIB] == 4


def test_what_was_there_before_is_left_alone() -> None:
    buffer = buffer_of_zeros()
    with zeros_given_back():
        pass
    assert resident(buffer) == SIZE


def test_what_was_there_before_is_left_alone_beside_what_is_new() -> None:
    """The kernel joins neighbours to one mapping."""
    buffer = buffer_of_zeros()
    with zeros_given_back():
        new = buffer_of_zeros()
    assert resident(buffer) == SIZE and resident(new) <= 2 * MIB


def test_memory_that_goes_away_while_it_is_looked_at_is_no_crash() -> None:
    """Another thread may give its memory back between the list of mappings and the look into one."""
    program = f"""
import ctypes, mmap
from agents.plant import zero_pages
with zero_pages.zeros_given_back():
    buffer = mmap.mmap(-1, {SIZE}, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    begin = ctypes.addressof(ctypes.c_char.from_buffer(buffer))
    zero_pages._large_mappings = lambda: [zero_pages._Mapping(begin, begin + {SIZE}, {SIZE})]
    assert ctypes.CDLL(None).munmap(ctypes.c_void_p(begin), ctypes.c_size_t({SIZE})) == 0
print("lives", flush=True)
import os; os._exit(0)  # Python would unmap the buffer once more
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "lives\n"), run.stderr


def test_the_renderer_keeps_no_buffer_of_zeros() -> None:
    if not egl_works():
        pytest.skip("EGL does not work here")
    counted = """
import ctypes, numpy as np
from agents.plant import zero_pages
from agents.plant.bullet import Bullet
from agents.plant.renderer import Renderer
renderer = Renderer(Bullet())
assert renderer.name == "egl"
print(sum(
    not np.frombuffer((ctypes.c_uint8 * zero_pages._BLOCK).from_address(at), np.uint64).any()
    for mapping in zero_pages._large_mappings()
    for at in range(mapping.begin, mapping.end - zero_pages._BLOCK, zero_pages._BLOCK)
))
"""
    run = subprocess.run([sys.executable, "-c", counted], capture_output=True, text=True, check=True)
    assert int(run.stdout.split()[0]) == 0
