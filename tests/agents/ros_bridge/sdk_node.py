"""A node of `zenoh-ros2-sdk`, an rmw_zenoh client that others wrote, as a process: JSON commands, one a line.

Imports nothing of this project. Definitions and hashes of types come with the commands.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import threading
import time

import numpy as np
from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2ServiceServer, ROS2Subscriber, ZenohSession

SUCCEEDED, CANCELED = 4, 5


def names(message):
    return [field.name for field in dataclasses.fields(message) if not field.name.startswith("__")]


def plain(value):
    if dataclasses.is_dataclass(value):
        return {name: plain(getattr(value, name)) for name in names(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, list) else value


class Commands:
    def __init__(self, port):
        self.session = ZenohSession.get_instance("127.0.0.1", port)
        self.place = {"router_ip": "127.0.0.1", "router_port": port}
        self.got, self.publishers, self.kept = {}, {}, []
        self.threads, self.ended = [], threading.Event()
        self.actions, self.repeated = {}, {}

    def define(self, definitions):
        for type, definition in definitions.items():
            self.session.register_message_type(definition, type)

    def build(self, type, values):
        """A message of nested lists and dictionaries."""
        store = self.session.store
        arguments = []
        for name, (node, inner) in store.fielddefs[type][1]:
            value = values[name]
            if node == 2:
                value = self.build(inner, value)
            elif node in (3, 4):
                (of, what), _ = inner
                if isinstance(value, dict):  # a large array, as a file of its bytes
                    value = np.fromfile(value["file"], what[0])
                elif of == 2:
                    value = [self.build(what, item) for item in value]
                elif what[0] != "string":
                    value = np.array(value, what[0])
            arguments.append(value)
        return store.types[type](*arguments)

    def subscribe(self, topic, type, hash, definition, qos=None):
        got = self.got.setdefault(topic, [])
        self.kept.append(
            ROS2Subscriber(topic, type, lambda message: got.append(plain(message)), msg_definition=definition,
                           type_hash=hash, qos=qos, **self.place)
        )  # fmt: skip

    def received(self, topic):
        return self.got[topic]

    def advertise(self, topic, type, hash, definition, node="talker"):
        self.publishers[topic] = ROS2Publisher(
            topic, type, msg_definition=definition, type_hash=hash, node_name=node, **self.place
        )

    def publish(self, topic, values, count=1, hz=0.0):
        publisher = self.publishers[topic]
        message = self.build(publisher.msg_type, values)
        fields = {name: getattr(message, name) for name in names(message)}
        for _ in range(count):
            publisher.publish(**fields)
            if hz:
                time.sleep(1.0 / hz)

    def repeat(self, messages, hz):
        """Send messages, by topic, again and again, each time with one present stamp."""
        sent = []
        for topic, values in messages.items():
            publisher = self.publishers[topic]
            sent.append((publisher, self.build(publisher.msg_type, values)))
            self.repeated[topic] = sent[-1][1]

        def run():
            due = time.monotonic()
            while not self.ended.wait(max(due - time.monotonic(), 0.0)):
                now = divmod(time.time_ns(), 10**9)
                for publisher, message in sent:
                    for part in getattr(message, "transforms", [message]):
                        part.header.stamp.sec, part.header.stamp.nanosec = now
                    publisher.publish(**{name: getattr(message, name) for name in names(message)})
                due = max(due + 1.0 / hz, time.monotonic())

        self.start(run)

    def start(self, run):
        thread = threading.Thread(target=run, daemon=True)
        self.threads.append(thread)
        thread.start()

    def close(self):
        self.ended.set()
        for thread in self.threads:
            thread.join()
        self.session.close()

    def call(self, name, type, hash, request, response, values, timeout=5.0):
        client = ROS2ServiceClient(name, type, request, response, type_hash=hash, timeout=timeout, **self.place)
        try:
            asked = self.build(client.request_store_type, values)
            return plain(client.call(**{name: getattr(asked, name) for name in names(asked)}))
        finally:
            client.close()

    def serve_sums(self, name, hash):
        """Adds two numbers."""

        def answer(request):
            return server.response_msg_class(sum=request.a + request.b)

        server = ROS2ServiceServer(
            name, "example_interfaces/srv/AddTwoInts", answer, "int64 a\nint64 b", "int64 sum", type_hash=hash,
            **self.place,
        )  # fmt: skip
        self.kept.append(server)

    def serve_action(self, name, type, hashes, definitions):
        """A server of any action, whose goals go as they are planned with `plan`; else they succeed after a second."""
        types = {"send_goal": f"{type}_SendGoal", "get_result": f"{type}_GetResult",
                 "cancel_goal": "action_msgs/srv/CancelGoal"}  # fmt: skip
        action = self.actions[name] = Action()
        feedback = ROS2Publisher(
            f"{name}/_action/feedback", f"{type}_FeedbackMessage", msg_definition=definitions["feedback"],
            type_hash=hashes["feedback"], **self.place,
        )  # fmt: skip
        store = self.session.store

        def zero(type):
            values = {}
            for field, (node, inner) in store.fielddefs[type][1]:
                if node == 2:
                    values[field] = zero(inner)
                elif node == 1:
                    values[field] = "" if inner[0] == "string" else 0
                else:
                    values[field] = [0] * inner[1] if node == 3 else []
            return values

        def work(id):
            goal = action.goals[id]
            took, begun = goal["plan"].get("seconds", 1.0), time.monotonic()
            go_on = self.way(goal["goal"].trajectory, action.joints) if action.joints else lambda share: None
            while (share := (time.monotonic() - begun) / took) < 1.0 and not goal["cancelled"].wait(0.05):
                go_on(share)
                values = zero(f"{type}_FeedbackMessage")
                values["goal_id"]["uuid"] = list(id)
                if "joint_names" in values["feedback"]:
                    values["feedback"]["joint_names"] = ["joint_1"]
                message = self.build(f"{type}_FeedbackMessage", values)
                feedback.publish(goal_id=message.goal_id, feedback=message.feedback)
            if not goal["cancelled"].is_set():
                go_on(1.0)
            goal["done"].set()

        def serve(kind):
            server = ROS2ServiceServer(
                f"{name}/_action/{kind}", types[kind], None, definitions[f"{kind}_request"],
                definitions[f"{kind}_response"], type_hash=hashes[kind], mode="queue", **self.place,
            )  # fmt: skip
            self.kept.append(server)

            def finish(key, id):
                goal = action.goals[id]
                goal["done"].wait()
                time.sleep(goal["plan"].get("late", 0.0))
                stopped = goal["cancelled"].is_set()
                status = CANCELED if stopped else goal["plan"].get("status", SUCCEEDED)
                said = goal["plan"].get("stopped" if stopped else "result", {})
                result = self.build(f"{type}_Result", {**zero(f"{type}_Result"), **said})
                server.send_response(key, server.response_msg_class(status=status, result=result))

            def run():
                while True:
                    key, request = server.take_request()
                    if kind == "cancel_goal":
                        id = bytes(request.goal_info.goal_id.uuid)
                        for one in action.goals if id == bytes(16) else [id]:
                            action.goals[one]["cancelled"].set()
                        answer = server.response_msg_class(return_code=0, goals_canceling=[request.goal_info])
                    elif kind == "send_goal":
                        plan = action.plans.pop(0) if action.plans else {}
                        accepted = plan.get("accept", True)
                        action.asked.append(plain(request.goal))
                        if accepted:
                            id = bytes(request.goal_id.uuid)
                            action.goals[id] = {
                                "plan": plan, "cancelled": threading.Event(), "done": threading.Event(),
                                "goal": request.goal,
                            }  # fmt: skip
                            threading.Thread(target=work, args=(id,), daemon=True).start()
                        stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
                        answer = server.response_msg_class(accepted=accepted, stamp=stamp)
                    else:
                        id = bytes(request.goal_id.uuid)
                        threading.Thread(target=finish, args=(key, id), daemon=True).start()
                        continue
                    server.send_response(key, answer)

            threading.Thread(target=run, daemon=True).start()

        for kind in types:
            serve(kind)

    def way(self, trajectory, topic):
        """Lets the joints that a topic tells go a share of the straight way to the end of a trajectory."""
        told = self.repeated[topic]
        places = [list(told.name).index(joint) for joint in trajectory.joint_names]
        begin, end = told.position[places], trajectory.points[-1].positions

        def go_on(share):
            told.position[places] = begin + share * (end - begin)

        return go_on

    def plan(self, name, goals):
        """How the next goals of an action go: `accept`, `seconds`, `late` (s), `status`, `result`, `stopped`."""
        self.actions[name].plans += goals

    def move(self, name, joints):
        """From now on the joints that are told again and again on a topic go where trajectories of this action lead."""
        self.actions[name].joints = joints

    def asked(self, name):
        """The goals that came, and how many of those accepted were cancelled."""
        action = self.actions[name]
        return {"goals": action.asked, "cancelled": sum(goal["cancelled"].is_set() for goal in action.goals.values())}


class Action:
    """What one action server knows of its goals."""

    def __init__(self):
        self.plans, self.asked, self.goals, self.joints = [], [], {}, ""


def say(answer):
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main():
    commands = Commands(int(sys.argv[1]))
    say("ready")
    for line in sys.stdin:
        command = json.loads(line)
        try:
            answer = {"ok": getattr(commands, command.pop("do"))(**command)}
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        say(answer)
    commands.close()


if __name__ == "__main__":
    main()
