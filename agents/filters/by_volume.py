"""Passes on things by their volume."""

from __future__ import annotations

import math

from dsr import main
from dsr.geometry import volume
from dsr.graph.elements import Node
from dsr.worlds import Filter, FilterConfig


class ByVolumeConfig(FilterConfig, frozen=True, forbid_unknown_fields=True):
    """Limits of the volume of the box around a thing."""

    least: float = 0.0
    """Least volume that is passed on, m^3."""
    most: float = math.inf
    """Greatest volume that is passed on, m^3."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.least <= self.most:
            raise ValueError(f"least {self.least} m^3, most {self.most} m^3: expected 0 <= least <= most")


class ByVolume(Filter):
    """Passes on things that are neither too small nor too large, and frames without extent."""

    name = "by_volume"
    Config = ByVolumeConfig
    config: ByVolumeConfig

    def accepts(self, node: Node) -> bool:
        """Accept a node by the volume of the box around it."""
        found = volume(self.memory, node)
        return found is None or self.config.least <= found <= self.config.most


if __name__ == "__main__":
    main(ByVolume)
