"""With whom the robot's Zenoh routers are joined, as far as they tell: each has a page of administration to read."""

from __future__ import annotations

from typing import Any

import msgspec
import zenoh

from agents.ros_bridge.link.zenoh.session import is_loopback

ROUTERS = "@/*/router"
"""Keys of the pages; `rmw_zenohd` allows them to be read, and writing is refused"""
_TIMEOUT = 1.0
"""s for the routers to answer; that on this machine takes a few ms"""
_MOST_BYTES = 1 << 20
"""Of one page: a router with a thousand sessions has some 200 kB"""
_MOST_PLACES = 10
"""That are told"""


class _Link(msgspec.Struct):
    dst: str = ""


class _Session(msgspec.Struct):
    links: list[_Link] = []


class _Page(msgspec.Struct):
    sessions: list[_Session] = []


_pages = msgspec.json.Decoder(_Page)


def places_beyond(session: zenoh.Session) -> list[str]:
    """Endpoints on other interfaces than loopback that routers have links to; empty if none of them tells any."""
    found: set[str] = set()
    try:
        replies: Any = session.get(ROUTERS, timeout=_TIMEOUT)
        for reply in replies:
            if reply.ok is not None:
                found |= _beyond(reply.ok.payload.to_bytes())
    except zenoh.ZError:
        return []
    return sorted(found)[:_MOST_PLACES]


def _beyond(page: bytes) -> set[str]:
    if len(page) > _MOST_BYTES:
        return set()
    try:
        read = _pages.decode(page)
    except msgspec.DecodeError:
        return set()
    ends = (link.dst for one in read.sessions for link in one.links)
    return {end for end in ends if end and not is_loopback(end.partition("/")[2].rpartition(":")[0])}
