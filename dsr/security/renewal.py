"""Watches the certificate of this process: warns before it ends, and takes over a new one without a restart."""

from __future__ import annotations

import logging
import threading
from typing import Protocol

from dsr.clock import WALL_CLOCK, Clock
from dsr.errors import ConfigError, ListenError
from dsr.security.authority import Lifetime, SecurityFolder
from dsr.security.identity import Identity
from dsr.threads import new_thread

PERIOD = 5.0
"""s between two looks at the files."""
WARNINGS = ((3600.0, "an hour"), (86_400.0, "a day"), (7 * 86_400.0, "a week"))
"""s before the end when this process warns, and how it says so: time enough for a person to act, three times."""

_log = logging.getLogger("dsr.security")


class Reopening(Protocol):
    """A transport that can begin a new session; see `dsr.network.zenoh_transport.ZenohTransport`."""

    trouble: str
    closing: threading.Event

    def reopen(self) -> None:
        """Begin a new session with what the files of certificates hold now. Raises `ListenError`."""


class CertificateWatch:
    """Looks at the certificate of one agent again and again.

    Args:
        transport: has the certificate that its session began with.
        files: the folder of certificates.
        agent: whose certificate it is.
        clock: whose time certificates are compared with.
    """

    def __init__(self, transport: Reopening, files: SecurityFolder, agent: str, clock: Clock = WALL_CLOCK) -> None:
        self._transport = transport
        self._files = files
        self._agent = agent
        self._clock = clock
        self._used = files.lifetime(agent)
        self._must_reopen = False
        self._told = ""

    def look(self) -> None:
        """Take over a certificate that is new and valid; say how long the present one is valid if that is not long."""
        found = self._found()
        if found is not None and (found.serial != self._used.serial or self._must_reopen):
            self._take_over(found)
        elif found is not None:
            self._used = found
        self._tell(self._used)

    def _found(self) -> Lifetime | None:
        """What the folder holds, if it can be used: while it is written, key and certificate may not fit."""
        try:
            self._files.check(self._agent, self._clock.now())
            return self._files.lifetime(self._agent)
        except ConfigError:
            return None

    def _take_over(self, found: Lifetime) -> None:
        self._used, self._must_reopen = found, True
        try:
            self._transport.reopen()
        except ListenError as error:
            _log.warning("the renewed certificate of %r waits: %s", self._agent, error)
            return
        self._must_reopen = False
        _log.info("agent %r goes on with a renewed certificate", self._agent)

    def _tell(self, used: Lifetime) -> None:
        left = used.ends - self._clock.now()
        within = next((words for seconds, words in WARNINGS if left <= seconds), "")
        advice = f"renew it: dsr security add --renew {self._files.path} {self._agent}"
        if used.file == self._files.authority:
            advice = "make a new authority: dsr security init"
        if left <= 0.0:
            self._transport.trouble = f"{used.file} has expired: others do not hear this process; {advice}"
            within = "expired"
        else:
            self._transport.trouble = f"{used.file} expires within {within}; {advice}" if within else ""
        if within and within != self._told:
            _log.log(logging.ERROR if left <= 0.0 else logging.WARNING, "%s", self._transport.trouble)
        self._told = within


def watch_certificate(transport: Reopening, identity: Identity, clock: Clock = WALL_CLOCK) -> None:
    """Watch the certificate of `identity` in a thread of its own until `transport` closes."""
    watch = CertificateWatch(transport, identity.files, identity.agent, clock)

    def run() -> None:
        watch.look()
        while not clock.wait(transport.closing, PERIOD):
            watch.look()

    new_thread(run, "dsr-certificate").start()
