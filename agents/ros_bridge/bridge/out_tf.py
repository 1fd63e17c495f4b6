"""From edges RT and Virtual_RT to `/tf` and `/tf_static`: what did not come from ROS, one parent for each frame."""

from __future__ import annotations

from collections.abc import Collection

from agents.ros_bridge.bridge.config import Send
from agents.ros_bridge.bridge.core import LATCHED, BridgeCore
from agents.ros_bridge.bridge.stamping import Upcoming
from agents.ros_bridge.bridge.throttle import Throttle
from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.names import BELIEF
from agents.ros_bridge.mapping.transforms import is_same, to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, StampedTransform, encode_transforms
from dsr.crdt.delta import Write
from dsr.frames.tree import WORLD
from dsr.graph.elements import Edge, Node
from dsr.math3d.transforms import Pose

_STALE = 1.0
"""s by which the newest sample below another parent must be newer before a frame changes its parent in tf"""
_MOST_AT_ONCE = 500
"""Transforms of one message"""
_RT, _BELIEVED = "RT", "Virtual_RT"
_POSE = "pose"

EdgeKey = tuple[str, str, str]
"""Parent, child and type"""


class TfOut:
    """Publishes what changes in the memory, each sample once.

    Args:
        core: of the bridge.
        config: what is sent.
        roots: nodes that the bridge itself hangs into the world: ROS does not know these edges.
    """

    def __init__(self, core: BridgeCore, config: Send, roots: Collection[str] = ()) -> None:
        self._core = core
        self._roots = frozenset(roots)
        self._published: dict[tuple[str, str], tuple[str, Pose]] = {}
        """Parent and newest pose by edge type and child"""
        self._static: dict[tuple[str, str], StampedTransform] = {}
        self._upcoming: Upcoming[EdgeKey, Write] = Upcoming(core)
        """Newest poses that are of a time to come, one at most of each edge that there is"""
        self._throttle = Throttle(core.clock, config.tf_hz)
        self.received: set[str] = set()
        """Nodes whose edges RT the bridge itself writes: changes of these are not looked at"""
        types = [type for type, wanted in ((_RT, config.tf), (_BELIEVED, config.belief)) if wanted]
        if types:
            self._outlet = core.outlet("/tf", TF_MESSAGE, Qos(depth=100))
            self._latched = core.outlet("/tf_static", TF_MESSAGE, LATCHED)
            self._watch = core.memory.watch(
                edge_type=types, attribute="pose", notify=self._changed, where=self._is_of_others
            )
            core.on_close(self._watch.close)
        self._sends = bool(types)

    def parent_of(self, child: str) -> str | None:
        """The node from which we hang a frame in tf; None if we do not publish it."""
        published = self._published.get((_RT, child))
        return None if published is None else published[0]

    def _is_of_others(self, element: Node | Edge) -> bool:
        return not (isinstance(element, Edge) and element.type == _RT and element.dst in self.received)

    def _changed(self) -> None:
        if self._throttle.is_due:  # else it waits for a tick
            self._core.turns.notify()

    def update(self) -> None:
        """Send what changed since the last message, if it is time."""
        if not self._sends or not self._throttle.is_due:
            return
        dynamic: list[StampedTransform] = []
        latched = False
        for change in self._watch.poll():
            key = change.src, change.dst, change.type
            latched |= self._forget(*key) if change.kind == "removed" else self._look(key, dynamic)
        for key, write in self._upcoming.due():
            edge = self._core.memory.get_edge(*key)
            if edge is not None and self._is_of_others(edge):
                latched |= self._add(edge, write, dynamic)
                latched |= self._look(key, dynamic)  # it may have changed while this one waited
        self._send(dynamic, latched=latched)

    def _look(self, key: EdgeKey, dynamic: list[StampedTransform]) -> bool:
        """Add the newest pose of an edge to what is sent, if its time has come. Whether static ones changed."""
        edge = self._core.memory.get_edge(*key)
        write = None if edge is None else edge.newest_write(_POSE)
        if edge is None or write is None or not isinstance(write.value, Pose):
            self._upcoming.drop(key)
            return False
        return not self._upcoming.waits(key, write.value.stamp, write, edge.dst) and self._add(edge, write, dynamic)

    def _add(self, edge: Edge, write: Write, dynamic: list[StampedTransform]) -> bool:
        """Add a pose of an edge to what is sent, if it is to be. Whether static ones changed."""
        pose: Pose = write.value
        if not self._is_to_be_sent(edge, pose, write):
            return False
        try:
            transform = self._transform(edge, pose)
        except RosMessageError as error:
            self._core.tally.tell("not sent", edge.dst, f"frame {edge.dst!r} was not sent: {error}")
            return False
        if pose.stamp == 0.0:
            self._static[edge.type, edge.dst] = transform
            return True
        dynamic.append(transform)
        return self._static.pop((edge.type, edge.dst), None) is not None

    def _send(self, dynamic: list[StampedTransform], *, latched: bool) -> None:
        """Send what is new, and if these changed all static ones."""
        if dynamic or latched:
            self._throttle.take()
        for begin in range(0, len(dynamic), _MOST_AT_ONCE):
            self._outlet.send_cdr(encode_transforms(dynamic[begin : begin + _MOST_AT_ONCE]))
        if latched:
            self._latched.send_cdr(encode_transforms(self._static.values()))

    def _forget(self, parent: str, child: str, type: str) -> bool:
        """An edge is gone. Whether it was static: who comes late is not to be told of it.

        Who is there keeps its last transform for as long as tf keeps any.
        """
        self._upcoming.drop((parent, child, type))
        if self._published.get((type, child), ("",))[0] != parent:
            return False
        del self._published[type, child]
        return self._static.pop((type, child), None) is not None

    def _is_to_be_sent(self, edge: Edge, pose: Pose, write: Write) -> bool:
        """Not what came from ROS, nor a sample twice, nor one below a parent that is not the frame's in tf."""
        own_root = edge.src == WORLD and edge.dst in self._roots
        if not self._core.wants((edge.src, edge.dst)) or (self._core.is_of_bridge(write) and not own_root):
            return False
        key = edge.type, edge.dst
        published = self._published.get(key)
        if published is not None:
            parent, newest = published
            if parent != edge.src:
                if pose.stamp - newest.stamp <= _STALE and pose.stamp != 0.0:
                    self._core.tally.count("further parents not sent")
                    return False
            elif pose.stamp == newest.stamp and (pose.stamp != 0.0 or is_same(pose, newest)):
                return False
        self._published[key] = edge.src, pose
        return True

    def _transform(self, edge: Edge, pose: Pose) -> StampedTransform:
        core = self._core
        parent, child = core.names.frame(edge.src), core.names.frame(edge.dst)
        if edge.type == _RT and child.startswith(BELIEF):
            raise RosMessageError(f"node {edge.dst!r} has the name of something that is believed")
        if edge.type == _BELIEVED:
            child = BELIEF + child
            if core.memory.edges(_BELIEVED, dst=edge.src):
                parent = BELIEF + parent
        return to_stamped(parent, child, 0.0 if pose.stamp == 0.0 else core.times.to_ros(pose.stamp), pose)
