"""An arm of Dynamixel servos, as a driver: a thread reads the servos and sends positions, 50 times a second.

Servos go straight to each position that they get, so the motion is made here (`agents/joint_ramp.py`). The torque is
off until the first motion.
"""

from __future__ import annotations

import itertools
import logging
import math
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from agents.drivers import ArmState
from agents.dynamixel.servos import ServoError, Servos
from agents.joint_ramp import Ramp
from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import ConfigError
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.vocabulary.arms import ARM
from dsr.vocabulary.halting import HaltLatch

_log = logging.getLogger("agents.dynamixel")

PERIOD = 0.02
"""s between two commands to the servos"""
DEADMAN = 0.1
"""s without `keep_alive` after which a moving arm stops; servos stop by themselves after that without any message"""
BEHIND = 0.2
"""rad that a joint may be behind its command: servos lag by some hundredths"""
STALLED = 0.1
"""s for which it may be further behind"""
SHOWN = 0.2
"""s for which a fault is told at least, that no sample of it is missed: ten samples"""
_ENDS_WITHIN = 2.0
"""s in which the thread ends"""


class DynamixelArm:
    """An `ArmDriver` for servos on one serial line. It has no gripper, as far as this driver knows.

    Args:
        bus: where emergency stops are heard.
        keys: of the graph.
        port: of the serial line, such as `/dev/ttyUSB0`.
        joints: names, as in the URDF.
        ids: of the servos; 1, 2, 3, ... if empty.
        series: `P` (PH54, PM42) or `X` (XM430).
        pulses: of a turn, for each servo; one for all if there is one.
        speed: rad/s, the most of a joint.
        baud: bit/s.
        arm: name of the arm, which `dsr halt --arm` uses.

    Raises:
        ConfigError: for options that fit no arm, or a port that cannot be opened.
    """

    clock: ClassVar[Clock] = WALL_CLOCK

    def __init__(
        self, bus: Transport, keys: Keys, *, port: str, joints: Sequence[str], ids: Sequence[int] = (),
        series: str = "P", pulses: Sequence[int] = (1_003_846,), speed: float = 1.0, baud: int = 1_000_000,
        arm: str = ARM,
    ) -> None:  # fmt: skip
        ids = tuple(ids) or tuple(range(1, len(joints) + 1))
        turns = tuple(pulses) * len(joints) if len(pulses) == 1 else tuple(pulses)
        if not joints or not len(ids) == len(turns) == len(joints) or speed <= 0.0 or min(turns) <= 0:
            raise ConfigError("an arm of servos needs `joints`, as many `ids` and `pulses`, and `speed` above 0")
        self._names, self._ids, self._speed = tuple(joints), ids, speed
        self._servos = Servos(port, baud, ids, series, turns)
        self._lock = threading.Lock()
        self._state: ArmState | None = None
        self._ramp: Ramp | None = None
        self._fault = ""
        self._alive = self._followed = self._faulty_at = -np.inf
        self._has_torque = False
        self._counts: Counter[str] = Counter()
        self._trouble = ""
        self._over = threading.Event()
        self._halt = HaltLatch(bus, keys, arm=arm)
        self._thread = threading.Thread(target=self._run, name="dynamixel", daemon=True)
        self._thread.start()

    # ---- the driver

    def state(self) -> ArmState | None:
        """The newest sample, or None before the first."""
        return self._state

    def follow(self, times: tuple[float, ...], positions: tuple[tuple[float, ...], ...]) -> None:
        """Pass through joint `positions` (rad) at `times` (s from now, increasing), and stay at the last ones.

        A way that begins where the arm is not, and cannot be by then, is refused, and told as a fault; likewise one of
        numbers that are not finite.
        """
        with self._lock:
            if (ramp := self._ready()) is None:
                return
            wrong = "the way has numbers that are not finite"
            if all(map(math.isfinite, (*times, *itertools.chain(*positions)))):
                if (aside := ramp.aside(times, positions)) is None:
                    ramp.follow(times, positions)
                    return
                wrong = f"the way begins {aside[1]:.2f} rad from where {self._names[aside[0]]} is"
            self._counts["motions refused"] += 1
            self._tell(wrong)
            if self._has_torque:
                ramp.stop()
            else:
                self._ramp = None  # else the torque would be switched on for a motion that is refused

    def move_gripper(self, opening: float) -> None:
        """Do nothing: this driver knows of no gripper."""
        self._counts["gripper commands without a gripper"] += 1

    def stop(self) -> None:
        """Come to rest within the limits of the joints, and stay there."""
        with self._lock:
            if self._ramp is not None:
                self._ramp.stop()

    def keep_alive(self) -> None:
        """The controller lives."""
        self._alive = self.clock.monotonic()

    @property
    def trouble(self) -> str:
        """What is wrong now, in words; empty if nothing is."""
        return self._fault or self._trouble

    @property
    def counts(self) -> Mapping[str, int]:
        """What went wrong since the start, by name."""
        return dict(self._counts)

    def close(self) -> None:
        """Stop, and close the serial line; the servos hold their positions."""
        self._halt.close()
        self._over.set()
        self._thread.join(_ENDS_WITHIN)
        self._servos.close()

    # ---- in the thread, but for `_ready`

    def _ready(self) -> Ramp | None:
        """The ramp, for a new motion, from where the arm is; None if it must not move."""
        state = self._state
        if self._halt.reason or state is None:
            self._counts["motions refused"] += 1
            return None
        if self._ramp is None:
            self._ramp = Ramp(state.positions, [self._speed] * len(self._names), PERIOD)
        self._fault = ""
        self._alive = self._followed = self.clock.monotonic()
        return self._ramp

    def _run(self) -> None:
        while not self._over.is_set():
            began = self.clock.monotonic()
            try:
                self._cycle()
                self._trouble = ""
            except ServoError as error:
                self._counts["cycles without an answer"] += 1
                if not self._trouble:
                    _log.warning("%s", error)
                self._trouble = str(error)
            except Exception as error:  # else the thread would end without a word: the servos hold where they are
                self._counts["failures"] += 1
                _log.exception("a cycle of the driver failed")
                with self._lock:
                    self._ramp = None
                    self._tell(f"the driver failed: {type(error).__name__}: {error}")
            self.clock.wait(self._over, max(0.0, PERIOD - (self.clock.monotonic() - began)))

    def _cycle(self) -> None:
        """Read, judge, and send the next positions. Raises `ServoError`; what is commanded goes on to brake."""
        with self._lock:
            self._watch()
        try:
            positions, velocities, currents = self._servos.read()
            faults = self._servos.faults()
        finally:
            self._send()
        with self._lock:
            self._judge(positions, faults)
            fault = self._halt.reason or self._fault
        self._state = ArmState(self.clock.now(), self._names, positions, velocities, 0.0, False, fault, currents)

    def _watch(self) -> None:
        """Stop if that is ordered, or if the controller gives no sign of life."""
        ramp = self._ramp
        if ramp is None or ramp.is_resting or ramp.is_braking:
            return
        silence = self.clock.monotonic() - self._alive
        if self._halt.reason:
            ramp.stop()
        elif silence > DEADMAN:
            self._tell(f"no sign of life of the arm's controller for {silence:.2f} s")
            ramp.stop()

    def _judge(self, positions: Sequence[float], faults: Mapping[int, str]) -> None:
        """Stop if a servo says that something is wrong with it, or does not follow.

        A fault is over when the arm rests, nothing is wrong, and the controller lives.
        """
        now, ramp = self.clock.monotonic(), self._ramp
        if faults:
            id, text = min(faults.items())
            self._tell(f"servo {id} ({self._names[self._ids.index(id)]}): {text}")
        elif (ramp is None or ramp.is_resting) and now - self._faulty_at > SHOWN and now - self._alive < DEADMAN:
            self._fault = ""
        if ramp is None:
            return
        behind = np.abs(ramp.positions - np.array(positions))
        if behind.max() <= BEHIND:
            self._followed = now
        elif now - self._followed > STALLED and not self._fault:
            worst = int(behind.argmax())
            self._tell(f"{self._names[worst]} does not follow: {behind[worst]:.2f} rad behind")
        if self._fault and not ramp.is_braking and not ramp.is_resting:
            ramp.stop(positions, [0.0] * len(positions))

    def _tell(self, fault: str) -> None:
        """Tell a fault from now on."""
        self._fault, self._faulty_at = fault, self.clock.monotonic()

    def _send(self) -> None:
        with self._lock:
            ramp = self._ramp
            if ramp is None:
                return
            if not self._has_torque:
                self._servos.command(ramp.positions.tolist())
                self._servos.switch(torque=True, watchdog=2 * DEADMAN)
                self._has_torque = True
            ramp.step()
            goal = ramp.positions.tolist()
        self._servos.command(goal)
