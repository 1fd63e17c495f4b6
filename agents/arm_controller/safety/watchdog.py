"""Says why the arm must not move now: samples that cannot be believed, a device in trouble, no camera or memory."""

from __future__ import annotations

import math
from collections.abc import Mapping

from agents.arm_controller.joints import Joints
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.safety.samples import SampleCheck
from agents.arm_controller.safety.sight import Sight

CLEARED = 0.5
"""s without trouble after which the arm may move again: a driver that lied once is not believed at once"""


class Watchdog:
    """Watches all that a motion relies on, while the arm moves and while it rests.

    Args:
        chain: joints with their limits.
        late: s that a sample may be late.
        efforts: N m, N or A by joint, the most that it may need; no others are watched.
    """

    def __init__(self, chain: JointChain, late: float, efforts: Mapping[str, float] | None = None) -> None:
        self.danger = ""
        """Why the arm must not move, in words; empty if it may."""
        self._samples = SampleCheck(chain, late)
        self._efforts = {chain.names.index(name): limit for name, limit in (efforts or {}).items()}
        self._names = chain.names
        self._sights: dict[str, Sight] = {}
        self._told: dict[str, tuple[str, float]] = {}
        self._had_company = False

    def note_sample(self, joints: Joints | None, error: str, fault: str, now: float) -> None:
        """Judge a new sample of the arm.

        Args:
            joints: the sample; None if nothing could be read off it.
            error: why not.
            fault: what the device says of itself, empty if all is well.
            now: time of arrival, s.
        """
        self._tell("samples", error or ("" if joints is None else self._samples.problem(joints, now)), now)
        self._tell("device", fault, now)
        if joints is not None:
            self._tell("effort", self._pressed(joints), now)

    def note_frame(self, camera: str, now: float) -> None:
        """A frame of a camera came at time `now` (s)."""
        self._sights.setdefault(camera, Sight(camera)).note(now)

    def note_rival(self, agent: str, now: float) -> None:
        """Another agent that runs says at time `now` (s) that it moves this arm; empty for none."""
        self._tell("rival", f"{agent} moves this arm, too: each needs a name of its own, `arm`" if agent else "", now)

    def look(self, company: bool, now: float) -> None:
        """Find out at time `now` (s) what is missing; `company` says whether others hold the memory, too."""
        self._had_company |= company
        alone = self._had_company and not company
        self._tell("memory", "nobody else holds the memory any more" if alone else "", now)
        for camera, sight in self._sights.items():
            self._tell(camera, sight.trouble(now), now)
        lasting = [what for what, at in self._told.values() if now - at <= CLEARED]
        self.danger = lasting[0] if lasting else ""

    def _pressed(self, joints: Joints) -> str:
        """Which joint needs more than it may, in words; empty for none."""
        if self._efforts and not joints.efforts:
            return "the driver tells no efforts, which `effort_limits` limits"
        for index, limit in self._efforts.items():
            effort = joints.efforts[index]
            if abs(effort) > limit:
                return f"{self._names[index]} presses with {effort:.3g}, more than {limit:g}"
        return ""

    def _tell(self, kind: str, problem: str, now: float) -> None:
        """Keep the newest trouble of a kind, with the time when it was there last."""
        if problem:
            first = self._told.get(kind, ("", -math.inf))
            goes_on = now - first[1] <= CLEARED
            self._told[kind] = (first[0] if goes_on else problem, now)
