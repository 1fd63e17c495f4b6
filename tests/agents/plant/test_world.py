"""The true world: physics, rendering, and bodies by name."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.plant.bullet import Bullet
from agents.plant.renderer import Renderer, RendererName
from agents.plant.world import FLOOR_BELOW_TABLE, RATE_HZ, World, upright, yaw_of
from agents.scenario.format.scenario import ObjectSpec, TableSpec
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

MakeWorld = Callable[..., World]
MakeCube = Callable[..., ObjectSpec]


def test_objects_settle_at_their_resting_height(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 0.3, 0.0, 0.025), cube(4, 0.4, 0.1, 0.02), cube(5, 0.4, 0.1, 0.06))
    world.settle()
    assert world.pose("cube_3").t == pytest.approx((0.3, 0.0, 0.02), abs=2e-4)
    assert world.pose("cube_5").t == pytest.approx((0.4, 0.1, 0.06), abs=2e-4)
    assert all(map(world.is_still, world))


class _Heap(ctypes.Structure):
    """What `mallinfo2` of glibc tells, in bytes."""

    _fields_ = tuple((name, ctypes.c_size_t) for name in ("all", *"abc", "mapped", *"de", "used", *"fg"))


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="only glibc tells what is allocated")
def test_a_world_that_was_closed_leaves_no_memory_behind(cube: MakeCube) -> None:
    """Meshes and textures of each world were kept by the library: 0.6 MB of four cubes."""
    allocated = ctypes.CDLL(None).mallinfo2
    allocated.restype = _Heap

    def used() -> int:
        gc.collect()
        heap = allocated()
        return int(heap.used + heap.mapped)

    def live() -> None:
        bullet = Bullet()
        World(bullet, TableSpec(), [cube(number, 0.1 * number, 0.0) for number in range(3, 7)])
        bullet.close()

    live()
    before = used()
    for _ in range(10):
        live()
    assert used() - before < 1e6


def test_a_stack_stays_where_it_is(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 0.3, 0.0), cube(4, 0.303, 0.0, 0.06), cube(5, 0.302, 0.002, 0.10))
    world.settle()
    before = world.poses()
    for _ in range(10 * RATE_HZ):
        world.step()
    assert all(world.pose(name).distance(pose)[0] < 1e-4 for name, pose in before.items())


def test_a_moved_object_is_not_pulled_back(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 0.3, 0.0), cube(4, 0.3, 0.0, 0.06))
    world.settle()
    world.put("cube_4", upright((0.3005, 0.0, 0.06), 0.0))
    world.settle()
    assert world.pose("cube_4").t == pytest.approx((0.3005, 0.0, 0.06), abs=1e-4)


def test_what_never_comes_to_rest_is_named(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 0.3, 0.0), cube(4, 0.3, 0.1, 60.0))
    with pytest.raises(ConfigError, match=r"\['cube_4'\] still move after 3 s"):
        world.settle()


def test_what_stands_beside_the_table_falls_to_the_floor(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 1.2, 0.0))
    world.settle()
    assert world.pose("cube_3").t[2] == pytest.approx(0.02 - FLOOR_BELOW_TABLE, abs=1e-3)


def test_riders_are_all_above_and_inside_but_not_beside(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 0.3, 0.0), cube(4, 0.3, 0.0, 0.06), cube(5, 0.31, 0.0, 0.10), cube(6, 0.3, 0.041))
    world.settle()
    assert world.supported("cube_3") == ["cube_4", "cube_5"]
    assert world.supported("cube_4") == ["cube_5"]
    assert world.supported("cube_6") == []


def test_removed_object_is_gone_until_put_back(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 0.3, 0.0), cube(4, 0.3, 0.1))
    world.remove("cube_3")
    assert list(world) == ["cube_4"]
    with pytest.raises(ConfigError, match="no object 'cube_3' in the scene"):
        world.pose("cube_3")
    world.put("cube_3", upright((0.5, 0.0, 0.02), 0.7))
    world.settle()
    assert world.pose("cube_3").t == pytest.approx((0.5, 0.0, 0.02), abs=2e-4)
    assert yaw_of(world.pose("cube_3")) == pytest.approx(0.7, abs=1e-3)


def test_has_below_looks_down_only(make_world: MakeWorld, cube: MakeCube) -> None:
    world = make_world(cube(3, 0.3, 0.0, 0.035), cube(4, 0.3, 0.041, 0.035))
    assert world.has_below("cube_3", 0.016)
    assert not world.has_below("cube_3", 0.014)


@pytest.mark.parametrize("renderer", ["auto", "tiny"])
def test_no_file_is_left_while_an_object_that_comes_back_looks_as_before(
    cube: MakeCube, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, renderer: RendererName
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    bullet = Bullet()
    eye = Renderer(bullet, renderer)
    world = World(bullet, TableSpec(), [cube(3, 0.35, 0.0)])
    assert list(tmp_path.iterdir()) == []
    camera = Pose((0.35, 0.0, 0.4), (1.0, 0.0, 0.0, 0.0))

    def look() -> NDArray[np.uint8]:
        return eye.render(camera, Intrinsics.from_fov(64, 48, 1.0)).color

    before = look()
    assert look() is before, "nothing has moved: the picture is not made again"
    with pytest.raises(ValueError, match="read-only"):
        before[:] = 0
    world.remove("cube_3")
    assert np.any(look() != before)
    world.put("cube_3", upright((0.35, 0.0, 0.02), 0.0))
    assert np.array_equal(look(), before)
    eye.close()
    bullet.close()
