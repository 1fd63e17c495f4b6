"""Services that answer questions to the memory: transform, objects, what if, mission.

They are called from threads of the link; the memory may be read and written from any thread. What-if questions go out
with the bridge's ticks: so they are answered in lockstep, too, while the run goes on.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import msgspec

from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.bridge.throttle import Throttle
from agents.ros_bridge.errors import RosError, RosMessageError
from agents.ros_bridge.mapping.names import BELIEF
from agents.ros_bridge.mapping.stamps import to_header, to_seconds
from agents.ros_bridge.mapping.transforms import to_pose_with_covariance
from agents.ros_bridge.services.missions import EndedMissions
from dsr.clock import WALL_CLOCK
from dsr.errors import DsrError, GoalError, TransportError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.math3d.transforms import Pose
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.intentions import ACTIVE, add_intention, nobody_pursues
from dsr.vocabulary.relations import SURFACES, THINGS, is_present, nodes_by_name
from dsr.vocabulary.what_if import MAX_SECONDS, TIMEOUT, Answer, Pending, Question, WhatIf

TRIGGER, ASK, TRANSFORM = "std_srvs/srv/Trigger", "dsr_msgs/srv/Ask", "dsr_msgs/srv/Transform"
_STAMPED = "geometry_msgs/msg/PoseWithCovarianceStamped"
_LONGEST = 1 << 16
"""Characters of a question: of a goal about a thousand things, which takes a tenth of a second to be read"""
_MOST_MISSIONS = 100
"""Intentions that are not at their end, of whomever, up to which a node of ROS may ask for further ones"""
_PATIENCE = 2.0 * TIMEOUT
"""s by the machine's clock for which a caller waits, as `WhatIf.ask_and_wait`: a run in lockstep may stand still"""
_questions = msgspec.json.Decoder(Question)


class _Asked:
    """A what-if question whose caller waits."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.pending: Pending | None = None
        """Once it was asked"""
        self.done = threading.Event()


class Questions:
    """Serves `objects`, `transform`, `what_if` and `mission` below a namespace.

    Args:
        core: of the bridge.
        config: with the namespace, for example `/dsr`.
        bus: for what-if questions.
        keys: of the graph.
    """

    def __init__(self, core: BridgeCore, config: Send, bus: Transport, keys: Keys) -> None:
        self._core = core
        self._ended = EndedMissions(core, config.keep_missions)
        self._throttle = Throttle(core.clock, config.beliefs_hz)
        self._objects_found: dict[str, Any] = {}
        """The newest answer about objects"""
        namespace = config.services
        self._what_if = WhatIf(bus, keys, core.clock)
        self._ticks_in = threading.get_ident()
        self._lock = threading.Lock()
        self._waiting: list[_Asked] = []
        self._closed = False
        wanted: tuple[tuple[str, str, Callable[[Any], dict[str, Any]]], ...] = (
            ("objects", TRIGGER, self._objects),
            ("transform", TRANSFORM, self._transform),
            ("what_if", ASK, self._supposed),
            ("mission", ASK, self._mission),
        )
        self._served = [
            core.link.serve(f"{namespace}/{name}", type, self._answer(type, name, answer))
            for name, type, answer in wanted
        ]

    def update(self) -> None:
        """Ask what came since the last tick, pass on what was answered, and forget missions that ended long ago."""
        self._ended.update()
        with self._lock:
            waiting = list(self._waiting)
        for asked in waiting:
            if asked.pending is None:
                asked.pending = self._what_if.ask(asked.question)
            elif asked.pending.done:
                self._finish(asked)

    def close(self) -> None:
        """Answer no more; who waits hears that the bridge ends."""
        with self._lock:
            self._closed = True
            waiting = list(self._waiting)
        for asked in waiting:
            self._finish(asked)
        for served in self._served:
            served.close()

    def _answer(self, type: str, name: str, answer: Callable[[Any], dict[str, Any]]) -> Callable[[bytes], bytes]:
        """From request to response in CDR; a question that cannot be answered gets the reason."""
        types, text = self._core.types, "answer" if type == ASK else "message"

        def respond(request: bytes) -> bytes:
            self._core.tally.count(f"asked {name}")
            try:
                values = answer(types.decode(f"{type}_Request", request))
            except (DsrError, ValueError) as error:
                values = {"success": False, text: str(error)}
            return types.encode(f"{type}_Response", types.new(f"{type}_Response", **values))

        return respond

    def _objects(self, _: Any) -> dict[str, Any]:
        """All present things and surfaces as JSON: where they are believed to be, and what they rest on.

        Looked up no more often than beliefs are published, however often it is asked.
        """
        if self._throttle.take():
            nodes = nodes_by_name(self._core.memory, (*THINGS, *SURFACES))
            found = [self._described(node) for node in nodes if is_present(node)]
            self._objects_found = {"success": True, "message": msgspec.json.encode(found).decode()}
        return self._objects_found

    def _described(self, node: Node) -> dict[str, Any]:
        memory = self._core.memory
        pose = memory.get_transform(WORLD, node.name, types=BELIEVED)
        return {
            "name": node.name,
            "type": node.type,
            "frame": self._core.names.frame(node.name),
            "position": None if pose is None else pose.t,
            "rotation": None if pose is None else pose.q,
            "size": node.get("size"),
            "perceived": bool(node.get("perceived", False)),
            "on": sorted(edge.dst for edge in memory.edges("on", src=node.name)),
        }

    def _transform(self, request: Any) -> dict[str, Any]:
        core = self._core
        believed = any(name.lstrip("/").startswith(BELIEF) for name in (request.target, request.source))
        target, source = (core.names.node(_plain(name)) for name in (request.target, request.source))
        told = to_seconds(request.stamp)
        at = core.times.to_graph(told) if told else None
        pose = core.memory.transform(target, source, at=at, types=BELIEVED if believed else ("RT",))
        stamp = core.times.to_ros(pose.stamp) if pose.stamp else 0.0
        return {"success": True, "message": "", "pose": self._stamped(request.target, stamp, pose)}

    def _stamped(self, frame: str, stamp: float, pose: Pose) -> Any:
        types = self._core.types
        return types.new(_STAMPED, header=to_header(types, stamp, frame), pose=to_pose_with_covariance(types, pose))

    def _supposed(self, request: Any) -> dict[str, Any]:
        try:
            question = _questions.decode(_text(request.question))
        except msgspec.DecodeError as error:
            example = '{"seconds": 1.0, "changes": [{"object": "cube_3", "action": "remove"}]}'
            raise RosMessageError(f"no what-if question: {error}; expected JSON such as {example}") from error
        if not 0.0 <= question.seconds <= MAX_SECONDS:
            raise RosMessageError(f"seconds {question.seconds}: expected 0 to {MAX_SECONDS:g}")
        answer = self._asked(question)
        return {"success": True, "answer": msgspec.json.encode(answer).decode()}

    def _asked(self, question: Question) -> Answer:
        """The answer, once ticks have asked for it. Raises `TransportError` if there is none, and why."""
        if threading.get_ident() == self._ticks_in:
            raise TransportError("what if? who asks in the thread of a lockstep run waits for itself: use another one")
        asked = _Asked(question)
        with self._lock:
            if self._closed:
                raise TransportError("what if? the bridge ends")
            self._waiting.append(asked)
        self._core.turns.notify()
        if not WALL_CLOCK.wait(asked.done, _PATIENCE):
            self._finish(asked)
        pending = asked.pending
        if pending is None or pending.answer is None:
            why = "" if pending is None else pending.failed
            raise TransportError(f"what if? {why or 'no answer in time: does the run go on?'}")
        return pending.answer

    def _finish(self, asked: _Asked) -> None:
        with self._lock:
            if asked in self._waiting:
                self._waiting.remove(asked)
        asked.done.set()

    def _mission(self, request: Any) -> dict[str, Any]:
        memory, text = self._core.memory, _text(request.question)
        goal = parse_goal(text)
        unknown = [name for name in goal.things if name not in memory]
        if unknown:
            raise GoalError(text, text.find(unknown[0]), f"there is no {unknown[0]!r}")
        if sum(node.get("status") in ACTIVE for node in memory.nodes("intention")) >= _MOST_MISSIONS:
            raise RosError(f"{_MOST_MISSIONS} missions are not at their end: a further one is refused")
        name = add_intention(memory, text)
        return {
            "success": True,
            "answer": msgspec.json.encode({"intention": name, "note": nobody_pursues(memory)}).decode(),
        }


def _plain(frame: str) -> str:
    return frame.lstrip("/").removeprefix(BELIEF)


def _text(text: str) -> str:
    if len(text) > _LONGEST:
        raise RosMessageError(f"a question of {len(text)} characters: expected {_LONGEST} at most")
    return text
