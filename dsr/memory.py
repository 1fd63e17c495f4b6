"""The working memory as users see it: read, write, watch, transform.

Reads are local and lock-free and return live views that copy nothing. Writes change the local replica at
once and travel in the background. Everything may be called from any thread.
"""

from __future__ import annotations

import contextlib
import logging
import secrets
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any

from dsr.believing.distribution import Whereabouts, whereabouts_of
from dsr.clock import WALL_CLOCK, Clock
from dsr.crdt.delta import Delta, EdgeKey
from dsr.errors import AgentError, ClockDriftError, NoPathError, SchemaError, TransportError
from dsr.forking import leave_to_parent
from dsr.frames.tree import WORLD, Types
from dsr.geometry.exchange import MeshExchange
from dsr.graph.access import Guard, check_one, guard_in, part_check
from dsr.graph.cycles import check_new_edge
from dsr.graph.elements import Edge, Node, types_of
from dsr.graph.extensions import Extensions
from dsr.graph.graph import Graph
from dsr.graph.schema import RECORDS, SCHEMA_RECORD, Schema, checked_names, records_are_own, with_pose
from dsr.graph.unposed import with_unposed
from dsr.graph.watch import ChangeFilter, Watch
from dsr.graph.watches import Watches
from dsr.images.blob_access import BlobAccess
from dsr.math3d.transforms import Array, Pose
from dsr.network.keys import ALL, WHOLE, Keys, check_interest, check_name
from dsr.network.transport import Transport
from dsr.parts.access import PartAccess
from dsr.parts.graph import PartedGraph
from dsr.parts.held import HeldParts, burial_allowed, not_parted
from dsr.parts.registry import PartList
from dsr.parts.replica import PartedReplica
from dsr.replication.holders import Holders
from dsr.replication.portions import parts_in
from dsr.replication.replica import Replica
from dsr.replication.stamp_access import StampAccess
from dsr.replication.statistics import Statistics
from dsr.replication.sync import ChangeGate
from dsr.replication.wire import decode_kept
from dsr.worlds.access import WorldAccess
from dsr.worlds.opened import WorldHandle, Worlds

_SWITCH_INTERVAL = 0.0002
"""s; lets the merging thread run soon while the main thread is busy in Python (5.4 -> 0.9 ms median)."""

_POSE = ("pose",)

_log = logging.getLogger("dsr.memory")


def new_rid(agent: str) -> str:
    """A replica id that no process had before: agent name and a random boot nonce."""
    return f"{check_name('agent name', agent)}-{secrets.token_hex(4)}"


class Memory(StampAccess, PartAccess, WorldAccess["Memory"], BlobAccess):
    """One process's replica of a working memory: of its base world, or of another (see `world`, `fork`).

    Args:
        graph: name of the graph.
        agent: what this process is called.
        transport: the network; it is not closed with the memory.
        clock: for stamps and waiting.
        schema: the vocabulary; the built-in one if None.
        guard: called before each write, see `Guard`.
        gate: decides what of an arriving message may be joined; everything if None.
        rid: replica id, made from `agent` if None; never reuse one. It stays the id of this process; its replica takes
            another one if somebody else speaks in its name.
        threaded: run threads that merge and send. Without, call `poll` and `flush`.
        holders: tells which other replicas hold the graph and live, whether they can be reached or not.
        meshes: those of the system, if this memory shares them with another one of this process.
        interest: parts of the graph to hold from the beginning, beside what is in no part, see `hold_part`; "*" for
            all. By default the memory can hold none; with an empty interest it can later.
    """

    def __init__(
        self,
        graph: str,
        agent: str,
        *,
        transport: Transport,
        clock: Clock = WALL_CLOCK,
        schema: Schema | None = None,
        guard: Guard | None = None,
        gate: ChangeGate | None = None,
        rid: str | None = None,
        threaded: bool = False,
        holders: Callable[[], Sequence[str]] = tuple,
        meshes: MeshExchange | None = None,
        interest: Iterable[str] | None = None,
        _handle: WorldHandle | None = None,
        _base: Memory | None = None,
    ) -> None:
        self.world_handle = _handle
        self.keys = _handle.keys(graph) if _handle else Keys(graph)
        self.graph_name = graph
        self.agent = agent
        self.clock = clock
        self.transport = transport
        self.schema = schema or Schema()
        self._guard, self._gate = guard, gate
        self.rid = rid or new_rid(agent)
        self._watches = _handle.watches() if _handle else Watches(self.schema.geometric)
        self._frames = self._watches.frames
        listed = PartList() if interest is not None else None
        self._graph = _handle.graph(self._watches) if _handle else self._new_graph(listed)
        self._base_memory = _base or self
        self.extensions: Extensions = _base.extensions if _base else Extensions(self.schema, self._graph)
        self.extensions.serve(self._graph)
        self._closing = contextlib.ExitStack()
        self._ending = threading.RLock()
        """Held while the memory is closed."""
        self._closed = self._ended = False
        """Whether nothing is written any more, and whether all that takes is done."""
        self.meshes = meshes or MeshExchange(transport, self.keys, self.rid, clock, threaded=threaded)
        if meshes is None:
            self._closing.callback(self.meshes.close)
        lock = _handle.worlds.lock if _handle else threading.RLock()
        kind = Replica if listed is None else PartedReplica
        self.replica = self._replica = kind(self._graph, transport, clock, self.keys, agent, gate, lock)
        self._worlds = _handle.worlds if _handle else Worlds(self, self._memory_for, threaded=threaded, lock=lock)
        self._held: HeldParts | None = None
        self._holders = holders
        self.who_holds = _base.who_holds if _base else self._new_who_holds()
        if _handle is None:
            self._replica.after_poll = self._sweep
        self._replica.synchroniser.joining.holders = holders()
        leave_to_parent(self)
        if threaded:
            sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_INTERVAL))
            self._replica.start(self._worlds.poller)
        self._held = self._new_held(listed, threaded=threaded)
        if self._held is not None:
            for part in check_interest(interest or ()):
                if part == ALL:
                    self._held.holds_all = True
                else:
                    self._held.take(part)

    def _new_graph(self, listed: PartList | None) -> Graph:
        if listed is None:
            return Graph(self.rid, self.schema, self._watches)
        graph = PartedGraph(self.rid, self.schema, self._watches, listed.claiming)
        graph.check_part = part_check(self._guard)
        if self._gate is not None and self._guard is not None:
            graph.may_bury = burial_allowed(self._guard)
        listed.follow(graph)
        return graph

    def _new_held(self, listed: PartList | None, *, threaded: bool) -> HeldParts | None:
        if listed is None or not isinstance(self._replica, PartedReplica):
            return None
        poller = self._worlds.poller if threaded else None
        return HeldParts(
            self._replica, listed, self.transport, self.clock, self.graph_name, self.agent, self.rid, poller,
            self.who_holds,
        )  # fmt: skip

    def _new_who_holds(self) -> Holders:
        holders = Holders(
            self._replica, self.transport, self.clock, self.keys, self.rid, self._holders, self._held_places
        )
        self._closing.callback(holders.close)
        return holders

    def _held_places(self) -> dict[str, str]:
        """What this process holds beside the base: the ids of its replicas, by `Keys.place`."""
        held = {world.keys.place: world.replica.graph.rid for world in self._worlds.opened()}
        for part, replica in (self._held.replicas if self._held is not None else {}).items():
            held[Keys(self.graph_name, part=part).place] = replica.graph.rid
        return held

    def _sweep(self) -> None:
        """Follow the lists of worlds and parts."""
        self._worlds.sweep()
        if self._held is not None and not self._closed:
            self._held.sweep()

    def _memory_for(self, handle: WorldHandle) -> Memory:
        """The memory of another world, beside this one of the base."""
        return Memory(
            self.graph_name, self.agent, transport=self.transport, clock=self.clock, schema=self.schema,
            guard=guard_in(self._guard, handle.record.info.name), gate=self.replica.synchroniser.gate, rid=handle.rid,
            threaded=handle.worlds.threaded, meshes=self.meshes, _handle=handle, _base=self,
        )  # fmt: skip

    def __enter__(self) -> Memory:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # ---- nodes

    def __contains__(self, name: object) -> bool:
        return name in self._graph.nodes

    def node(self, name: str) -> Node:
        """The node `name`. Raises `NodeNotFoundError`."""
        return self._graph.node(name)

    def get_node(self, name: str) -> Node | None:
        """The node `name`, or None."""
        return self._graph.nodes.get(name)

    def __repr__(self) -> str:
        counts = [(len(self.nodes()), "node", "s"), (len(self._graph.edges), "edge", "s")]
        if not self._closed:
            counts.append((len(self.peers), "other process", "es"))
        content = ", ".join(f"{count} {what}{'' if count == 1 else plural}" for count, what, plural in counts)
        return f"<Memory of graph {self.graph_name!r}: {content}{', closed' if self._closed else ''}>"

    def nodes(self, type: str | Iterable[str] | None = None) -> list[Node]:
        """All nodes, or those of one type or several. Raises `SchemaError` for an unknown type.

        Nodes about the graph itself (types `world_record`, `schema_record`) come only if asked for by their type.
        """
        if type is None:
            nodes = list(self._graph.nodes.values())
            if any(self._graph.nodes_by_type.get(type) for type in RECORDS):
                return [node for node in nodes if node.type not in RECORDS]
            return nodes
        nodes = []
        for one in (type,) if isinstance(type, str) else type:
            found = self._graph.nodes_by_type.get(one)
            if found is None:
                self._check_type(one, self.schema.node_types, "node")
            else:
                nodes += found.values()
        return nodes

    def add_node(self, name: str, type: str, part: str | None = None, /, **attributes: Any) -> Node:
        """Create a node; if it is there already, only write the attributes.

        It is made in this part of the graph, which must be held here. By default that is the first part held here that
        claims its type, see `create_part`; else it is in no part. Raises `SchemaError`, `NodeTypeError` if the node is
        there under another type, and `PartError` if it is in another part, or if the part is not held.
        """
        with self._replica.lock:
            self._check_write("node", (type,), attributes)
            self._put(lambda: self._add_node(name, type, attributes, part))
            node = self._graph.nodes[name]
        self._replica.send_soon()
        return node

    def _add_node(self, name: str, type: str, attributes: Mapping[str, Any], part: str | None) -> Delta:
        if isinstance(self._graph, PartedGraph):
            return self._graph.add_node(name, type, attributes, self.clock.now(), part)
        if part not in (None, WHOLE):
            raise not_parted(f"add_node {name!r}")
        return self._graph.add_node(name, type, attributes, self.clock.now())

    def update_node(self, name: str, /, **attributes: Any) -> None:
        """Write attributes of a node. Raises `NodeNotFoundError`, `SchemaError`."""
        replica, graph = self._replica, self._graph
        with replica.lock:
            self._check_write("node", types_of(graph.nodes.get(name) or graph.node(name)), attributes)
            self._put(lambda: graph.write(graph.nodes[name], attributes, self.clock.now()))
        replica.send_soon()

    def remove_node(self, name: str) -> bool:
        """Remove a node and all edges at it; false if it was not there.

        Where rights are told, what others made of the name stays, with the edges that hang on that.
        """
        node = self.get_node(name)
        types = () if node is None else types_of(node)
        shown = types if self._graph.rights is not None else types[:1]  # without rights, it goes with all of them
        return node is not None and self._remove("node", shown, lambda: self._graph.remove_node(name))

    def remove_attribute(self, element: str | Node | Edge, attribute: str) -> None:
        """Take an attribute of a node (by name) or an edge away; harmless if it is not set."""
        if isinstance(element, str):
            element = self.node(element)
        kind = "node" if isinstance(element, Node) else "edge"
        with self._replica.lock:
            self._check_write(kind, types_of(element), (attribute,))
            self._put(lambda: self._graph.remove_attribute(self._seen(element), attribute, self.clock.now()))
        self._replica.send_soon()

    # ---- edges

    def edge(self, src: str, dst: str, type: str) -> Edge:
        """The edge of this type from `src` to `dst`. Raises `EdgeNotFoundError`."""
        return self._graph.edge(src, dst, type)

    def get_edge(self, src: str, dst: str, type: str) -> Edge | None:
        """The edge of this type from `src` to `dst`, or None."""
        return self._graph.edges.get((src, dst, type))

    def get_pose(self, src: str, dst: str, type: str) -> Pose | None:
        """The pose source_from_destination that an edge holds; None without the edge, or if its pose was taken away."""
        edge = self._graph.edges.get((src, dst, type))
        return None if edge is None else edge.get("pose")

    def edges(self, type: str | None = None, *, src: str | None = None, dst: str | None = None) -> list[Edge]:
        """Edges by type, source and destination, in any combination; at a cost that follows the smallest answer."""
        if type is not None:
            self._check_type(type, self.schema.edge_types, "edge")
        graph = self._graph
        if src is not None and dst is not None and type is not None:
            found = [graph.edges.get((src, dst, type))]
            return [edge for edge in found if edge is not None]
        indexes: list[Mapping[EdgeKey, Edge]] = []
        if src is not None:
            indexes.append(graph.edges_out.get(src, {}))
        if dst is not None:
            indexes.append(graph.edges_in.get(dst, {}))
        if type is not None:
            indexes.append(graph.edges_by_type.get(type, {}))
        smallest: Mapping[EdgeKey, Edge] = min(indexes, key=len) if indexes else graph.edges
        return [
            edge
            for edge in list(smallest.values())
            if (type is None or edge.type == type) and src in (None, edge.src) and dst in (None, edge.dst)
        ]

    def add_edge(self, src: str, dst: str, type: str, /, **attributes: Any) -> Edge:
        """Create an edge; if it is there already, only write the attributes.

        A geometric edge takes `pose`, or `translation` and `rotation` with `stamp` and `covariance` if wanted; until it
        has a pose, it connects no frames. Raises `SchemaError`, `NodeNotFoundError` if an end is missing, `CycleError`
        if frames would hang in a circle of this agent's own edges.
        """
        values = with_pose(attributes)
        with self._replica.lock:
            self._check_write("edge", (type,), values)
            if type in self.schema.geometric and (src, dst, type) not in self._graph.edges:
                check_new_edge(self._graph, src, dst, type)
            self._put(lambda: self._graph.add_edge(src, dst, type, values, self.clock.now()))
            edge = self._graph.edges[(src, dst, type)]
        self._replica.send_soon()
        return edge

    def update_edge(self, src: str, dst: str, type: str, /, **attributes: Any) -> None:
        """Write attributes of an edge, as in `add_edge`. Raises `EdgeNotFoundError`, `SchemaError`."""
        values, key = with_pose(attributes), (src, dst, type)
        replica, graph = self._replica, self._graph
        with replica.lock:
            self._check_write("edge", ((graph.edges.get(key) or graph.edge(*key)).type,), values)
            self._put(lambda: graph.write(graph.edges[key], values, self.clock.now()))
        replica.send_soon()

    def update_poses(self, type: str, poses: Mapping[tuple[str, str], Pose]) -> None:
        """Write the poses of many edges of one type, by (source, destination): at half the cost of one by one.

        All are written, or none: raises `EdgeNotFoundError`, `SchemaError`.
        """
        with self._replica.lock:
            self._check_write("edge", (type,), _POSE)
            self._put(lambda: self._graph.write_poses(type, poses, self.clock.now()))
        self._replica.send_soon()

    def remove_edge(self, src: str, dst: str, type: str) -> bool:
        """Remove an edge; false if it was not there."""
        if (src, dst, type) not in self._graph.edges:
            return False
        return self._remove("edge", (type,), lambda: self._graph.remove_edge((src, dst, type)))

    # ---- geometry, frames, changes

    def transform(self, target: str, source: str, *, at: float | None = None, types: Types = ("RT",)) -> Pose:
        """target_from_source: where the frame `source` is in the frame `target`; see `FrameTree.transform`.

        With `types=("Virtual_RT", "RT")` each frame is taken where the simulation believes it to be, if it does.
        Raises `NoPathError`, which names edges on the way that have no pose yet, `ExtrapolationError`, `CycleError`.
        """
        try:
            return self._frames.transform(target, source, at, types)
        except NoPathError as error:
            raise with_unposed(error, self._graph, source, target, types) from None

    def get_transform(
        self, target: str, source: str, *, at: float | None = None, types: Types = ("RT",)
    ) -> Pose | None:
        """As `transform`; None where that raises, because the frame is nowhere in the other, or was not then.

        That costs no more than a way would; `transform` looks at all frames to say why there is none.
        """
        return self._frames.find(target, source, at, types)

    def poses_since(self, src: str, dst: str, time: float, *, type: str = "RT") -> list[Pose]:
        """The poses that an edge has had in the last seconds, of later stamps than `time` s; the oldest first."""
        return self._frames.since(type, src, dst, time)

    def belief(self, name: str) -> Whereabouts | None:
        """Where a thing may be: alternatives with weights, poses with covariance, or that it is gone; see `samples`.

        None if nothing is believed of it. Raises `NodeNotFoundError` for a name that nobody has.
        """
        return whereabouts_of(self.node(name), self.get_edge(WORLD, name, "Virtual_RT"))

    def transforms(
        self, target: str, sources: Sequence[str], *, at: float | None = None, types: Types = ("RT",)
    ) -> Array:
        """(n, 4, 4) matrices target_from_source of many frames, NaN without a path; see `FrameTree.transforms`."""
        return self._frames.transforms(target, sources, at, types)

    def watch(
        self,
        *,
        node_type: str | Iterable[str] | None = None,
        edge_type: str | Iterable[str] | None = None,
        attribute: str | Iterable[str] | None = None,
        existing: bool = True,
        notify: Callable[[], None] | None = None,
        where: Callable[[Node | Edge], bool] | None = None,
    ) -> Watch:
        """Follow changes: of nodes or edges of these types, of these attributes; of everything by default.

        Args:
            node_type: wanted node types; alone, no edges are reported.
            edge_type: wanted edge types; alone, no nodes are reported.
            attribute: wanted attributes; then additions are reported only through their attributes.
            existing: begin with what is there already.
            notify: called, in any thread and with the graph locked, when there is something to poll, and when the
                watch is closed; it must return at once.
            where: tells of an element whether its additions and updates are wanted; removals are reported in any case.
                It is called for each of them, in any thread and with the graph locked: it must return at once.

        Raises:
            SchemaError: for an unknown name.
        """
        wanted = ChangeFilter(
            checked_names(node_type, self.schema.node_types, "node type"),
            checked_names(edge_type, self.schema.edge_types, "edge type"),
            checked_names(attribute, self.schema.attributes, "attribute"),
        )
        watch = Watch(wanted, notify, where)
        with self._replica.lock:
            present: list[Node | Edge] = [*self._graph.nodes.values(), *self._graph.edges.values()] if existing else []
            self._watches.follow(watch, present)
            if self._closed:
                watch.close()
        return watch

    # ---- life

    def batch(self) -> contextlib.AbstractContextManager[None]:
        """Send all writes inside `with memory.batch():` as one message, if they fit into one (1 MiB)."""
        return self._replica.hold()

    @property
    def joined(self) -> bool:
        """Whether the content that the graph had before us is here."""
        return self._replica.synchroniser.joined and (self._held is None or self._held.joined)

    @property
    def peers(self) -> list[str]:
        """Replica ids of the other processes that can be reached."""
        return self._replica.synchroniser.peers

    @property
    def dropped(self) -> dict[str, int]:
        """Malformed messages that were dropped, by replica id of the sender."""
        return dict(self._replica.synchroniser.dropped)

    @property
    def statistics(self) -> Statistics:
        """Counts of messages that were lost, skipped or malformed, and of repairs."""
        return self._replica.statistics

    def wait_joined(self, timeout: float, *, all_known: bool = False, begin: bool = False) -> None:
        """Wait for the graph's present content, until none of it has come for `timeout` s.

        If nobody is there, or nobody who has joined, and all gave what they have, the graph begins with us.

        Args:
            timeout: s.
            all_known: no others than the `holders` can be there, so that without any there is nobody to wait for.
            begin: begin with what is here if those who hold the graph do not answer.

        Raises:
            TransportError: if others may hold more and do not answer.
        """
        sync = self._replica.synchroniser
        joining = sync.joining
        joining.others_possible = not all_known

        def complete() -> bool:
            with self._replica.lock:
                joining.holders = self._holders()
                if all_known and not joining.holders:
                    sync.nobody_there()
                return sync.joined

        if self._replica.wait_for_pieces(complete, timeout):
            return
        if sync.is_held_up and not begin:
            why = joining.why(self.clock.monotonic())
            raise TransportError(f"graph {self.graph_name!r}: not complete after {timeout:.1f} s, {why}")
        _log.info("nobody else gives anything of graph %r within %.1f s: it begins here", self.graph_name, timeout)
        sync.nobody_there()

    @property
    def behind(self) -> float:
        """Time (s) since the memory has known that it lacks changes of the graph; 0 if it lacks none."""
        since = [each for replica in self._replicas if (each := replica.synchroniser.behind_since) is not None]
        return max(0.0, self.clock.monotonic() - min(since)) if since else 0.0

    @property
    def delivered(self) -> bool:
        """Whether all others that can be heard have seen what was written here."""
        return all(replica.synchroniser.delivered for replica in self._replicas)

    @property
    def _replicas(self) -> list[Replica]:
        return [self._replica, *(self._held.replicas.values() if self._held else ())]

    def snapshot(self) -> bytes:
        """The whole graph as one encoded message, for `restore`."""
        return self._replica.snapshot()

    def restore(self, snapshot: bytes) -> None:
        """Join a snapshot; what is in parts that are not held here is left out.

        Raises `WireError` if it is none, and `PartError` if it has parts and this memory can hold none.
        """
        delta = decode_kept(snapshot)
        parts = [part for part in parts_in(delta) if part != WHOLE]
        if self._held is not None:
            self._held.take_named(parts)
        elif parts and self.world_handle is None:
            raise not_parted(f"a snapshot with parts {', '.join(sorted(parts))}")
        with self._replica.lock:
            self._graph.restore(delta, self.clock.now())

    def on_close(self, action: Callable[[], None]) -> None:
        """Call `action` when the memory is closed, last one first."""
        self._closing.callback(action)

    def abandon(self) -> None:
        """Count as closed, without a word to anybody: in a forked child."""
        self._closed = self._ended = True
        self._replica.lock = threading.RLock()  # the old one may be held by a thread that the child does not have

    def close(self) -> None:
        """Send the waiting writes, end all watches and leave; harmless when repeated.

        What Ctrl-C breaks off goes on when it is called again, at the latest when the program ends.
        """
        if not self._ending.acquire(blocking=False):
            return  # another thread is at it
        try:
            if not self._ended:
                self._end()
                self._ended = True
        finally:
            self._ending.release()

    def _end(self) -> None:
        with self._replica.lock:  # after the last write that returned
            self._closed = True
        if self.world_handle is None:
            self._worlds.close()
        elif not self._base_memory.closed:
            self._worlds.forget(self)  # who opens the world from now on gets another memory of it
        self._watches.close()
        try:
            if self._held is not None:
                self._held.close()
            self._replica.close()
        except Exception:  # Ctrl-C is none: then the network is needed again
            self._closing.close()
            raise
        if self.world_handle is not None:
            self._worlds.forget(self)
        self._closing.close()

    def write_record(self, name: str, type: str, record: str) -> None:
        """Write an entry about the graph itself, a node of one of `RECORDS`; for the memory's own use."""
        with self._replica.lock:
            self._check_write("node", (type,), ("record",), own=True)
            self._put(lambda: self._graph.add_node(name, type, {"record": record}, self.clock.now()))
        self._replica.send_soon()

    def remove_record(self, name: str, type: str) -> None:
        """Remove an entry about the graph itself; for the memory's own use."""
        self._remove("node", (type,), lambda: self._graph.remove_node(name), own=True)

    def _check_write(
        self, element: str, types: Sequence[str], attributes: Iterable[str], *, own: bool = False
    ) -> None:
        """Raise unless this write may be made; with the lock held, so that none is made after `close`.

        Of several types that others gave a node, one suffices. Nodes about the graph itself are written only as the
        memory's `own`.
        """
        if types[0] in RECORDS and element == "node" and not own:
            raise SchemaError(records_are_own(f"nodes of type {types[0]!r}"))
        if self._guard is not None:
            check_one(self._guard, element, types, attributes)
        if self._closed:
            raise TransportError(f"the memory of graph {self.graph_name!r} is closed")
        clocks = self._replica.synchroniser.clocks
        if clocks.slower and clocks.is_ahead:
            raise ClockDriftError(f"graph {self.graph_name!r}: {clocks}; set it right")
        if self.extensions.to_publish:
            self._base_memory.publish_names()
            if self._base_memory is not self:  # which sends what it has after its own writes
                self._base_memory._replica.send_soon()

    def publish_names(self) -> None:
        """Tell the others of the names that were registered here; called, with the lock held, before each write."""
        allowed = True
        if self._guard is not None:
            try:
                self._guard("node", SCHEMA_RECORD, ("record",))
            except AgentError as error:
                _log.debug("registered names stay here: %s", error)
                allowed = False
        self.extensions.publish(self._write_schema_record if allowed else _keep_to_oneself)

    def _write_schema_record(self, name: str, record: str) -> None:
        self._put(lambda: self._graph.add_node(name, SCHEMA_RECORD, {"record": record}, self.clock.now()))

    def _remove(self, element: str, types: Sequence[str], remove: Callable[[], Delta], *, own: bool = False) -> bool:
        with self._replica.lock:
            self._check_write(element, types, (), own=own)
            delta = remove()
            self._replica.commit(delta)
        self._replica.send_soon()
        return bool(delta)

    def _check_type(self, type: str, valid: dict[str, str], what: str) -> None:
        checked_names(type, valid, f"{what} type")


def _keep_to_oneself(name: str, record: str) -> None:
    """Write no record: the process may not."""
