"""Simulations that are closed after each test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from simulation_handler.physics.simulator import Simulator


@pytest.fixture
def table() -> Iterator[Simulator]:
    """A table with its top at z = 0."""
    with Simulator() as sim:
        sim.add_box("table", (1.2, 1.2, 0.04), (0.0, 0.0, -0.02))
        yield sim
