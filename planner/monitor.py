"""Watches the relations while the arm works, for changes that nobody planned."""

from __future__ import annotations

import math
from collections.abc import Mapping

from dsr.clock import ROUNDING
from dsr.math3d.quaternions import Vector3
from dsr.memory import Memory
from dsr.vocabulary.calibration import IN_DOUBT
from dsr.vocabulary.relations import THINGS, Relations
from planner.config import PlannerConfig
from planner.plan import PlanStep


def surprising(memory: Memory) -> list[str]:
    """Names of the things that are being explained, in order."""
    return sorted(node.name for node in memory.nodes(THINGS) if node.get("surprising") is True)


def doubtful(memory: Memory) -> list[str]:
    """Names of the cameras that may have moved, which is being looked into; in order."""
    return sorted(node.name for node in memory.nodes("camera") if node.get("mount") == IN_DOUBT)


def differences(before: Relations, after: Relations, step: PlanStep | None = None) -> list[str]:
    """List the relations that began or ended between two moments, but for the effects of `step`; as text, in order."""
    found = [(fact, "ended") for fact in before.facts - after.facts]
    found += [(fact, "began") for fact in after.facts - before.facts]
    texts = [f"{fact} {how}" for fact, how in found if step is None or not step.may_change(fact)]
    texts += [f"{thing} is gone" for thing in before.things - after.things]
    texts += [f"{thing} appeared" for thing in after.things - before.things]
    return sorted(texts)


class RelationMonitor:
    """Tells when a change that `step` does not explain has lasted long enough to be believed.

    Relations flicker while a surprise is being explained. A change of what the step does not touch may then last
    longer; one of what it touches may not, for the arm is about to rely on it.
    """

    def __init__(self, before: Relations, step: PlanStep | None, config: PlannerConfig) -> None:
        self._before = before
        self._step = step
        self._config = config
        self._since: float | None = None
        self.change = ""
        """What deviates now, as text; empty if nothing does."""
        self.about_step = False
        """Whether it concerns the very thing that is being moved."""

    def deviates(self, relations: Relations, surprises: list[str], now: float) -> bool:
        """Whether the relations at `now` (s) deviate, and have for long enough."""
        found = differences(self._before, relations, self._step)
        self.change = ", ".join(found)
        if not found:
            self._since = None
            return False
        if self._since is None:
            self._since = now
        self.about_step = self._concerns_thing(relations)
        patient = bool(surprises) and not self._concerns_step(relations)
        limit = self._config.explained if patient else self._config.settle
        return now - self._since >= limit - ROUNDING

    def _changed(self, relations: Relations) -> set[str]:
        step = self._step
        changed = self._before.facts ^ relations.facts
        facts = [fact for fact in changed if step is None or not step.may_change(fact)]
        return {name for fact in facts for name in fact.arguments} | (self._before.things ^ relations.things)

    def _concerns_thing(self, relations: Relations) -> bool:
        changed = self._before.facts ^ relations.facts
        step = self._step
        return step is not None and any(f.arguments[0] == step.thing and not step.may_change(f) for f in changed)

    def _concerns_step(self, relations: Relations) -> bool:
        """Whether it is about the thing, its support, or what carries them."""
        if self._step is None:
            return False
        concerned: set[str] = set()
        grown = {self._step.thing, self._step.support} - self._before.tables
        while grown != concerned:
            concerned = grown
            grown = concerned | {support for name in concerned for support in self._before.supports(name)}
            grown -= self._before.tables
        return not concerned.isdisjoint(self._changed(relations) - self._before.tables)


def believed_places(memory: Memory) -> dict[str, Vector3]:
    """(3,) m in the world of everything that is believed to be somewhere."""
    return {edge.dst: pose.t for edge in memory.edges("Virtual_RT") if (pose := edge.get("pose")) is not None}


def have_moved(before: Mapping[str, Vector3], now: Mapping[str, Vector3], tolerance: float) -> bool:
    """Whether something has come, gone, or moved by more than `tolerance` m."""
    return before.keys() != now.keys() or any(math.dist(place, now[name]) > tolerance for name, place in before.items())
