"""Tells a node of the SDK what messages look like: their definitions and hashes come from our side."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype

from tests.agents.ros_bridge.samples import TYPES
from tests.agents.ros_bridge.told import Told


def parts(*types: str) -> dict[str, str]:
    """The definitions of types and of all that is in them, by name."""
    found: dict[str, str] = {}
    for type in types:
        lines = []
        for name, kind in TYPES.fields(type):
            (of, what), size = (kind, None) if kind[0] in (Nodetype.BASE, Nodetype.NAME) else kind[1]
            if of == Nodetype.NAME:
                found |= parts(what)
            many = "" if size is None else f"[{size or ''}]"
            lines.append(f"{what if of == Nodetype.NAME else what[0]}{many} {name}")
        found[type] = "\n".join(lines)
    return found


def listen(sdk: Told, topic: str, type: str, **options: Any) -> None:
    definitions = parts(type)
    definition = definitions.pop(type)
    sdk.define(definitions=definitions)
    sdk.subscribe(topic=topic, type=type, hash=TYPES.hash(type), definition=definition, **options)


def advertise(sdk: Told, topic: str, type: str) -> None:
    definitions = parts(type)
    definition = definitions.pop(type)
    sdk.define(definitions=definitions)
    sdk.advertise(topic=topic, type=type, hash=TYPES.hash(type), definition=definition)


def ask(sdk: Told, name: str, type: str, timeout: float = 20.0, **values: Any) -> Any:
    """Let it ask a service; gives the response."""
    request, response = f"{type}_Request", f"{type}_Response"
    definitions = parts(request, response)
    of_request, of_response = definitions.pop(request), definitions.pop(response)
    sdk.define(definitions=definitions)
    return sdk.call(
        name=name, type=type, hash=TYPES.hash(type), request=of_request, response=of_response, values=values,
        timeout=timeout,
    )  # fmt: skip


def serve_action(sdk: Told, name: str, type: str) -> None:
    """Let it serve an action, with definitions and hashes from our side."""
    cancel = "action_msgs/srv/CancelGoal"
    names = {
        "send_goal_request": f"{type}_SendGoal_Request", "send_goal_response": f"{type}_SendGoal_Response",
        "get_result_request": f"{type}_GetResult_Request", "get_result_response": f"{type}_GetResult_Response",
        "cancel_goal_request": f"{cancel}_Request", "cancel_goal_response": f"{cancel}_Response",
        "feedback": f"{type}_FeedbackMessage",
    }  # fmt: skip
    known = parts(*names.values())
    definitions = {part: known.pop(name) for part, name in names.items()}
    sdk.define(definitions=known)
    hashes = {
        "send_goal": TYPES.hash(f"{type}_SendGoal"), "get_result": TYPES.hash(f"{type}_GetResult"),
        "cancel_goal": TYPES.hash(cancel), "feedback": TYPES.hash(f"{type}_FeedbackMessage"),
    }  # fmt: skip
    sdk.serve_action(name=name, type=type, hashes=hashes, definitions=definitions)
