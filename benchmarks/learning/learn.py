"""Learns all parameters by recorded episodes, and tells them as TOML with their standard errors."""

from __future__ import annotations

import pickle
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from agents.scenario.generate.registry import is_for_tuning
from benchmarks.learning.holding import HOLDING, learn_holding
from benchmarks.learning.judged import Episode, RememberedShares
from benchmarks.learning.noise import START, Errors, errors_of, learn_noise
from benchmarks.learning.rates import (
    ABSENCE,
    ELSEWHERE,
    RATES,
    WITHIN,
    Key,
    Vector,
    learn_rates,
    start_of,
    with_values,
)
from benchmarks.learning.recognition import CURVES, learn_recognition, looks_at
from dsr.believing.absence import LEARNED, Absence
from simulation_handler.worlds.circumstances import CIRCUMSTANCES, IN_VIEW
from simulation_handler.worlds.parameters import Elsewhere, PlaceNoise, Rates, WorldParameters, learned_parameters
from simulation_handler.worlds.weighted import WeightedWorlds

_MOST_MOMENTS = 1200  # of one circumstance that are used, evenly chosen
_RESAMPLINGS = 4  # of episodes, by which standard errors of noise are found

RECOGNITION = "recognition"
GROUPS = ("rates", "absence", RECOGNITION, "elsewhere", "within")
"""Of values other than noise and holding"""
BEGUN = WorldParameters(dict.fromkeys(CIRCUMSTANCES, START), {}, RATES, ABSENCE, CURVES, ELSEWHERE, WITHIN)
"""Before anything is learned"""

VALUES: Mapping[str, Sequence[Key]] = {
    **{name: [("rates", name)] for name in Rates.__struct_fields__},
    "absence": [("absence", name) for name in Absence.__struct_fields__],
    "elsewhere": [("elsewhere", name) for name in Elsewhere.__struct_fields__],
}
"""What may be learned alone beside noise and holding: single rates, and all of absence and of elsewhere"""

Deviations = Mapping[str, Mapping[str, float]]
Sources = Mapping[str, Sequence[str]]
"""Names of the episodes, by `episodes` and by circumstances that were learned by others"""


def learn_parameters(folder: Path, tell: Callable[[str], None]) -> str:
    """Learn by the recorded episodes of a folder; the TOML file. Those for judging are left out."""
    episodes = [episode for episode in load_episodes(folder) if _is_for_tuning(episode)]
    tell(f"{len(episodes)} episodes")
    known, told = learned_parameters(), tomllib.loads(LEARNED.read_text(encoding="utf-8"))
    begun = msgspec.structs.replace(BEGUN, recognition=known.recognition)
    noise, deviations = _learn_noise(episodes, begun, CIRCUMSTANCES, tell)
    holding, unsure = _learn_holding(episodes, begun, tell)
    parameters, errors = learn_rates(episodes, msgspec.structs.replace(begun, noise=noise, holding=holding), tell)
    sources = {RECOGNITION: told["source"][RECOGNITION], "episodes": [episode.name for episode in episodes]}
    return toml_of(parameters, deviations, {**errors, **unsure, **_errors_of(told, RECOGNITION)}, sources)


def learn_some(folder: Path, only: Sequence[str], file: Path, tell: Callable[[str], None]) -> str:
    """Learn some values alone, and keep all others of `file`; the TOML file.

    Args:
        folder: of the recorded episodes.
        only: circumstances whose noise is learned, names of `VALUES`, and `holding` for what hands hold.
        file: that holds all other values.
        tell: is told what was learned.

    Raises:
        ConfigError: for a file whose values do not fit.
    """
    episodes = [episode for episode in load_episodes(folder) if _is_for_tuning(episode)]
    tell(f"{len(episodes)} episodes")
    parameters, told = learned_parameters(file), tomllib.loads(file.read_text(encoding="utf-8"))
    errors = _errors_of(told, HOLDING, *GROUPS)
    deviations = dict(told["errors"]["noise"])
    if circumstances := [name for name in only if name in CIRCUMSTANCES]:
        noise, found = _learn_noise(episodes, parameters, circumstances, tell)
        parameters = msgspec.structs.replace(parameters, noise={**parameters.noise, **noise})
        deviations |= found
    if values := [key for name in only for key in VALUES.get(name, ())]:
        begun = start_of(BEGUN)
        begin = with_values(parameters, {key: begun[key] for key in values})
        parameters, unsure = learn_rates(episodes, begin, tell, values)
        errors |= unsure
    if HOLDING in only:
        holding, unsure = _learn_holding(episodes, parameters, tell)
        parameters = msgspec.structs.replace(parameters, holding={**parameters.holding, **holding})
        errors |= unsure
    anew = {name: [episode.name for episode in episodes] for name in only}
    return toml_of(parameters, deviations, errors, {**told["source"], **anew})


def learn_to_recognise(families: Sequence[str], seeds: Sequence[int], file: Path, tell: Callable[[str], None]) -> str:
    """Learn how likely cameras recognise what they see a part of, and keep all other values of `file`; the TOML file.

    Raises:
        ConfigError: for a file whose values do not fit.
    """
    known, told = learned_parameters(file), tomllib.loads(file.read_text(encoding="utf-8"))
    looks, names = [], []
    for family, seed in ((family, seed) for family in families for seed in seeds if is_for_tuning(family, seed)):
        looks += looks_at(family, seed)
        names.append(f"{family}-{seed}")
        tell(f"{names[-1]}: {len(looks)} looks")
    recognition, errors = learn_recognition(looks)
    parameters = msgspec.structs.replace(known, recognition=recognition)
    kept = _errors_of(told, HOLDING, *(group for group in GROUPS if group != RECOGNITION))
    return toml_of(parameters, told["errors"]["noise"], kept | errors, {**told["source"], RECOGNITION: names})


def _errors_of(told: Mapping[str, Any], *groups: str) -> Vector:
    """Standard errors of all values of some groups that a file tells."""
    return {(group, name): error for group in groups for name, error in told["errors"].get(group, {}).items()}


def load_episodes(folder: Path) -> Iterator[Episode]:
    """Recorded episodes by name, every other moment."""
    for file in sorted(folder.glob("*-*.pickle")):
        settle, moments = pickle.loads(file.read_bytes())
        yield Episode(file.stem, settle, [one for one in moments if one.time >= 0.0][::2], RememberedShares())


def _is_for_tuning(episode: Episode) -> bool:
    family, _, seed = episode.name.partition("-")
    return is_for_tuning(family, int(seed))


def _learn_noise(
    episodes: Sequence[Episode], begun: WorldParameters, circumstances: Sequence[str], tell: Callable[[str], None]
) -> tuple[dict[str, PlaceNoise], dict[str, dict[str, float]]]:
    """The noise of each of some circumstances, and standard errors of the logarithms of its values."""
    told_of = ((episode.moments, WeightedWorlds(begun, episode.shares)) for episode in episodes)
    errors = errors_of(told_of, begun.noise)
    noise, deviations = {}, {}
    rng = np.random.default_rng(0)
    for circumstance in circumstances:
        found = errors.get(circumstance)
        seen = circumstance in IN_VIEW
        noise[circumstance] = START if found is None else learn_noise(_thinned(found), is_in_view=seen)
        tell(f"{circumstance}: {0 if found is None else len(found.age)} moments, {noise[circumstance]}")
        if found is not None:
            tried = [
                learn_noise(_thinned(_resampled(found, rng)), noise[circumstance], is_in_view=seen)
                for _ in range(_RESAMPLINGS)
            ]
            values = [np.log(np.array(msgspec.structs.astuple(one)) + _NOTHING) for one in tried]
            spread = np.std(values, axis=0, ddof=1).tolist()
            deviations[circumstance] = dict(zip(PlaceNoise.__struct_fields__, spread, strict=True))
    return noise, deviations


def _learn_holding(
    episodes: Sequence[Episode], begun: WorldParameters, tell: Callable[[str], None]
) -> tuple[dict[str, float], Vector]:
    """How often hands hold what they seem to hold, by circumstance, and standard errors of the logits."""
    found, errors = learn_holding((episode.moments, WeightedWorlds(begun, episode.shares)) for episode in episodes)
    for circumstance, share in found.items():
        tell(f"{HOLDING}, {circumstance}: {share:.3f}")
    return found, {(HOLDING, circumstance): error for circumstance, error in errors.items()}


_NOTHING = 1e-9  # added before a logarithm


def _thinned(errors: Errors) -> Errors:
    count = len(errors.age)
    return errors if count <= _MOST_MOMENTS else errors.of(np.linspace(0, count - 1, _MOST_MOMENTS).astype(np.int64))


def _resampled(errors: Errors, rng: np.random.Generator) -> Errors:
    """As many episodes, drawn with replacement."""
    numbers = np.unique(errors.episode)
    drawn = rng.choice(numbers, len(numbers))
    return errors.of(np.concatenate([np.flatnonzero(errors.episode == number) for number in drawn]))


def toml_of(parameters: WorldParameters, deviations: Deviations, errors: Vector, sources: Sources) -> str:
    """The file: parameters, and below them the standard errors of their logarithms (or logits)."""
    lines = [
        "# Learned parameters of the weighted worlds: `python -m benchmarks.learning fit` writes this file.",
        "# simulation_handler/worlds/parameters.py tells what each one means, and its unit.",
        "",
    ]
    for circumstance, noise in parameters.noise.items():
        lines += _table(f'parameters.noise."{circumstance}"', msgspec.structs.asdict(noise))
    lines += _table(f"parameters.{HOLDING}", parameters.holding)
    for group in GROUPS:
        lines += _table(f"parameters.{group}", msgspec.structs.asdict(getattr(parameters, group)))
    lines += ["# Standard errors of the logarithms of these values, of probabilities: of their logits.", ""]
    for circumstance, told in deviations.items():
        lines += _table(f'errors.noise."{circumstance}"', told)
    for group in (HOLDING, *GROUPS):
        lines += _table(f"errors.{group}", {name: error for (of, name), error in errors.items() if of == group})
    lines += ["# The episodes that were learned by; of what was learned later, those.", "", "[source]"]
    lines += [f'"{name}" = {msgspec.json.encode(list(episodes)).decode()}' for name, episodes in sources.items()]
    lines.append("")
    return "\n".join(lines)


def _table(name: str, values: Mapping[str, float]) -> list[str]:
    """Keys with blanks are names of circumstances, and quoted."""
    quoted = {f'"{key}"' if " " in key else key: value for key, value in values.items()}
    return [f"[{name}]", *(f"{key} = {float(f'{value:.3g}')!r}" for key, value in quoted.items()), ""]
