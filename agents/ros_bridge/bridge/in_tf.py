"""From `/tf` and `/tf_static` into RT edges: who writes which frame, which stamps count, and what is refused."""

from __future__ import annotations

import math

import msgspec

from agents.ros_bridge.bridge.config import RosBridgeConfig
from agents.ros_bridge.bridge.core import BridgeCore
from agents.ros_bridge.bridge.frame_nodes import MOST_FRAMES
from agents.ros_bridge.bridge.inbox import Arrived, RosInbox
from agents.ros_bridge.bridge.out_tf import TfOut
from agents.ros_bridge.bridge.stamping import usable_stamp
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.names import BELIEF
from agents.ros_bridge.mapping.transforms import is_same, read_transform
from agents.ros_bridge.messages.tf_batches import TfBatch, TfDecoder
from agents.ros_bridge.messages.transforms import TF_MESSAGE
from dsr.errors import CycleError, DsrError
from dsr.frames.tree import WORLD
from dsr.math3d.transforms import Pose

TF, TF_STATIC = "/tf", "/tf_static"
_MOST_WAITING = 2000
"""Messages of tf that wait for a tick: a flood of 100 000 a second fills no more"""
_HEARD = 1.0
"""s after which a publisher of a frame that is silent has given it up"""
_MOST_BACK = 1.0
"""s by which a stamp may be older than the last before a clock counts as set back, and not a message as late"""
_AGAIN = 1.0
"""s until an edge that was refused is tried again, and until parents are looked at again"""
_STATIC_QOS = Qos(transient_local=True, depth=100)


class _Frame(msgspec.Struct):
    """What is known of one frame that comes from ROS."""

    child: str
    parent: str
    spelled: tuple[str, str]
    """Parent and child as the messages name them"""
    writer: bytes
    heard: float
    """s, our monotonic time of its last message"""
    stamp: float
    """s, of its newest transform"""
    batch: TfBatch | None = None
    """The message with the newest transform, until that is written"""
    row: int = 0
    """Its place in the message"""
    written: float = -math.inf
    """s, our time when it was last written"""
    shown: Pose | None = None
    """As it was last written"""
    refused_until: float = -math.inf


class TfIn:
    """Writes the transforms of ROS.

    Args:
        core: of the bridge.
        config: of the bridge.
        out: what we publish ourselves, which is never taken back.
    """

    def __init__(self, core: BridgeCore, config: RosBridgeConfig, out: TfOut) -> None:
        self._core = core
        self._config = config
        self._out = out
        self._period = 1.0 / config.most_hz
        self._decoder = TfDecoder()
        self._frames: dict[str, _Frame] = {}
        self._known: dict[str, _Frame] = {}
        """The same by their names in messages, as far as nobody else writes them"""
        self._waiting: dict[str, _Frame] = {}
        """Those with a transform that is not written yet"""
        self._looked = -math.inf
        self.unattached = ""
        """The frame from which others hang, and which hangs from nothing; empty if there is none"""
        self._inboxes: list[tuple[bool, RosInbox]] = []
        """Whether it is of static frames, and the inbox"""
        for static, name, qos in ((True, TF_STATIC, _STATIC_QOS), (False, TF, Qos(depth=100))):
            self._inboxes.append((static, core.inbox(name, TF_MESSAGE, _MOST_WAITING, qos, self._update_now)))

    def _update_now(self) -> None:
        with self._core.memory.batch():
            self.update(self._core.clock.now())

    def update(self, now: float) -> None:
        """Take what came, and write what is due at time `now` (s)."""
        for static, inbox in self._inboxes:
            for message in inbox.take():
                self._read(message, static)
        monotonic = self._core.clock.monotonic()
        if self._waiting:
            self._write_due(now, monotonic)
        if monotonic - self._looked >= _AGAIN:
            self._looked = monotonic
            self._look_at_parents()

    # ---- reading

    def _read(self, message: Arrived, static: bool) -> None:
        writer = message.writer
        try:
            batch = self._decoder.decode(message.cdr, writer)
        except RosMessageError as error:
            self._core.tally.tell("malformed", TF, f"a message of tf was dropped: {error}")
            return
        heard, waiting = self._core.clock.monotonic(), self._waiting
        told, stamp = -1.0, 0.0
        for row, ((parent, child), then) in enumerate(zip(batch.names, batch.stamps, strict=True)):
            if not static and then != told:
                found = usable_stamp(self._core, then, message.at, restamp=self._config.restamp, subject=child)
                if found is None:
                    continue
                told, stamp = then, found
            frame = self._known.get(child)
            if frame is None or frame.spelled[0] != parent or frame.writer != writer:
                frame = self._looked_up(parent, child, writer, heard, stamp)
                if frame is None:
                    continue
            elif not static and stamp <= frame.stamp and not self._is_newer(frame, stamp):
                continue
            frame.heard, frame.stamp, frame.batch, frame.row = heard, stamp, batch, row
            waiting[frame.child] = frame

    def _looked_up(self, ros_parent: str, ros_child: str, writer: bytes, heard: float, stamp: float) -> _Frame | None:
        """The frame of a transform that comes from elsewhere than its last one; None if it does not count."""
        core = self._core
        if self._is_belief(ros_parent, ros_child):
            return None
        try:
            parent, child = core.names.node(ros_parent), core.names.node(ros_child)
        except RosMessageError as error:
            core.tally.tell("malformed", ros_child, f"a transform was dropped: {error}")
            return None
        if self._is_echo(parent, child):
            return None
        frame = self._frames.get(child)
        if frame is None and len(self._frames) >= MOST_FRAMES:
            core.tally.tell("too many frames", TF, f"more than {MOST_FRAMES} frames on tf: further ones are dropped")
            return None
        if frame is None:
            frame = self._frames[child] = _Frame(child, parent, ("", ""), writer, heard, stamp)
        elif not self._may_write(frame, parent, child, writer, heard) or (stamp and not self._is_newer(frame, stamp)):
            return None
        elif frame.parent != parent:
            self._leave_parent(child, frame, parent)
        self._known.pop(frame.spelled[1], None)
        frame.writer, frame.spelled = writer, (ros_parent, ros_child)
        self._known[ros_child] = frame
        return frame

    def _is_belief(self, ros_parent: str, ros_child: str) -> bool:
        """Whether a frame is a belief of the memory, or hangs from one."""
        if ros_child.lstrip("/").startswith(BELIEF):
            self._core.tally.count("own frames passed on")
            return True
        if not ros_parent.lstrip("/").startswith(BELIEF):
            return False
        self._core.tally.tell(
            "frames below beliefs", ros_child,
            f"frame {ros_child!r} hangs from {ros_parent!r} in ROS: what hangs from a belief is not received",
        )  # fmt: skip
        return True

    def _is_echo(self, parent: str, child: str) -> bool:
        """Whether we publish this frame ourselves: it is never taken back, whoever sends it."""
        published = self._out.parent_of(child)
        if published is None:
            return False
        if published == parent:
            self._core.tally.count("own frames passed on")
        else:
            self._core.tally.tell(
                "frames with two parents", child,
                f"frame {child!r} hangs from {published!r} in the memory, and somebody in ROS hangs it from "
                f"{parent!r}: the memory's holds",
            )  # fmt: skip
        return True

    def _may_write(self, frame: _Frame, parent: str, child: str, writer: bytes, heard: float) -> bool:
        """Whether this writer's word counts: of two who write one frame, with different parents the first one's."""
        if writer == frame.writer or not writer or not frame.writer or heard - frame.heard > _HEARD:
            return True
        who = f"two publishers write frame {child!r}"
        if parent == frame.parent:
            self._core.tally.tell("frames with two writers", child, f"{who}: the newest transform wins")
            return True
        refused = f"{who}, below {frame.parent!r} and below {parent!r}: the first one holds while it is heard"
        self._core.tally.tell("frames with two parents", child, refused)
        return False

    def _is_newer(self, frame: _Frame, stamp: float) -> bool:
        if stamp > frame.stamp:
            return True
        if frame.stamp - stamp > _MOST_BACK:
            back = f"the clock behind frame {frame.child!r} was set back by {frame.stamp - stamp:.1f} s"
            self._core.tally.tell("clock set back", frame.child, back)
            return True
        self._core.tally.count("late or repeated transforms")
        return False

    # ---- writing

    def _write_due(self, now: float, monotonic: float) -> None:
        held: dict[str, _Frame] = {}
        moved: list[tuple[_Frame, Pose]] = []
        due = now - self._period * (1.0 - _EARLY)
        waiting, self._waiting = self._waiting, held
        with self._core.memory.batch():
            for child, frame in waiting.items():
                if frame.written > due or monotonic < frame.refused_until:
                    held[child] = frame
                elif frame.batch is not None and (pose := self._pose(frame, frame.batch)) is not None:
                    if frame.shown is None:
                        self._write(frame, pose, now, monotonic)
                    elif pose.stamp != 0.0 or frame.shown.stamp != 0.0 or not is_same(frame.shown, pose):
                        moved.append((frame, pose))
            if moved:
                self._move(moved, now, monotonic)

    def _pose(self, frame: _Frame, batch: TfBatch) -> Pose | None:
        """The newest pose, which is not waiting any more; None if it is none."""
        try:
            return read_transform(*frame.spelled, batch.numbers[frame.row], frame.stamp)
        except RosMessageError as error:
            self._core.tally.tell("malformed", frame.child, f"a transform was dropped: {error}")
            return None
        finally:
            frame.batch = None

    def _move(self, moved: list[tuple[_Frame, Pose]], now: float, monotonic: float) -> None:
        """Write frames that were written before: at once, or each by itself if something is in the way of one."""
        try:
            self._core.memory.update_poses("RT", {(frame.parent, frame.child): pose for frame, pose in moved})
        except DsrError:
            for frame, pose in moved:
                self._write(frame, pose, now, monotonic)
            return
        for frame, pose in moved:
            frame.shown, frame.written = pose, self._written(frame, now)
        self._core.tally.count("edges written", len(moved))

    def _write(self, frame: _Frame, pose: Pose, now: float, monotonic: float) -> None:
        memory, child = self._core.memory, frame.child
        try:
            if frame.shown is None:
                if not self._is_free(child, frame.parent):
                    self._put_off(frame, pose, monotonic)
                    return
                for name in (frame.parent, child):
                    self._ensure(name)
                self._out.received.add(child)
            memory.add_edge(frame.parent, child, "RT", pose=pose)
        except CycleError as error:
            self._core.tally.tell("loops", child, f"tf has a loop, and an edge was not written: {error}")
            self._put_off(frame, pose, monotonic)
        except DsrError as error:
            self._core.tally.tell("not written", child, f"frame {child!r} was not written: {error}")
            self._put_off(frame, pose, monotonic)
        else:
            frame.shown, frame.written = pose, self._written(frame, now)
            self._core.tally.count("edges written")

    def _written(self, frame: _Frame, now: float) -> float:
        """The time (s) that counts as that of a write: what came a little late makes the next one wait no longer."""
        is_on_time = 0.0 <= now - frame.written < 2.0 * self._period
        return frame.written + self._period if is_on_time else now

    def _put_off(self, frame: _Frame, pose: Pose, monotonic: float) -> None:
        """Try this pose again later, or a newer one if that comes: of a static transform there may be no other."""
        if frame.shown is None:
            self._out.received.discard(frame.child)
        frame.refused_until = monotonic + _AGAIN
        frame.batch, frame.row = TfBatch([frame.spelled], [pose.stamp], [(*pose.t, *pose.q)]), 0
        self._waiting[frame.child] = frame

    def _ensure(self, name: str) -> None:
        memory, ros_frame = self._core.memory, self._core.names.frame(name)
        self._core.frames.ensure(name, self._config.types.get(ros_frame, "body"))
        root = self._config.roots.get(ros_frame)
        if root is not None and not memory.edges("RT", dst=name):
            self._core.frames.ensure(WORLD)
            memory.add_edge(WORLD, name, "RT", pose=root.pose())

    def _is_free(self, child: str, parent: str) -> bool:
        """Whether nobody but us hangs this frame anywhere in the memory; what we left behind elsewhere is removed."""
        memory = self._core.memory
        for edge in memory.edges("RT", dst=child):
            if self._core.came_from_ros(edge, "pose"):
                if edge.src != parent:
                    memory.remove_edge(edge.src, child, "RT")
            else:
                same = "" if edge.src != parent else " as well"
                self._core.tally.tell(
                    "frames of the memory", child,
                    f"frame {child!r} hangs from {edge.src!r} in the memory, and from {parent!r} in ROS{same}: "
                    "the memory's holds",
                )  # fmt: skip
                return False
        return True

    def _leave_parent(self, child: str, frame: _Frame, parent: str) -> None:
        """The frame's own writer hangs it elsewhere from now on."""
        self._core.tally.count("frames that changed their parent")
        if frame.shown is not None:
            self._core.memory.remove_edge(frame.parent, child, "RT")
        frame.parent, frame.shown, frame.refused_until = parent, None, -math.inf

    # ---- once a second

    def _look_at_parents(self) -> None:
        """Who else writes our frames meanwhile, and which frame hangs from nothing."""
        memory = self._core.memory
        self.unattached = ""
        parents: dict[str, None] = {}
        self._known = {name: frame for name, frame in self._known.items() if self._out.parent_of(frame.child) is None}
        for child, frame in self._frames.items():
            if frame.shown is None:
                continue
            others = memory.edges("RT", dst=child)
            if len(others) > 1 or (others and not self._core.came_from_ros(others[0], "pose")):
                frame.shown = None  # so that it is looked at before it is written again
                self._out.received.discard(child)
                if others[0].src == frame.parent and len(others) == 1:
                    continue
                mine = memory.get_edge(frame.parent, child, "RT")
                if mine is not None and self._core.came_from_ros(mine, "pose"):
                    memory.remove_edge(frame.parent, child, "RT")
            elif not others:
                frame.shown = None
            parents[frame.parent] = None
        for parent in parents:
            if self._hangs_from_nothing(parent):
                self.unattached = self._core.names.frame(parent)

    def _hangs_from_nothing(self, parent: str) -> bool:
        """Whether a frame from which others hang is neither the world, nor above it, nor hangs anywhere."""
        memory = self._core.memory
        if parent == WORLD or parent in self._frames or memory.edges("RT", dst=parent):
            return False
        return memory.get_transform(WORLD, parent) is None


_EARLY = 0.1
"""Share of the period by which a transform may come before its time, so that a regular one is not passed over"""
