"""What interest spares between machines: simulated ones, each a process behind a link of its own to a Zenoh router.

A machine finds no process of another one but through its router, and routers are linked to the first of them. All
bytes of the link of a machine are counted, those of Zenoh too.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.interest.curves import ROOMS_OF_ROBOT
from benchmarks.interest.machine import Job, Told
from dsr.clock import WALL_CLOCK
from dsr.network.rendezvous import free_port
from dsr.network.zenoh_transport import ZenohTransport

_SETTLE, _WHILE = 4.0, 10.0
"""s until all is quiet, and while which is measured"""
_PATIENCE = 120.0
"""s for all to be equal once nobody writes"""
_PIECE = 1 << 16
"""Bytes"""


class Uplinks:
    """Links to routers, one for each machine, of which the bytes are counted both ways."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.carried: dict[int, int] = {}
        """Bytes by the port of the link."""

    def open(self, router: int) -> int:
        """Make a link to the router at this port; returns its port on this machine."""
        port = free_port()
        self.carried[port] = 0

        async def meet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            theirs, ours = await asyncio.open_connection("127.0.0.1", router)
            await asyncio.gather(self._pass_on(port, reader, ours), self._pass_on(port, theirs, writer))

        starting = asyncio.run_coroutine_threadsafe(asyncio.start_server(meet, "127.0.0.1", port), self._loop)
        starting.result(_PATIENCE)
        return port

    async def _pass_on(self, port: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while piece := await reader.read(_PIECE):
                self.carried[port] += len(piece)
                writer.write(piece)
                await writer.drain()
        writer.close()

    def close(self) -> None:
        """Carry nothing any more."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()


@dataclass
class _Running:
    process: subprocess.Popen[str]
    port: int

    def told(self, word: str = "") -> Told:
        """What the machine answers to a word; to none, what it says by itself."""
        assert self.process.stdin is not None and self.process.stdout is not None
        if word:
            self.process.stdin.write(f"{word}\n")
            self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"a machine has ended, with exit code {self.process.wait()}")
        return msgspec.json.decode(line, type=Told)

    def end(self) -> None:
        """Let it leave."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        try:
            self.process.wait(_SETTLE * 5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class _Site:
    """The machines of one measurement."""

    def __init__(self, folder: Path, fleet: int, *, parted: bool, routers: int) -> None:
        self._folder, self._fleet, self._parted = folder, fleet, parted
        self._ports = [free_port() for _ in range(routers)]
        ends = [f"tcp/127.0.0.1:{port}" for port in self._ports]
        self._routers = [ZenohTransport(end, ends[:1] if end != ends[0] else (), routing=True) for end in ends]
        self.uplinks = Uplinks()
        self.machines: list[_Running] = []

    def begin(self, robots: list[int], interest: list[int]) -> _Running:
        """Start a machine."""
        number = len(self.machines)
        port = self.uplinks.open(self._ports[number % len(self._ports)])
        runtime = self._folder / f"machine_{number}"
        runtime.mkdir(mode=0o700)
        job = Job(f"tcp/127.0.0.1:{port}", str(runtime), robots, self._fleet, self._parted, interest)
        file = runtime / "job.json"
        file.write_bytes(msgspec.json.encode(job))
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.interest.machine", str(file)], text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
        )  # fmt: skip
        self.machines.append(_Running(process, port))
        return self.machines[-1]

    def all(self, word: str) -> list[Told]:
        """What all machines answer."""
        return [machine.told(word) for machine in self.machines]

    def carried(self) -> int:
        """Bytes of all links until now."""
        return sum(self.uplinks.carried.values())

    def close(self) -> None:
        """End all."""
        for machine in self.machines:
            machine.end()
        self.uplinks.close()
        for router in self._routers:
            router.close()


@contextlib.contextmanager
def _site(fleet: int, *, parted: bool, routers: int) -> Iterator[_Site]:
    with tempfile.TemporaryDirectory() as folder:
        site = _Site(Path(folder), fleet, parted=parted, routers=routers)
        try:
            yield site
        finally:
            site.close()


def machines(number: int, *, parted: bool, robots: int = 2, routers: int = 1) -> dict[str, Any]:
    """What the link of one of so many machines carries, at work and when another machine joins; per s where a rate."""
    fleet = robots * number
    with _site(fleet, parted=parted, routers=routers) as site:
        for machine in range(number):
            site.begin(list(range(robots * machine, robots * (machine + 1))), []).told()
        site.all("start")
        _pass(_SETTLE)
        before, carried, begin = site.all("tell"), site.carried(), WALL_CLOCK.monotonic()
        _pass(_WHILE)
        seconds, carried = WALL_CLOCK.monotonic() - begin, site.carried() - carried
        after = site.all("tell")
        site.all("stop")
        equal = _become_equal(site)
        newcomer = site.begin([], list(range(ROOMS_OF_ROBOT)))
        held = newcomer.told().nodes
        return {
            "machines": number, "robots": fleet, "routers": routers, "parted": parted, "equal": equal,
            "writes": sum(b.writes - a.writes for a, b in zip(before, after, strict=True)) / (fleet * seconds),
            "bytes": carried / (number * seconds),
            "received": sum(b.received - a.received for a, b in zip(before, after, strict=True)) / (fleet * seconds),
            "seconds": sum(b.seconds - a.seconds for a, b in zip(before, after, strict=True)) / (fleet * seconds),
            "join": site.uplinks.carried[newcomer.port], "nodes": held,
        }  # fmt: skip


def _pass(seconds: float) -> None:
    WALL_CLOCK.wait(threading.Event(), seconds)


def _become_equal(site: _Site) -> bool:
    """Whether all who hold a part hold the same in the end."""
    until = WALL_CLOCK.monotonic() + _PATIENCE
    while WALL_CLOCK.monotonic() < until:
        told = site.all("tell")
        states: dict[str, set[tuple[int, ...]]] = {}
        for part, state in [item for one in told for item in one.holds.items()]:
            states.setdefault(part, set()).add(tuple(state))
        if not any(one.differ for one in told) and all(len(each) == 1 for each in states.values()):
            return True
        _pass(0.5)
    return False


def measured_machines(
    numbers: list[int], tell: Callable[[str], None], *, robots: int, routers: int, parted_only: bool
) -> list[dict[str, Any]]:
    """Measure fleets on so many machines, with parts and, unless `parted_only`, without."""
    rows = []
    for number in numbers:
        for parted in (True,) if parted_only else (True, False):
            rows.append(machines(number, parted=parted, robots=robots, routers=routers))
            tell(f"{rows[-1]}")
    return rows
