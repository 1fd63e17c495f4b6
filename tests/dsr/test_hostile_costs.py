"""What a hostile peer may have others do: what a message costs is in proportion to what it brings."""

from __future__ import annotations

import random
from itertools import count
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from dsr import Pose, errors
from dsr.crdt.delta import Delta, Write
from dsr.errors import NoPathError, suggest
from dsr.frames import frame_batch, frame_chain
from dsr.frames import tree as tree_module
from dsr.frames.tree import BELIEVED, FrameTree
from tests.dsr.conftest import Net


def test_values_under_one_dot_cost_by_the_shorter_one(net: Net) -> None:
    """Else one message has all replicas spell out a long value as often as it has short ones for the same dot."""

    def spell_out(_: object) -> str:
        raise AssertionError("a long value is spelled out")

    memory = net.join("a")
    (entry,) = memory.add_node("x", "cube")._entries
    long: Any = type("tuple", (tuple,), {"__repr__": spell_out})([0.5] * 1000)
    write = Write(entry.dot, "way", 1 << 60, "liar-1", ("liar-1", 1), long)
    for value in (long, (0.25,), (1.0,)):
        memory._graph.store.join(Delta(writes=[replace(write, value=value)], context=[("liar-1", 1, 1)]))
    assert memory.node("x")["way"] == (1.0,)


def test_a_frame_that_is_nowhere_costs_no_look_at_all_frames(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else who makes many frames, and one thing without a place, holds up each agent that asks where the thing is."""
    memory = net.join("a")
    memory.add_node("world", "world")
    memory.add_node("lost", "cube")
    monkeypatch.setattr(FrameTree, "_no_path", lambda *_: pytest.fail("it is said why there is no way"))
    assert memory.get_transform("world", "lost", types=BELIEVED) is None


def test_an_error_about_very_many_names_compares_none(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"n{number}" for number in range(501)]
    monkeypatch.setattr(errors, "_wording", lambda name: "n" if name == "n7" else pytest.fail("compared"))
    assert suggest("n7", names, most=3) == "valid: n0, n1, n10 and 498 more"


@pytest.mark.parametrize("seed", range(20))
def test_what_hangs_too_deep_is_nowhere_however_it_is_asked_for(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    most, rng, tree = 5, random.Random(seed), FrameTree()
    for module in (frame_chain, frame_batch, tree_module):
        monkeypatch.setattr(module, "MOST_STEPS", most)
    parents = {f"f{number}": f"f{max(0, number - rng.choice([1, 1, 1, 2, 7]))}" for number in range(1, 30)}
    names = ["f0", *parents, "elsewhere"]
    for round in range(4):
        moved = rng.choice([*parents])
        tree.remove("RT", parents[moved], moved)
        parents[moved] = "f0" if round % 2 else f"f{max(0, int(moved[1:]) - 1)}"
        for child, parent in parents.items():
            tree.update("RT", parent, child, Pose((rng.uniform(-1.0, 1.0), 0.0, 0.0), stamp=float(round)))
        for target in ("f0", "f12", "f25"):
            sources = rng.sample(names, len(names))
            matrices = tree.transforms(target, sources)
            ways = [_steps(parents, target), *([_steps(parents, source) for source in sources])]
            for source, matrix, way in zip(sources, matrices, ways[1:], strict=True):
                meeting = next((frame for frame in way if frame in ways[0]), None)
                is_near = meeting is not None and way.index(meeting) + ways[0].index(meeting) <= most
                found = tree.find(target, source)
                assert (found is not None) == is_near == bool(np.isfinite(matrix).all()), (target, source)
                assert found is None or found.t[0] == pytest.approx(matrix[0, 3])
                if not is_near:
                    with pytest.raises(NoPathError):
                        tree.transform(target, source)


def _steps(parents: dict[str, str], frame: str) -> list[str]:
    """A frame and all above it."""
    way = [frame]
    while way[-1] in parents:
        way.append(parents[way[-1]])
    return way


def test_who_hangs_a_camera_from_thousands_of_frames_makes_no_look_long() -> None:
    """One message of 1.7 MB, and each look at 20 things that the camera sees took 2 s of each agent."""
    tree = FrameTree()
    for number in range(5000):
        tree.update("RT", f"f{number + 1}", f"f{number}", Pose((1.0, 0.0, 0.0)))
    looks = count()
    found = frame_chain.climb("f0", lambda frame: (next(looks) >= 0 and tree.link("RT", frame)) or None, ("f5000",))
    assert len(found) == next(looks) + 1 == frame_chain.MOST_STEPS + 1
    assert tree.find("f5000", "f0") is None and np.isnan(tree.transforms("f5000", ["f0", "f4990"])[0, 0, 0])
    assert tree.transforms("f5000", ["f0", "f4990"])[1, 0, 3] == 10.0
