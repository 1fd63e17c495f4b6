"""The public names of `dsr`, one by one: adding or removing one is a decision, not an accident."""

import dsr


def test_public_names() -> None:
    assert set(dsr.__all__) == {
        "Access", "Agent", "AgentError", "AttributeType", "Change", "Clock", "ClockDriftError", "ConfigError",
        "DsrError", "Edge", "EdgeNotFoundError", "ExtrapolationError", "Faults", "Frame", "FrameReader", "GoalError",
        "GraphContent", "GraphError", "ListenError", "LocalNetwork", "ManualClock", "Memory", "NoPathError", "Node",
        "NodeNotFoundError", "Pose", "Schema", "SchemaError", "StateKeeper", "Statistics", "TransformError",
        "TransportError", "WallClock", "Watch", "WireError", "connect", "read_graph", "write_graph",
    }  # fmt: skip
    assert all(hasattr(dsr, name) for name in dsr.__all__)
