"""Notices nodes that DDS lost and found again, and that tell nothing of themselves any more.

Who stood still for longer than its lease is lost. Its own DDS may not notice, and takes all of its endpoints for told.
Cyclone DDS asks it to begin anew by a request from 1 on, Fast DDS understands one from 0 on. Only a new process helps.
"""

from __future__ import annotations

from agents.ros_bridge.link.dds.discovery import DdsDiscovery

_TELLS_WITHIN = 5.0
"""s within which a node that is well tells its endpoints: Cyclone DDS asks each second"""
_MOST_GONE = 1000
"""Participants that are remembered: who leaves for good comes back under another GUID"""


class Returned:
    """Looks for such nodes each time it is asked: all that comes and goes between two questions is not seen."""

    def __init__(self, discovery: DdsDiscovery) -> None:
        self._discovery = discovery
        self._alive: set[bytes] = set()
        """GUIDs of those that were seen last"""
        self._gone: dict[bytes, None] = {}
        """Those that were lost, the last one at the end"""
        self._back: dict[bytes, float] = {}
        """When (s) each was back that has told nothing since"""

    def deaf(self, now: float) -> list[bytes]:
        """GUIDs of the participants that have told nothing for 5 s since they came back; `now` (s) never goes back."""
        alive = self._discovery.participants()
        self._back = {guid: since for guid, since in self._back.items() if guid in alive}
        for guid in alive & self._gone.keys():
            del self._gone[guid]
            self._back[guid] = now
        for guid in self._alive - alive:
            self._gone[guid] = None
            if len(self._gone) > _MOST_GONE:
                del self._gone[next(iter(self._gone))]
        self._alive = alive
        for guid in self._discovery.with_endpoints() if self._back else ():
            self._back.pop(guid, None)
        return [guid for guid, since in self._back.items() if now - since > _TELLS_WITHIN]
