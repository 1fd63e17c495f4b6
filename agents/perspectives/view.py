"""The knowledge of one person from having seen the world: a world of its own, kept in step with the eyes."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from agents.perspectives.chronicle import PersonalTimeline
from agents.perspectives.containment import carried, covers
from agents.perspectives.falling import fallen
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.visibility import (
    LEAST_PIXELS,
    PERSON,
    PERSPECTIVES,
    Picture,
    VisibilityMonitor,
    body_at,
)
from dsr.vocabulary.relations import MODELLED, SURFACES, THINGS

KINDS = (*THINGS, *MODELLED)
"""Node types of things that are seen and remembered."""
LOOKS = ("size", "shape", "bounds", "mesh", "color", "marker_id", "model", "mass", "friction")
"""Attributes that are taken over from visible things."""
RELATIONS = ("on", "in")
"""Edges likewise."""
_MOVED = PoseTolerance(1e-3, 1e-2)  # m, rad, from which a pose is another one
_SWAYED = PoseTolerance(5e-3, 2e-2)  # likewise, of who looks: heads are never still
_TELL_EVERY = 0.5  # s, between two writings of when something was last seen that is seen all the time


class PersonalView:
    """Keeps the world of one person, or camera, in step with the things seen from there.

    What is seen is known as it is in the source, at once. What was seen before stays where it was (`perceived` false,
    `last_seen`, and `seen_at`), and goes along with the container in which it was, if that is seen to move. What
    vanishes from a place in full view fell straight down, if it would be hidden there. Otherwise a thing is nowhere
    (`present` false, no pose) once it is seen that it is not where it was. Who is not there learns nothing.

    Args:
        name: of the person's node in the source.
        source: the world that is seen.
        world: the person's own.
        empty_share: of what would be seen of a thing, from which on its place is seen to be empty.
        patience: s for which that must be so.
    """

    def __init__(
        self, name: str, source: Memory, world: Memory, *, empty_share: float = 0.5, patience: float = 0.3
    ) -> None:
        self.name = name
        self.world = world
        self._source = source
        self._empty_share = empty_share
        self._patience = patience
        self._last_seen = {node.name: node.get("last_seen", 0.0) for node in self._known()}
        self._empty_since: dict[str, float] = {}
        self._timeline = PersonalTimeline(name, world, self._known)

    def update(self, monitor: VisibilityMonitor, now: float) -> None:
        """Take in what is seen at time `now` (s), by the monitor's last look."""
        with self.world.batch():
            self._furnish(now)
            if self.name in monitor.perspectives:
                self._look(monitor, now)
            else:
                self._lose((node.name for node in self._known()), now)
                self._see_others(None, now)
            self._timeline.update(now)

    def _look(self, monitor: VisibilityMonitor, now: float) -> None:
        picture = monitor.picture(self.name)
        seen = [thing for thing in sorted(monitor.scene.things) if monitor.sees(self.name, thing)]
        lost = [node for node in self._known() if node.name not in seen and node.get("perceived") is True]
        self._lose((node.name for node in lost), now)
        self._carry_along(self._take_in(seen, now), seen, now)
        self._let_fall(picture, lost, now)
        self._relate(seen)
        self._know_contents(picture, seen)
        self._notice_empty_places(picture, seen, now)
        self._see_others(picture, now)
        for thing in seen:
            if thing in self.world:
                self._connect(self.name, thing, monitor.visibilities[self.name, thing].share)

    # ---- what is seen

    def _take_in(self, seen: Iterable[str], now: float) -> dict[str, tuple[Pose, Pose]]:
        """Know what is seen as it is; returns where what has moved was, and is."""
        moved = {}
        for name in seen:
            node, pose = self._source.get_node(name), self._source.get_transform(WORLD, name, types=BELIEVED)
            if node is None or pose is None:
                continue
            self._copy(node, {"present": True, "perceived": True})
            self._last_seen[name] = now
            self._empty_since.pop(name, None)
            self._tell_seen(name, now)
            before = self._put(name, pose.with_covariance(None).with_stamp(now))
            if before is not None:
                moved[name] = before, pose
        return moved

    def _put(self, name: str, pose: Pose, least: PoseTolerance = _MOVED) -> Pose | None:
        """Let something be somewhere; returns where it was before if that was somewhere else, by `least` m or rad."""
        before = self._at(name)
        if before is not None and least.covers(before, pose):
            return None
        self.world.add_edge(WORLD, name, "RT", pose=pose)
        return before

    def _relate(self, seen: Collection[str]) -> None:
        """What is seen lies on and in what it lies on and in, as far as that is known."""
        for kind in RELATIONS:
            for name in seen:
                holds = {edge.dst for edge in self._source.edges(kind, src=name) if edge.dst in self.world}
                for edge in self.world.edges(kind, src=name):
                    if edge.dst not in holds:
                        self.world.remove_edge(*edge.key)
                for other in sorted(holds):
                    if name in self.world and self.world.get_edge(name, other, kind) is None:
                        self.world.add_edge(name, other, kind, source=self.name)

    def _know_contents(self, picture: Picture, seen: Collection[str]) -> None:
        """What is not seen, and is believed where a hollow thing is seen to cover it, is in that."""
        containers = [(node, pose) for name in seen if (node := self.world.get_node(name)) and (pose := self._at(name))]
        for node in self._known():
            where = None if node.name in seen else self._at(node.name)
            if where is None:
                continue
            around = [cover.name for cover, there in containers if covers(self.world, cover, there, node, where)]
            new = [name for name in around if self.world.get_edge(node.name, name, "in") is None]
            if new and not self._is_empty(picture, node, where):
                for name in new:
                    self.world.add_edge(node.name, name, "in", source=self.name)

    def _at(self, name: str) -> Pose | None:
        """Where the person believes something to be; None where somebody took the pose away."""
        return self.world.get_pose(WORLD, name, "RT")

    def _connect(self, name: str, thing: str, share: float) -> None:
        edge = self.world.get_edge(name, thing, "sees")
        if name in self.world and (edge is None or abs(edge.get("share", 0.0) - share) > 0.1):
            self.world.add_edge(name, thing, "sees", share=share, visible=True)

    # ---- what is remembered

    def _known(self) -> list[Node]:
        return self.world.nodes(KINDS)

    def _lose(self, names: Iterable[str], now: float) -> None:
        """Remember what is not seen any more: when and where it was. Nobody has seen it in times to come."""
        for name in names:
            node = self.world.node(name)
            if node.get("perceived") is not True:
                continue
            where = self._at(name)
            told: dict[str, Any] = {} if where is None else {"seen_at": where}
            last_seen = min(self._last_seen.get(name, 0.0), now)
            self.world.update_node(name, perceived=False, last_seen=last_seen, **told)
            self.world.remove_edge(self.name, name, "sees")

    def _carry_along(self, moved: Mapping[str, tuple[Pose, Pose]], seen: Collection[str], now: float) -> None:
        """What is in something that is seen to move goes along, at any depth; what a lifted cover covered stays."""
        shifts = dict(moved)
        level = list(shifts)
        while level:
            contents = [
                (edge.src, edge.dst)
                for name in level
                for edge in self.world.edges("in", dst=name)
                if edge.src not in seen and edge.src not in shifts
            ]
            level = []
            for name, container in sorted(contents):
                where = self._at(name)
                if where is None or name in shifts:
                    continue
                goal = carried(self.world.node(container), *shifts[container], where)
                if goal is None:
                    self.world.remove_edge(name, container, "in")
                    continue
                shifts[name] = where, goal
                self.world.add_edge(WORLD, name, "RT", pose=goal.with_stamp(now))
                level.append(name)

    def _let_fall(self, picture: Picture, lost: Iterable[Node], now: float) -> None:
        """What was just seen in a place that is empty now has fallen, if it would be hidden where it came to lie."""
        for node in lost:
            where = self._at(node.name)
            if where is None or not self._is_empty(picture, node, where):
                continue
            below = fallen(self.world, node, where)
            if below is not None and not self._is_empty(picture, node, below):
                self._put(node.name, below.with_stamp(now))

    def _notice_empty_places(self, picture: Picture, seen: Collection[str], now: float) -> None:
        """What is not where it would be seen is nowhere."""
        for node in self._known():
            where = self._at(node.name)
            if node.name in seen or where is None or not self._is_empty(picture, node, where):
                self._empty_since.pop(node.name, None)
                continue
            since = self._empty_since.setdefault(node.name, now)
            if now - since >= self._patience:
                self._forget_place(node.name)

    def _is_empty(self, picture: Picture, node: Node, pose: Pose) -> bool:
        body = body_at(self.world, node, pose)
        if body is None:
            return False
        visible = picture.would_show(body)
        return visible.share >= self._empty_share and visible.pixels >= LEAST_PIXELS

    def _forget_place(self, name: str) -> None:
        self._empty_since.pop(name, None)
        self.world.update_node(name, present=False)
        for edge in (*self.world.edges(src=name), *self.world.edges("RT", dst=name)):
            self.world.remove_edge(*edge.key)

    # ---- what is around

    def _furnish(self, now: float) -> None:
        """Tables are known to everybody, and so is where one is oneself. The root may have been taken away."""
        if WORLD not in self.world:
            self.world.add_node(WORLD, WORLD)
        for kind in SURFACES:
            for node in self._source.nodes(kind):
                self._place(node, now, {})
        own = self._onlooker(self.name)
        if own is None:
            self._miss(self.name)
            return
        self._place(own, now, {key: own[key] for key in ("perceived", "fov") if key in own})
        last_seen = own.get("last_seen")
        if last_seen is not None and self.name in self.world:
            self._tell_seen(self.name, min(last_seen, now))

    def _tell_seen(self, name: str, when: float) -> None:
        """Write when somebody or something was last seen, unless it was told lately; a time to come is corrected."""
        if not 0.0 <= when - self.world.node(name).get("last_seen", -math.inf) < _TELL_EVERY:
            self.world.update_node(name, last_seen=when)

    def _see_others(self, picture: Picture | None, now: float) -> None:
        """Other persons and cameras are where they were last seen."""
        nodes = (node for memory in (self._source, self.world) for node in memory.nodes(PERSPECTIVES))
        for name in sorted({node.name for node in nodes} - {self.name}):
            node, pose = self._onlooker(name), self._source.get_transform(WORLD, name, types=BELIEVED)
            if picture is not None and node is not None and pose is not None and _is_shown(node, pose, picture):
                self._place(node, now, {"perceived": True})
                self._tell_seen(name, now)
            else:
                self._miss(name)

    def _onlooker(self, name: str) -> Node | None:
        """A person or a camera as it is; None for what is neither any more."""
        node = self._source.get_node(name)
        return node if node is not None and node.type in PERSPECTIVES else None

    def _miss(self, name: str) -> None:
        """Let somebody not be perceived."""
        node = self.world.get_node(name)
        if node is not None and node.get("perceived") is True:
            self.world.update_node(name, perceived=False)

    def _place(self, node: Node, now: float, told: Mapping[str, Any]) -> None:
        """Let a node of the source be known, with its place."""
        pose = self._source.get_transform(WORLD, node.name, types=BELIEVED)
        if pose is not None:
            self._copy(node, told)
            self._put(node.name, pose.with_covariance(None).with_stamp(now), _SWAYED)

    def _copy(self, node: Node, told: Mapping[str, Any]) -> None:
        wanted = {key: node[key] for key in LOOKS if key in node} | dict(told)
        here = self.world.get_node(node.name)
        if here is not None and here.type != node.type:
            self.world.remove_node(node.name)
            here = None
        if here is None:
            self.world.add_node(node.name, node.type, **wanted)
            return
        changed = {key: value for key, value in wanted.items() if here.get(key) != value}
        if changed:
            self.world.update_node(node.name, **changed)
        for key in LOOKS:
            if key in here and key not in wanted:
                self.world.remove_attribute(node.name, key)


def _is_shown(node: Node, pose: Pose, picture: Picture) -> bool:
    """Whether anything of a person is seen; of a camera, the point where it is."""
    if node.type == PERSON:
        return node.get("perceived") is True and picture.visible(node.name).pixels >= LEAST_PIXELS
    return picture.shows(pose.translation)
