"""The requests of calibrations that begin by themselves: whoever follows calibrations sees these, too."""

from __future__ import annotations

import msgspec

from agents.calibrator.solve.reporting import encoded, make_report
from agents.calibrator.watch.doubt import Doubt
from dsr.memory import Memory
from dsr.vocabulary.calibration import (
    ADOPTED,
    ANSWERED,
    CALIBRATION,
    LOOKING,
    REFUSED,
    SURPRISE,
    Report,
    read_report,
    request_calibration,
)


class OwnRequests:
    """One for each camera that is doubted.

    Args:
        memory: where they are.
        method: of calibration.
    """

    def __init__(self, memory: Memory, method: str) -> None:
        self._memory = memory
        self._method = method
        self._names: dict[str, str] = {}

    def __contains__(self, request: object) -> bool:
        """Whether a node is one whose answer may still change."""
        return request in self._names.values()

    def make(self, camera: str) -> None:
        """Begin."""
        name = request_calibration(self._memory, camera, method=self._method)
        self._memory.update_node(name, source=SURPRISE, status=LOOKING)
        self._names[camera] = name

    def resume(self, camera: str, request: str) -> None:
        """Go on with that of an earlier run."""
        self._names[camera] = request

    def refuse_left_over(self) -> None:
        """Refuse the requests that an earlier run did not answer."""
        for node in list(self._memory.nodes(CALIBRATION)):
            if node.get("source") == SURPRISE and node.get("status") not in ANSWERED:
                self._memory.update_node(node.name, status=REFUSED, explanation="the calibrator was restarted")

    def answer(self, doubt: Doubt, status: str, why: str = "", *, provisional: bool = False) -> None:
        """Say what came out; later answers replace earlier ones."""
        request, adopted = self._names.get(doubt.camera, ""), status == ADOPTED
        if request not in self._memory:
            return
        if doubt.solution is not None:
            report = make_report(doubt.camera, doubt.parent, doubt.solution, adopted=adopted)
        elif (known := self.report(doubt.camera)) is not None:  # of an earlier run
            report = msgspec.structs.replace(known, adopted=adopted)
        else:
            self._memory.update_node(request, status=status, explanation=why)
            return
        text = report.text if adopted else f"{doubt.camera} {why}"
        report = msgspec.structs.replace(report, text=text, provisional=provisional)
        self._memory.update_node(request, status=status, explanation=text if adopted else why, report=encoded(report))

    def report(self, camera: str) -> Report | None:
        """The newest answer for a camera; None before the first one."""
        return read_report(self._memory, self._names.get(camera, ""))

    def close(self, camera: str) -> None:
        """Leave the answer for a camera as it is."""
        self._names.pop(camera, None)
