"""What the tests of graph files share: generated graphs, and whether two are equal."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from dsr.graph.schema import MAX_NUMBER, AttributeType, Schema
from dsr.math3d.transforms import Pose
from dsr.persistence.content import GraphContent, NodeContent

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
BOUNDED = st.floats(-MAX_NUMBER, MAX_NUMBER)
"""Those that built-in attributes have."""
NAMES = st.from_regex(r"[A-Za-z0-9_.\-]{1,20}", fullmatch=True)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    """Any pose, half of them with a covariance."""
    rotation = draw(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 1e-3))
    norm = sum(x * x for x in rotation) ** 0.5
    variances = draw(st.lists(st.floats(0, 1e3), min_size=6, max_size=6))
    covariance = [[variances[row] if row == column else 0.0 for column in range(6)] for row in range(6)]
    translation = draw(st.tuples(*[st.floats(-1e6, 1e6)] * 3))
    stamp = draw(BOUNDED) + 0.0  # never -0.0
    return Pose(translation, [x / norm for x in rotation], stamp, draw(st.sampled_from([None, covariance])))


VALUES: dict[str, Any] = {
    "bool": st.booleans(),
    "int": st.integers(-(1 << 63), (1 << 63) - 1),
    "float": NUMBERS,
    "str": st.text(st.characters(exclude_categories=["Cs"])),
    "bytes": st.binary(max_size=40),
    "vector": st.lists(NUMBERS, max_size=8).map(tuple),
    "pose": poses(),
}


@st.composite
def contents(draw: st.DrawFn) -> GraphContent:
    """A graph with values of every kind, under built-in and custom names."""
    schema = Schema()
    for kind in VALUES:
        schema.register_attribute(f"own_{kind}", AttributeType(kind, unit="m", meaning=f"a {kind}"))  # type: ignore[arg-type]
    schema.register_node_type("drawer", "can be opened")
    schema.register_edge_type("Assumed_RT", "guessed", geometric=True)
    schema.register_edge_type("blocks", "stands before")
    own = {f"own_{kind}": values for kind, values in VALUES.items()}
    attributes = st.fixed_dictionaries({}, optional={**own, "mass": BOUNDED, "note": VALUES["str"]})
    names = draw(st.lists(NAMES, unique=True, max_size=5))
    nodes = {name: NodeContent(draw(st.sampled_from(["cube", "drawer"])), draw(attributes)) for name in names}
    types = st.sampled_from(["RT", "Assumed_RT", "blocks"])
    keys = st.lists(st.tuples(st.sampled_from(names), st.sampled_from(names), types), unique=True, max_size=5)
    edges = {key: draw(attributes) for key in (draw(keys) if names else [])}
    for key, values in edges.items():
        if key[2] != "blocks":
            values["pose"] = draw(poses())
    return GraphContent("g", schema, nodes, edges)
