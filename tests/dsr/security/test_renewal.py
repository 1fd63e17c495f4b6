"""Certificates that end: told in time, and replaced without a restart."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

import dsr
from dsr.clock import WALL_CLOCK, ManualClock
from dsr.errors import ListenError
from dsr.security.authority import SecurityFolder
from dsr.security.renewal import CertificateWatch
from tests.dsr.security.conftest import DAY

PATIENCE = 20.0
"""s: far beyond what is expected, because machines are shared."""
HOUR = 3600.0


@dataclass
class Link:
    """A transport that counts how often it began anew."""

    trouble: str = ""
    closing: threading.Event = field(default_factory=threading.Event)
    reopened: int = 0
    refuses: bool = False

    def reopen(self) -> None:
        if self.refuses:
            raise ListenError("the port is in use")
        self.reopened += 1


def eventually(condition: Callable[[], object]) -> bool:
    deadline = WALL_CLOCK.monotonic() + PATIENCE
    while not (holds := condition()) and WALL_CLOCK.monotonic() < deadline:
        WALL_CLOCK.wait(threading.Event(), 0.02)
    return bool(holds)


def test_the_end_is_told_a_week_a_day_and_an_hour_ahead_once_each(
    own_keys: SecurityFolder, caplog: pytest.LogCaptureFixture
) -> None:
    clock = ManualClock(WALL_CLOCK.now())
    own_keys.issue("arm", clock.now(), days=10)
    link = Link()
    watch = CertificateWatch(link, own_keys, "arm", clock)
    told = []
    for wait in (0, 2.9 * DAY, 0.2 * DAY, 5.8 * DAY, 0.2 * DAY, 0.8 * DAY, 0.08 * DAY, HOUR, DAY):
        clock.advance(wait)
        watch.look()
        told.append(link.trouble.partition("; ")[0].rpartition("arm.pem ")[2].partition(":")[0])
    week, day, hour = (f"expires within {words}" for words in ("a week", "a day", "an hour"))
    assert told == ["", "", week, week, day, day, hour, "has expired", "has expired"]
    assert [record.levelname for record in caplog.records] == ["WARNING"] * 3 + ["ERROR"]
    assert f"dsr security add --renew {own_keys.path} arm" in link.trouble


def test_an_authority_that_ends_first_is_what_is_told(own_keys: SecurityFolder) -> None:
    clock = ManualClock(WALL_CLOCK.now())
    own_keys.issue("arm", clock.now(), days=9999)
    link = Link()
    watch = CertificateWatch(link, own_keys, "arm", clock)
    clock.advance(3649.9 * DAY)
    watch.look()
    assert "ca.pem expires within a day" in link.trouble and "dsr security init" in link.trouble


def test_a_new_certificate_is_taken_over_once_it_is_whole(own_keys: SecurityFolder) -> None:
    clock = ManualClock(WALL_CLOCK.now())
    own_keys.issue("arm", clock.now(), days=0.5)
    link = Link()
    watch = CertificateWatch(link, own_keys, "arm", clock)
    watch.look()
    assert link.reopened == 0 and "within a day" in link.trouble
    key = own_keys.key("arm").read_bytes()
    own_keys.issue("arm", clock.now(), days=300)
    new_key = own_keys.key("arm").read_bytes()
    own_keys.key("arm").write_bytes(key)  # half written
    watch.look()
    assert link.reopened == 0
    own_keys.key("arm").write_bytes(new_key)
    watch.look()
    watch.look()
    assert link.reopened == 1 and link.trouble == ""


def test_a_session_that_cannot_begin_is_tried_again(own_keys: SecurityFolder) -> None:
    clock = ManualClock(WALL_CLOCK.now())
    link = Link(refuses=True)
    watch = CertificateWatch(link, own_keys, "arm", clock)
    own_keys.issue("arm", clock.now())
    watch.look()
    link.refuses = False
    watch.look()
    watch.look()
    assert link.reopened == 1


def test_agents_go_on_beyond_the_end_of_a_certificate_that_was_renewed(own_keys: SecurityFolder) -> None:
    seconds = 12.0
    begun = WALL_CLOCK.now()
    own_keys.issue("arm", begun, days=seconds / DAY)
    with dsr.connect("g", "scene", security=own_keys.path, timeout=PATIENCE) as scene:
        arm = dsr.connect("g", "arm", security=own_keys.path, timeout=PATIENCE)
        heard: list[str] = []
        subscription = arm.transport.subscribe(arm.keys.status("scene"), lambda key, _: heard.append(key))
        arm.add_node("gen3", "arm", status="before")
        assert eventually(lambda: scene.nodes("arm"))
        own_keys.issue("arm", WALL_CLOCK.now())
        assert eventually(lambda: WALL_CLOCK.now() > begun + seconds + 1.0)
        arm.update_node("gen3", status="after")
        assert eventually(lambda: scene.node("gen3")["status"] == "after")
        scene.add_node("cube", "cube")
        assert eventually(lambda: arm.nodes("cube") and arm.peers == [scene.rid] and scene.peers == [arm.rid])
        scene.transport.publish(scene.keys.status("scene"), b"here")
        assert eventually(lambda: heard)
        subscription.close()
        arm.close()
        assert eventually(lambda: not scene.peers)


def test_an_agent_whose_certificate_ends_is_told_and_goes_on_alone(own_keys: SecurityFolder) -> None:
    own_keys.issue("arm", WALL_CLOCK.now(), days=3.0 / DAY)
    with dsr.connect("g", "arm", security=own_keys.path, timeout=PATIENCE) as arm:
        assert "expires within an hour" in arm.transport.trouble
        assert eventually(lambda: "has expired" in arm.transport.trouble)
        arm.add_node("gen3", "arm")
