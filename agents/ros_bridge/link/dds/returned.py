"""Notices nodes that DDS lost and found again, and that tell nothing of themselves any more.

Who stood still for longer than its lease is lost. Its own DDS may not notice, and takes all of its endpoints for told.
Cyclone DDS asks it to begin anew by a request from 1 on, Fast DDS understands one from 0 on. Only a new process helps.
"""

from __future__ import annotations

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState
from cyclonedds.domain import DomainParticipant

_TELLS_WITHIN = 5.0
"""s within which a node that is well tells its endpoints: Cyclone DDS asks each second"""
_MOST = 20_000
"""Participants or endpoints that are looked at: robots have some hundreds"""
_MOST_GONE = 1000
"""Participants that are remembered: who leaves for good comes back under another GUID"""


class Returned:
    """Looks for such nodes each time it is asked: all that comes and goes between two questions is not seen."""

    def __init__(self, participant: DomainParticipant) -> None:
        self._participants = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
        self._endpoints = [
            BuiltinDataReader(participant, kind)
            for kind in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)
        ]
        self._alive: set[bytes] = set()
        """GUIDs of those that were seen last"""
        self._gone: dict[bytes, None] = {}
        """Those that were lost, the last one at the end"""
        self._back: dict[bytes, float] = {}
        """When (s) each was back that has told nothing since"""

    def deaf(self, now: float) -> list[bytes]:
        """GUIDs of the participants that have told nothing for 5 s since they came back; `now` (s) never goes back."""
        alive = {
            sample.key.bytes
            for sample in self._participants.read(N=_MOST)
            if sample.sample_info.instance_state == InstanceState.Alive
        }
        self._back = {guid: since for guid, since in self._back.items() if guid in alive}
        for guid in alive & self._gone.keys():
            del self._gone[guid]
            self._back[guid] = now
        for guid in self._alive - alive:
            self._gone[guid] = None
            if len(self._gone) > _MOST_GONE:
                del self._gone[next(iter(self._gone))]
        self._alive = alive
        if self._back:
            for guid in self._telling():
                self._back.pop(guid, None)
        return [guid for guid, since in self._back.items() if now - since > _TELLS_WITHIN]

    def _telling(self) -> set[bytes]:
        """Whose endpoints are known."""
        return {
            sample.participant_key.bytes
            for reader in self._endpoints
            for sample in reader.read(N=_MOST)
            if sample.sample_info.instance_state == InstanceState.Alive
        }
