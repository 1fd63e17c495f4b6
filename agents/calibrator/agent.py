"""Calibrates cameras, on request and by itself: collects views, solves, writes the camera's RT edge and an event."""

from __future__ import annotations

from collections.abc import Mapping

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.calibrate import calibrate
from agents.calibrator.solve.reporting import encoded, make_report, refusal, tell
from agents.calibrator.watch.doubt import believed_now
from agents.calibrator.watch.looking import Looking, can_look
from agents.calibrator.watch.undoing import taken_back
from agents.calibrator.watch.views import Views, only_camera
from agents.calibrator.watch.watch import MountWatch
from dsr.agent import Access, Agent
from dsr.errors import ConfigError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.timeline import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES, Chronicle
from dsr.vocabulary.calibration import (
    ADOPTED,
    ANSWERED,
    CALIBRATION,
    DEFAULT_METHOD,
    LOOKING,
    REFUSED,
    SURPRISE,
    Report,
    checked_method,
    pose_of,
)
from dsr.vocabulary.relations import THINGS

_MOST_VIEWS = 32


class Calibrator(Agent):
    """Calibrates cameras, those that an arm carries and those on a stand, on request (`dsr.vocabulary.calibration`).

    What a request's camera sees from now on is compared with the belief. The pose of the camera that makes them agree
    is written as its RT edge, with covariance and without a stamp: it holds at all times. Where the geometry is weak,
    or no pose of the camera explains what is seen, it is not, unless the request is forced. A restarted calibrator
    begins afresh with what is not answered yet. When the simulation handler explains that a camera moved, that is
    looked into without a request, see `MountWatch`.
    """

    name = "calibrator"
    rate_hz = 10.0
    shares_process = True
    reads = Access(
        nodes=(CALIBRATION, "camera", "arm", "gripper", "action", *THINGS, *WRITTEN_NODES),
        edges=("RT", "Virtual_RT", "grasping", "on", "in", *WRITTEN_EDGES),
        attributes=(
            *("target", "method", "forced", "views", "moves_arm", "undo", "status", "present", "mount"),
            *("surprising", "source", "request", "changes", "arm", "controller", "gripper"),
            *WRITTEN_ATTRIBUTES,
        ),
    )
    writes = Access(
        nodes=("mind", "camera", "action", CALIBRATION, *WRITTEN_NODES),
        edges=("RT", "has", *WRITTEN_EDGES),
        attributes=(
            *("target", "method", "forced", "views", "moves_arm", "status", "explanation", "report", "mount", "source"),
            *("skill", "target_pose", "request", "arm"),
            *WRITTEN_ATTRIBUTES,
        ),
        exclusive=("mount",),
    )
    Config = CalibratorConfig
    config: CalibratorConfig

    def setup(self) -> None:
        """Nothing is being looked at yet."""
        self._views: dict[str, Views] = {}
        self._began: dict[str, float] = {}
        self._answered: dict[str, float] = {}
        self._looking: dict[str, Looking] = {}
        self._chronicle = Chronicle(self.memory, self.name)
        self._watch = MountWatch(self.memory, self._chronicle, self.config, self.log) if self.config.by_itself else None

    def tick(self, now: float) -> None:
        """Go on with what is in doubt, and with each request."""
        if self._watch is not None:
            self._watch.update(now)
        requests = {node.name: node for node in self.memory.nodes(CALIBRATION)}
        self._move_arms(requests)
        for known in (self._views, self._began, self._answered):
            for name in known.keys() - requests.keys():
                del known[name]
        for name, node in sorted(requests.items()):
            if node.get("source") == SURPRISE and node.get("status") not in ANSWERED:
                continue
            if node.get("status") in ANSWERED:
                if self._watch is not None and self._watch.needs(name):
                    continue
                if now - self._answered.setdefault(name, now) > self.config.keep:
                    self.memory.remove_node(name)
                continue
            try:
                self._pursue(node, now)
            except ConfigError as error:
                self._refuse(name, str(error))

    def _pursue(self, node: Node, now: float) -> None:
        """Look on; once there is enough, answer. Raises `ConfigError` for what can never be answered."""
        name, wanted = node.name, int(node.get("views", 1))
        if node.get("undo") is True:
            self._undo(node)
            return
        if name not in self._views:
            checked_method(node.get("method", DEFAULT_METHOD))
            if not 1 <= wanted <= _MOST_VIEWS:
                raise ConfigError(f"views {wanted}: expected 1 to {_MOST_VIEWS}")
            camera = node.get("target") or only_camera(self.memory)
            moves = node.get("moves_arm") is True
            believed = believed_now(self.memory) if moves else None  # later they follow what is seen from elsewhere
            depths = {} if self._watch is None else self._watch.depths_of(camera)
            views = Views(self.memory, camera, now, self.config, believed, depths, keeps_brief=wanted == 1)
            if wanted > 1 and not moves and views.parent == WORLD:
                raise ConfigError(f"{camera} stands still: {wanted} views of it are the same")
            self._views[name] = views
            self._began[name] = now
        views = self._views[name]
        views.update()
        waited = now - self._began[name]
        if views.complete and views.complete < wanted and node.get("moves_arm") is True:
            self._look_around(name, views, wanted - 1)
        is_over = waited > self.config.views_patience or (name in self._looking and self._looking[name].is_over)
        if views.complete >= wanted or (views.complete and is_over):
            self._answer(node, views, wanted)
        elif not views.complete and now - max(views.latest, self._began[name]) > self.config.patience:
            raise ConfigError(refusal(views.skipped, now - self._began[name]))
        else:
            progress = f"{views.complete} of {wanted} views"
            if (node.get("status"), node.get("explanation")) != (LOOKING, progress):
                self.memory.update_node(name, status=LOOKING, explanation=progress)

    def _look_around(self, name: str, views: Views, most: int) -> None:
        """Have the arm bring the camera to other places. Raises `ConfigError` without an arm that could."""
        if name in self._looking:
            return
        if not can_look(self.memory, views.parent):
            raise ConfigError(f"no arm is there that moves {views.camera}, which is fixed to {views.parent}")
        self._looking[name] = Looking(
            self.memory, views.parent, views.camera, views.middle, lambda: views.complete, self.config, most
        )

    def _move_arms(self, requests: Mapping[str, Node]) -> None:
        """Go on with the moves of arms; home with those whose request is answered or gone."""
        for name, looking in list(self._looking.items()):
            is_open = name in requests and requests[name].get("status") not in ANSWERED
            if not is_open and not looking.goes_home:
                looking.go_home()
            looking.update()
            if looking.is_over and not is_open:
                del self._looking[name]

    def _answer(self, node: Node, views: Views, wanted: int) -> None:
        """Solve, and adopt or refuse. Raises `ConfigError` if there is nothing to solve."""
        camera = views.camera
        edge = self.memory.get_edge(views.parent, camera, "RT")
        before = None if edge is None else edge.get("pose")
        sightings = views.sightings(complete=wanted > 1)
        if before is None:
            raise ConfigError(f"{camera} was taken off {views.parent} meanwhile")
        if not sightings:
            raise ConfigError("nothing that is seen is believed to stand still")
        solution = calibrate(sightings, before, node.get("method", DEFAULT_METHOD))
        if views.complete < wanted and node.get("forced") is not True:
            raise ConfigError(f"only {views.complete} of {wanted} views came in time; --force makes do with them")
        forced = node.get("forced") is True
        adopted, unchanged = solution.is_adoptable or forced, solution.confirms and not forced
        report = make_report(camera, views.parent, solution, adopted=adopted, unchanged=unchanged)
        with self.memory.batch():
            if adopted and not unchanged:
                self.memory.add_edge(views.parent, camera, "RT", pose=solution.pose)
                tell(self._chronicle, report)
            self._close(node.name, ADOPTED if adopted else REFUSED, report.text, report)
        self.log.info("%s", report.text)

    def _undo(self, node: Node) -> None:
        """Write the pose from before the last calibration. Raises `ConfigError` if there is none to take back."""
        report = taken_back(self.memory, self._chronicle, node.get("target") or only_camera(self.memory))
        with self.memory.batch():
            pose = pose_of(report.after, report.covariance)
            self.memory.add_edge(report.parent, report.camera, "RT", pose=pose)
            if self._watch is not None:
                self._watch.settle(report.camera)
            tell(self._chronicle, report)
            self._close(node.name, ADOPTED, report.text, report)
        self.log.info("%s", report.text)

    def _refuse(self, name: str, why: str) -> None:
        self.log.warning("%s: %s", name, why)
        self._close(name, REFUSED, why, None)

    def _close(self, name: str, status: str, why: str, report: Report | None) -> None:
        text = {} if report is None else {"report": encoded(report)}
        self.memory.update_node(name, status=status, explanation=why, **text)
        self._views.pop(name, None)
