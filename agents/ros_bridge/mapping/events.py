"""Events and situations of the timeline as JSON in a `std_msgs/String`, which any node of ROS can read."""

from __future__ import annotations

from typing import Any

import msgspec

from agents.ros_bridge.messages.types import RosTypes
from dsr.timeline.entries import Entry

EVENT = "std_msgs/msg/String"


def to_event(types: RosTypes, entry: Entry) -> Any:
    """A String of one JSON object with the fields of the entry; `begin` and `end` in s, of the memory's time."""
    values = {
        "name": entry.name,
        "type": entry.type,
        "kind": entry.kind,
        "participants": entry.participants,
        "begin": entry.begin,
        "end": entry.end,
        "text": entry.text,
        "outcome": entry.outcome,
        "source": entry.source,
        "confidence": entry.confidence,
    }
    return types.new(EVENT, data=msgspec.json.encode(values).decode())
