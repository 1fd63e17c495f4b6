"""Processor time and memory of the processes of a system, and what else the machine was busy with."""

from __future__ import annotations

import os
from dataclasses import dataclass, field

import psutil


@dataclass
class Usage:
    """What a process took, with its children."""

    first: float | None = None
    """s of processor time when the measurement began"""
    last: float = 0.0
    """s, at its end"""
    memory: list[float] = field(default_factory=list)
    """MB, each time it was asked for: its own pages, and its share of those that several processes have (PSS)"""

    @property
    def spent(self) -> float:
        """Processor time in between, s."""
        return self.last - (self.last if self.first is None else self.first)

    def look(self, pid: int, *, memory: bool) -> None:
        """Take a sample; one of a process that has ended is left out."""
        try:
            parts = [psutil.Process(pid)]
            parts += parts[0].children(recursive=True)
            self.last = sum(processor_time(part) for part in parts)
            self.first = self.last if self.first is None else self.first
            if memory:
                self.memory.append(sum(part.memory_full_info().pss for part in parts) / 1e6)
        except psutil.Error:
            return


def processor_time(process: psutil.Process) -> float:
    """Seconds of processor time of a process, and of its children that have ended."""
    times = process.cpu_times()
    return float(times.user + times.system + times.children_user + times.children_system)


class Machine:
    """How busy the machine is as a whole."""

    cores = os.cpu_count() or 1

    def __init__(self) -> None:
        self._before = psutil.cpu_times()

    def busy(self) -> float:
        """Processor time of all programs since it was made, s: what hypervisors took away counts too."""
        idle = {"idle", "iowait", "guest", "guest_nice"}
        passed = {name: after - getattr(self._before, name) for name, after in psutil.cpu_times()._asdict().items()}
        return float(sum(seconds for name, seconds in passed.items() if name not in idle))
