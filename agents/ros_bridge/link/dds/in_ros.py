"""Asks services in a process of an installed ROS, for a link over DDS: JSON commands, one a line, and answers.

Vendors of DDS do not understand each other's requests, so the robot's own `rclpy` asks. The Python of that ROS runs
this file: it imports nothing of this project, and runs on Python 3.10. Commands and answers:

    {"prepare": NAME, "type": TYPE}                        begin to look for the server
    {"call": NUMBER, "name": ..., "type": ..., "request": HEX, "within": S}
        {"call": NUMBER, "taken": true} at once, then
        {"call": NUMBER, "response": HEX} or {"call": NUMBER, "absent": true} or {"call": NUMBER, "failed": TEXT}

The first answer is {"ready": RELEASE} or {"failed": TEXT}. Requests and responses are CDR. The process ends with its
input, also while ROS hangs.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any, TextIO

_IMPL = {"SendGoal": "SendGoalService", "GetResult": "GetResultService"}
"""Services of an action: what rclpy calls their classes"""

_LEAVES_WITHIN = 1.0
"""s in which ROS is left once the input has ended; a ROS that hangs is left without a farewell"""


def service_class(type: str) -> Any:
    """The class of `std_srvs/srv/Trigger`, or of a service of an action (`.../action/Fibonacci_SendGoal`).

    Raises:
        ImportError: if this ROS has no such type.
    """
    package, kind, name = type.split("/")
    owner, _, part = name.partition("_")
    try:
        found = getattr(import_module(f"{package}.{kind}"), owner)
        return getattr(found.Impl, _IMPL[part]) if part else found
    except (ImportError, AttributeError, KeyError) as error:
        raise ImportError(f"the robot's ROS has no {type}: {error}") from error


class Caller:
    """Asks services on behalf of the process at the other end of the pipes.

    Args:
        node: of rclpy.
        serialization: its module of that name.
        say: writes one answer.
    """

    def __init__(self, node: Any, serialization: Any, say: Callable[[dict[str, Any]], None]) -> None:
        self._node, self._serialization, self._say = node, serialization, say
        self._clients: dict[str, tuple[str, Any, Any]] = {}

    def obey(self, command: dict[str, Any]) -> None:
        """Carry out one command; what goes wrong is its answer."""
        number = command.get("call")
        try:
            if number is None:
                self._client(command["prepare"], command["type"])
            else:
                self._call(number, command)
        except Exception as error:
            self._say({"call": number, "failed": f"{error}" if isinstance(error, ImportError) else repr(error)})

    def _client(self, name: str, type: str) -> tuple[Any, Any]:
        if name in self._clients and self._clients[name][0] != type:
            self._node.destroy_client(self._clients.pop(name)[2])
        if name not in self._clients:
            kind = service_class(type)
            self._clients[name] = (type, kind, self._node.create_client(kind, name))
        return self._clients[name][1:]

    def _call(self, number: int, command: dict[str, Any]) -> None:
        kind, client = self._client(command["name"], command["type"])
        request = self._serialization.deserialize_message(bytes.fromhex(command["request"]), kind.Request)
        within = command["within"]
        if client.service_is_ready():
            self._ask(number, client, request, within)
        else:
            threading.Thread(target=self._ask_once_there, args=(number, client, request, within), daemon=True).start()

    def _ask_once_there(self, number: int, client: Any, request: Any, within: float) -> None:
        try:
            if client.wait_for_service(timeout_sec=within):
                self._ask(number, client, request, within)
            else:
                self._say({"call": number, "absent": True})
        except Exception as error:  # the client was taken back meanwhile
            self._say({"call": number, "failed": repr(error)})

    def _ask(self, number: int, client: Any, request: Any, within: float) -> None:
        future = client.call_async(request)
        forget = threading.Timer(within, client.remove_pending_request, [future])
        forget.daemon = True
        forget.start()

        def answer(done: Any) -> None:
            forget.cancel()
            try:
                response = self._serialization.serialize_message(done.result())
            except Exception as error:
                self._say({"call": number, "failed": repr(error)})
            else:
                self._say({"call": number, "response": bytes(response).hex()})

        future.add_done_callback(answer)


def _sayer(output: TextIO) -> Callable[[dict[str, Any]], None]:
    lock = threading.Lock()

    def say(answer: dict[str, Any]) -> None:
        with lock:
            output.write(json.dumps(answer) + "\n")
            output.flush()

    return say


def main() -> None:
    """Join ROS as the node whose namespace and name are the arguments; obey standard input until it ends."""
    output = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what ROS prints goes to the errors
    say = _sayer(output)
    commands: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(say, commands), daemon=True).start()
    try:
        rclpy, serialization = import_module("rclpy"), import_module("rclpy.serialization")
        rclpy.init(args=[])
        node = rclpy.create_node(sys.argv[2], namespace=sys.argv[1], start_parameter_services=False)
    except Exception as error:
        say({"failed": f"{type(error).__name__}: {error}"})
        sys.exit(1)
    caller = Caller(node, serialization, say)

    def obey() -> None:
        while True:
            caller.obey(commands.get())

    threading.Thread(target=obey, daemon=True).start()
    say({"ready": os.environ.get("ROS_DISTRO", "")})
    try:
        rclpy.spin(node)
    except Exception:
        if rclpy.ok():
            raise


def _read(say: Callable[[dict[str, Any]], None], commands: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Take commands until the input ends; then leave ROS, and end the process whatever its other threads do."""
    for line in sys.stdin:
        command = json.loads(line)
        if "call" in command:
            say({"call": command["call"], "taken": True})
        commands.put(command)
    last = threading.Timer(_LEAVES_WITHIN, os._exit, [0])
    last.daemon = True
    last.start()
    with contextlib.suppress(Exception):  # it may not have joined yet
        import_module("rclpy").shutdown()


if __name__ == "__main__":
    main()
