"""Writes a graph as a JSON file of CORTEX: as its notes say it stood in one, the rest in the plainest way."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dsr.graph.schema import Value
from dsr.math3d.transforms import Pose
from dsr.persistence.content import GraphContent
from dsr.persistence.cortex_poses import pose_attributes
from dsr.persistence.cortex_values import (
    INT32,
    NOTE,
    UINT64,
    Note,
    to_theirs,
)
from dsr.persistence.json_text import to_text


def to_cortex(content: GraphContent) -> str:
    """The text of a CORTEX file.

    Poses of nodes become lists (x y z in m, quaternion x y z w, stamp in s), since CORTEX has no such type. `level` and
    `parent` follow from the RT edges. Ids stay those of the file that a node came from.
    """
    notes = {name: Note.decoded(node.attributes.get(NOTE)) for name, node in content.nodes.items()}
    ids = _ids(notes)
    links = _links(content, ids)
    places = _places(content)
    symbols = {}
    for name, node in sorted(content.nodes.items(), key=lambda item: _order(ids[item[0]])):
        note, (level, parent) = notes[name], places[name]
        derived = {
            "level": {"type": INT32, "value": level},
            "parent": {"type": UINT64, "value": ids[parent] if parent else "0"},
        }
        symbols[ids[name]] = {
            **note.extra,
            "id": ids[name],
            "name": name if note.name is None else note.name,
            "type": node.type if note.type is None else note.type,
            "attribute": dict(sorted({**_attributes(node.attributes, note), **derived}.items())),
            "links": links[name],
        }
    return to_text({"DSRModel": {"symbols": symbols}})


def _ids(notes: dict[str, Note]) -> dict[str, str]:
    """The id of each node: the one it came with, or a free one."""
    owners = {note.id: name for name, note in sorted(notes.items(), reverse=True) if note.id}
    free = _free_ids(set(owners))
    ids = {name: id for id, name in owners.items()}
    return ids | {name: next(free) for name in sorted(notes) if name not in ids}


def _free_ids(used: set[str]) -> Iterator[str]:
    number = max((int(id) for id in used if id.isdecimal() and len(id) < 100), default=0)
    while True:
        number += 1
        yield str(number)


def _order(id: str) -> tuple[int, str]:
    """Numbers by value."""
    return len(id), id


def _links(content: GraphContent, ids: dict[str, str]) -> dict[str, list[dict[str, Any]]]:
    """The links that start at each node."""
    links: dict[str, list[dict[str, Any]]] = {name: [] for name in content.nodes}
    for key, values in sorted(content.edges.items(), key=lambda item: (_order(ids[item[0][1]]), item[0][2])):
        note = Note.decoded(values.get(NOTE))
        others = {name: value for name, value in values.items() if name != "pose"}
        pose = values.get("pose")
        geometry = pose_attributes(pose, note) if isinstance(pose, Pose) else {}
        links[key[0]].append(
            {
                **note.extra,
                "src": ids[key[0]],
                "dst": ids[key[1]],
                "label": key[2] if note.type is None else note.type,
                "linkAttribute": dict(sorted({**_attributes(others, note), **geometry}.items())),
            }
        )
    return links


def _attributes(values: dict[str, Value], note: Note) -> dict[str, Any]:
    theirs = {}
    for name, value in values.items():
        if name != NOTE:
            origin = note.attributes.get(name)
            theirs[name if origin is None or origin.name is None else origin.name] = to_theirs(value, origin)
    return theirs


def _places(content: GraphContent) -> dict[str, tuple[int, str | None]]:
    """Level and parent of each node in the tree of RT edges; a node without an RT parent is at level 0."""
    parents: dict[str, str] = {}
    for src, dst, _ in sorted(key for key in content.edges if key[2] == "RT"):
        parents.setdefault(dst, src)
    return {name: (_depth(name, parents), parents.get(name)) for name in content.nodes}


def _depth(name: str, parents: dict[str, str]) -> int:
    above: set[str] = set()
    while name in parents and name not in above:
        above.add(name)
        name = parents[name]
    return len(above)
