"""The content of a recording: one kind of channel for each kind of traffic, with a description for readers."""

from __future__ import annotations

from typing import NamedTuple


class ChannelKind(NamedTuple):
    """A kind of traffic; its topics begin with `prefix`, and are the keys without the graph's root."""

    prefix: str
    schema: str
    encoding: str
    """Encoding of the messages."""
    text: str
    """Their layout, stored in the file."""


SNAPSHOT = "snapshot"
"""Topic of the whole graph at one instant; it is written first, so that a late recording is complete too."""

MESH = "mesh"
"""Topic of the meshes that nodes name by their hashes, each once."""

_DELTA = """MessagePack array [version, replica ids, adds, writes, removed, context, live]: changes of the graph.
  add      [replica, counter, key, type, sources, destinations]; key: a node's name, or [source, destination, type]
  write    [owner replica, owner counter, attribute, stamp, writer, dot replica, dot counter, value]
  removed  [replica, counter, ...]; context [replica, first, last, ...]; live as removed, or nil
Replicas are indexes into the list of replica ids. Extension type 1 is a pose: little-endian doubles
x y z (m) qx qy qz qw stamp (s), then, if known, a 6 x 6 covariance row by row. See dsr/replication/wire.py.
"""

_FRAME = """4 bytes little-endian header length; the header, a MessagePack array [stamp (s), meta, entries] with entries
[name, dtype, shape, offset]; zero bytes up to a multiple of 8; the arrays at their offsets. See dsr/images/blobs.py.
Images are packed as uint8 arrays:
  color.jpeg  the colour image (height, width, 3) as a JPEG file, or color.png: as a PNG file, without loss
  depth.png   the depth image (height, width) as a 16-bit PNG file in units of meta["depth_unit"] m, 0 where unknown
"""

KINDS = (
    ChannelKind(SNAPSHOT, "dsr.Snapshot", "msgpack", "The whole graph; same layout as dsr.Delta.\n" + _DELTA),
    ChannelKind("d/", "dsr.Delta", "msgpack", "Durable changes.\n" + _DELTA),
    ChannelKind("rt/", "dsr.Stream", "msgpack", "Samples of high-rate values, without dots.\n" + _DELTA),
    ChannelKind("blob/", "dsr.Frame", "dsr-frame", _FRAME),
    ChannelKind(
        MESH,
        "dsr.Mesh",
        "dsr-mesh",
        "Canonical bytes of a mesh, whose SHA-256 is what nodes have in `mesh`; see dsr/geometry/mesh.py.\n",
    ),
    ChannelKind(
        "truth",
        "dsr.Truth",
        "msgpack",
        "MessagePack map of a simulated reality: stamp (s), objects {name: [x, y, z (m), qx, qy, qz, qw]} in the "
        "world frame, robot [joint positions (rad)], camera.\n",
    ),
    ChannelKind(
        "device/",
        "dsr.Device",
        "msgpack",
        "MessagePack map: state of an arm, command to it, or tags seen by a camera; see agents/drivers.py and "
        "agents/plant/messages.py.\n",
    ),
    ChannelKind("log/", "dsr.LogRecord", "msgpack", "MessagePack array [stamp (s), level, agent, text].\n"),
    ChannelKind(
        "status/",
        "dsr.Status",
        "msgpack",
        "MessagePack map: agent, rid, pid, state, rate_hz, tick_ms_p50, tick_ms_p95, latency_ms, missed, errors, "
        "last_error, stamp (s).\n",
    ),
)


def kind_of(topic: str) -> ChannelKind:
    """The kind of a topic. Raises `ValueError` for one that is not recorded."""
    for kind in KINDS:
        if topic.startswith(kind.prefix):
            return kind
    raise ValueError(f"topic {topic!r}: expected one that begins with {', '.join(kind.prefix for kind in KINDS)}")
