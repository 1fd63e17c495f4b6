"""The agent between ROS and the memory: opens the connection, and lets each part do its step."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import msgspec

from agents.ros_bridge.bridge.config import RosBridgeConfig
from agents.ros_bridge.bridge.core import SENSOR, BridgeCore
from agents.ros_bridge.bridge.in_detections import DetectionsIn
from agents.ros_bridge.bridge.in_sensors import CamerasIn, CloudsIn, JointsIn
from agents.ros_bridge.bridge.in_tf import TfIn
from agents.ros_bridge.bridge.out_beliefs import BeliefsOut
from agents.ros_bridge.bridge.out_sensors import ImagesOut, JointsOut
from agents.ros_bridge.bridge.out_status import ClockOut, DiagnosticsOut, EventsOut
from agents.ros_bridge.bridge.out_tf import TfOut
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.bridge.times import TimeSource
from agents.ros_bridge.bridge.turns import Turns
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import LinkConfig, RosLink
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.mapping.names import FrameNames
from agents.ros_bridge.mapping.stamps import CLOCK, to_seconds
from agents.ros_bridge.messages.types import types_of
from agents.ros_bridge.services.questions import Questions
from dsr.agent import Access, Agent
from dsr.connecting import identity_of
from dsr.errors import ConfigError, WireError
from dsr.vocabulary.intrinsics import INTRINSICS
from dsr.vocabulary.relations import THINGS
from dsr.vocabulary.replayed import decode_replayed, replayed_key

_JOINTS = ("joint_names", "joint_positions", "joint_velocities")
_LOOK = 1.0
"""s between two looks at what may be wrong with the connection"""
_NUMBER = re.compile(r"[0-9]+")


def _writes(config: RosBridgeConfig) -> Access:
    """What a bridge with this configuration may write."""
    receive = config.receive
    nodes, edges = {"world", "body", *config.types.values()}, {"RT"}
    attributes: set[str] = set()
    if config.serves:  # one of the services asks for missions
        nodes |= {"mind", "intention"}
        edges |= {"has"}
        attributes |= {"goal", "maintain", "priority", "status"}
    if receive.joints:
        nodes |= {"robot"}
        attributes |= set(_JOINTS)
    if receive.cameras:
        nodes |= {"camera"}
        attributes |= set(INTRINSICS)
    if receive.cameras or receive.clouds:
        attributes |= {"stream"}
    if receive.detections:
        nodes |= {*THINGS, *(type for one in receive.detections.values() for type in one.types.values())}
        attributes |= {"perceived", "last_seen", "size"}
    return Access(nodes=tuple(sorted(nodes)), edges=tuple(sorted(edges)), attributes=tuple(sorted(attributes)))


class RosBridge(Agent):
    """Lets a robot that speaks ROS 2 take part in the memory, and ROS see what the memory holds.

    Frames, joints, images, clouds and detections come in; beliefs, frames, joints, images, diagnostics and events go
    out, and questions are answered as services. What came from ROS is never sent back, nor the other way round.
    """

    name = "ros_bridge"
    rate_hz = 50.0
    reads = Access(nodes=("*",), edges=("*",), attributes=("*",))
    writes = _writes(RosBridgeConfig())
    publishes = ("blob/*",)
    Config = RosBridgeConfig
    config: RosBridgeConfig
    connect: ClassVar[Callable[[LinkConfig, str], RosLink]] = staticmethod(open_link)
    """Opens the connection to ROS."""

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> type[Agent]:
        """This class, which may write no more than it receives."""
        try:
            read = msgspec.convert(dict(config), RosBridgeConfig)
        except msgspec.ValidationError:
            return cls  # the error is told where the agent is made
        told = {"writes": _writes(read), "__module__": cls.__module__, "__doc__": cls.__doc__}
        return type(cls.__name__, (cls,), told)

    def setup(self) -> None:
        """Connect to ROS, and announce all that is bridged.

        Raises:
            ConfigError: for names, types or a release of ROS that there are not, or a connection that is not allowed.
            RosLinkError: if ROS cannot be reached now.
        """
        try:
            self._connect()
        except RosMessageError as error:
            raise ConfigError(str(error)) from error

    def _connect(self) -> None:
        config = self.config
        self._closing = contextlib.ExitStack()
        self._tally = Tally(self.clock, self.log)
        self.counts = self._tally.counts
        self._looked = -math.inf
        self._turns = Turns(self.clock, self.wake)
        self._problem = self._hint = ""
        self._lasting: set[str] = set()
        """Problems of the last look, without numbers; and of these, those that are logged"""
        self._logged: set[str] = set()
        self._lost: dict[str, int] = {}
        link = type(self).connect(config.link, config.node)
        self._closing.callback(link.close)
        if identity_of(self.name) is not None:
            self.log.warning("this graph is secured, and ROS is not: %s", "; ".join(link.unauthenticated()))
        self._times = TimeSource(self.clock, config.clock, self._tally)
        names = FrameNames(config.world_frame)
        self._core = core = BridgeCore(
            self.memory, link, types_of(config.link.distro), names, self._times, self._tally, self.clock, self.name,
            self._turns,
        )  # fmt: skip
        self._closing.callback(core.close)
        replay = self.bus.subscribe(replayed_key(self.keys), self._on_replay, newest=1)
        self._closing.callback(replay.close)
        self._clock_in = core.inbox("/clock", CLOCK, 1, SENSOR) if self._times.follows else None
        self._tf_out = TfOut(core, config.send, [names.node(frame) for frame in config.roots])
        self._tf_in = TfIn(core, config, self._tf_out) if config.receive.tf else None
        self._sensors_in = (CamerasIn(core, config), CloudsIn(core, config))
        self._joints_in, self._detections_in = JointsIn(core, config), DetectionsIn(core, config)
        self._beliefs_out = BeliefsOut(core, config.send)
        self._images_out = ImagesOut(core, config.send, {*config.receive.cameras, *config.receive.clouds})
        self._joints_out, self._events_out = JointsOut(core, config.send), EventsOut(core, config.send)
        self._diagnostics_out = DiagnosticsOut(core, config.send, self.bus, self.keys, lambda: self.last_status)
        self._clock_out = ClockOut(core, config.send)
        self._questions = Questions(core, config.send, self.bus, self.keys) if config.serves else None
        if self._questions is not None:
            core.on_close(self._questions.close)

    def tick(self, now: float) -> None:
        """Take what came from ROS, then send what is new in the memory."""
        with self._turns.tick():
            self._take_and_send(now)
            self._tell_problems()

    def _take_and_send(self, now: float) -> None:
        self._clock_out.update()
        self._hear_clock()
        if self._tf_in is not None:
            self._tf_in.update(now)
        for sensors in self._sensors_in:
            sensors.update()
        self._joints_in.update(now)
        self._detections_in.update(now)
        self._tf_out.update()
        self._joints_out.update()
        self._events_out.update()
        self._beliefs_out.update()
        self._images_out.update(now)
        self._diagnostics_out.update()
        if self._questions is not None:
            self._questions.update()

    def teardown(self) -> None:
        """Leave ROS."""
        if hasattr(self, "_closing"):
            self._closing.close()

    @property
    def told(self) -> list[str]:
        """Each kind of trouble that there was, once, in words."""
        return self._tally.told

    def _hear_clock(self) -> None:
        if self._clock_in is None:
            return
        for message in self._clock_in.take():
            try:
                ros = to_seconds(self._core.types.decode(CLOCK, message.cdr).clock)
            except RosMessageError as error:
                self._tally.tell("malformed", "/clock", f"a message on /clock was dropped: {error}")
                continue
            self._times.hear(ros, message.at)

    def _on_replay(self, key: str, payload: bytes) -> None:
        with contextlib.suppress(WireError):
            self._times.replay(decode_replayed(payload).stamp)

    def _tell_problems(self) -> None:
        now = self.clock.monotonic()
        if now - self._looked >= _LOOK:
            self._looked = now
            problems, self._hint = self._core.link.problems(), self._unattached()
            self._problem = "; ".join(problems)
            self._log_lasting([*problems, *filter(None, [self._hint])])
            self._tell_lost()
        told = [text for text in (self._problem, self._tally.trouble) if text]
        self.degraded = "; ".join(told) or self._hint

    def _log_lasting(self, problems: list[str]) -> None:
        """Log each problem that is there for the second time in a row, once until it is gone; numbers in it may change.

        The first look comes before there can be a connection.
        """
        kinds = {_NUMBER.sub("", problem): problem for problem in problems}
        for kind, problem in kinds.items():
            if kind in self._lasting and kind not in self._logged:
                self.log.warning("%s", problem)
        self._logged = {kind for kind in kinds if kind in self._lasting}
        self._lasting = set(kinds)

    def _tell_lost(self) -> None:
        """What did not arrive since the last look: each once in the log, and in the status for a while."""
        for name, number in self._core.link.lost().items():
            if new := number - self._lost.get(name, 0):
                self._lost[name] = number
                text = f"{number} messages of {name} did not arrive: they came too fast, or a link broke"
                self._tally.tell(f"lost on {name}", name, text, new)

    def _unattached(self) -> str:
        frame = self._tf_in.unattached if self._tf_in is not None else ""
        if not frame:
            return "" if self._times.is_known else "nobody publishes /clock, which this bridge follows"
        return f"frame {frame!r} hangs from nothing: set world_frame = {frame!r}, or its pose among `roots`"
