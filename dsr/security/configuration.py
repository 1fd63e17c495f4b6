"""The Zenoh configuration of one agent: mutual TLS, and access control by the common names of certificates.

Each process carries the rules for all, because the one that receives enforces them: what does not fit the
certificate at the other end of the link is dropped before anybody sees it.
"""

from __future__ import annotations

from typing import Any

import msgspec

from dsr.network.keys import PROTOCOL, Keys, descriptor_key
from dsr.security.authority import SecurityFolder
from dsr.security.policy import AccessPolicy, Grant

_ASK = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
_TELL = ["put", "reply", "declare_queryable", "liveliness_token"]
_HEADER = """\
// Zenoh configuration of agent {name!r} for programs other than dsr: zenoh.Config.from_file(...).
// Made from policy.json, from which dsr makes its own; run "dsr security add --renew" when that or the folder changed.
"""


class _EveryGraph(Keys):
    """Key expressions that match the keys of every graph: of its base, or of what is below it."""

    def __init__(self, below: str = "") -> None:
        self.graph = "*"
        self.root = f"{PROTOCOL}/*"
        self.state = f"{self.root}/{below}" if below else self.root


def zenoh_settings(folder: SecurityFolder, policy: AccessPolicy, agent: str) -> dict[str, Any]:
    """Make the settings that secure a Zenoh session of `agent`, by configuration key."""
    path = folder.path.resolve()
    files = SecurityFolder(path)
    certificate, key = str(files.certificate(agent)), str(files.key(agent))
    return {
        "transport/link/protocols": ["tls"],
        "transport/link/tls": {
            "root_ca_certificate": str(files.authority),
            "listen_certificate": certificate,
            "listen_private_key": key,
            "connect_certificate": certificate,
            "connect_private_key": key,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        },
        "access_control": access_control(policy),
    }


def access_control(policy: AccessPolicy) -> dict[str, Any]:
    """The rules: all in the policy may ask and be told everything, and tell only on keys of their own; relays on all.

    Who is connected to a relay hears others through it, and trusts it to have checked who they are as we would.
    """
    everything = f"{_EveryGraph().root}/**"
    anything = [everything, descriptor_key(everything)]
    rules = [
        _rule("ask", ["ingress", "egress"], _ASK, anything),
        _rule("be told", ["egress"], _TELL, anything),
        _rule("pass on", ["ingress"], _TELL, anything),
    ]
    policies = []
    for name, grant in policy.agents.items():
        granted = ["ask", "be told"]
        if grant.relay:
            granted.append("pass on")
        elif not grant.read_only:
            granted.append(f"tell as {name}")
            rules.append(_rule(granted[-1], ["ingress"], _TELL, own_keys(name, grant)))
        policies.append({"rules": granted, "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in policy.agents],
        "policies": policies,
    }


def own_keys(agent: str, grant: Grant) -> list[str]:
    """Key expressions on which only `agent` and its replicas may send, in any graph."""
    keys = _EveryGraph()
    replicas = f"{agent}-$*"
    states = (keys, _EveryGraph("world/*/*"), *(_EveryGraph(f"part/{part}") for part in grant.parts))
    by_replica = [key(replicas) for k in states for key in (k.delta, k.stream, k.digest, k.sync)]
    by_replica += [keys.mesh(replicas), keys.holders(replicas)]
    by_replica += [k.presence(agent, replicas) for k in states]
    by_name = [keys.status(agent), keys.log(agent)]
    granted = [f"{keys.root}/{key}" for key in grant.publishes]
    return by_replica + by_name + granted + [descriptor_key(key) for key in granted]


def _rule(name: str, flows: list[str], messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}


def write_configuration(folder: SecurityFolder, policy: AccessPolicy, agent: str) -> None:
    """Write the configuration of `agent` to its file, as an example for other programs."""
    relay = policy.grant(agent).relay
    whole: dict[str, Any] = {
        "mode": "router" if relay else "peer",
        "listen": {"endpoints": ["tls/127.0.0.1:7447" if relay else "tls/127.0.0.1:0"]},
        "scouting": {"multicast": {"enabled": False}},
    }
    for key, value in zenoh_settings(folder, policy, agent).items():
        *tables, last = key.split("/")
        place = whole
        for table in tables:
            place = place.setdefault(table, {})
        place[last] = value
    text = msgspec.json.format(msgspec.json.encode(whole), indent=2).decode()
    folder.configuration(agent).write_text(_HEADER.format(name=agent) + text + "\n", encoding="utf-8")
