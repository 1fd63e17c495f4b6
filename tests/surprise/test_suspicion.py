"""When a flag is raised, told again and cleared."""

from __future__ import annotations

from surprise.config import SurpriseConfig
from surprise.evidence import Reason
from surprise.suspicion import Suspicion

CONFIG = SurpriseConfig(telling=0.5)


def reason(extent: float, kind: str = "beside") -> Reason:
    return Reason(kind, f"{kind} {extent}", extent)


def test_it_is_raised_at_once_and_cleared_by_agreement() -> None:
    suspicion = Suspicion(CONFIG)
    assert not suspicion.update(0.0, [], agrees=True, undecided=True)
    assert suspicion.update(0.1, [reason(0.02)], agrees=False, undecided=True)
    assert (suspicion.raised, suspicion.text) == (True, "beside 0.02")
    assert not suspicion.update(0.2, [], agrees=False, undecided=True), "neither"
    assert suspicion.update(0.3, [], agrees=True, undecided=True)
    assert (suspicion.raised, suspicion.text) == (False, "")


def test_without_anything_new_it_is_cleared_after_a_while() -> None:
    suspicion = Suspicion(CONFIG, raised=True, text="before")
    flags = []
    for step in range(8):
        suspicion.update(step * 0.1, [], agrees=False, undecided=step == 1)
        flags.append(suspicion.raised)
    assert flags == [True] * 7 + [False]


def test_figures_are_told_again_only_when_they_are_news() -> None:
    suspicion = Suspicion(CONFIG)
    told = [
        suspicion.update(time, [reason(extent)], agrees=False, undecided=True)
        for time, extent in ((0.0, 0.02), (0.2, 0.04), (0.6, 0.021), (0.7, 0.04), (0.8, 0.08))
    ]
    assert told == [True, False, False, True, False]
    assert suspicion.update(0.9, [reason(0.04), reason(0.5, "turn")], agrees=False, undecided=True), "a new kind"
    assert suspicion.text == "beside 0.04; turn 0.5"
