"""Agents that share a process in the tests: they fail, end, crash or talk when a file of their name says so."""

from __future__ import annotations

import ctypes
import logging
import os
import sys
import threading
from pathlib import Path

import msgspec

from dsr.agent import Agent
from dsr.graph.access import Access


class MateConfig(msgspec.Struct, frozen=True):
    folder: str = ""
    """where the file is"""


class Mate(Agent):
    """Counts its ticks in the mass of a cube of its name, and does what the file `<name>.order` says, once."""

    name = "mate"
    rate_hz = 50.0
    shares_process = True
    writes = Access(nodes=("cube",), attributes=("mass",))
    Config = MateConfig

    def setup(self) -> None:
        self.fails = False
        self.memory.add_node(self.name, "cube", mass=0.0)

    def tick(self, now: float) -> None:
        self.memory.update_node(self.name, mass=self.memory.node(self.name)["mass"] + 1.0)
        file = Path(self.config.folder) / f"{self.name}.order"
        if file.exists() and (order := file.read_text()):  # whoever writes it begins with an empty file
            file.unlink()
            self.obey(order)
        if self.fails:
            raise ValueError("it hurts")

    def obey(self, order: str) -> None:
        """Do as told."""
        self.log.info("%s is told to %s", self.name, order)
        if order == "fail":
            self.fails = True
        elif order == "exit":
            sys.exit(3)
        elif order == "exit with a text":
            sys.exit(f"{self.name} is fed up")
        elif order == "crash":
            ctypes.string_at(0)
        elif order == "leave":
            os._exit(0)
        elif order == "block":
            threading.Event().wait()
        elif order == "talk":
            logging.getLogger("elsewhere").warning("said by %s in another logger", self.name)
