"""What is in what: relations that last, and those of this moment."""

from __future__ import annotations

from simulation_handler.contact.containment import Containment
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import container

SIZE = (0.1, 0.1, 0.1)
CUP = Solid("cup", SIZE, (0.0, 0.0, 0.05), shape=container(SIZE))
BALL = Solid("ball", (0.02, 0.02, 0.02), (0.0, 0.0, 0.03))


def test_what_is_in_something_is_found_at_once_and_told_when_that_has_lasted() -> None:
    containment = Containment(delay=0.2)
    containment.update([CUP, BALL], 0.0)
    assert containment.found == {("ball", "cup")} and not containment.current()
    containment.update([CUP, BALL], 0.25)
    assert list(containment.current()) == [("ball", "cup")]


def test_nothing_is_in_what_is_no_more_even_before_the_next_step() -> None:
    containment = Containment(delay=0.2)
    containment.update([CUP, BALL], 0.0)
    containment.forget("cup")
    assert not containment.found
