"""What the calibrator hears of surprises."""

from __future__ import annotations

from agents.calibrator.watch.surprises import CALM, Surprises
from dsr import LocalNetwork, ManualClock, Memory
from dsr.timeline import EXPLAINED, Chronicle


def test_explanations_are_heard_once_and_calm_takes_a_while() -> None:
    clock = ManualClock()
    network = LocalNetwork(clock)
    with Memory("tabletop", "calibrator", transport=network.connect("calibrator"), clock=clock) as memory:
        memory.add_node("cube_1", "cube", surprising=True)
        chronicle = Chronicle(memory, "simulation_handler")
        chronicle.happened(EXPLAINED, ("cube_1",), text="before it listened")
        surprises = Surprises(memory, chronicle)
        clock.advance(1.0)
        chronicle.happened(EXPLAINED, ("cube_1",), text="moved_alone(cube_1)")
        assert [entry.text for entry in surprises.explanations()] == ["moved_alone(cube_1)"]
        assert surprises.explanations() == []
        began = clock.now()
        assert not surprises.are_over(began)
        memory.update_node("cube_1", surprising=False)
        assert not surprises.are_over(began)
        assert not surprises.are_over(began + 0.9 * CALM) and surprises.are_over(began + CALM)
        memory.update_node("cube_1", surprising=True)
        assert not surprises.are_over(began + CALM)
