"""Chains of frames: what they are made of, at which time, and when they are computed anew."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import reduce
from itertools import count

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.errors import CycleError, ExtrapolationError, NoPathError
from dsr.frames.pose_history import PoseHistory
from dsr.frames.tree import FrameTree
from dsr.math3d.transforms import Pose, interpolate

BELIEF_FIRST = ("Virtual_RT", "RT")

rotvecs = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
poses = st.builds(Pose.from_rotvec, rotvecs, rotvecs, st.floats(1.0, 9.0))


def shift(x: float, stamp: float = 0.0) -> Pose:
    return Pose((x, 0.0, 0.0), stamp=stamp)


def chain(*edge_poses: Pose) -> FrameTree:
    """f0 -> f1 -> f2 ..."""
    tree = FrameTree()
    for i, pose in enumerate(edge_poses):
        tree.update("RT", f"f{i}", f"f{i + 1}", pose)
    return tree


def assert_close(a: Pose, b: Pose) -> None:
    assert max(a.distance(b)) < 1e-9


@pytest.fixture
def tabletop() -> FrameTree:
    """Two cameras at 1 m and 2 m on x; each sees the cube, the overhead one last."""
    tree = FrameTree()
    tree.update("RT", "world", "camera_overhead", shift(1.0))
    tree.update("RT", "world", "camera_wrist", shift(2.0))
    tree.update("RT", "camera_overhead", "cube_3", shift(0.1, stamp=5.0))
    tree.update("RT", "camera_wrist", "cube_3", shift(0.2, stamp=4.0))
    return tree


class TestChains:
    @given(st.lists(poses, min_size=1, max_size=8))
    def test_a_chain_is_the_product_of_its_edges(self, edges: list[Pose]) -> None:
        tree = chain(*edges)
        top_from_bottom = tree.transform("f0", f"f{len(edges)}")
        assert_close(top_from_bottom, reduce(Pose.__matmul__, edges))
        assert top_from_bottom.stamp == min(edge.stamp for edge in edges)
        assert_close(tree.transform(f"f{len(edges)}", "f0"), top_from_bottom.inverse())

    @given(poses, poses, poses)
    def test_siblings_meet_at_their_first_common_frame(self, mount: Pose, left: Pose, right: Pose) -> None:
        tree = FrameTree()
        tree.update("RT", "world", "camera", mount)
        tree.update("RT", "camera", "cube_1", left)
        tree.update("RT", "camera", "cube_2", right)
        assert_close(tree.transform("cube_1", "cube_2"), left.inverse() @ right)

    def test_a_frame_in_itself_is_the_identity(self, tabletop: FrameTree) -> None:
        assert tabletop.transform("cube_3", "cube_3") == Pose.identity()
        assert tabletop.transform("cube_3", "cube_3", at=7.0) == Pose(stamp=7.0)

    def test_static_edges_do_not_date_the_result(self) -> None:
        assert chain(shift(1.0), shift(1.0, stamp=8.0), shift(1.0, stamp=6.0)).transform("f0", "f3").stamp == 6.0
        assert chain(shift(1.0), shift(1.0)).transform("f0", "f2").stamp == 0.0

    def test_covariance_is_that_of_the_product(self) -> None:
        edges = [
            Pose.from_rotvec((1.0, i, 0.5), (0.1 * i, 0.2, 0.3), covariance=c)
            for i, c in enumerate([None, 0.01 * np.eye(6), None, 0.02 * np.eye(6)])
        ]
        covariance = chain(*edges).transform("f0", "f4").covariance
        np.testing.assert_allclose(covariance, reduce(Pose.__matmul__, edges).covariance, atol=1e-12)


class TestChoiceOfEdge:
    def test_the_parent_with_the_newest_sample_is_taken(self, tabletop: FrameTree) -> None:
        assert tabletop.transform("world", "cube_3").t[0] == pytest.approx(1.1)
        tabletop.update("RT", "camera_wrist", "cube_3", shift(0.3, stamp=6.0))
        assert tabletop.transform("world", "cube_3").t[0] == pytest.approx(2.3)

    def test_when_the_newest_parent_goes_the_other_one_is_taken(self, tabletop: FrameTree) -> None:
        tabletop.transform("world", "cube_3")
        tabletop.remove("RT", "camera_overhead", "cube_3")
        assert tabletop.transform("world", "cube_3").t[0] == pytest.approx(2.2)

    def test_parents_with_one_and_the_same_pose_are_told_apart(self, tabletop: FrameTree) -> None:
        seen = shift(0.1, stamp=6.0)
        for camera in ("camera_wrist", "camera_overhead"):
            tabletop.update("RT", camera, "cube_3", seen)
        assert tabletop.transform("world", "cube_3").t[0] == pytest.approx(1.1)
        tabletop.remove("RT", "camera_overhead", "cube_3")
        assert tabletop.transform("world", "cube_3").t[0] == pytest.approx(2.1)

    def test_a_parent_known_at_that_time_is_taken(self, tabletop: FrameTree) -> None:
        tabletop.update("RT", "camera_overhead", "cube_3", shift(0.1, stamp=5.1))
        tabletop.update("RT", "camera_wrist", "cube_3", shift(0.2, stamp=4.1))
        assert tabletop.transform("world", "cube_3", at=5.05).t[0] == pytest.approx(1.1)
        assert tabletop.transform("world", "cube_3", at=4.05).t[0] == pytest.approx(2.2)

    def test_ties_between_parents_do_not_depend_on_their_order(self) -> None:
        trees = FrameTree(), FrameTree()
        for tree, parents in zip(trees, ("ab", "ba"), strict=True):
            for parent in parents:
                tree.update("RT", parent, "cube", shift(1.0, stamp=5.0))
        for tree in trees:
            assert tree.transform("a", "cube") == shift(1.0, stamp=5.0)
            with pytest.raises(NoPathError):
                tree.transform("b", "cube")

    def test_belief_first_falls_back_on_perception_frame_by_frame(self, tabletop: FrameTree) -> None:
        tabletop.update("RT", "cube_3", "tag", shift(0.01))
        assert tabletop.transform("world", "tag", types=BELIEF_FIRST).t[0] == pytest.approx(1.11)
        tabletop.update("Virtual_RT", "world", "cube_3", shift(7.0, stamp=3.0))
        assert tabletop.transform("world", "tag", types=BELIEF_FIRST).t[0] == pytest.approx(7.01)
        assert tabletop.transform("camera_wrist", "tag", types=BELIEF_FIRST).t[0] == pytest.approx(5.01)
        assert tabletop.transform("world", "tag").t[0] == pytest.approx(1.11)
        tabletop.remove("Virtual_RT", "world", "cube_3")
        assert tabletop.transform("world", "tag", types=BELIEF_FIRST).t[0] == pytest.approx(1.11)

    def test_belief_first_also_in_the_past(self, tabletop: FrameTree) -> None:
        tabletop.update("Virtual_RT", "world", "cube_3", shift(7.0, stamp=5.0))
        tabletop.update("Virtual_RT", "world", "cube_3", shift(8.0, stamp=6.0))
        assert tabletop.transform("world", "cube_3", 5.5, BELIEF_FIRST).t[0] == pytest.approx(7.5)


class TestCache:
    """An unchanged result is the same object; a changed edge renews the results that go through it."""

    def test_unchanged_is_not_computed_again(self, tabletop: FrameTree) -> None:
        for types in (("RT",), BELIEF_FIRST):
            first = tabletop.transform("world", "cube_3", types=types)
            assert tabletop.transform("world", "cube_3", types=types) is first

    def test_each_edge_of_the_chain_renews_it(self) -> None:
        tree = chain(*[shift(1.0, stamp=1.0)] * 4)
        for i in range(4):
            before = tree.transform("f0", "f4")
            tree.update("RT", f"f{i}", f"f{i + 1}", shift(2.0, stamp=2.0))
            after = tree.transform("f0", "f4")
            assert after.t[0] == before.t[0] + 1.0
            assert tree.transform("f0", "f4") is after

    def test_edges_elsewhere_do_not(self, tabletop: FrameTree) -> None:
        tabletop.update("RT", "camera_overhead", "cube_4", shift(0.5, stamp=5.0))
        kept = [
            (target, source, tabletop.transform(target, source))
            for target, source in [("world", "cube_3"), ("cube_4", "cube_3"), ("camera_overhead", "cube_3")]
        ]
        tabletop.update("RT", "world", "table", shift(1.0))  # another branch
        tabletop.update("RT", "cube_3", "tag", shift(1.0))  # below
        tabletop.update("RT", "map", "world", shift(1.0))  # above
        tabletop.update("Virtual_RT", "world", "cube_3", shift(9.0))  # of a type not asked for
        tabletop.update("RT", "camera_wrist", "cube_3", shift(0.2, stamp=4.5))  # not the newest parent
        tabletop.update("RT", "camera_overhead", "cube_3", shift(0.2, stamp=4.9))  # a late sample
        tabletop.remove("RT", "camera_wrist", "cube_3")
        for target, source, pose in kept:
            assert tabletop.transform(target, source) is pose

    def test_only_what_lies_between_counts(self, tabletop: FrameTree) -> None:
        tabletop.update("RT", "camera_overhead", "cube_4", shift(0.5, stamp=5.0))
        between = tabletop.transform("cube_4", "cube_3")
        from_world = tabletop.transform("world", "cube_3")
        tabletop.update("RT", "world", "camera_overhead", shift(3.0))
        assert tabletop.transform("cube_4", "cube_3") is between
        assert tabletop.transform("world", "cube_3") is not from_world

    def test_writing_the_same_value_again_renews_nothing(self, tabletop: FrameTree) -> None:
        before = tabletop.transform("world", "cube_3")
        tabletop.update("RT", "world", "camera_overhead", shift(1.0))
        tabletop.update("RT", "camera_overhead", "cube_3", shift(0.1, stamp=5.0))
        assert tabletop.transform("world", "cube_3") is before

    def test_more_pairs_than_are_kept(self) -> None:
        tree = FrameTree()
        for i in range(5000):
            tree.update("RT", "world", f"cube_{i}", shift(float(i)))
        for _ in range(2):
            assert all(tree.transform("world", f"cube_{i}").t[0] == i for i in range(5000))


class TestTime:
    @given(poses, poses, poses, st.floats(0.0, 1.0))
    def test_each_edge_is_interpolated(self, a: Pose, b: Pose, mount: Pose, s: float) -> None:
        a, b, at = a.with_stamp(10.0), b.with_stamp(11.0), 10.0 + s
        tree = chain(mount.with_stamp(0.0), a)
        tree.update("RT", "f1", "f2", b)
        found = tree.transform("f0", "f2", at=at)
        assert_close(found, mount @ interpolate(a, b, at))
        assert found.stamp == at

    def test_between_many_samples_the_neighbours_count(self) -> None:
        tree = FrameTree()
        for i in range(100):
            tree.update("RT", "world", "cube", shift(float(i * i), stamp=1.0 + 0.01 * i))
        assert tree.transform("world", "cube", at=1.0 + 0.01 * 50.5).t[0] == pytest.approx((50**2 + 51**2) / 2)

    def test_one_sample_or_a_static_one_holds_at_all_times(self) -> None:
        tree = chain(shift(1.0), shift(2.0, stamp=100.0))
        for at in (-5.0, 3.0, 1e6):
            assert tree.transform("f0", "f2", at=at) == shift(3.0, stamp=at)

    def test_the_newest_is_held_for_a_moment_and_then_refused(self) -> None:
        tree = FrameTree(extrapolation=0.1)
        tree.update("RT", "camera", "cube_3", shift(1.0, stamp=10.0))
        tree.update("RT", "camera", "cube_3", shift(2.0, stamp=12.0))
        assert tree.transform("camera", "cube_3", at=12.09).t[0] == 2.0
        with pytest.raises(ExtrapolationError) as error:
            tree.transform("camera", "cube_3", at=12.2)
        for part in ("RT", "'camera' -> 'cube_3'", "12.200 s", "10.000 s", "12.000 s"):
            assert part in str(error.value)

    @pytest.mark.parametrize("at", [9.99, math.nan])
    def test_before_the_oldest_is_refused(self, at: float) -> None:
        tree = chain(shift(1.0, stamp=10.0))
        tree.update("RT", "f0", "f1", shift(2.0, stamp=12.0))
        with pytest.raises(ExtrapolationError, match=r"10\.000 s to 12\.000 s"):
            tree.transform("f0", "f1", at=at)

    def test_an_unknown_edge_off_the_way_does_not_matter(self) -> None:
        tree = chain(shift(1.0, stamp=1.0), shift(1.0, stamp=100.0))
        tree.update("RT", "f0", "f1", shift(1.0, stamp=2.0))
        assert tree.transform("f1", "f2", at=100.0).t[0] == 1.0
        with pytest.raises(ExtrapolationError, match="'f0' -> 'f1'"):
            tree.transform("f0", "f2", at=100.0)

    @given(st.permutations(range(1, 8)))
    def test_late_samples_take_their_place(self, order: list[int]) -> None:
        tree = FrameTree()
        for i in order:
            tree.update("RT", "world", "cube", shift(float(i * i), stamp=float(i)))
        assert tree.transform("world", "cube").t[0] == 49.0
        for i in range(1, 7):
            assert tree.transform("world", "cube", at=i + 0.5).t[0] == pytest.approx((i**2 + (i + 1) ** 2) / 2)

    def test_a_sample_of_an_equal_stamp_replaces(self) -> None:
        tree = chain(shift(1.0, stamp=1.0))
        tree.update("RT", "f0", "f1", shift(2.0, stamp=2.0))
        for stamp in (1.0, 2.0):
            tree.update("RT", "f0", "f1", shift(5.0, stamp=stamp))
        assert tree.transform("f0", "f1").t[0] == 5.0
        assert tree.transform("f0", "f1", at=1.5).t[0] == 5.0

    def test_the_past_is_bounded_in_time(self) -> None:
        tree = FrameTree(history=1.0)
        for i in range(41):
            tree.update("RT", "world", "cube", shift(float(i), stamp=10.0 + 0.125 * i))
        assert tree.transform("world", "cube", at=14.0).t[0] == 32.0
        with pytest.raises(ExtrapolationError, match=r"14\.000 s to 15\.000 s"):
            tree.transform("world", "cube", at=13.99)

    def test_the_past_is_bounded_in_number(self) -> None:
        tree = FrameTree(samples=4)
        for i in [*range(1, 9), 6.5]:
            tree.update("RT", "world", "cube", shift(float(i), stamp=float(i)))
        with pytest.raises(ExtrapolationError, match=r"6\.000 s to 8\.000 s"):
            tree.transform("world", "cube", at=5.5)

    def test_a_clock_set_back_starts_afresh(self) -> None:
        tree = FrameTree(history=10.0)
        tree.update("RT", "world", "cube", shift(1.0, stamp=1000.0))
        tree.update("RT", "world", "cube", shift(2.0, stamp=1001.0))
        tree.update("RT", "world", "cube", shift(3.0, stamp=5.0))
        assert tree.transform("world", "cube") == shift(3.0, stamp=5.0)

    def test_static_and_moving_samples_end_each_other(self) -> None:
        tree = chain(shift(1.0), shift(1.0))
        tree.update("RT", "f0", "f1", shift(2.0, stamp=5.0))
        assert tree.transform("f0", "f1") == shift(2.0, stamp=5.0)
        assert tree.transform("f0", "f1", at=3.0).t[0] == 2.0
        tree.update("RT", "f0", "f1", shift(3.0, stamp=6.0))
        tree.update("RT", "f0", "f1", shift(4.0))
        assert tree.transform("f0", "f1") == shift(4.0)
        assert tree.transform("f0", "f1", at=5.5).t[0] == 4.0


class TestFailures:
    def test_no_path_says_where_both_chains_end(self, tabletop: FrameTree) -> None:
        tabletop.update("RT", "map", "dock", shift(1.0))
        with pytest.raises(NoPathError) as error:
            tabletop.transform("dock", "cube_3")
        for part in ("'cube_3' ends at 'world'", "'dock' ends at 'map'", "RT edges"):
            assert part in str(error.value)

    def test_no_path_suggests_a_close_name(self, tabletop: FrameTree) -> None:
        for target, source in (("wrold", "cube_3"), ("cube_3", "wrold")):
            with pytest.raises(NoPathError, match=r"'wrold'.*did you mean 'world'\?"):
                tabletop.transform(target, source)

    def test_no_path_tells_a_root_from_an_unknown_frame(self, tabletop: FrameTree) -> None:
        tabletop.update("Virtual_RT", "world", "cube_9", shift(1.0))
        with pytest.raises(NoPathError, match="'cube_9' has no such edge to a parent"):
            tabletop.transform("world", "cube_9")

    def test_nothing_known_at_all(self) -> None:
        with pytest.raises(NoPathError, match=r"'a'.*none is known"):
            FrameTree().transform("a", "b")

    def test_a_removed_edge_leads_nowhere(self, tabletop: FrameTree) -> None:
        tabletop.transform("world", "cube_3")
        tabletop.remove("RT", "world", "camera_overhead")
        for at in (None, 5.0):
            with pytest.raises(NoPathError, match="'cube_3' ends at 'camera_overhead'"):
                tabletop.transform("world", "cube_3", at)

    def test_a_removed_edge_forgets_its_past(self) -> None:
        tree = chain(shift(1.0, stamp=1.0))
        tree.remove("RT", "f0", "f1")
        tree.update("RT", "f0", "f1", shift(2.0, stamp=0.5))
        assert tree.transform("f0", "f1") == shift(2.0, stamp=0.5)

    def test_removing_what_is_not_there_is_harmless(self, tabletop: FrameTree) -> None:
        before = tabletop.transform("world", "cube_3")
        tabletop.remove("RT", "table", "cube_3")
        tabletop.remove("Virtual_RT", "world", "nothing")
        assert tabletop.transform("world", "cube_3") is before

    @pytest.mark.parametrize("at", [None, 1.0])
    def test_a_cycle_is_named(self, at: float | None) -> None:
        tree = chain(shift(1.0), shift(1.0), shift(1.0))
        tree.update("RT", "f2", "f0", shift(1.0))
        with pytest.raises(CycleError, match="cycle 'f2' -> 'f1' -> 'f0' -> 'f2'"):
            tree.transform("elsewhere", "f3", at)
        with pytest.raises(CycleError, match="cycle"):
            tree.transform("f3", "elsewhere", at)

    def test_below_a_cycle_frames_still_meet(self) -> None:
        tree = chain(shift(1.0), shift(1.0))
        tree.update("RT", "f1", "f0", shift(1.0))
        tree.update("RT", "f1", "side", shift(5.0))
        assert tree.transform("side", "f2").t[0] == pytest.approx(-4.0)

    @pytest.mark.parametrize("asked_before", [False, True])
    def test_round_a_cycle_the_way_up_from_the_source_counts(self, asked_before: bool) -> None:
        tree = chain(shift(1.0))
        if asked_before:
            assert tree.transform("f1", "f0").t[0] == -1.0 and tree.transforms("f1", ["f0"])[0, 0, 3] == -1.0
        tree.update("RT", "f1", "f0", shift(5.0))
        assert tree.transform("f1", "f0").t[0] == 5.0 and tree.transforms("f1", ["f0"])[0, 0, 3] == 5.0
        assert tree.transform("f0", "f1").t[0] == 1.0
        tree.remove("RT", "f1", "f0")
        assert tree.transform("f1", "f0").t[0] == -1.0 and tree.transforms("f1", ["f0"])[0, 0, 3] == -1.0

    def test_an_edge_from_a_frame_to_itself_is_a_cycle(self) -> None:
        tree = FrameTree()
        tree.update("RT", "a", "a", shift(1.0))
        with pytest.raises(CycleError, match="cycle 'a' -> 'a'"):
            tree.transform("world", "a")


FRAMES = ("world", "camera", "cube", "tag")
operations = st.tuples(
    st.sampled_from(["RT", "Virtual_RT"]),
    st.sampled_from([(parent, child) for i, parent in enumerate(FRAMES) for child in FRAMES[i + 1 :]]),
    st.one_of(st.none(), st.builds(shift, st.integers(-9, 9).map(float), st.integers(0, 5).map(float))),
)


def expected(edges: dict[tuple[str, str], dict[str, Pose]], target: str, source: str, types: tuple[str, ...]) -> float:
    """The offset by a plain climb to the world, for edges that only shift; raises KeyError without a path."""

    def climb(frame: str) -> dict[str, float]:
        offsets, offset = {frame: 0.0}, 0.0
        while parents := next((edges[type, frame] for type in types if edges.get((type, frame))), None):
            frame, pose = min(parents.items(), key=lambda item: (-item[1].stamp, item[0]))
            offset += pose.t[0]
            offsets[frame] = offset
        return offsets

    up, down = climb(source), climb(target)
    meeting = next((frame for frame in down if frame in up), "")
    return up[meeting] - down[meeting]


@given(st.lists(operations, max_size=30))
def test_after_any_history_results_are_those_of_a_plain_climb(
    history: list[tuple[str, tuple[str, str], Pose | None]],
) -> None:
    tree = FrameTree()
    edges: dict[tuple[str, str], dict[str, Pose]] = {}
    for type, (parent, child), pose in history:
        parents = edges.setdefault((type, child), {})
        if pose is None:
            tree.remove(type, parent, child)
            parents.pop(parent, None)
        else:
            tree.update(type, parent, child, pose)
            old = parents.get(parent, pose)
            parents[parent] = pose if 0.0 in (pose.stamp, old.stamp) or pose.stamp >= old.stamp else old
        for types in (("RT",), BELIEF_FIRST):
            for target, source in [("world", "tag"), ("tag", "cube"), ("camera", "cube")]:
                try:
                    offset = expected(edges, target, source, types)
                except KeyError:
                    with pytest.raises(NoPathError):
                        tree.transform(target, source, types=types)
                else:
                    assert tree.transform(target, source, types=types).t[0] == pytest.approx(offset)


class TimeWithWriter(float):
    """A time whose first comparison lets a writer in, as another thread may come in between."""

    def __new__(cls, value: float, write: Callable[[], None]) -> TimeWithWriter:
        time = super().__new__(cls, value)
        time.write = [write]
        return time

    write: list[Callable[[], None]]

    def __lt__(self, other: float) -> bool:
        if self.write:
            self.write.pop()()
        return super().__lt__(other)


@pytest.mark.parametrize("stamp", [3.5, 9.0, 1000.0, 0.0])
def test_a_write_in_the_middle_of_a_read_does_not_mix_samples(stamp: float) -> None:
    tree = FrameTree(samples=8)
    for i in range(1, 9):
        tree.update("RT", "world", "cube", shift(float(i), stamp=float(i)))
    at = TimeWithWriter(4.5, lambda: tree.update("RT", "world", "cube", shift(100.0, stamp=stamp)))
    assert tree.transform("world", "cube", at=at).t[0] == 4.5
    assert not at.write


def test_readers_never_see_a_torn_edge() -> None:
    """While one thread writes x = y = stamp, readers of any time find x = y = stamp."""
    tree = FrameTree(samples=8)
    tree.update("RT", "world", "arm", Pose())

    def write(i: float) -> None:
        tree.update("RT", "arm", "cube", Pose((i, i, 0.0), stamp=i))

    def read() -> None:
        for _ in range(1000):
            pose = tree.transform("world", "cube")
            assert pose.t[0] == pose.t[1] == pose.stamp
            with suppress(ExtrapolationError):  # the writer may have left that time behind
                past = tree.transform("world", "cube", at=pose.stamp - 0.5)
                assert past.t[0] == pytest.approx(past.stamp)

    write(1.0)
    write(2.0)
    with ThreadPoolExecutor() as pool:
        readers = [pool.submit(read) for _ in range(2)]
        stamps = count(3.0)
        while not all(reader.done() for reader in readers):
            write(next(stamps))
        for reader in readers:
            reader.result()


def test_parents_come_and_go_while_a_frame_is_asked_for() -> None:
    tree = FrameTree()
    tree.update("RT", "world", "cube", shift(1.0, stamp=5.0))
    for number in range(50):
        tree.update("RT", "world", f"p{number}", shift(0.5))

    def read() -> None:
        for _ in range(500):
            assert tree.transform("world", "cube", at=5.0).t[0] == 1.0
            assert tree.transform("world", "cube").t[0] == 1.0

    with ThreadPoolExecutor() as pool:
        reader = pool.submit(read)
        for number in count():
            tree.update("RT", f"p{number % 50}", "cube", shift(0.5, stamp=5.0))
            tree.remove("RT", f"p{(number + 25) % 50}", "cube")
            if reader.done():
                break
        reader.result()


def test_the_newest_parent_is_the_same_as_if_all_were_looked_at_each_time() -> None:
    """Of few stamps, so that they are often equal; samples come late, are taken back, and edges go."""
    rng = np.random.default_rng(5)
    tree, edges = FrameTree(), dict[str, list[float]]()
    for _ in range(3000):
        parent, stamp, what = f"p{rng.integers(4)}", float(rng.integers(1, 6)), rng.integers(6)
        if what < 2:
            tree.remove("RT", parent, "x")
            edges.pop(parent, None)
        elif what < 4:
            tree.update("RT", parent, "x", shift(1.0, stamp=stamp))
            edges[parent] = sorted({*edges.get(parent, []), stamp})
        else:
            tree.follow("RT", parent, "x", shift(1.0, stamp=stamp))
            edges[parent] = [*(s for s in edges.get(parent, []) if s < stamp), stamp]
        link = tree.link("RT", "x")
        expected = min(edges, key=lambda one: (-edges[one][-1], one), default=None)
        assert (None if link is None else link.parent) == expected
        assert link is None or (link.pose is not None and link.pose.stamp == edges[link.parent][-1])


def test_who_hangs_a_frame_from_thousands_of_others_makes_no_write_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """One message with ten thousand such edges kept all writers waiting for a minute, and one that took them away."""
    looks = count()
    monkeypatch.setattr(PoseHistory, "newest", property(lambda self: next(looks) >= 0 and self._samples[-1]))
    tree = FrameTree()
    for number in range(500):
        tree.update("RT", f"p{number}", "x", shift(1.0, stamp=float(number)))
    for number in range(500):
        tree.update("RT", "p7", "x", shift(1.0, stamp=7.0 + number / 1e3))
    assert tree.link("RT", "x").parent == "p499"  # type: ignore[union-attr]
    for number in range(500):
        tree.follow("RT", "p499", "x", shift(1.0, stamp=-float(number)))
    for number in reversed(range(500)):
        tree.remove("RT", f"p{number}", "x")
    assert next(looks) < 20_000 and tree.link("RT", "x") is None
