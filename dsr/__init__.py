"""dsr: the working memory that robots think with.

    with dsr.connect("tabletop", agent="counter") as memory:
        for change in memory.watch(node_type="cube"):
            pose = memory.transform("world", change.name)
            memory.update_node("table", seen=len(memory.nodes(type="cube")))
"""

from dsr.agent import Agent
from dsr.clock import Clock, ManualClock, WallClock
from dsr.connect import connect
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
    NoPathError,
    SchemaError,
    TransformError,
    TransportError,
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
from dsr.persistence.content import GraphContent
from dsr.persistence.files import read_graph, write_graph
from dsr.persistence.keeper import StateKeeper
from dsr.replication.replica import Statistics
from dsr.runtime.agent_process import main
from dsr.worlds.registry import WorldInfo

__all__ = [
    "Access",
    "Agent",
    "AgentError",
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
    "Pose",
    "Schema",
    "SchemaError",
    "StateKeeper",
    "Statistics",
    "TransformError",
    "TransportError",
    "WallClock",
    "Watch",
    "WireError",
    "WorldError",
    "WorldInfo",
    "WorldNotFoundError",
    "connect",
    "main",
    "read_graph",
    "write_graph",
]
