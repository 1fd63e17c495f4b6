"""The tables that a recording is exported to: their columns, with units in the names, and what each means."""

from __future__ import annotations

from typing import NamedTuple


class TableColumn(NamedTuple):
    """A column of a table; its name ends with the unit, if it has one."""

    name: str
    meaning: str


class Table(NamedTuple):
    """A table; in CSV a file of its name."""

    name: str
    meaning: str
    columns: tuple[TableColumn, ...]


_TIME = TableColumn("time_s", "since the recording's first message: when the message arrived")
_STAMP = TableColumn("stamp_s", "since the Unix epoch, by the clock of who measured or wrote it")
_WRITER = TableColumn("writer", "agent that wrote it")
_EDGE = (
    TableColumn("type", "of the edge"),
    TableColumn("src", "node at which it begins"),
    TableColumn("dst", "node at which it ends"),
)
_POSITION = tuple(TableColumn(f"{axis}_m", "translation") for axis in "xyz")
_ROTATION = tuple(TableColumn(f"q{axis}", "unit quaternion") for axis in "xyzw")
_VARIANCES = (
    *(TableColumn(f"var_{axis}_m2", "variance of the translation, in dst; empty if unknown") for axis in "xyz"),
    *(TableColumn(f"var_r{axis}_rad2", "variance of the rotation about that axis, likewise") for axis in "xyz"),
)
_VALUE = (
    TableColumn("attribute", "name of an attribute; empty if this is about the element itself"),
    TableColumn("unit", "of the value, SI"),
    TableColumn("value", "text, number, true or false; several numbers as a JSON list; empty if it was taken away"),
)
_CHANGE = TableColumn("change", "added, updated, removed; at the beginning everything is added")

TABLES = (
    Table(
        "poses",
        "Every sample of RT, Virtual_RT and other edges with a pose: dst in the frame of src.",
        (_TIME, _STAMP, *_EDGE, *_POSITION, *_ROTATION, *_VARIANCES, _WRITER),
    ),
    Table(
        "joints",
        "Every sample of joints of nodes with joint_names: a row for each joint.",
        (
            _TIME,
            _STAMP,
            TableColumn("node", "such as arm"),
            TableColumn("joint", "name, as in the URDF"),
            TableColumn("position_rad", "measured; m for a joint that slides"),
            TableColumn("velocity_rad_s", "measured; empty if unknown"),
            _WRITER,
        ),
    ),
    Table(
        "nodes",
        "Comings, goings and attributes of nodes: a row for each attribute that changed. Joints have their own table.",
        (_TIME, _STAMP, _CHANGE, TableColumn("node", "name"), TableColumn("type", "of the node"), *_VALUE, _WRITER),
    ),
    Table(
        "edges",
        "The same of edges. Poses have their own table.",
        (_TIME, _STAMP, _CHANGE, *_EDGE, *_VALUE, _WRITER),
    ),
    Table(
        "events",
        "What happened, as `dsr timeline` tells it: surprises, explanations, relations, intentions, agents.",
        (
            _TIME,
            TableColumn("stamp_s", "since the Unix epoch: when it happened"),
            TableColumn("kind", "such as surprised, began, explained"),
            TableColumn("subject", "nodes, an edge, or an agent"),
            TableColumn("text", "one line for people"),
        ),
    ),
    Table(
        "truth",
        "True poses of a simulated reality, in the world frame; no agent reads them.",
        (_TIME, _STAMP, TableColumn("object", "name"), *_POSITION, *_ROTATION),
    ),
    Table(
        "statuses",
        "Statuses of agents, about one a second.",
        (
            _TIME,
            _STAMP,
            TableColumn("agent", "name"),
            TableColumn("state", "such as ready, degraded"),
            TableColumn("rate_hz", "measured ticks a second"),
            TableColumn("tick_ms_p50", "median duration of ticks"),
            TableColumn("tick_ms_p95", "95th percentile of it"),
            TableColumn("missed", "ticks left out because one took too long"),
            TableColumn("errors", "failed ticks since the start"),
            TableColumn("last_error", "text"),
        ),
    ),
    Table(
        "logs",
        "Log records of agents.",
        (
            _TIME,
            _STAMP,
            TableColumn("agent", "name"),
            TableColumn("level", "INFO, WARNING, ..."),
            TableColumn("text", "one line"),
        ),
    ),
)
"""All tables, in the order in which they are told."""
