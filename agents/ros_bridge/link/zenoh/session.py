"""The Zenoh session of the bridge: a peer of the robot's nodes that finds them through the robot's router."""

from __future__ import annotations

import ipaddress
import json
import re
from typing import Any

import zenoh

from agents.ros_bridge.errors import RosLinkError, RosSettingError
from agents.ros_bridge.link.link import LinkConfig

_ENDPOINT = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?P<host>\[[^\]\s]+\]|[^\[\]:/\s]+):[0-9]{1,5}(?:[?#].*)?")
_MOST_BYTES = 64 << 20
"""Of one message: more than twice a colour image of 4096 x 2160 pixels"""
_WAITS = 20_000
"""us for which a message waits for room on a full link before it is dropped: bursts pass, and a robot that is stuck
holds up nobody for longer"""
_LOOPBACK = ("localhost", "ip6-localhost")


def open_session(config: LinkConfig) -> zenoh.Session:
    """Open the session, whether the router is there or not: it is tried again and again.

    Raises:
        RosSettingError: if the router's endpoint is malformed, or on another machine without `beyond_loopback`.
    """
    match = _ENDPOINT.fullmatch(config.router)
    if match is None:
        raise RosSettingError(f"router {config.router!r}: expected PROTOCOL/HOST:PORT, such as tcp/localhost:7447")
    if not config.beyond_loopback and not is_loopback(match["host"]):
        raise RosSettingError(
            f"the router {config.router} is on another machine: what arrives from there is not authenticated; "
            "say --beyond-loopback, or beyond_loopback = true in a system file, if that is meant"
        )
    settings = zenoh.Config()
    for key, value in _settings(config).items():
        settings.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(settings)
    except zenoh.ZError as error:
        raise RosLinkError(f"no Zenoh session can be opened: {reason(error)}") from error


def is_loopback(host: str) -> bool:
    """Whether a host name or address names this machine's loopback interface."""
    host = host.strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host in _LOOPBACK


def reason(error: Exception) -> str:
    """The message of a Zenoh error without the place in its sources."""
    return str(error).splitlines()[0].split(" at /")[0][:200]


def _settings(config: LinkConfig) -> dict[str, Any]:
    """Those of rmw_zenoh's nodes where others see them."""
    found: dict[str, Any] = {
        "mode": "peer",
        "connect/endpoints": [config.router],
        "connect/timeout_ms": -1,  # tried in the background, again and again
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
        "listen/endpoints": ["tcp/localhost:0"],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "timestamping/enabled": True,  # without it, advanced publishers keep nothing for late subscribers
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": _MOST_BYTES,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": _WAITS,
    }
    if not config.beyond_loopback:
        found["access_control"] = _LOOPBACK_ONLY
    return found


_LOOPBACK_ONLY: dict[str, Any] = {
    "enabled": True,
    "default_permission": "deny",
    "rules": [
        {
            "id": "all",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": [
                "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
                "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
            ],
            "key_exprs": ["**", "@ros2_lv/**", "**/@adv/**"],
        },
        {
            "id": "pages of routers",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": ["query", "reply", "declare_queryable"],
            "key_exprs": ["@/*/router"],
        },
    ],
    "subjects": [{"id": "here", "interfaces": ["lo", "lo0"]}],
    "policies": [{"rules": ["all", "pages of routers"], "subjects": ["here"]}],
}  # fmt: skip
"""Nothing passes links of other interfaces, to which gossip may lead."""
