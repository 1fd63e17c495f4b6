"""dsr: the working memory that robots think with.

with dsr.connect("tabletop", agent="counter") as memory:
    for change in memory.watch(node_type="cube"):
        pose = memory.transform("world", change.name)
        memory.update_node("table", seen=len(memory.nodes(type="cube")))
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dsr.agent import Agent
    from dsr.believing.distribution import Alternative, Whereabouts
    from dsr.clock import Clock, ManualClock, WallClock
    from dsr.connecting import connect
    from dsr.errors import (
        AgentError,
        ClockDriftError,
        ConfigError,
        CycleError,
        DsrError,
        EdgeNotFoundError,
        ExtrapolationError,
        GoalError,
        GraphError,
        ImaginationError,
        ListenError,
        MeshError,
        MeshNotFoundError,
        NodeNotFoundError,
        NodeTypeError,
        NoPathError,
        PartError,
        PartNotFoundError,
        RegistrationError,
        SchemaError,
        TransformError,
        TransportError,
        UndeclaredError,
        WireError,
        WorldError,
        WorldNotFoundError,
    )
    from dsr.geometry.mesh import Mesh
    from dsr.graph.access import Access
    from dsr.graph.elements import Edge, Node
    from dsr.graph.schema import AttributeType, Schema
    from dsr.graph.watch import Change, Watch
    from dsr.images.blobs import Frame
    from dsr.images.frame_reader import FrameReader
    from dsr.math3d.transforms import Pose
    from dsr.memory import Memory
    from dsr.network.local_transport import Faults, LocalNetwork
    from dsr.parts.registry import PartInfo
    from dsr.persistence.content import GraphContent
    from dsr.persistence.files import read_graph, write_graph
    from dsr.persistence.keeper import StateKeeper
    from dsr.replication.statistics import Statistics
    from dsr.runtime.agent_process import main
    from dsr.worlds.registry import WorldInfo

__all__ = [
    "Access",
    "Agent",
    "AgentError",
    "Alternative",
    "AttributeType",
    "Change",
    "Clock",
    "ClockDriftError",
    "ConfigError",
    "CycleError",
    "DsrError",
    "Edge",
    "EdgeNotFoundError",
    "ExtrapolationError",
    "Faults",
    "Frame",
    "FrameReader",
    "GoalError",
    "GraphContent",
    "GraphError",
    "ImaginationError",
    "ListenError",
    "LocalNetwork",
    "ManualClock",
    "Memory",
    "Mesh",
    "MeshError",
    "MeshNotFoundError",
    "NoPathError",
    "Node",
    "NodeNotFoundError",
    "NodeTypeError",
    "PartError",
    "PartInfo",
    "PartNotFoundError",
    "Pose",
    "RegistrationError",
    "Schema",
    "SchemaError",
    "StateKeeper",
    "Statistics",
    "TransformError",
    "TransportError",
    "UndeclaredError",
    "WallClock",
    "Watch",
    "Whereabouts",
    "WireError",
    "WorldError",
    "WorldInfo",
    "WorldNotFoundError",
    "connect",
    "main",
    "read_graph",
    "write_graph",
]

_MODULES = {
    "dsr.agent": "Agent",
    "dsr.believing.distribution": "Alternative Whereabouts",
    "dsr.clock": "Clock ManualClock WallClock",
    "dsr.connecting": "connect",
    "dsr.geometry.mesh": "Mesh",
    "dsr.graph.access": "Access",
    "dsr.graph.elements": "Edge Node",
    "dsr.graph.schema": "AttributeType Schema",
    "dsr.graph.watch": "Change Watch",
    "dsr.images.blobs": "Frame",
    "dsr.images.frame_reader": "FrameReader",
    "dsr.math3d.transforms": "Pose",
    "dsr.memory": "Memory",
    "dsr.network.local_transport": "Faults LocalNetwork",
    "dsr.parts.registry": "PartInfo",
    "dsr.persistence.content": "GraphContent",
    "dsr.persistence.files": "read_graph write_graph",
    "dsr.persistence.keeper": "StateKeeper",
    "dsr.replication.replica": "Statistics",
    "dsr.runtime.agent_process": "main",
    "dsr.worlds.registry": "WorldInfo",
}
"""The names that each module defines, beside the errors. A module is imported when one of its names is used."""
_MODULE_OF = {name: "dsr.errors" for name in __all__ if name.endswith("Error")}
_MODULE_OF |= {name: module for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Import the module that defines a public name, or read the version. Raises `AttributeError` for other names."""
    if name == "__version__":
        from importlib.metadata import version

        from dsr.config.extras import DISTRIBUTION

        return version(DISTRIBUTION)
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'dsr' has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
