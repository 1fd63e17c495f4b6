"""How much it tells that cameras do not recognise what they should see: learned parameters that all agents share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from statistics import fmean
from typing import Annotated

import msgspec

from dsr.config.toml import TomlFile
from dsr.files.built_in import ETC
from dsr.vocabulary.nats import AGAIN, MOST_MISSED

LEARNED = ETC / "belief" / "worlds.toml"
"""The file with all learned parameters of the belief. Written by `python -m benchmarks.learning`."""


class Absence(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How soon cameras recognise what they should see."""

    rate: Annotated[float, msgspec.Meta(ge=0)]
    """1/s, of percepts of an object that is surely recognised"""
    blind: Annotated[float, msgspec.Meta(ge=0, le=1)]
    """1, probability that it is not recognised however long, at a place where it surely should be"""


class Recognition(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the probability that a thing is recognised grows with what is to be seen of it: logistic functions."""

    tag: float
    """1, share of its tag from which a thing with a tag is rather recognised than not"""
    tag_width: Annotated[float, msgspec.Meta(gt=0)]
    """1, more of that share, by which the odds grow by the factor e"""
    color: float
    """1, share of its image from which a thing without tag is rather recognised than not"""
    color_width: Annotated[float, msgspec.Meta(gt=0)]
    """1, more of that share, by which the odds grow by the factor e"""

    def probability(self, share: float, *, tagged: bool) -> float:
        """Of a thing of which a share (0 to 1) is to be seen, of its tag or, without one, of its image.

        A number beyond counts as the nearest share: it comes from the graph, where anybody may have written it.
        """
        half, width = (self.tag, self.tag_width) if tagged else (self.color, self.color_width)
        return 1.0 / (1.0 + math.exp((half - min(max(share, 0.0), 1.0)) / width))


@cache
def learned_recognition(file: Path = LEARNED) -> Recognition:
    """The parameters of a file. Raises `ConfigError` with its line for a field that does not fit."""
    return TomlFile(file).convert(Recognition, ("parameters", "recognition"))


def missed_after(missed: float, share: float, step: float, absence: Absence) -> float:
    """How often an object should have been recognised, after `step` s more in a `share` of which it should have been.

    It is never more than that can tell, for what cameras should see is only a model: probability `absence.blind` of no
    recognition is left where it surely should be, and its power by the share where it need not be.
    """
    most = -math.log(absence.blind) * share
    more = absence.rate * share * step
    return max(missed, min(missed + more, most))


def most_missed(probability: float) -> float:
    """What it tells at most that an object is missing which is recognised with some probability, nats."""
    return MOST_MISSED * probability


def somewhere(probabilities: Sequence[float]) -> float:
    """The probability of being recognised that tells as much, in many frames, of a thing at one of several places.

    All places are as probable. The thing stays where it is: where it is never recognised, all frames miss it.
    So one such place of four explains its absence, however plainly it would be seen at the other three.

    Args:
        probabilities: that it is recognised at each of the places, one or more.
    """
    unseen = fmean(math.exp(-most_missed(probability)) for probability in probabilities)
    return -math.log(unseen) / MOST_MISSED


def missed(frames: float, probability: float) -> float:
    """What it tells that an object is missing in so many frames, in each of which it should be recognised, nats.

    Args:
        frames: count, of which none shows it.
        probability: that it is recognised where it should be seen, by `Recognition.probability`.
    """
    return min(AGAIN * frames, MOST_MISSED) * probability
