"""The learned parameters of the weighted worlds, read from `etc/belief/worlds.toml`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

from dsr.believing.absence import LEARNED, Absence, Recognition
from dsr.config.toml import TomlFile

Amount = Annotated[float, msgspec.Meta(ge=0)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class PlaceNoise(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How far an object may be from where a world has it, in one circumstance."""

    scale: Amount
    """1, factor on the standard deviations that perception tells"""
    level: Amount
    """m, standard deviation in each horizontal direction"""
    height: Amount
    """m, standard deviation in height"""
    growth: Amount
    """m/sqrt(s), standard deviation of a random walk since the object was seen, in each horizontal direction"""
    path: Amount
    """1, standard deviation in each horizontal direction, as a share of the way since the object was seen"""
    upwards: Share
    """1, share of `growth` and `path` that counts in height"""
    lag: Amount
    """s, standard deviation of the time by which what moves is ahead or behind"""
    turn: Amount
    """rad, standard deviation about each axis"""
    turning: Amount
    """rad/m, standard deviation about each axis, for the way since the object was seen"""
    wide: Amount
    """1, factor on all standard deviations where something unknown is wrong, and once more where that is wrong, too"""
    wrong: Share
    """1, probability of these worlds, and of the wider one among them"""
    perceived: Annotated[float, msgspec.Meta(ge=0, lt=1)]
    """1, probability of the world in which the object is where percepts have it, if the simulation has it there, too"""
    trust: Amount
    """1, power by which the odds of that world grow with 1 + the squared Mahalanobis distance between the two"""
    percept: Amount
    """1, factor on the standard deviations of the place that percepts tell in that world"""


class Rates(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How soon something else is so than the simulation has it, while an object is not seen."""

    moved: Amount
    """1/s, that it is moved to somewhere near, with no hand in reach"""
    moved_by_hand: Amount
    """1/s, the same within reach of a hand"""
    taken: Amount
    """1/s, that a hand within reach takes it"""
    put_down: Amount
    """1/s, that a hand that holds it leaves it somewhere near"""
    removed: Amount
    """1/s, that it leaves the scene"""
    stayed: Amount
    """1/m, that it did not go along when the simulation moves it"""
    kept: Share
    """1, that it is still in its container when the simulation moves it out of there"""
    entered: Share
    """1, that what vanishes on its way beside or over a container is in it"""
    went_on: Share
    """1, that what vanishes on its way goes on otherwise than the simulation has it, by one of its courses"""
    astray: Share
    """1, that something unknown stopped it near, or turned it, on any of these courses and the simulation's"""
    work: Amount
    """1/s, that somebody begins to work while cameras fail"""
    work_removed: Share
    """1, that an object leaves the scene when somebody was at work then"""
    work_moved: Share
    """1, that an object is moved to somewhere near when somebody was at work then, if it does not leave"""
    missed: Share
    """1, that it has left the scene when the explanation of its absence says so"""
    slipped: Share
    """1, that what rested in view, and is missing with no hand about, was moved to somewhere near, seen there or not"""
    vanished: Share
    """1, that it has left the scene then, if it was not moved to somewhere near"""


class Elsewhere(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where an object is that was moved by something unknown: a Gaussian around where it was."""

    level: Amount
    """m, standard deviation in each horizontal direction"""
    growth: Amount
    """m/sqrt(s), growth of that since the object was seen"""
    height: Amount
    """m, standard deviation in height"""


class Within(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where an object in a container is."""

    level: Amount
    """1, standard deviation in each direction as a share of the container's edge lengths"""


class WorldParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of them."""

    noise: dict[str, PlaceNoise]
    """By circumstance (`simulation_handler.worlds.circumstances`)."""
    holding: dict[str, Share]
    """1, probability that the human hand which seems to hold or touch an object holds it, by `circumstances.hold`"""
    rates: Rates
    absence: Absence
    recognition: Recognition
    elsewhere: Elsewhere
    within: Within


@cache
def learned_parameters(file: Path = LEARNED) -> WorldParameters:
    """The parameters of a file. Raises `ConfigError` with its line for a field that does not fit."""
    return TomlFile(file).convert(WorldParameters, ("parameters",))
