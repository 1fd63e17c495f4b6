"""The detector in the whole system, in lockstep with the tag sensor."""

from __future__ import annotations

import pytest

from agents.scenario.run.staging import make_run, staged_system, without
from dsr.runtime.lockstep import Lockstep


@pytest.mark.parametrize("scenario", ["hovering", "hovering_wrist"])
def test_a_scene_at_rest_is_not_surprising(scenario: str) -> None:
    """The flags are compared with percepts that are up to 15 mm off; the detector is killed in between."""
    system = without(staged_system(make_run(scenario, seed=1, sensor="poses")), "viewer", "recorder")
    with Lockstep(system.agents, graph=system.graph, seed=1, strict=True) as lockstep:
        watch = lockstep.memory.watch(attribute="surprising", existing=False)
        for restart in (True, False):
            lockstep.run_for(6.0)
            if restart:
                lockstep.kill("surprise")
                lockstep.restart("surprise")
        cubes = lockstep.memory.nodes("cube")
        assert [cube["surprising"] for cube in cubes] == [False] * len(cubes)
        assert len(watch.poll()) == len(cubes), "each was told once"
        assert {edge["visible"] for edge in lockstep.memory.edges("sees")} >= {True}
