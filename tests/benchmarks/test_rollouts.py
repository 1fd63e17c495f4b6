"""The rates of rollouts: all kinds are measured, and the peer simulates the same scene."""

from __future__ import annotations

import math

import pytest

from benchmarks.rollouts import _table, measured, variants
from simulation_handler.physics.rollouts.engine import Engine


def test_each_kind_has_a_rate() -> None:
    row = measured(objects=4, rollouts=2, seconds=0.05)
    assert row["objects"] == 4
    kinds = {kind: rate for kind, rate in row.items() if kind != "objects"}
    assert {"0 workers", "1 workers", "2 workers", "new client", "snapshot"} <= kinds.keys()
    assert all(rate["per_s"] > 0.0 and rate["cpu_ms"] >= 0.0 for rate in kinds.values())
    assert _table([row]).row_count == 1


def test_mujoco_brings_the_same_cubes_to_rest_where_pybullet_does() -> None:
    pytest.importorskip("mujoco")
    from benchmarks.peers.mujoco_rollouts import MujocoRollouts

    scenes = variants(4, 2)
    with MujocoRollouts(scenes[0], threads=1) as peer:
        ends = peer.run(scenes, 0.4)
    engine = Engine()
    for scene, positions in zip(scenes, ends, strict=True):
        poses = engine.run(scene, 0.4).poses
        free = [body.name for body in scene.bodies if not body.fixed]
        assert max(math.dist(poses[name][0], there) for name, there in zip(free, positions, strict=True)) < 0.002
    engine.close()
