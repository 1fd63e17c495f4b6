"""How badly a place explains the percepts of a span, in nats beyond what ordinary percepts cost; and that in words.

Noise makes their mean as far off as it is, or each of those that are off alike is false. Percepts that show the object
where it is believed to be speak against a displacement as much as others speak for it.
"""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Sequence
from typing import Literal, NamedTuple

from dsr.vocabulary.nats import FALSE_FRAME, SURPRISING
from surprise.deviation import Deviation, Offset

Way = Literal["beside", "depth", "turn"]
WAYS: tuple[Way, ...] = ("beside", "depth", "turn")
_ORDINARY = sum(1.0 / (index + 1.0) for index in range(len(WAYS)))
"""nats, mean of the greatest of the costs in all ways, where noise makes each of these"""


class DepthBias(NamedTuple):
    """The systematic error along the viewing ray."""

    mean: float
    """m"""
    std: float
    """m, standard deviation"""


class Misfit(NamedTuple):
    """What percepts cost."""

    nats: float = 0.0
    way: Way = "beside"
    """In which they are off most."""
    alike: tuple[Offset, ...] = ()
    """Those of the percepts that are off as the newest is."""


def misfit(deviations: Sequence[Deviation], bias: DepthBias, false: float = FALSE_FRAME) -> Misfit:
    """What the percepts of a span cost, the oldest first, in the way in which they are off most.

    Args:
        deviations: from a place of the object.
        bias: along the viewing ray.
        false: nats, that a percept is false.
    """
    found = Misfit()
    for way in WAYS if deviations else ():
        alike, lead = _alike([offset(way, deviation, bias) for deviation in deviations])
        noise = max(_improbability(way, alike) - _ORDINARY, 0.0)
        nats = max(-_log_sum(-noise, -false * lead), 0.0)
        if not found.alike or nats > found.nats:
            found = Misfit(nats, way, tuple(alike))
    return found


def disagreement(deviation: Deviation, bias: DepthBias) -> float:
    """What noise alone costs that makes one percept so far off, nats."""
    return max(max(_of_one(way, offset(way, deviation, bias)) for way in WAYS) - _ORDINARY, 0.0)


def disagrees(deviation: Deviation, bias: DepthBias, share: float = 1.0) -> bool:
    """Whether one percept would be surprising, or as much as a share of that, if it could not be false."""
    return is_surprising(disagreement(deviation, bias), share)


def is_surprising(nats: float, share: float = 1.0) -> bool:
    """Whether what noise alone costs is surprising, or as much as a share of that."""
    return nats >= share * SURPRISING


def offset(way: Way, deviation: Deviation, bias: DepthBias) -> Offset:
    """How far a percept is off in one way, without the systematic error."""
    if way == "beside":
        return deviation.beside
    if way == "turn":
        return deviation.turn
    depth = deviation.depth
    return Offset((depth.vector[0] - bias.mean, 0.0, 0.0), depth.noise, math.hypot(depth.common, bias.std))


def describe(found: Misfit, camera: str) -> str:
    """Describe in words how far off percepts are, with medians."""
    amount = statistics.median(one.length for one in found.alike)
    sigmas = statistics.median(one.length / math.hypot(one.noise, one.common) for one in found.alike)
    if found.way == "beside":
        return f"seen {amount * 1e3:.0f} mm beside its belief ({sigmas:.0f} sigma)"
    if found.way == "turn":
        return f"seen turned by {math.degrees(amount):.0f} deg ({sigmas:.0f} sigma)"
    side = "nearer to" if statistics.median(one.vector[0] for one in found.alike) < 0.0 else "farther from"
    return f"seen {amount * 1e3:.0f} mm {side} {camera} ({sigmas:.0f} sigma)"


def are_alike(a: Offset, b: Offset) -> bool:
    """Whether two disagreements point in the same direction and are of similar length, as those of one move are."""
    return math.dist(a.vector, b.vector) <= 0.5 * max(a.length, b.length)


def _alike(offsets: Sequence[Offset]) -> tuple[list[Offset], int]:
    """Those that are off as the newest is, and by how many they outnumber those that agree with the belief since.

    They are looked for as far back as makes their lead greatest.
    """
    newest, alike, lead = offsets[-1], [offsets[-1]], 1
    found, most = [offsets[-1]], 1
    for one in reversed(offsets[:-1]):
        if are_alike(one, newest):
            alike.append(one)
            lead += 1
        elif one.length < math.dist(one.vector, newest.vector):
            lead -= 1
        if lead > most:
            found, most = list(alike), lead
    return found, most


def _improbability(way: Way, alike: Sequence[Offset]) -> float:
    """How improbable it is that noise makes the mean of percepts so far off, nats."""
    count = len(alike)
    squared = sum(sum(parts) ** 2 for parts in zip(*(one.vector for one in alike), strict=True)) / count**2
    noise, common = sum(one.noise**2 for one in alike) / count**2, sum(one.common**2 for one in alike) / count
    return _of_half(way, float(0.5 * squared / (noise + common)))


def _of_one(way: Way, one: Offset) -> float:
    """How improbable it is that noise makes one percept so far off, nats."""
    x, y, z = one.vector
    return _of_half(way, float(0.5 * (x**2 + y**2 + z**2) / (one.noise**2 + one.common**2)))


def _of_half(way: Way, half: float) -> float:
    """The same, nats, by half the square of the distance in standard deviations."""
    if way == "beside":
        return half
    return -(log_tail_of_three(half) if way == "turn" else math.log(_tail_of_one(half)))


def log_tail_of_three(half: float) -> float:
    """Logarithm of the probability that half the squared Mahalanobis distance of three coordinates is that great."""
    return math.log(_tail_of_one(half) + 2.0 * math.sqrt(half / math.pi) * math.exp(-half))


def _tail_of_one(half: float) -> float:
    return max(math.erfc(math.sqrt(half)), sys.float_info.min)


def _log_sum(a: float, b: float) -> float:
    """Logarithm of the sum of two probabilities, of which the logarithms are given."""
    return max(a, b) + math.log1p(math.exp(-abs(a - b)))
