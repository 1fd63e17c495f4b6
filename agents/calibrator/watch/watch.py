"""Calibrations that begin by themselves: the simulation handler explains that a camera moved, and so it is doubted."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.solve.reporting import encoded, make_report, tell
from agents.calibrator.watch.decision import Decision
from agents.calibrator.watch.depths import DepthError, Depths
from agents.calibrator.watch.displaced import LOOKBACK, Displaced
from agents.calibrator.watch.doubt import Doubt, Memories, believed_now
from agents.calibrator.watch.looking import SOURCE, Looking, Touch, can_look
from agents.calibrator.watch.own_requests import OwnRequests
from agents.calibrator.watch.refining import Refining
from agents.calibrator.watch.steps import REACH, Steps
from agents.calibrator.watch.surprises import CALM, Surprises
from agents.calibrator.watch.undoing import turned_round
from agents.calibrator.watch.views import Views
from dsr.errors import DsrError
from dsr.math3d.tolerance import SAME_POSE
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.timeline import Chronicle, Entry
from dsr.vocabulary.calibration import (
    ADOPTED,
    CALIBRATED,
    CONFIRMED,
    IN_DOUBT,
    PROVISIONAL,
    REFUSED,
    STEADY,
    pose_of,
    provisional,
)
from dsr.vocabulary.explained import CAMERA_MOVED, PUT_ON, changes_of
from dsr.vocabulary.perceived import camera_nodes

_FRESH = 1.0  # s for which a camera sees what it saw
_ASTRAY = 0.006  # m that a belief has moved, from which seeing it where it was will be surprising
_BACK = 3.0  # s within which that is explained


class _Stand(NamedTuple):
    """For how long it is taken for sure where a camera is, and what is said of it then."""

    until: float
    mount: str = STEADY
    why: str = ""
    believed: Mapping[str, Pose] = MappingProxyType({})
    """world_from_object, to which beliefs are led back meanwhile"""


class MountWatch:
    """Keeps `mount` of the cameras, and calibrates one that moved.

    Args:
        memory: the graph.
        chronicle: gets what was adopted or undone.
        config: when and how.
        log: for people.
    """

    def __init__(self, memory: Memory, chronicle: Chronicle, config: CalibratorConfig, log: logging.Logger) -> None:
        self._memory = memory
        self._chronicle = chronicle
        self._config = config
        self._log = log
        self._memories = Memories(max(config.lookback, REACH) + _FRESH)
        self._depths = Depths(memory)
        self._steps = Steps(memory)
        self._doubts: dict[str, Doubt] = {}
        self._requests = OwnRequests(memory, config.method)
        self._displaced = Displaced(memory, config)
        self._refining = Refining(memory, chronicle, config, log)
        self._stands: dict[str, _Stand] = {}
        self._looking: dict[str, Looking] = {}
        self._touches: dict[str, Touch] = {}
        self._untold: dict[str, set[str]] = {}
        """What a camera saw that did not tell whether it had moved."""
        self._surprises = Surprises(memory, chronicle)
        self._begin_afresh()

    def update(self, now: float) -> None:
        """Go on at time `now` (s)."""
        self._memories.note(self._memory, now)
        for entry in self._surprises.explanations():
            self._take_in(entry, now)
        self._displaced.update(now)
        self._refining.update(now)
        for node in camera_nodes(self._memory):
            if node.name not in self._doubts:
                self._depths.learn(node.name, now)
                self._depths.note(node.name, now, REACH + _FRESH)
            self._look_for_step(node.name, now)
            self._look_at_displaced(node.name, now)
        is_calm = self._surprises.are_over(now)
        for camera, doubt in list(self._doubts.items()):
            if camera not in self._memory:
                self._forget(camera)
                continue
            try:
                self._go_on(doubt, now, is_calm=is_calm)
            except DsrError as error:  # nothing carries it any more, or it is nowhere
                self._end(doubt, STEADY, str(error))
        for camera, looking in list(self._looking.items()):
            looking.update()
            if looking.is_over and self._mount(camera) != IN_DOUBT:
                del self._looking[camera]
        for camera, stand in list(self._stands.items()):
            if now >= stand.until and camera not in self._looking:
                del self._stands[camera]
                if self._mount(camera) == CONFIRMED:
                    self._tell(camera, stand.mount, stand.why)

    def _begin_afresh(self) -> None:
        """Of what an earlier run left open, doubts come back by themselves; provisional poses are watched on."""
        for node in camera_nodes(self._memory):
            if node.get("mount", STEADY) == PROVISIONAL and self._resume(node.name):
                continue
            if node.get("mount", STEADY) != STEADY:
                self._tell(node.name, STEADY, "the calibrator was restarted")
        self._requests.refuse_left_over()
        for node in list(self._memory.nodes("action")):
            if node.get("source") == SOURCE:
                self._memory.remove_node(node.name)

    def _resume(self, camera: str) -> bool:
        """Go on with a pose that an earlier run adopted provisionally, by what it told; whether that was possible."""
        if (told := provisional(self._memory, camera)) is None:
            return False
        request, report = told
        now, believed = self._memory.clock.now(), believed_now(self._memory)
        try:
            doubt = Doubt(self._memory, camera, now, self._config, believed, {})
            doubt.resume(pose_of(report.before), self._memory.transform("world", doubt.parent))
        except DsrError:
            return False
        self._doubts[camera] = doubt
        self._requests.resume(camera, request)
        if doubt.moved_alike is not None:
            self._touches[camera] = Touch(self._memory, believed, doubt.moved_alike)
        return True

    def needs(self, request: str) -> bool:
        """Whether what came out of a request of our own may still change."""
        return request in self._requests

    def depths_of(self, camera: str) -> Mapping[str, DepthError]:
        """The errors of depth with which a camera sees objects, by object."""
        return self._depths.of(camera)

    def settle(self, camera: str) -> None:
        """Somebody says where a camera is: for a while whatever it sees elsewhere has moved."""
        why = "stands where somebody says that it does"
        self._depths.forget(camera)
        self._stands[camera] = _Stand(self._memory.clock.now() + self._config.confirmed_for)
        if camera in self._doubts:
            self._end(self._doubts[camera], CONFIRMED, why)
        else:
            self._tell(camera, CONFIRMED, why)

    @property
    def doubts(self) -> Sequence[Doubt]:
        """Doubts that are open, or were adopted provisionally."""
        return tuple(self._doubts.values())

    # ---- into doubt

    def _take_in(self, entry: Entry, now: float) -> None:
        """What was put on something stands as high as that: no camera that moved shows it just there."""
        changes = changes_of(entry.details, entry.text)
        if any(change.kind == CAMERA_MOVED for change in changes):
            self._begin(entry, now)
            return
        put_on = {group[0] for change in changes if change.kind == PUT_ON for group in change.groups[:1] if group}
        self._note_displaced(entry.begin, [name for name in entry.participants if name not in put_on], now)

    def _begin(self, entry: Entry, now: float) -> None:
        """Doubt the cameras that see what is displaced."""
        time = entry.begin - self._config.lookback
        believed = self._memories.at(time)
        for node in camera_nodes(self._memory):
            if node.name not in self._stands and self._sees(node.name, entry.participants, now):
                self._doubt(node.name, entry.participants, now, believed, self._depths.at(node.name, time))

    def _note_displaced(self, begin: float, names: Sequence[str], now: float) -> None:
        """What is said to have moved at `begin` (s): more and more of that may be the camera, also one that was found
        out just now.
        """
        lately = self._memories.at(begin - LOOKBACK)
        for node in camera_nodes(self._memory):
            stand = self._stands.get(node.name)
            before = lately if stand is None else stand.believed
            for name in () if node.name in self._doubts else names:
                if self._sees(node.name, (name,), now):
                    self._displaced.add(node.name, name, before.get(name), self._depths.of(node.name), now)

    def _look_at_displaced(self, camera: str, now: float) -> None:
        views = None if camera in self._doubts else self._displaced.doubts(camera)
        if views is not None:
            names = sorted({one.name for one in views.sightings()})
            self._doubt(camera, names, now, {}, {}, views)

    def _look_for_step(self, camera: str, now: float) -> None:
        """Doubt a camera that sees all displaced alike by so little that beliefs just follow."""
        names = self._steps.found(camera, now)
        if names and self._mount(camera) in (STEADY, PROVISIONAL):
            time = now - REACH
            self._doubt(camera, names, now, self._memories.at(time), self._depths.at(camera, time))
            if camera in self._doubts:
                self._doubts[camera].is_slight = True

    def _doubt(
        self,
        camera: str,
        names: Sequence[str],
        now: float,
        believed: Mapping[str, Pose],
        depths: Mapping[str, DepthError],
        views: Views | None = None,
    ) -> None:
        """Look into it, unless that is being done."""
        doubt = self._doubts.get(camera)
        if doubt is not None and (self._mount(camera) == IN_DOUBT or doubt.looks_anew):
            return
        try:
            doubt = Doubt(self._memory, camera, now, self._config, believed, depths, views)
        except DsrError as error:
            self._log.warning("%s", error)
            return
        self._forget(camera)
        self._doubts[camera] = doubt
        self._requests.make(camera)
        self._tell(camera, IN_DOUBT, f"may have moved: {', '.join(names)} seem displaced alike")

    def _sees(self, camera: str, names: tuple[str, ...], now: float) -> bool:
        edges = (self._memory.get_edge(camera, name, "RT") for name in names)
        poses = (edge.get("pose") for edge in edges if edge is not None)
        return any(pose is not None and now - pose.stamp <= _FRESH for pose in poses)

    # ---- out of it

    def _go_on(self, doubt: Doubt, now: float, *, is_calm: bool) -> None:
        camera, mount = doubt.camera, self._mount(doubt.camera)
        if self._is_overtaken(doubt):
            self._depths.forget(camera)
            self._end(doubt, STEADY, "its pose was written by somebody else")
            return
        late = mount == IN_DOUBT and now - doubt.began > self._config.elsewhere_patience
        waits = doubt.is_open and mount == IN_DOUBT
        looking = self._looking.get(camera)
        late = late or (looking is not None and looking.is_over)
        decision = doubt.update(last=late and doubt.views > 1)
        if mount == PROVISIONAL and camera in self._touches:
            decision = decision or self._touches[camera].decide()
        if decision is not None:
            self._conclude(doubt, decision, now)
        elif waits and late:
            self._make_do(doubt)
        elif waits and looking is None and self._may_look(doubt):
            self._looking[camera] = Looking(
                self._memory, doubt.parent, camera, doubt.middle, lambda: doubt.views, self._config
            )
        elif mount == PROVISIONAL and doubt.looks_anew:
            self._tell(camera, IN_DOUBT, "sees things from elsewhere, which tells whether it moved")
        elif mount == IN_DOUBT and is_calm and now - doubt.began > CALM and doubt.decision is None:
            self._end(doubt, STEADY, "nothing seems displaced any more")

    def _is_overtaken(self, doubt: Doubt) -> bool:
        """Whether somebody else wrote the pose of the camera, such as a calibration on request."""
        edge, ours = self._memory.get_edge(doubt.parent, doubt.camera, "RT"), doubt.written or doubt.before
        pose = None if edge is None else edge.get("pose")
        return edge is not None and (pose is None or not SAME_POSE.covers(pose, ours))

    def _may_look(self, doubt: Doubt) -> bool:
        return self._config.moves_arm and doubt.can_look_elsewhere and can_look(self._memory, doubt.parent)

    def _conclude(self, doubt: Doubt, decision: Decision, now: float) -> None:
        camera = doubt.camera
        self._log.info("%s: %s", camera, decision.why)
        if decision.moved is False:
            self._restore(doubt, decision)
            if decision.is_idle or (doubt.is_slight and doubt.views == 1):
                self._end(doubt, STEADY, f"has not moved: {decision.why}", REFUSED)
                return
            self._stands[camera] = _Stand(now + self._config.confirmed_for)
            self._end(doubt, CONFIRMED, f"has not moved: {decision.why}", REFUSED)
        elif decision.moved and not decision.is_ambiguous:
            self._adopt(doubt)
            self._end(doubt, STEADY, "", ADOPTED)
            self._lead_back(doubt)
            self._refining.add(doubt, now)
        elif decision.moved and not doubt.can_look_elsewhere:
            self._adopt_provisionally(doubt, decision.why)
        else:
            self._tell(camera, IN_DOUBT, decision.why)

    def _make_do(self, doubt: Doubt) -> None:
        """No view from elsewhere came in time: take what is likelier, if there is any pose at all."""
        assert doubt.decision is not None
        if doubt.decision.moved:
            self._adopt_provisionally(doubt, f"{doubt.decision.why}; no view from elsewhere told")
            if doubt.camera in self._looking:
                self._looking[doubt.camera].go_home()
        else:
            self._give_up(doubt, doubt.decision.why)

    def _give_up(self, doubt: Doubt, why: str) -> None:
        """It stays where it was; if the same objects did not tell before, for sure."""
        names, before = {one.name for one in doubt.sightings}, self._untold.get(doubt.camera, set())
        self._untold[doubt.camera] = names
        if names <= before:
            self._stands[doubt.camera] = _Stand(self._memory.clock.now() + self._config.confirmed_for)
            self._end(doubt, CONFIRMED, f"is taken to stand where it was: {why}", REFUSED)
        else:
            self._end(doubt, STEADY, why, REFUSED)

    def _adopt_provisionally(self, doubt: Doubt, why: str) -> None:
        self._adopt(doubt)
        self._requests.answer(doubt, ADOPTED, provisional=True)
        self._tell(doubt.camera, PROVISIONAL, why)
        self._lead_back(doubt)
        if doubt.moved_alike is not None:
            self._touches[doubt.camera] = Touch(self._memory, doubt.believed(), doubt.moved_alike)

    def _lead_back(self, doubt: Doubt) -> None:
        """For a while it is sure where a camera is, if beliefs went astray before that was known: they return."""
        for name, before in doubt.believed().items():
            edge = self._memory.get_edge("world", name, "Virtual_RT")
            pose = None if edge is None else edge.get("pose")
            if pose is not None and pose.distance(before)[0] > _ASTRAY:
                camera = doubt.camera
                now, node = self._memory.clock.now(), self._memory.node(camera)
                why = str(node.get("explanation", ""))
                self._stands[camera] = _Stand(now + _BACK, self._mount(camera), why, doubt.believed())
                self._tell(camera, CONFIRMED, f"was found out; {name} and others were not seen rightly before")
                return

    def _adopt(self, doubt: Doubt) -> None:
        """Write the pose by all views up to now, unless it is written already."""
        assert doubt.solution is not None
        edge = self._memory.get_edge(doubt.parent, doubt.camera, "RT")
        if edge is not None and edge.get("pose") == doubt.solution.pose:
            return
        report = make_report(doubt.camera, doubt.parent, doubt.solution, adopted=True)
        self._write(doubt, doubt.solution.pose)
        tell(self._chronicle, report)
        self._log.info("%s", report.text)

    def _restore(self, doubt: Doubt, decision: Decision) -> None:
        """Take back a pose that was adopted provisionally."""
        edge = self._memory.get_edge(doubt.parent, doubt.camera, "RT")
        if edge is not None and edge.get("pose") != doubt.before:
            self._write(doubt, doubt.before)
            text = f"{doubt.camera} is where it was before after all: {decision.why}"
            adopted = self._requests.report(doubt.camera)
            if adopted is None and doubt.solution is not None:
                adopted = make_report(doubt.camera, doubt.parent, doubt.solution, adopted=True)
            told = None if adopted is None else encoded(turned_round(adopted, text))
            self._chronicle.happened(CALIBRATED, (doubt.camera,), text=text, report=told)
            self._log.info("%s", text)

    def _write(self, doubt: Doubt, pose: Pose) -> None:
        self._memory.add_edge(doubt.parent, doubt.camera, "RT", pose=pose.with_stamp(0.0))
        doubt.written = pose
        self._untold.pop(doubt.camera, None)

    def _end(self, doubt: Doubt, mount: str, why: str, status: str = REFUSED) -> None:
        self._requests.answer(doubt, status, why)
        self._tell(doubt.camera, mount, why)
        self._forget(doubt.camera)

    def _forget(self, camera: str) -> None:
        self._steps.forget(camera)
        self._doubts.pop(camera, None)
        self._touches.pop(camera, None)
        if camera in self._looking:
            self._looking[camera].go_home()
        self._requests.close(camera)
        self._refining.forget(camera)
        self._displaced.forget(camera)

    # ---- small things

    def _mount(self, camera: str) -> str:
        node = self._memory.get_node(camera)
        return STEADY if node is None else str(node.get("mount", STEADY))

    def _tell(self, camera: str, mount: str, why: str) -> None:
        node = self._memory.get_node(camera)
        if node is not None and (node.get("mount", STEADY), node.get("explanation", "")) != (mount, why):
            self._memory.update_node(camera, mount=mount, explanation=why)
            if mount != STEADY:
                self._log.info("%s: %s, %s", camera, mount, why)
