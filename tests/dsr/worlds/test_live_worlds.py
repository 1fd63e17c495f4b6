"""Worlds between processes over Zenoh: found by late joiners, alive while anybody holds them, deleted without trace."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

import dsr
from dsr.clock import WALL_CLOCK
from dsr.math3d.transforms import Pose
from dsr.network.transport import Qos


def eventually(holds: Callable[[], object], seconds: float = 5.0) -> bool:
    end = WALL_CLOCK.monotonic() + seconds
    never = threading.Event()
    while not holds() and WALL_CLOCK.monotonic() < end:
        WALL_CLOCK.wait(never, 0.01)
    return bool(holds())


def test_a_fork_is_found_opened_shared_and_deleted() -> None:
    with dsr.connect("worlds", agent="a") as a, dsr.connect("worlds", agent="b") as b:
        a.add_node("cube_3", "cube", mass=1.0)
        fork = a.fork("idea")
        fork.update_node("cube_3", mass=2.0)
        assert eventually(lambda: len(b.worlds()) == 2)
        theirs = b.world("idea")
        assert theirs.node("cube_3")["mass"] == 2.0 and b.node("cube_3")["mass"] == 1.0
        theirs.add_node("ball", "ball")
        assert eventually(lambda: "ball" in fork)
        with dsr.connect("worlds", agent="late") as late:
            assert "ball" in late.world("idea")
        b.delete_world("idea")
        assert eventually(lambda: len(a.worlds()) == 1)
        with pytest.raises(dsr.WorldNotFoundError):
            a.world("idea")
        assert eventually(lambda: fork.closed)


def test_a_world_outlives_its_maker_and_no_server_is_needed() -> None:
    with dsr.connect("worlds", agent="b") as b:
        with dsr.connect("worlds", agent="a") as a:
            a.create_world("w").add_node("ball", "ball")
            assert eventually(lambda: len(b.worlds()) == 2)
            b.world("w")
        with dsr.connect("worlds", agent="a") as a:
            assert "ball" in a.create_world("w", exist_ok=True)


def test_a_world_takes_six_threads_and_shares_the_one_that_polls() -> None:
    with dsr.connect("worlds", agent="a") as a:
        before = set(threading.enumerate())
        for index in range(3):
            a.fork(f"idea_{index}")
        names = [thread.name for thread in set(threading.enumerate()) - before]
        assert len(names) == 3 * 6 and "dsr-sync" not in names


def test_deleting_leaves_no_threads_behind() -> None:
    with dsr.connect("worlds", agent="a") as a:
        before = threading.active_count()
        for index in range(3):
            a.fork(f"idea_{index}")
        for index in range(3):
            a.delete_world(f"idea_{index}")
        assert eventually(lambda: threading.active_count() <= before)


def test_the_thread_that_polls_all_worlds_leaves_sending_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    with dsr.connect("worlds", agent="a") as a, dsr.connect("worlds", agent="b"):
        senders: list[str] = []
        publish = a.transport.publish

        def note(key: str, payload: bytes, qos: Qos) -> None:
            senders.extend([threading.current_thread().name] if qos is Qos.RELIABLE else [])
            publish(key, payload, qos)

        monkeypatch.setattr(a.transport, "publish", note)
        a.add_node("world", "world")
        a.add_node("cube_1", "cube")
        a.add_edge("world", "cube_1", "RT", pose=Pose.identity())
        a.flush()
        before = len(senders)
        a.update_edge("world", "cube_1", "RT", pose=Pose((0.1, 0.0, 0.0)))  # a sample: a poll settles it
        assert eventually(lambda: len(senders) > before)
        assert "dsr-sync" not in senders
