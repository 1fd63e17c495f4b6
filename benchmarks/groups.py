"""All groups of rows, in the order in which they are measured and shown."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks import (
    by_type,
    camera_frames,
    cascade,
    frame_chains,
    growth,
    join,
    latency,
    local,
    meshes,
    planning,
    ros_links,
    throughput,
    visibility,
    world_cascade,
    worlds,
)
from benchmarks.group import Group
from benchmarks.rows import Spec
from dsr.errors import ConfigError

GROUPS: tuple[Group, ...] = (
    latency.GROUP, throughput.GROUP, join.GROUP, local.GROUP, by_type.GROUP, frame_chains.GROUP, camera_frames.GROUP,
    meshes.GROUP, cascade.GROUP, worlds.GROUP, world_cascade.GROUP, growth.GROUP, planning.GROUP, visibility.GROUP,
    ros_links.GROUP,
)  # fmt: skip


def find(name: str) -> Group:
    """The group of this name."""
    return next(group for group in GROUPS if group.name == name)


def choose(wanted: Sequence[str]) -> list[tuple[Group, list[Spec]]]:
    """Groups and those of their rows whose name contains one of `wanted`, or whose group is called so.

    Raises:
        ConfigError: if one of them is in no row.
    """
    for part in wanted:
        if not any(_matches(part, group, spec) for group in GROUPS for spec in group.specs):
            groups = ", ".join(group.name for group in GROUPS)
            raise ConfigError(f"no row contains {part!r}; groups: {groups}; see all rows: dsr bench --list")
    chosen = [
        (group, [spec for spec in group.specs if not wanted or any(_matches(part, group, spec) for part in wanted)])
        for group in GROUPS
    ]
    return [(group, specs) for group, specs in chosen if specs]


def _matches(part: str, group: Group, spec: Spec) -> bool:
    return part.lower() in spec.row.lower() or part.lower() == group.name
