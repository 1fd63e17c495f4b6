"""What is on a ROS system now: topics, types, rates and who; and why nothing arrives."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version

import msgspec

from agents.ros_bridge.link.link import Endpoint, LinkConfig, Qos, Received, RosLink, Topic
from agents.ros_bridge.messages.types import RosTypes
from dsr.clock import WALL_CLOCK

_ANY_PUBLISHER = Qos(reliable=False, depth=100)
"""Best effort and volatile hears all publishers; so many messages wait at most while they are counted"""
_SETTLES = 1.0
"""s without anything new after which all that was there before is visible, on one machine or in a local network"""
_NOBODY_AFTER = 4.0
"""s without anybody after which nobody is there: Fast DDS announces itself every 3 s"""
_AT_MOST = 6.0
"""s for which is waited while more comes to be seen, or nothing at all: on a busy machine it takes its time"""
_LOOK = 0.1
"""s between two looks"""
_OF_ACTIONS = "/_action/"
"""In the names of the services behind an action"""
_PACKAGES = ("rosbags", "eclipse-zenoh", "cyclonedds")


class TopicSeen(msgspec.Struct):
    """A topic or service with those who have to do with it."""

    name: str
    types: list[str]
    publishers: list[str]
    """Full names of nodes; for a service, its servers"""
    subscribers: list[str]
    """Full names of nodes; for a service, its clients"""
    service: bool = False
    hz: float | None = None
    """Messages a second; None if it was not listened to"""
    bytes_per_s: float | None = None
    note: str = ""
    """Why it cannot be listened to; empty if it can."""


class RosFindings(msgspec.Struct):
    """What a check found."""

    versions: dict[str, str]
    """Of the packages that matter; `not installed` for those that are not there"""
    reached: str
    """Which transport, domain, release, and router"""
    nodes: list[str]
    problems: list[str]
    """Sentences; empty if all is well."""
    lost: list[str] = []
    """What did not arrive while the check listened, in sentences; the rest did"""
    unauthenticated: list[str] = []
    """Who may speak without proving who they are, in sentences"""


class _Count:
    """Counts what comes on one topic."""

    def __init__(self) -> None:
        self.messages = self.bytes = 0

    def add(self, message: Received) -> None:
        self.messages += 1
        self.bytes += len(message.cdr)


def look(link: RosLink, types: RosTypes, seconds: float) -> list[TopicSeen]:
    """List all topics and services but our own; listen for `seconds` to those with publishers, if that is not 0."""
    _wait_for_all(link)
    found = list(_listed(link.endpoints(), types))
    if seconds > 0:
        _measure(link, [one for one in found if one.publishers and not one.service and not one.note], seconds)
    return found


def check(link: RosLink, config: LinkConfig, types: RosTypes, topics: Iterable[str], seconds: float) -> RosFindings:
    """Look for reasons why messages do not arrive, in general and on `topics`, to which it listens for `seconds`."""
    seen = {one.name: one for one in look(link, types, 0.0)}
    if config.installed_ros:
        _prepare_actions(link, seen.values())
    problems = []
    wanted = [seen[name] for name in topics if name in seen]
    problems += [f"{name}: nobody has this topic" for name in topics if name not in seen]
    _measure(link, [one for one in wanted if not one.note and not one.service], seconds)
    for one in wanted:
        if one.note:
            problems.append(f"{one.name}: {one.note}")
        elif one.service:
            problems.append(f"{one.name}: is a service, no topic")
        elif not one.publishers:
            problems.append(f"{one.name}: nobody publishes ({', '.join(one.subscribers)} listens)")
        elif not one.hz:
            who = ", ".join(one.publishers)
            problems.append(f"{one.name}: {who} publishes, but nothing came within {seconds:g} s")
    nodes = {endpoint.node for endpoint in link.endpoints() if not endpoint.mine and endpoint.node}
    lost = [
        f"{name}: {number} messages did not arrive: they came too fast, or a link broke"
        for name, number in link.lost().items()
    ]
    everything = [*link.problems(), *problems]
    return RosFindings(_versions(), _reached(config), sorted(nodes), everything, lost, link.unauthenticated())


def _wait_for_all(link: RosLink) -> None:
    """Wait until what there is to be seen is seen, with the names of its nodes."""
    began = changed = WALL_CLOCK.monotonic()
    before = 0, 0
    while (now := WALL_CLOCK.monotonic()) - began < _AT_MOST:
        others = [endpoint for endpoint in link.endpoints() if not endpoint.mine]
        named = sum(bool(endpoint.node) for endpoint in others)
        if (len(others), named) != before:
            before, changed = (len(others), named), now
        elif others and named == len(others) and now - changed >= _SETTLES:
            return
        elif not others and now - began >= _NOBODY_AFTER and link.problems():
            return  # nobody can be seen
        _pause(_LOOK)


def _prepare_actions(link: RosLink, seen: Iterable[TopicSeen]) -> None:
    """Have the installed ROS look for all actions: types that it has not become problems of the link."""
    for one in seen:
        if one.service and _OF_ACTIONS in one.name:
            link.prepare(one.name, one.types[0])
    _pause(_SETTLES)


def _listed(endpoints: Iterable[Endpoint], types: RosTypes) -> Iterable[TopicSeen]:
    found: dict[tuple[str, bool], TopicSeen] = {}
    hashes: dict[str, set[str]] = {}
    for one in endpoints:
        if one.mine:
            continue
        service = one.kind in ("service", "client")
        seen = found.setdefault((one.topic.name, service), TopicSeen(one.topic.name, [], [], [], service))
        if one.topic.type not in seen.types:
            seen.types.append(one.topic.type)
        (seen.publishers if one.kind in ("publisher", "service") else seen.subscribers).append(one.node or "?")
        if one.kind == "publisher" and one.type_hash:
            hashes.setdefault(one.topic.name, set()).add(one.type_hash)
    for _, seen in sorted(found.items()):
        seen.publishers.sort()
        seen.subscribers.sort()
        seen.note = _note(seen, hashes.get(seen.name, set()), types)
        yield seen


def _note(seen: TopicSeen, hashes: set[str], types: RosTypes) -> str:
    if len(seen.types) > 1:
        return "several types: those of different types do not hear each other"
    (type,) = seen.types
    if type not in types:
        return f"{type} is not known here"
    if not seen.service and hashes and types.hash(type) not in hashes:
        return f"{type} has another definition than in ROS 2 {types.distro}"
    return ""


def _measure(link: RosLink, topics: list[TopicSeen], seconds: float) -> None:
    counts, subscriptions = [], []
    began = WALL_CLOCK.monotonic()
    for seen in topics:
        counts.append(count := _Count())
        subscriptions.append(link.subscribe(Topic(seen.name, seen.types[0], _ANY_PUBLISHER), count.add))
    if subscriptions:
        _pause(seconds)
    for subscription in subscriptions:
        subscription.close()
    passed = WALL_CLOCK.monotonic() - began
    for seen, count in zip(topics, counts, strict=True):
        seen.hz, seen.bytes_per_s = count.messages / passed, count.bytes / passed


def _versions() -> dict[str, str]:
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _reached(config: LinkConfig) -> str:
    where = f"router {config.router}" if config.transport == "zenoh" else "no router needed"
    reach = "other machines too" if config.beyond_loopback else "this machine only"
    return f"{config.transport}, domain {config.domain}, ROS 2 {config.distro}, {where}, {reach}"


def _pause(seconds: float) -> None:
    WALL_CLOCK.wait(threading.Event(), seconds)
