"""A calibration on request for which the arm moves the camera: one view of a cluster does not tell enough."""

from __future__ import annotations

import pytest

from benchmarks.calibration_runs import bump, on_table, play, scene
from dsr.agent import Access, Agent
from dsr.math3d.transforms import Pose
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.calibration import ANSWERED, CALIBRATION, read_report, request_calibration


class Asker(Agent):
    """Asks once, then keeps what came out."""

    name = "asker"
    rate_hz = 5.0
    reads = Access(nodes=("*",), edges=("*",), attributes=("*",))
    writes = Access(
        nodes=("mind", CALIBRATION),
        edges=("has",),
        attributes=("target", "method", "forced", "views", "moves_arm", "status"),
    )
    views = 0
    adopted = False
    home: Pose
    moved = 0.0
    back = 1.0

    def setup(self) -> None:
        """Nothing is asked yet."""
        self._request, self._began = "", self.clock.now()

    def tick(self, now: float) -> None:
        """Ask after five seconds."""
        if now - self._began < 5.0:
            return
        gripper = self.memory.transform("world", "gripper")
        if not self._request:
            Asker.home = gripper
            self._request = request_calibration(self.memory, "camera_wrist", views=2, move=True)
        node = self.memory.get_node(self._request)
        Asker.back = gripper.distance(Asker.home)[0]
        Asker.moved = max(Asker.moved, Asker.back)
        if node is not None and node.get("status") in ANSWERED:
            report = read_report(self.memory, self._request)
            Asker.views, Asker.adopted = (0, False) if report is None else (report.views, report.adopted)


@pytest.mark.timeout(600)
def test_the_arm_looks_from_elsewhere_and_comes_back() -> None:
    cluster = [on_table(0.36 + x, y, 0.0) for x in (-0.022, 0.022) for y in (-0.022, 0.022)]
    bumped = bump(Pose.from_rotvec((0.03, -0.02, 0.01), (0.05, -0.04, 0.1)), at=3.0)
    text = scene(cluster, [bumped], duration=17.0)
    metrics = play(text, seed=0, sensor="poses", more=[AgentSpec("asker", Asker)], by_itself=False).result.metrics
    assert Asker.views == 2 and Asker.adopted
    assert metrics["camera_error_m"] < 0.003 and metrics["camera_error_rad"] < 0.005
    assert Asker.moved > 0.05 and Asker.back < 0.002
