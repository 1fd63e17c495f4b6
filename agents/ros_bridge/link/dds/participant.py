"""Joins a DDS domain of ROS 2: over the loopback interface only, unless told otherwise."""

from __future__ import annotations

import threading

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.qos import Policy, Qos

from agents.ros_bridge.errors import RosLinkError, RosSettingError
from agents.ros_bridge.link.link import LinkConfig

_LOOPBACK_ONLY = """
<CycloneDDS><Domain>
  <General>
    <Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>
    <AllowMulticast>false</AllowMulticast>
    <MaxMessageSize>65500B</MaxMessageSize>
    <FragmentSize>65000B</FragmentSize>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>50</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers>
  </Discovery>
</Domain></CycloneDDS>
"""
"""As ROS 2 has it with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST: no multicast, up to 50 processes.

A fragment fills a datagram, as those of Fast DDS do. By default Cyclone DDS packs 48 fragments of 1344 bytes into one.
Fast DDS 2.14 may then never return from `take`, if fragments are lost and a newer message replaces the old one.
"""
_ANYWHERE = """
<CycloneDDS><Domain>
  <General>
    <AllowMulticast>true</AllowMulticast>
    <MaxMessageSize>65500B</MaxMessageSize>
    <FragmentSize>65000B</FragmentSize>
  </General>
  <Discovery><MaxAutoParticipantIndex>50</MaxAutoParticipantIndex></Discovery>
</Domain></CycloneDDS>
"""
_LAST_DOMAIN = 232
"""Later ones have no ports"""

_domains: dict[int, tuple[Domain, bool]] = {}
"""Those that this process has configured, and whether they reach beyond loopback: once each, says Cyclone DDS"""
_lock = threading.Lock()


def join(config: LinkConfig) -> DomainParticipant:
    """Join the domain. Raises `RosLinkError` if it cannot be joined, or was joined with another reach before."""
    if not 0 <= config.domain <= _LAST_DOMAIN:
        raise RosSettingError(f"domain {config.domain}: expected 0 to {_LAST_DOMAIN}")
    with _lock:
        try:
            if config.domain not in _domains:
                text = _ANYWHERE if config.beyond_loopback else _LOOPBACK_ONLY
                _domains[config.domain] = Domain(config.domain, text.strip()), config.beyond_loopback
            if _domains[config.domain][1] != config.beyond_loopback:
                raise RosLinkError(f"this process is in DDS domain {config.domain} already, with another reach")
            return DomainParticipant(config.domain, Qos(Policy.EntityName("dsr")))
        except DDSException as error:
            raise RosLinkError(f"cannot join DDS domain {config.domain}: {error}") from error
