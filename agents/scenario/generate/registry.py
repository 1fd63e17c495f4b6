"""The families of random episodes: what each is about, and whether it is for tuning or for judging."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from agents.scenario.generate.draft import EpisodeDraft
from agents.scenario.generate.families.handling import handing, hands, persons
from agents.scenario.generate.families.motions import rolling
from agents.scenario.generate.families.piles import leaning, perturbations, propped, stacks
from agents.scenario.generate.families.senses import blackouts, bumps, failures, screens, sensors
from agents.scenario.generate.families.vessels import containers, covers, pouring
from dsr.errors import ConfigError, suggest

Purpose = Literal["tuning", "judging"]
FIRST_JUDGING_SEED = 1000
"""From this seed on, the episodes of every family are for judging alone: nobody looks at them before."""


class Family(NamedTuple):
    """A kind of random episodes."""

    name: str
    title: str
    draw: Callable[[EpisodeDraft], None]
    """Fills an empty draft."""
    purpose: Purpose
    """Whether anything may be set or learned by its episodes: then it is for tuning."""
    may_fall: bool = False
    """Whether things falling off the table belong to it."""
    system: str = "reasoner"
    """The agents that take part, `etc/systems/<system>.toml`."""


FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Family("stacks", "Stacks are built, taken apart, moved and toppled", stacks, "tuning"),
        Family("perturbations", "Things are swapped, turned, shoved and taken away", perturbations, "tuning"),
        Family("rolling", "Balls roll, things are dropped and fall off the table", rolling, "tuning", may_fall=True),
        Family("leaning", "Boards lean, cans lie, and what holds them up is moved", leaning, "judging", may_fall=True),
        Family("propped", "Things lie aslant on others, which are moved", propped, "tuning"),
        Family("containers", "Things are put into vessels, and come along in them", containers, "tuning"),
        Family("covers", "Things are hidden under covers and moved with them", covers, "judging"),
        Family("hands", "Hands take things away, behind things, or only touch them", hands, "tuning"),
        Family("handing", "A thing goes from hand to hand", handing, "judging"),
        Family("pouring", "What is in a vessel is poured out", pouring, "tuning", may_fall=True),
        Family("bumps", "The camera is bumped", bumps, "tuning"),
        Family("blackouts", "Things change while the camera sees nothing", blackouts, "judging", may_fall=True),
        Family("failures", "The camera fails, and things change or not", failures, "tuning", may_fall=True),
        Family("screens", "Things are half hidden unseen, and some are taken away", screens, "tuning"),
        Family("sensors", "Sensors err, and things are seen where they are not", sensors, "tuning"),
        Family("persons", "People look on while hands move things", persons, "judging", system="people"),
    )
}
"""All by name, in the order in which they are told."""


def find_family(name: str) -> Family:
    """The family of that name. Raises `ConfigError`."""
    if name not in FAMILIES:
        raise ConfigError(f"unknown family {name!r}; {suggest(name, FAMILIES, most=len(FAMILIES))}")
    return FAMILIES[name]


def is_for_tuning(family: str, seed: int) -> bool:
    """Whether anything may be set or learned by this episode."""
    return find_family(family).purpose == "tuning" and seed < FIRST_JUDGING_SEED
