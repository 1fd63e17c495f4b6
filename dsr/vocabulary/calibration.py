"""Requests to calibrate a camera: nodes of type `calibration`, which agents/calibrator answers.

name = request_calibration(memory, "camera_wrist")
...
if (report := read_report(memory, name)) is not None: print(report.text)
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import msgspec
import numpy as np

from dsr.config.plugins import CALIBRATION_METHODS, checked_name, provided
from dsr.errors import ConfigError, WireError
from dsr.graph.elements import Node
from dsr.graph.schema import MAX_NUMBER, is_within_bounds
from dsr.math3d.tolerance import SAME_POSE
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.decoding import decoded
from dsr.vocabulary.intentions import MIND

CALIBRATION = "calibration"
"""Node type of a request."""
METHODS = ("robust", "closed_form")
"""Names of the built-in methods; packages may provide others."""
DEFAULT_METHOD = "robust"
LOOKING, ADOPTED, REFUSED = "looking", "adopted", "refused"
"""Words of `status`: it still collects views; the pose is written; it is not, and `explanation` says why."""
ANSWERED = (ADOPTED, REFUSED)
STEADY, IN_DOUBT, PROVISIONAL, CONFIRMED = "steady", "in doubt", "provisional", "confirmed"
"""Words of a camera's `mount`, which the calibrator writes. Nothing speaks against its pose; it may have moved, and is
being looked into: do not rely on what it sees; it got a new pose, but objects that all moved alike would look the same,
and a view from elsewhere will tell; it was looked into, and has not moved: what is seen elsewhere has."""
CALIBRATED = "calibrated"
"""Kind of the event that tells of an adopted pose; its participants are the camera and the objects, and `read_report`
of its node tells the pose before and after."""
SURPRISE = "surprise"
"""`source` of requests that nobody made: the calibrator began by itself."""


class ObjectReport(msgspec.Struct, frozen=True):
    """The distance of one object from its believed pose, before and after: root mean squares over its views."""

    name: str
    before_m: float
    before_rad: float
    after_m: float
    after_rad: float
    is_outlier: bool
    """Whether the object disagrees with the pose that was found."""


class Report(msgspec.Struct, frozen=True):
    """The outcome of a calibration. Raises `ValueError` for poses that are none."""

    camera: str
    parent: str
    """Name of the frame that carries the camera."""
    method: str
    adopted: bool
    """Whether its pose is known now."""
    text: str
    """One line for people: the change, or why there was none."""
    before: tuple[float, ...]
    """parent_from_camera as it was: translation (m), then quaternion x, y, z, w."""
    after: tuple[float, ...]
    """Pose that the calibration found, adopted or not: parent_from_camera, x y z (m) and quaternion x y z w."""
    covariance: tuple[float, ...]
    """Covariance of `after`, (6, 6) row by row, m and rad: a perturbation in the frame of the camera."""
    shift_m: float
    shift_rad: float
    """Angle (rad) between the poses before and after."""
    condition: float
    """Condition number of the information about the pose; -1 if infinite."""
    weak: bool
    """Whether the geometry does not determine the pose."""
    views: int
    sightings: int
    agreeing: int
    """Sightings that agree with the pose that was found."""
    objects: tuple[ObjectReport, ...]
    unchanged: bool = False
    """Whether that is the pose as it was, which was not written anew: what was found differs by less than its error."""
    provisional: bool = False
    """Whether objects that were all moved alike would look the same, so that the pose may yet be taken back."""

    def __post_init__(self) -> None:
        if not (is_within_bounds(pose_of(self.before)) and is_within_bounds(pose_of(self.after, self.covariance))):
            raise ValueError(f"expected numbers up to {MAX_NUMBER:g}")


_report_decoder = msgspec.json.Decoder(Report)


def request_calibration(
    memory: Memory,
    camera: str = "",
    *,
    method: str = DEFAULT_METHOD,
    force: bool = False,
    views: int = 1,
    move: bool = False,
) -> str:
    """Ask for the calibration of a camera.

    Args:
        memory: where to.
        camera: its node; empty for the only one there is, or that sees objects.
        method: one of `method_names()`.
        force: adopt the pose also if geometry or agreement speak against it.
        views: from how many poses of the camera's parent the objects are to be seen before the answer.
        move: have the arm that carries the camera go to the other ones, and come back; otherwise somebody else does.

    Returns:
        The name of the request, a node below `mind`; `status` and `explanation` say how it goes, and `read_report` what
        came out. `memory.remove_node` withdraws it.

    Raises:
        ConfigError: for an unknown method, or fewer than one view.
    """
    checked_method(method)
    if views < 1:
        raise ConfigError(f"views {views}: expected 1 or more")
    name = next(name for number in count() if (name := f"{CALIBRATION}_{memory.rid}_{number}") not in memory)
    with memory.batch():
        if MIND not in memory:
            memory.add_node(MIND, "mind")
        moves = {"moves_arm": True} if move else {}
        memory.add_node(name, CALIBRATION, target=camera, method=method, forced=force, views=views, **moves)
        memory.add_edge(MIND, name, "has")
    return name


def request_undo(memory: Memory, camera: str = "") -> str:
    """Ask that a camera be believed again where it was before its last calibration; else like `request_calibration`."""
    with memory.batch():
        name = request_calibration(memory, camera)
        memory.update_node(name, undo=True)
    return name


def read_report(memory: Memory, name: str) -> Report | None:
    """Read the outcome of a request, or of an event `calibrated`, by the name of its node; None if there is none yet.

    None before a request is answered, and if it was refused before anything could be computed.
    """
    node: Node | None = memory.get_node(name)
    text = None if node is None else node.get("report")
    try:
        return None if not text else decoded(text, "report", _report_decoder.decode)
    except WireError:
        return None


def provisional(memory: Memory, camera: str) -> tuple[str, Report] | None:
    """How a camera came to a pose that is provisional: the request, which nobody made, and its report; else None."""
    node = memory.get_node(camera)
    if node is None or node.get("mount") not in (PROVISIONAL, CONFIRMED):
        return None
    for request in memory.nodes(CALIBRATION):
        report = read_report(memory, request.name) if request.get("source") == SURPRISE else None
        if report is not None and report.provisional and report.camera == camera and _holds(memory, report):
            return request.name, report
    return None


def _holds(memory: Memory, report: Report) -> bool:
    """Whether a camera still is where a report says that it is."""
    edge = memory.get_edge(report.parent, report.camera, "RT")
    pose = None if edge is None else edge.get("pose")
    return pose is not None and SAME_POSE.covers(pose, pose_of(report.after))


def pose_of(numbers: Sequence[float], covariance: Sequence[float] = ()) -> Pose:
    """A pose of a report, with its covariance if that is told. Raises `ValueError` for numbers that are none."""
    x, y, z, qx, qy, qz, qw = numbers
    pose = Pose((x, y, z), (qx, qy, qz, qw))
    return pose.with_covariance(np.reshape(covariance, (6, 6))) if len(covariance) else pose


def checked_method(name: str) -> str:
    """The name of a method. Raises `ConfigError` for an unknown one."""
    return checked_name(CALIBRATION_METHODS, name, METHODS)


def method_names() -> list[str]:
    """Names of all methods that there are."""
    return [*METHODS, *provided(CALIBRATION_METHODS)]
