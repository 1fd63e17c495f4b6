"""In which ways a percept can disagree with the belief, when it does, and how that is put into words."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Literal

from dsr.math3d.quaternions import Vector3
from surprise.config import SurpriseConfig
from surprise.deviation import Deviation

Way = Literal["beside", "depth", "turn"]
WAYS: tuple[Way, ...] = ("beside", "depth", "turn")


def vector(way: Way, deviation: Deviation, bias: float | None) -> Vector3:
    """The disagreement in one way: m, or rad. `bias` (m) is the systematic depth error, if it is known."""
    if way == "beside":
        return deviation.beside
    if way == "depth":
        return deviation.depth - (bias or 0.0), 0.0, 0.0
    return deviation.turn


def exceeds(way: Way, deviation: Deviation, bias: float | None, config: SurpriseConfig, share: float = 1.0) -> bool:
    """Whether the deviation is beyond `share` of the limits: beyond the least extent, and beyond noise."""
    sigmas = share * config.sigmas
    if way == "beside":
        return math.hypot(*deviation.beside) >= share * config.shift and deviation.beside_sigmas >= sigmas
    if way == "turn":
        return deviation.turning(config) >= share and deviation.turn_sigmas >= sigmas
    if bias is None:
        beyond = abs(deviation.depth) - config.depth_bound
        return beyond >= 0.0 and beyond >= sigmas * deviation.depth_std
    change = abs(deviation.depth - bias)
    std = math.hypot(deviation.depth_std, config.learned_bias)
    return change >= share * config.depth_change and change >= sigmas * std


def disagrees(deviation: Deviation, bias: float | None, config: SurpriseConfig, share: float = 1.0) -> bool:
    """Whether the deviation is beyond `share` of the limits in any way."""
    return any(exceeds(way, deviation, bias, config, share) for way in WAYS)


def extent(way: Way, deviations: Sequence[Deviation], bias: float | None) -> float:
    """Median of the disagreements, m or rad."""
    return statistics.median(math.hypot(*vector(way, deviation, bias)) for deviation in deviations)


def describe(way: Way, deviations: Sequence[Deviation], bias: float | None, camera: str) -> str:
    """Describe deviations in words, with their medians."""
    amount = extent(way, deviations, bias)
    if way == "beside":
        sigmas = statistics.median(deviation.beside_sigmas for deviation in deviations)
        return f"seen {amount * 1e3:.0f} mm beside its belief ({sigmas:.0f} sigma)"
    if way == "turn":
        sigmas = statistics.median(deviation.turn_sigmas for deviation in deviations)
        return f"seen turned by {math.degrees(amount):.0f} deg ({sigmas:.0f} sigma)"
    std = statistics.median(deviation.depth_std for deviation in deviations)
    nearer = statistics.median(vector(way, deviation, bias)[0] for deviation in deviations) < 0.0
    side = "nearer to" if nearer else "farther from"
    return f"seen {amount * 1e3:.0f} mm {side} {camera} ({amount / std:.0f} sigma)"


def are_alike(a: Vector3, b: Vector3, config: SurpriseConfig) -> bool:
    """Whether two disagreements point in the same direction and are of similar length, as those of one move are."""
    lengths = math.hypot(*a), math.hypot(*b)
    cosine = sum(x * y for x, y in zip(a, b, strict=True))
    return cosine >= config.alike * lengths[0] * lengths[1] and math.dist(a, b) <= config.close * max(lengths)
