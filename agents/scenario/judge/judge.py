"""Watches a run from outside, through the working memory and the truth on the bus, and judges it."""

from __future__ import annotations

import contextlib
import logging
from typing import Any, Literal

import msgspec

from agents.scenario.format.expectations import Attribute, Edges
from agents.scenario.format.model import Scenario
from agents.scenario.judge.course import missing_events
from agents.scenario.judge.found_names import FoundNames
from agents.scenario.judge.metrics import curves, measure
from agents.scenario.judge.overload import moment, overload
from agents.scenario.judge.result import Result
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.judge.worlds import WorldWatch
from agents.scenario.truth.history import Error, Explained, History, Inferred, LateTicks, MissionState, Sample
from dsr.errors import TransformError, WireError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.decoding import decoded
from dsr.network.keys import BASE, Keys
from dsr.network.transport import Transport
from dsr.runtime.status import State, decode_status
from dsr.vocabulary.calibration import CALIBRATED
from dsr.vocabulary.intentions import FULFILLED, GIVEN_UP
from dsr.vocabulary.observed_actions import read_action

_Seven = tuple[float, float, float, float, float, float, float]


class TruthReader(msgspec.Struct, frozen=True):
    """One instant of the true world."""

    stamp: float
    """Time of the instant, s."""
    objects: dict[str, _Seven]
    """Poses by name: position (m) and quaternion (x, y, z, w) in the world frame."""
    held: str | None = None
    """Object in the first arm's gripper."""
    apart: float | None = None
    """m, the least distance between two arms since the instant before; None if they were far apart"""
    moving: frozenset[str] = frozenset()
    """Names of the objects that do not lie still."""
    in_view: frozenset[str] = frozenset()
    """Objects whose tag the camera could see in its last frame."""
    grasped: dict[str, str] = {}
    """Objects that are held, and by what: the node of a gripper or a hand, or `unknown` for the experimenter."""
    moves: dict[int, tuple[float, float | None]] = {}
    """Begin and end (s after the start) of each move, by the number of its event in the file (from 1)."""
    given_up: dict[int, str] = {}
    """Reasons why moves could not be carried out, by the event's number."""
    hands: dict[int, tuple[tuple[float, float, float], ...]] = {}
    """21 landmarks (m, world) of each human hand in the scene, by number."""
    camera: dict[str, _Seven] = {}
    """world_from_camera of the scenario's camera, by the plant's name of it."""
    touched: dict[str, str] = {}
    """Objects on which fingertips of a human hand just lie, and the node of the hand."""
    pinched: dict[str, str] = {}
    """What each human hand grasps, by the node of the hand."""

    def poses(self) -> dict[str, Pose]:
        """world_from_object of each object."""
        return {name: Pose(seven[:3], seven[3:], self.stamp) for name, seven in self.objects.items()}

    def cameras(self) -> dict[str, Pose]:
        """world_from_camera of each camera, by the name of its node."""
        return {f"camera_{name}": Pose(seven[:3], seven[3:], self.stamp) for name, seven in self.camera.items()}


_decoder = msgspec.msgpack.Decoder(TruthReader)


def decode_truth(payload: bytes) -> TruthReader:
    """The truth in a message; raises `WireError`. Fields unknown here are ignored."""
    return decoded(payload, "truth", _read)


def _read(payload: bytes) -> TruthReader:
    truth = _decoder.decode(payload)
    truth.poses()
    truth.cameras()
    return truth


def frame_keys(keys: Keys) -> tuple[str, ...]:
    """Keys with a message for each frame that was looked at, or, of cameras that tell poses, that came."""
    return keys.blob("*/detections"), keys.device("camera/*/poses")


_log = logging.getLogger("scenario.judge")


class Judge:
    """Collects truth, percepts and beliefs.

    Args:
        scenario: what is expected.
        memory: a replica of its own; only read.
        bus: where the plant's truth and the agents' statuses are heard.
        keys: of the same graph.
        live: whether time passes by itself. In lockstep no frame is late, and none is noted.
    """

    def __init__(
        self, scenario: Scenario, memory: Memory, bus: Transport, keys: Keys, *, live: bool = False
    ) -> None:
        self.history = History(scenario)
        self.dropped = 0
        """Messages that were no valid truth or status."""
        self._memory = memory
        self._worlds = WorldWatch(scenario, memory)
        self.names = FoundNames(scenario, memory)
        """Which nodes are which objects."""
        self.triggered: dict[int, float] = {}
        """By the number of an event that the runner carries out: when its condition came true, s after the start."""
        self._start = 0.0
        self._truth: bytes | None = None
        self._flagged: set[str] = set()
        self._running: set[tuple[str, str]] = set()
        self._intentions: dict[str, tuple[str, str, int]] = {}
        self._told: set[tuple[str, float]] = set()
        self._subscriptions = [
            bus.subscribe(keys.truth(), self._on_truth),
            bus.subscribe(keys.status(), self._on_status),
            *(bus.subscribe(key, self._on_frame) for key in frame_keys(keys) if live),
        ]

    def begin(self, start: float) -> None:
        """The scenario starts at `start` (s); nothing before it counts."""
        self._start = start
        self.history = History(self.history.scenario)

    def sample(self) -> None:
        """Note the present state of the memory beside the newest truth, if that is new.

        Flags that rise and fall between two truths count for the second one.
        """
        self._flagged |= {name for spec in self.history.scenario.objects if self._is_surprising(name := spec.name)}
        payload, self._truth = self._truth, None
        if payload is None:
            return
        try:
            truth = decode_truth(payload)
        except WireError as error:
            self._drop(error)
            return
        if truth.stamp >= self._start:
            time = truth.stamp - self._start
            self.history.add(self._look(time, truth))
            self._note_moves(truth)
            self._follow_mind(time)
        self._flagged.clear()

    def is_over(self, time: float) -> bool:
        """Whether the run may end at `time` (s after the start): see the scenario's `linger`."""
        history, linger = self.history, self.history.scenario.linger
        if linger is None or missing_events(history):
            return False
        ends = [end for _, end in history.spans.values() if end is not None]
        if history.scenario.mission is not None:
            state = history.mission(time)
            if state is None or state.status not in (*FULFILLED, *GIVEN_UP):
                return False
            ends.append(state.time)
        over = time > moment(history, max(ends), linger, time) if ends else False
        if over:
            history.end = time
        return over

    def result(
        self,
        seed: int,
        mode: Literal["live", "lockstep"],
        sensor: Literal["pixels", "poses"],
        policy: str | None = None,
        hands: Literal["model", "colour"] | None = None,
    ) -> Result:
        """The verdicts and numbers of the finished run."""
        scenario = self.history.scenario
        verdicts = [judge_check(check, self.history) for check in scenario.expectations]
        passed = all(verdict.passed for verdict in verdicts)
        metrics, notes = measure(self.history)
        return Result(
            scenario=scenario.name,
            seed=seed,
            mode=mode,
            sensor=sensor,
            policy=policy,
            hands=hands,
            passed=passed,
            expectations=verdicts,
            metrics=metrics,
            curves=curves(self.history),
            notes=notes,
            overload=overload(self.history, passed=passed),
        )

    def close(self) -> None:
        """Stop listening; harmless when repeated."""
        for subscription in self._subscriptions:
            subscription.close()

    def _look(self, time: float, truth: TruthReader) -> Sample:
        poses = truth.poses()
        self.names.update(poses)
        nodes = {spec.name: node for spec in self.history.scenario.objects if (node := self._node(spec.name))}
        percepts = _present({name: self._memory.get_transform(WORLD, node.name) for name, node in nodes.items()})
        beliefs = _present({name: self._belief(node.name) for name, node in nodes.items()})
        percepts, _ = self.names.as_true(percepts, nodes, poses)
        beliefs, sizes = self.names.as_true(beliefs, nodes, poses)
        return Sample(
            time=time,
            truth=poses,
            percepts=percepts,
            beliefs=beliefs,
            sizes=sizes,
            perceived={name: bool(node.get("perceived", False)) for name, node in nodes.items()},
            edges=frozenset((edge.type, *map(self.names.object, (edge.src, edge.dst))) for edge in self._relations()),
            attributes=self._attributes(),
            held=truth.held,
            grasped=truth.grasped,
            apart=truth.apart,
            touched=truth.touched,
            pinched=truth.pinched,
            hands={f"human_hand_{number}": landmarks for number, landmarks in truth.hands.items()},
            moving=truth.moving,
            in_view=truth.in_view,
            surprising=frozenset(self._flagged),
            camera_error=self._camera_error(truth),
            absent=frozenset(name for name, node in nodes.items() if not node.get("present", True)),
            worlds=self._worlds.look(),
        )

    def _note_moves(self, truth: TruthReader) -> None:
        events = self.history.scenario.events
        by_runner = {number for number, event in enumerate(events, start=1) if event.by_runner}
        self.triggered = {number: begin for number, (begin, _) in truth.moves.items() if number in by_runner}
        self.history.spans = {number: span for number, span in truth.moves.items() if number not in by_runner}
        self.history.given_up = truth.given_up

    def _follow_mind(self, time: float) -> None:
        """Note what has changed about intentions, and new explanations."""
        history = self.history
        for node in self._memory.nodes("intention"):
            values = (node.get("status", ""), node.get("explanation", ""), node.get("replans", 0))
            if self._intentions.get(node.name) != values:
                self._intentions[node.name] = values
                history.missions.append(MissionState(time, node.name, *values))
        for node in self._memory.nodes("event"):
            key = (node.name, node.get("time", 0.0))
            if key not in self._told:
                self._told.add(key)
                self._note_event(node, time)

    def _note_event(self, node: Node, time: float) -> None:
        """An explanation or an action that is in the memory since `time`; other events are not judged."""
        action = read_action(node)
        if action is not None:
            action = action._replace(time=action.time - self._start)
            self.history.actions.append(Inferred(action, time, node.get("confidence", 1.0)))
        elif node.get("kind") == CALIBRATED:
            self.history.calibrations.append((time, node.get("text", "")))
        elif "explanation" in node:
            self.history.explanations.append(Explained(time, node.name, node["explanation"]))

    def _is_surprising(self, name: str) -> bool:
        node = self._node(name)
        return node is not None and bool(node.get("surprising", False))

    def _node(self, name: str) -> Node | None:
        """The node of an object."""
        return self._memory.get_node(self.names.node(name))

    def _belief(self, name: str) -> Pose | None:
        return self._memory.get_pose("world", name, "Virtual_RT")

    def _camera_error(self, truth: TruthReader) -> Error | None:
        """Of the scenario's camera."""
        for name, pose in truth.cameras().items():
            if self._memory.get_node(name) is None:
                continue  # where nobody perceives, as in a true course: an error of every sample would be slow
            with contextlib.suppress(TransformError):
                return Error(*self._memory.transform("world", name, at=truth.stamp).distance(pose))
        return None

    def _relations(self) -> list[Any]:
        checks = [check for check in self.history.scenario.expectations if isinstance(check, Edges)]
        kinds = {check.type for check in checks if check.world == BASE}
        return [edge for kind in sorted({"on", "in", "grasping", *kinds}) for edge in self._memory.edges(kind)]

    def _attributes(self) -> dict[tuple[str, str], Any]:
        wanted = [check for check in self.history.scenario.expectations if isinstance(check, Attribute)]
        nodes = {(check.node, check.name): self._node(check.node) for check in wanted}
        return _present({key: node.get(key[1], None) for key, node in nodes.items() if node})

    def _on_truth(self, key: str, payload: bytes) -> None:
        self._truth = payload

    def _on_frame(self, key: str, payload: bytes) -> None:
        self.history.frames.append(self._memory.clock.now() - self._start)

    def _on_status(self, key: str, payload: bytes) -> None:
        try:
            status = decode_status(payload)
        except WireError as error:
            self._drop(error)
            return
        if status.overloaded:
            self.history.loads.append(LateTicks(status.stamp - self._start, status.agent, status.waiting))
        started = (status.agent, status.rid)
        if status.state in (State.READY, State.DEGRADED) and started not in self._running:
            self._running.add(started)
            self.history.agent_starts.append((status.stamp - self._start, status.agent))

    def _drop(self, error: WireError) -> None:
        self.dropped += 1
        if self.dropped == 1:
            _log.warning("dropped a message: %s (logged once)", error)


def _present(values: dict[Any, Any]) -> dict[Any, Any]:
    return {key: value for key, value in values.items() if value is not None}
