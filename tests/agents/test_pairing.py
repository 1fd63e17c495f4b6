"""Colour and depth with stamps of their own: who belongs together, who goes alone, and what is counted."""

from __future__ import annotations

import pytest

from agents.pairing import PATIENCE, Pairing

PERIOD = 1.0 / 30.0


def play(
    pairing: Pairing[str], seconds: float, *, offset: float = 0.0, depth_every: float = PERIOD, lost: int = 0
) -> list[tuple[str, str | None]]:
    """Colour at 30 Hz, and depth so much later; each `lost`th depth is lost. All pairs that came out."""
    arrivals = [(PERIOD * k, "c", k) for k in range(round(seconds / PERIOD))]
    depths = [(depth_every * k + offset, "d", k) for k in range(round(seconds / depth_every))]
    arrivals += [one for one in depths if not lost or one[2] % lost]
    found = []
    for stamp, kind, number in sorted(arrivals):
        (pairing.add_color if kind == "c" else pairing.add_depth)(f"{kind}{number}", stamp, stamp)
        found += [pair for pair in [pairing.take()] if pair is not None]
    return found


@pytest.mark.parametrize("offset", [0.0, 0.002, 0.012, 0.016, -0.012])
def test_stamps_within_half_a_picture_are_a_pair(offset: float) -> None:
    pairing: Pairing[str] = Pairing()
    pairs = play(pairing, 1.0, offset=offset)
    assert pairs == [(f"c{k}", f"d{k}") for k in range(30)]
    assert pairing.unpaired == 0


def test_depth_that_rolls_by_is_paired_with_the_nearest() -> None:
    """At 29 and 30 Hz each depth is at some time halfway between two colours."""
    pairing: Pairing[str] = Pairing()
    pairs = play(pairing, 3.0, depth_every=1.0 / 29.0)
    for color, depth in pairs:
        assert depth is not None
        assert abs(int(color[1:]) / 30.0 - int(depth[1:]) / 29.0) <= 0.5 / 29.0 + 1e-9
    assert len({depth for _, depth in pairs}) == len({color for color, _ in pairs}) == len(pairs) > 75
    waiting = 90 + 87 - 2 * len(pairs) - pairing.unpaired
    assert 0 <= waiting <= 4


def test_colour_whose_depth_was_lost_is_left_out_and_counted() -> None:
    pairing: Pairing[str] = Pairing()
    pairs = play(pairing, 2.0, lost=5)
    assert pairs == [(f"c{k}", f"d{k}") for k in range(60) if k % 5]
    assert pairing.unpaired == 12


def test_half_a_picture_is_that_of_the_faster_stream() -> None:
    pairing: Pairing[str] = Pairing()
    play(pairing, 1.0)
    assert pairing.apart == pytest.approx(PERIOD / 2)
    play(slow := Pairing[str](), 1.0, depth_every=0.1)
    assert slow.apart == pytest.approx(PERIOD / 2)
    rare: Pairing[str] = Pairing()
    for k in range(5):
        rare.add_color("c", 3.0 * k, 3.0 * k)
        rare.add_depth("d", 3.0 * k + 0.3, 3.0 * k + 0.3)
    assert rare.apart == pytest.approx(1.0 / 30.0) and rare.unpaired > 0


@pytest.mark.parametrize("late", [0.0, PERIOD])
def test_without_depth_colour_goes_on_alone_after_a_while_and_depth_is_taken_up_again(late: float) -> None:
    """Also depth that arrives later than the next colour."""
    pairing: Pairing[str] = Pairing()
    alone = []
    for k in range(60):
        pairing.add_color(f"c{k}", PERIOD * k, PERIOD * k)
        alone += [pair for pair in [pairing.take()] if pair]
    assert all(depth is None for _, depth in alone) and pairing.gap is None
    assert [color for color, _ in alone] == [f"c{k}" for k in range(60 - 2 - len(alone), 58)]
    assert len(alone) == pytest.approx((2.0 - PATIENCE) / PERIOD, abs=2)
    found = []
    for k in range(60, 70):
        pairing.add_color(f"c{k}", PERIOD * k, PERIOD * k)
        if (came := k - round(late / PERIOD)) >= 60:
            pairing.add_depth(f"d{came}", PERIOD * came, PERIOD * came + late)
        found += [pair for pair in [pairing.take()] if pair]
    assert found[-1][0] in ("c69", "c68") and all(depth == f"d{color[1:]}" for color, depth in found[-5:])


def test_of_several_pairs_the_newest_is_taken() -> None:
    pairing: Pairing[str] = Pairing()
    for k in range(3):
        pairing.add_color(f"c{k}", PERIOD * k, PERIOD * k)
        pairing.add_depth(f"d{k}", PERIOD * k, PERIOD * k)
    assert pairing.take() == ("c2", "d2") and pairing.take() is None
    assert pairing.passed_over == 2 and pairing.unpaired == 0


def test_clocks_apart_are_told_by_their_gap() -> None:
    pairing: Pairing[str] = Pairing()
    for k in range(60):
        pairing.add_depth("d", 3.0 + PERIOD * k, PERIOD * k)
        pairing.add_color("c", 5.0 + PERIOD * k, PERIOD * k)
    assert pairing.take() == ("c", None) and pairing.gap == pytest.approx(2.0, abs=0.1)


def test_a_burst_of_pictures_is_paired_too() -> None:
    pairing: Pairing[str] = Pairing()
    for k in range(4):
        pairing.add_color(f"c{k}", 0.001 * k, 0.0)
    for k in range(4):
        pairing.add_depth(f"d{k}", 0.001 * k + 0.004, 0.0)
    assert pairing.take() == ("c3", "d0")


def test_depth_alone_never_goes_on_and_waits_in_bounds() -> None:
    pairing: Pairing[str] = Pairing()
    for k in range(100):
        pairing.add_depth(f"d{k}", PERIOD * k, PERIOD * k)
    assert pairing.take() is None and pairing.unpaired == 96
