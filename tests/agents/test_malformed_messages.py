"""All agents at work while a stranger sends nonsense on every key: none fails, and the scenario goes on."""

from __future__ import annotations

import math
from itertools import cycle

import numpy as np

from agents.plant.messages import arm_command_key, arm_state_key, decode_arm_state, decode_command, readings_key
from agents.plant.messages import decode_tag_readings as decode_readings
from agents.scenario.judge.judge import decode_truth
from agents.scenario.run.staging import make_run, staged_system
from benchmarks.fuzz import corpus
from benchmarks.fuzz.mutations import Mutator
from dsr.crdt.delta import Delta, Write
from dsr.errors import WireError
from dsr.graph.schema import MAX_NUMBER
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.perception.reach import FARTHEST
from dsr.replication.wire import decode_delta, decode_digest, encode_delta
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.logs import decode_log
from dsr.runtime.status import decode_status
from dsr.vocabulary.scenario_start import decode_start, start_key

SECONDS = 4.0
ODD = ("text", "", (), (1.0,), -1e308, 1e308, (1e308,) * 3, True, 7, -(1 << 62), b"\xff", Pose((1e308, 0.0, 0.0)))
"""Values, each of which is none of most attributes."""
PER_STEP = 3
ENDS = (
    *(Pose((far, 0.0, -far)) for far in (1e3, 1e8, MAX_NUMBER)),
    Pose((0.0, 0.0, 0.0), stamp=-MAX_NUMBER),
    Pose((0.1, 0.0, 0.5)).with_covariance(MAX_NUMBER * np.eye(6)),
    Pose((1e8, 0.0, 0.0)).with_covariance(np.zeros((6, 6))),
)
"""Poses that each replica takes"""


def test_nobody_minds_nonsense() -> None:
    system = staged_system(make_run("hovering_1", sensor="poses"))
    with Lockstep(system.agents, graph=system.graph, seed=1, strict=True) as lockstep:
        keys, stranger = lockstep.keys, lockstep.network.connect("stranger")
        kinds = [
            (arm_state_key(keys), corpus.arm_states(), decode_arm_state),
            (arm_command_key(keys), corpus.commands(), lambda payload: decode_command(payload, corpus.JOINTS)),
            (readings_key(keys, "overhead"), corpus.tag_readings(), decode_readings),
            (start_key(keys), corpus.starts(), decode_start),
            (keys.truth(), corpus.truths(), decode_truth),
            (keys.status("plant"), corpus.statuses(), decode_status),
            (keys.log("plant"), corpus.log_records(), decode_log),
            (keys.delta("stranger"), corpus.deltas(), decode_delta),
            (keys.stream("stranger"), corpus.deltas(), decode_delta),
            (keys.digest("stranger"), corpus.digests(), decode_digest),
        ]
        mutators = [(key, Mutator(messages, 1), decode) for key, messages, decode in kinds]
        sent = 0

        def disturb(_now: float) -> None:
            nonlocal sent
            for key, mutate, decode in mutators:
                for _ in range(PER_STEP):
                    payload = mutate()
                    try:
                        decode(payload)
                    except WireError:
                        stranger.publish(key, payload)
                        sent += 1

        lockstep.run_for(SECONDS, disturb)
        assert sent > 1000
        assert lockstep.memory.dropped.keys() == {"stranger"}
        assert lockstep.memory.edges("RT"), "the scene is there all the same"


def test_nobody_minds_values_that_no_such_attribute_has() -> None:
    """One wrong value of a pose ended the simulation handler before, for it stays in the graph."""
    system = staged_system(make_run("joint_action", sensor="poses"))
    with Lockstep(system.agents, graph=system.graph, seed=1, strict=True) as lockstep:
        stranger, key, values = lockstep.network.connect("stranger"), lockstep.keys.stream("stranger-1"), cycle(ODD)
        lockstep.run_for(1.0)
        told = 0

        def disturb(_now: float) -> None:
            nonlocal told
            entries = list(lockstep.memory.replica.graph.store.entries.values())
            present = [(entry.dot, write) for entry in entries for write in entry.registers.values()]
            writes = [
                Write(dot, write.attribute, write.stamp + 1, "stranger-1", None, next(values))
                for dot, write in present[told % 5 :: 5]
            ]
            told += 1
            stranger.publish(key, encode_delta(Delta(writes=writes)))

        lockstep.run_for(SECONDS, disturb)
        assert told > 100 and not lockstep.memory.dropped


def test_nobody_minds_poses_at_the_ends_of_what_a_pose_may_be() -> None:
    """A percept that is 1e8 m away came into the belief before, and its covariance ended the simulation handler."""
    system = staged_system(make_run("hovering_1", sensor="poses"))
    with Lockstep(system.agents, graph=system.graph, seed=1, strict=True) as lockstep:
        memory, stranger = (
            lockstep.memory,
            Memory(system.graph, "stranger", transport=lockstep.network.connect("stranger"), clock=lockstep.clock),
        )
        lockstep.run_for(1.0)
        stranger.poll()
        poses, told = cycle(ENDS), 0

        def disturb(now: float) -> None:
            nonlocal told
            stranger.poll()
            for edge in [*stranger.edges("RT"), *stranger.edges("Virtual_RT")][told % 3 :: 3]:
                pose = next(poses)
                stranger.update_edge(*edge.key, pose=pose.with_stamp(now) if told % 2 else pose)
                told += 1
            stranger.flush()

        lockstep.run_for(1.0, disturb)
        lockstep.run_for(2.0)
        assert told > 100
        believed = [edge.pose for edge in memory.edges("Virtual_RT") if "pose" in edge]
        assert believed and all(math.hypot(*pose.t) <= FARTHEST for pose in believed)
