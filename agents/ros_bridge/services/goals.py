"""Waits for the end of a goal while something newer may come, and tells what a controller leaves people to guess."""

from __future__ import annotations

import threading
from collections.abc import Callable

from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.errors import RosTimeoutError
from agents.ros_bridge.link.actions import ABORTED, CANCELED, SUCCEEDED, ActionGoal, ActionOutcome
from dsr.clock import WALL_CLOCK
from dsr.errors import DsrError

GIVEN_UP = "motions given up"
"""What is counted for goals that did not succeed"""
_ASK = 10.0
"""s for which one request for a result waits; it is asked again until it comes"""
_LOOK = 0.05
"""s between two looks for a newer command"""
_SERVER_LOOK = 0.5
"""s between two looks for the server"""
_GONE_AFTER = 2.0
"""s without a server after which it is gone: a router that comes back takes one"""
_LATE_AFTER = 5.0
"""s beyond the time of a motion after which its end is late: controllers wait for the arm to settle"""


def wait_for_end(
    goal: ActionGoal, tally: Tally, what: str, seconds: float, is_over: Callable[[], bool]
) -> ActionOutcome | None:
    """How a goal ended; None if something newer is to be done before, or its server is gone, which is told.

    Args:
        goal: that the server accepted.
        tally: is told that the server is gone or late.
        what: for people, for example `a motion`.
        seconds: that it should take, s.
        is_over: whether nobody is interested any more.
    """
    result = _Result(goal)
    began = looked = here = WALL_CLOCK.monotonic()
    is_late = False
    while not is_over():
        if WALL_CLOCK.wait(result.ended, _LOOK):
            if result.error:
                tally.tell(GIVEN_UP, result.error, f"nobody knows how {what} ended: {result.error}")
            return result.outcome
        now = WALL_CLOCK.monotonic()
        if now - looked >= _SERVER_LOOK:
            looked = now
            here = now if goal.is_served() else here
        if now - here > _GONE_AFTER:
            tally.tell(GIVEN_UP, f"{what} gone", f"nobody knows how {what} ended: its controller is gone")
            break
        if not is_late and now - began > seconds + _LATE_AFTER:
            is_late = True
            tally.tell("late results", what, f"the controller has not said how {what} of {seconds:.1f} s ended")
    result.drop()
    return None


class _Result:
    """The result of a goal, asked for in a thread of its own: an answer that takes its time is not asked for twice."""

    def __init__(self, goal: ActionGoal) -> None:
        self.ended = threading.Event()
        self.outcome: ActionOutcome | None = None
        self.error = ""
        """Why there is no outcome, once `ended`"""
        self._goal = goal
        self._dropped = threading.Event()
        threading.Thread(target=self._run, name="ros-result", daemon=True).start()

    def drop(self) -> None:
        """Nobody waits for it any more."""
        self._dropped.set()

    def _run(self) -> None:
        while not self._dropped.is_set():
            try:
                self.outcome = self._goal.outcome(_ASK)
            except RosTimeoutError:
                WALL_CLOCK.wait(self._dropped, _LOOK)
                continue
            except DsrError as error:
                self.error = str(error)
            self.ended.set()
            return


def tell_end(outcome: ActionOutcome, tally: Tally, what: str) -> None:
    """Tell what did not succeed, with the controller's own words if it has any."""
    code = getattr(outcome.result, "error_code", 0)
    if outcome.status == SUCCEEDED and not code:
        return
    said = getattr(outcome.result, "error_string", "") or (f"error {code}" if code else _WITHOUT_WORDS[outcome.status])
    tally.tell(GIVEN_UP, said, f"the controller gave {what} up: {said}")


class _WithoutWords(dict[int, str]):
    def __missing__(self, status: int) -> str:
        return f"it does not know the goal (status {status}): it may have been started anew"


_WITHOUT_WORDS = _WithoutWords({ABORTED: "aborted, without a reason", CANCELED: "somebody cancelled it"})
