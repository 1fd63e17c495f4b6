"""Many frames at once: the same as one by one, whatever changed in between; and what a change costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from dsr.errors import TransformError
from dsr.frames.tree import FrameTree
from dsr.math3d.transforms import Pose
from tests.dsr.conftest import Net

FRAMES = tuple("abcdefgh")
TYPES = (("RT",), ("Virtual_RT", "RT"))

coordinates = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
poses = st.builds(Pose.from_rotvec, coordinates, coordinates, st.integers(0, 5).map(float))
edges = st.tuples(st.sampled_from(["RT", "Virtual_RT"]), st.sampled_from(FRAMES), st.sampled_from(FRAMES))
changes = st.tuples(edges, st.one_of(st.none(), poses))


def one_by_one(
    tree: FrameTree, target: str, sources: Sequence[str], at: float | None, types: tuple[str, ...]
) -> NDArray[np.float64]:
    def matrix(source: str) -> NDArray[np.float64]:
        try:
            return tree.transform(target, source, at, types).matrix
        except TransformError:
            return np.full((4, 4), np.nan)

    return np.array([matrix(source) for source in sources]).reshape(-1, 4, 4)


def assert_same(found: NDArray[np.float64], expected: NDArray[np.float64]) -> None:
    lost = np.isnan(expected).any(axis=(1, 2))
    assert np.isnan(found[lost, :3]).all()
    np.testing.assert_allclose(found[~lost], expected[~lost], rtol=0.0, atol=1e-9)


def change(tree: FrameTree, changes: list[Any]) -> None:
    for (type, parent, child), pose in changes:
        if pose is None:
            tree.remove(type, parent, child)
        else:
            tree.follow(type, parent, child, pose)


@given(st.lists(st.lists(changes, min_size=1, max_size=6), max_size=8), st.sampled_from(FRAMES))
def test_after_each_change_all_are_as_one_by_one_in_a_new_tree(history: list[list[Any]], target: str) -> None:
    """Cycles, several parents, edges that come and go: nothing of it makes a difference."""
    tree = FrameTree()
    for i, step in enumerate(history):
        change(tree, step)
        new = FrameTree()
        for earlier in history[: i + 1]:
            change(new, earlier)
        for sources in ((), FRAMES, FRAMES[::-2] + FRAMES):
            for types in TYPES:
                for at in (None, 2.5):
                    found = tree.transforms(target, sources, at, types)
                    assert_same(found, one_by_one(new, target, sources, at, types))


@given(st.lists(poses, min_size=1, max_size=20), st.data())
def test_a_renewed_chain_is_as_one_made_from_nothing(links: list[Pose], data: st.DataObject) -> None:
    tree = FrameTree()
    for i, pose in enumerate(links):
        tree.update("RT", f"f{i}", f"f{i + 1}", pose)
    middle = f"f{len(links) // 2}"
    tree.update("RT", middle, "side", Pose((1.0, 2.0, 3.0)))
    pairs = [("f0", f"f{len(links)}"), (f"f{len(links)}", "f0"), ("side", f"f{len(links)}"), ("side", "f0")]
    for _ in range(4):
        i = data.draw(st.integers(0, len(links) - 1))
        tree.follow("RT", f"f{i}", f"f{i + 1}", data.draw(poses))
        other = FrameTree()
        for j in range(len(links)):
            other.update("RT", f"f{j}", f"f{j + 1}", tree.transform(f"f{j}", f"f{j + 1}"))
        other.update("RT", middle, "side", Pose((1.0, 2.0, 3.0)))
        for target, source in pairs:
            found, expected = tree.transform(target, source), other.transform(target, source)
            assert max(found.distance(expected)) < 1e-9 and found.stamp == expected.stamp


def test_covariances_of_a_renewed_chain_are_those_of_the_product() -> None:
    rng = np.random.default_rng(5)
    links = [
        Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3), 1.0, np.diag(rng.random(6)) if i % 2 else None)
        for i in range(5)
    ]
    tree = FrameTree()
    for i, pose in enumerate(links):
        tree.update("RT", f"f{i}", f"f{i + 1}", pose)
    tree.transform("f0", "f5")
    links[3] = links[3].with_stamp(2.0).with_covariance(np.eye(6))
    tree.update("RT", "f3", "f4", links[3])
    product = links[0]
    for pose in links[1:]:
        product = product @ pose
    found = tree.transform("f0", "f5").covariance
    assert found is not None and product.covariance is not None
    np.testing.assert_allclose(found, product.covariance, atol=1e-9)


def test_memory_gives_matrices_in_the_order_asked_for(net: Net) -> None:
    memory = net.join("a")
    for name, type in (("world", "world"), ("table", "table"), ("cube_1", "cube"), ("cube_2", "cube")):
        memory.add_node(name, type)
    memory.add_edge("world", "table", "RT", pose=Pose((1.0, 0.0, 0.5)))
    memory.add_edge("table", "cube_1", "RT", pose=Pose((0.0, 2.0, 0.0)))
    found = memory.transforms("world", ["cube_1", "nothing", "world", "table", "cube_2", "cube_1"])
    assert found.shape == (6, 4, 4)
    np.testing.assert_array_equal(found[0], memory.transform("world", "cube_1").matrix)
    np.testing.assert_array_equal(found[5], found[0])
    np.testing.assert_array_equal(found[2], np.eye(4))
    assert np.isnan(found[[1, 4], :3]).all() and not np.isnan(found[[0, 2, 3, 5]]).any()
    with pytest.raises(TypeError, match=r"\['cube_1'\]"):
        memory.transforms("world", "cube_1")
    found[0] = 0.0  # belongs to the caller
    assert memory.transforms("world", ["cube_1"])[0, 0, 0] == 1.0


class Counted(dict[str, Any]):
    """A table of links that counts looks."""

    looks = 0

    def get(self, key: str, default: Any = None) -> Any:
        self.looks += 1
        return super().get(key, default)


def looks(frames: int, ask: Callable[[FrameTree], object]) -> int:
    """How many links are looked at when one of ten on the way changed, among `frames` others."""
    tree = FrameTree()
    table = tree._newest["RT"] = Counted()
    for i in range(10):
        tree.update("RT", f"f{i}", f"f{i + 1}", Pose((1.0, 0.0, 0.0)))
    for i in range(frames):
        tree.update("RT", f"f{i % 10}", f"other_{i}", Pose((1.0, 0.0, 0.0)))
    ask(tree)
    tree.update("RT", "f4", "f5", Pose((2.0, 0.0, 0.0)))
    table.looks = 0
    ask(tree)
    return table.looks


@pytest.mark.parametrize(
    "ask",
    [lambda tree: tree.transform("f0", "f10"), lambda tree: tree.transforms("f0", ["f10", "f7", "f3"])],
    ids=["one", "many"],
)
def test_what_a_change_costs_does_not_depend_on_the_size_of_the_graph(ask: Callable[[FrameTree], object]) -> None:
    assert looks(0, ask) == looks(5000, ask) <= 25


def test_one_changed_edge_costs_a_logarithm_of_products(monkeypatch: pytest.MonkeyPatch) -> None:
    tree = FrameTree()
    for i in range(100):
        tree.update("RT", f"f{i}", f"f{i + 1}", Pose((1.0, 0.0, 0.0)))
    tree.transform("f0", "f100")
    products = 0
    matmul = Pose.__matmul__

    def counted(a: Pose, b: Pose) -> Pose:
        nonlocal products
        products += 1
        return matmul(a, b)

    monkeypatch.setattr(Pose, "__matmul__", counted)
    for i in (0, 50, 99):
        products = 0
        tree.update("RT", f"f{i}", f"f{i + 1}", Pose((float(i), 0.0, 0.0)))
        assert tree.transform("f0", "f100").t[0] == 99.0 + i
        assert products <= 7
        tree.update("RT", f"f{i}", f"f{i + 1}", Pose((1.0, 0.0, 0.0)))
        tree.transform("f0", "f100")
