"""A real node of rclpy, run in `.venv-ros`: reads commands as JSON, one a line, and answers each with a line.

Imports nothing of this project: all that it knows of ROS is ROS's own.
"""

from __future__ import annotations

import bisect
import hashlib
import json
import queue
import sys
import threading
import time
from importlib import import_module
from math import acos, sin

import rclpy
from rclpy.action import ActionServer
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message

LARGE = 100_000  # bytes of pixels that are told by their hash


def message_class(name):
    """The class of `sensor_msgs/msg/Image`, or of a part of a service or action."""
    package, kind, short = name.split("/")
    owner, *parts = short.split("_")
    found = getattr(import_module(f"{package}.{kind}"), owner)
    if parts[:1] and parts[0] in ("SendGoal", "GetResult", "FeedbackMessage"):
        found = found.Impl
        found = getattr(found, {"SendGoal": "SendGoalService", "GetResult": "GetResultService"}.get(parts[0], parts[0]))
        parts = parts[1:]
    for part in parts:
        found = getattr(found, part)
    return found


def profile(reliable=True, transient_local=False, depth=10):
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if transient_local else DurabilityPolicy.VOLATILE,
    )


class Listener:
    """All transforms that came, as a tf2 buffer keeps them: by child, sorted by time."""

    def __init__(self, node):
        from tf2_msgs.msg import TFMessage

        self.samples = {}
        self.parents = {}
        self.static = set()
        node.create_subscription(TFMessage, "/tf", lambda message: self.take(message, False), profile(depth=100))
        node.create_subscription(
            TFMessage, "/tf_static", lambda message: self.take(message, True), profile(True, True, 100)
        )

    def take(self, message, static):
        for one in message.transforms:
            child = one.child_frame_id
            self.parents[child] = one.header.frame_id
            if static:
                self.static.add(child)
            moved, turned = one.transform.translation, one.transform.rotation
            stamp = one.header.stamp.sec * 10**9 + one.header.stamp.nanosec
            entry = (stamp, (moved.x, moved.y, moved.z), (turned.x, turned.y, turned.z, turned.w))
            bisect.insort(self.samples.setdefault(child, []), entry)

    def at(self, child, stamp):
        samples = self.samples[child]
        if child in self.static:
            return samples[-1][1:]
        place = bisect.bisect_left(samples, (stamp,))
        if place < len(samples) and samples[place][0] == stamp:
            return samples[place][1:]
        if place in (0, len(samples)):
            raise LookupError(f"{child} has no sample around {stamp}")
        (early, p, q), (late, to_p, to_q) = samples[place - 1], samples[place]
        share = (stamp - early) / (late - early)
        return tuple(a + share * (b - a) for a, b in zip(p, to_p, strict=True)), slerp(q, to_q, share)

    def lookup(self, target, source, stamp):
        """target_from_source, over the root that both have."""
        to_root = []
        for frame in (target, source):
            position, rotation = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
            place = frame
            while place in self.parents:
                moved, turned = self.at(place, stamp)
                position = add(moved, turn(turned, position))
                rotation = multiply(turned, rotation)
                place = self.parents[place]
            to_root.append((position, rotation))
        (p, q), (position, rotation) = to_root
        back = (-q[0], -q[1], -q[2], q[3])
        return turn(back, add(position, tuple(-x for x in p))), multiply(back, rotation)


def add(a, b):
    return tuple(x + y for x, y in zip(a, b, strict=True))


def multiply(a, b):
    x, y, z, w = a
    u, v, s, r = b
    return (w * u + x * r + y * s - z * v, w * v - x * s + y * r + z * u, w * s + x * v - y * u + z * r,
            w * r - x * u - y * v - z * s)  # fmt: skip


def turn(q, p):
    x, y, z, _ = multiply(multiply(q, (*p, 0.0)), (-q[0], -q[1], -q[2], q[3]))
    return x, y, z


def slerp(a, b, share):
    cosine = sum(x * y for x, y in zip(a, b, strict=True))
    if cosine < 0:
        b, cosine = tuple(-x for x in b), -cosine
    if cosine > 1 - 1e-12:
        mixed = tuple(x + share * (y - x) for x, y in zip(a, b, strict=True))
    else:
        angle = acos(cosine)
        weights = sin((1 - share) * angle) / sin(angle), sin(share * angle) / sin(angle)
        mixed = tuple(weights[0] * x + weights[1] * y for x, y in zip(a, b, strict=True))
    norm = sum(x * x for x in mixed) ** 0.5
    return tuple(x / norm for x in mixed)


class Commands:
    """What the node does when it is told to."""

    def __init__(self, node):
        self.node = node
        self.got = {}
        self.publishers = {}
        self.timers = []
        self.actions = []
        self.listener = None
        self.arm = None

    def subscribe(self, topic, type, **qos):
        got = self.got.setdefault(topic, [])

        def take(message):
            sample = {"at": time.time()}
            if len(getattr(message, "data", "")) > LARGE:  # its hash and the rest: padding between fields is random
                sample["sha256"] = hashlib.sha256(bytes(message.data)).hexdigest()
                message.data = []
            got.append({**sample, "cdr": serialize_message(message).hex()})

        self.node.create_subscription(message_class(type), topic, take, profile(**qos))

    def received(self, topic):
        return self.got[topic]

    def advertise(self, topic, type, **qos):
        self.publishers[topic] = (self.node.create_publisher(message_class(type), topic, profile(**qos)), type)

    def publish(self, topic, cdr, count=1, hz=0.0):
        """Send these messages in turn, `count` times in all; returns at once if there is a rate."""
        publisher, type = self.publishers[topic]
        messages = [deserialize_message(bytes.fromhex(text), message_class(type)) for text in cdr]
        if not hz:
            for number in range(count):
                publisher.publish(messages[number % len(messages)])
            return
        sent = 0

        def send():
            nonlocal sent
            if sent < count:
                publisher.publish(messages[sent % len(messages)])
                sent += 1

        self.timers.append(self.node.create_timer(1.0 / hz, send))

    def serve_action(self, name, type):
        """A real action server that succeeds at once."""

        def execute(goal):
            goal.succeed()
            return kind.Result()

        kind = message_class(type)
        self.actions.append(ActionServer(self.node, kind, name, execute))

    def play_arm(self, joints, held):
        """Controllers of an arm and of a gripper that something between its pads stops at `held` rad."""
        from controller import Arm

        self.arm = Arm(self.node, joints, held)

    def arm_now(self):
        """Where the joints and the gripper's joint are, and how the goals of the arm ended."""
        arm = self.arm
        return {"at": arm.at, "knuckle": arm.knuckle, "ended": arm.done, "moves": arm.goal is not None}

    def matched(self, topic):
        """How many subscribers our publisher of the topic has, and publishers there are for it."""
        return [self.node.count_subscribers(topic), self.node.count_publishers(topic)]

    def nodes(self):
        return sorted(self.node.get_node_names_and_namespaces())

    def topics(self):
        return self.node.get_topic_names_and_types()

    def publishers_of(self, topic):
        found = self.node.get_publishers_info_by_topic(topic)
        return [[one.node_namespace, one.node_name, one.topic_type, str(one.topic_type_hash)] for one in found]

    def encode(self, type, cdr):
        """What real ROS makes of a message: read, and written again."""
        return serialize_message(deserialize_message(bytes.fromhex(cdr), message_class(type))).hex()

    def listen(self):
        self.listener = Listener(self.node)

    def frames(self):
        return self.listener.parents

    def lookup(self, target, source, stamp):
        return self.listener.lookup(target, source, stamp)


def say(answer):
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main():
    rclpy.init()
    node = Node(sys.argv[1])
    commands = Commands(node)
    lines = queue.Queue()

    def read():
        for line in sys.stdin:
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    say("ready")
    while True:
        rclpy.spin_once(node, timeout_sec=0.002)
        try:
            line = lines.get_nowait()
        except queue.Empty:
            continue
        if line is None:
            break
        command = json.loads(line)
        try:
            answer = {"ok": getattr(commands, command.pop("do"))(**command)}
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        say(answer)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
