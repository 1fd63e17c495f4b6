"""The public names of `dsr`, one by one: adding or removing one is a decision, not an accident."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import inspect

import pytest

import dsr

MODULES = {
    "dsr.geometry": {
        "Bounds", "Mesh", "Model", "ModelNode", "bounding_box", "load_model", "mesh_hashes", "own_bounds", "put_model",
        "volume",
    },
    "dsr.vocabulary.goals": {"Goal", "parse_goal"},
    "dsr.imagining": {
        "Outcome", "PLACEABLE", "Step", "Thinking", "Thought", "best", "carried_out", "differences", "keep",
        "parse_step", "placed", "think",
    },
    "dsr.vocabulary.intentions": {
        "ACTIVE", "DONE", "ENDED", "EXECUTING", "FAILED", "FULFILLED", "GIVEN_UP", "HALT", "HALTED", "INVALID",
        "MAINTAINED", "MIND", "NOTHING_GRASPED", "NO_SOLVER", "PLANNED", "PLANNING", "PREFIX", "REACHED", "RUN",
        "RUNNING", "UNSOLVABLE", "WAITING", "WANTED", "add_intention", "describe_action",
        "MOST_INTENTIONS", "nobody_pursues",
    },
    "dsr.vocabulary.distortion": {"Distortion", "LensModel", "MOST_COEFFICIENTS"},
    "dsr.vocabulary.intrinsics": {
        "INTRINSICS", "Intrinsics", "read_intrinsics",
    },
    "dsr.vocabulary.relations": {
        "ARITY", "MODELLED", "SURFACES", "THINGS", "Pair", "Relation", "Relations", "grasped_things", "is_present",
        "nodes_by_name", "present_things", "read_relations",
    },
    "dsr.spatial": {
        "ALLOCENTRIC", "Box", "EDGE_TYPES", "EGOCENTRIC", "EPSILON", "Fact", "Hysteresis", "MIRRORED", "QUERY",
        "SOURCE", "SPATIAL", "Scene", "View", "WRITTEN", "above", "behind", "below", "box_at", "checked_relations",
        "close_to", "in_", "in_front_of", "left_of", "margin", "next_to", "on_top", "read_scene", "read_view",
        "request_relations", "right_of",
    },
    "dsr.timeline": {
        "ALLEN", "AllenRelation", "Chronicle", "DERIVED", "EVENT", "EVENT_KINDS", "EXPLAINED", "Entry", "Event",
        "FORBIDDEN", "INVERSE", "Interval", "OBJECTS", "RELATIONS", "Retention", "SITUATION", "TIMELINE", "Timeline",
        "WRITTEN_ATTRIBUTES", "WRITTEN_EDGES", "WRITTEN_NODES", "explanations", "holds", "is_keyed", "kept_by",
        "query", "read_entry", "relation", "relations", "tell", "ACTION", "AGENT", "INTENTION", "PRESENT", "SURPRISING",
        "Consolidator", "PeriodSummary", "Remembered", "StoredSummary", "SUMMARY", "SUMMARY_ATTRIBUTES",
        "SUMMARY_NODES", "SURPRISES", "read_summary", "recall", "stored_summaries",
    },
    "dsr.visibility": {
        "BAND", "Body", "CAMERA", "LEAST_PIXELS", "LEAST_SHARE", "PERSON", "PERSON_FOV", "PERSPECTIVES",
        "Perspective", "Picture", "Posed", "SightChange", "VisibilityMonitor", "VisibleScene", "VisibleFraction",
        "WIDTH", "bodies_of", "body_at",
        "is_enough", "is_seen", "intrinsics_of", "placed", "read_perspectives", "read_posed", "shape_of_thing",
        "visibility",
    },
    "dsr.vocabulary.what_if": {
        "Action", "Answer", "LONGEST", "MAX_CHANGES", "MAX_SECONDS", "MAX_WORLDS", "Numbers", "Pending", "Question",
        "SERVICE", "Supposed", "TIMEOUT", "USUAL_WORLDS", "WhatIf", "WorldOutcome", "decode_answer", "decode_question",
        "encode_answer", "encode_question", "share",
    },
    "dsr.worlds": {
        "ROOT", "Client", "Difference", "Filter", "FilterConfig", "Hosted", "HostedConfig", "Monitor", "Provider",
        "Reader", "Tolerance", "WorldInfo", "WorldsConfig", "difference",
    },
}  # fmt: skip
"""What agents of one's own import from modules rather than from `dsr`."""


def test_public_names() -> None:
    assert set(dsr.__all__) == {
        "Access", "Agent", "AgentError", "Alternative", "AttributeType", "Change", "Clock", "ClockDriftError",
        "ConfigError",
        "CycleError", "DsrError", "Edge", "EdgeNotFoundError", "ExtrapolationError", "Faults", "Frame", "FrameReader",
        "GoalError", "GraphContent", "GraphError", "ImaginationError", "ListenError", "LocalNetwork", "ManualClock",
        "Memory", "Mesh", "MeshError", "MeshNotFoundError", "NoPathError", "Node",
        "NodeNotFoundError", "NodeTypeError", "PartError", "PartInfo", "PartNotFoundError", "Pose",
        "RegistrationError", "Schema", "SchemaError", "StateKeeper",
        "Statistics", "TransformError", "TransportError", "UndeclaredError", "WallClock", "Watch", "Whereabouts",
        "WireError",
        "WorldError", "WorldInfo", "WorldNotFoundError", "connect", "main", "read_graph", "write_graph",
    }  # fmt: skip
    assert all(hasattr(dsr, name) for name in dsr.__all__)


@pytest.mark.parametrize("module", MODULES)
def test_public_names_of_a_module(module: str) -> None:
    """What a package exports; what a module assigns or defines itself, and does not begin with an underscore."""
    found = importlib.import_module(module)
    exported = getattr(found, "__all__", None)
    assert (set(exported) if exported else _assigned(inspect.getsource(found))) == MODULES[module]
    assert all(hasattr(found, name) for name in MODULES[module])


def _assigned(source: str) -> set[str]:
    names: set[str] = set()
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            names.add(statement.name)
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            names.update(node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name))
    return {name for name in names if not name.startswith("_")}


def test_the_version_is_that_of_the_distribution() -> None:
    assert dsr.__version__ == importlib.metadata.version("dsr-memory")
