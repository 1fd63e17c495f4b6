"""Explains by hypotheses that are simulated and weighed against percepts and expected percepts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from dsr.believing.worlds import MOST_WORLDS
from dsr.clock import Clock
from dsr.perception.scales import RESOLUTION, SAME_OUTCOME
from dsr.vocabulary import nats
from dsr.vocabulary.explained import text_of
from simulation_handler.explaining.drafting import Draft
from simulation_handler.explaining.hypotheses import Hypothesis
from simulation_handler.explaining.least_change import with_least_change
from simulation_handler.explaining.policy import Explanation
from simulation_handler.explaining.search import Candidate, search
from simulation_handler.explaining.situation import Situation
from simulation_handler.explaining.wording import describe
from simulation_handler.physics.rollouts import RolloutBody, RolloutScene
from simulation_handler.physics.rollouts.pool import Pool
from simulation_handler.physics.rollouts.scene import STILL
from simulation_handler.shapes.geometry import Solid


def with_typical_fall(ranking: Sequence[Candidate]) -> list[Candidate]:
    """The ranking, with one in the place of the best and all that differ from it only in how something fell.

    That is the medoid: the one whose objects come to lie nearest, on average, to where those of the others do, by
    the probabilities of these.
    """
    if not ranking or not ranking[0].hypothesis.fallen:
        return list(ranking)
    best, kind = ranking[0], _kind(ranking[0].hypothesis)
    alike = [candidate for candidate in ranking if _kind(candidate.hypothesis) == kind]
    weights = [math.exp(best.score.total - candidate.score.total) for candidate in alike]

    def distance(candidate: Candidate) -> float:
        """Mean distance (m), up to a factor, of what fell to where it lies in the other outcomes."""
        return sum(
            weight * math.dist(candidate.settled[name].position, other.settled[name].position)
            for weight, other in zip(weights, alike, strict=True)
            for name, _ in best.hypothesis.fallen
        )

    medoid = min((c for c in alike if c.score.total - best.score.total <= nats.AS_GOOD), key=distance)
    return [medoid, *(candidate for candidate in ranking if _kind(candidate.hypothesis) != kind)]


def _kind(hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis without how things fell."""
    return replace(hypothesis, fallen=tuple((name, 0) for name, _ in hypothesis.fallen))


class ByHypotheses:
    """The default policy.

    Args:
        pool: simulates the hypotheses.
        clock: measures the budget of an explanation; a pool without processes needs none.
    """

    name = "hypotheses"

    def __init__(self, pool: Pool, clock: Clock) -> None:
        self._pool = pool
        self._clock = clock
        self._deadline: float | None = None  # s, of what is simulated with workers
        self._is_complete = True  # whether all was simulated that had to be
        self._last: Hypothesis | None = None

    def prepare(self) -> None:
        """Start the processes that simulate."""
        self._pool.start()

    def explain(self, situation: Situation) -> Explanation | None:
        """The best hypothesis, if it leads clearly or waiting will not help."""
        self._pool.start()
        self._deadline, self._is_complete = None, True
        first = self._last if self._last and self._fits(self._last, situation) else None
        found = search(situation, self._simulate, situation.config.most_rollouts, first)
        ranking = with_typical_fall(with_least_change(situation, found))
        if not ranking or not self._is_clear(situation, ranking):
            return None
        self._last = ranking[0].hypothesis
        return self._explanation(situation, ranking)

    def close(self) -> None:
        """End the processes that simulate."""
        self._pool.close()

    def _fits(self, hypothesis: Hypothesis, situation: Situation) -> bool:
        """Whether a hypothesis is about the objects that are surprising now: something goes on as before."""
        if hypothesis.camera_moved:
            return False
        names = {move.name for move in hypothesis.moves}
        known = situation.believed.keys() | situation.unplaced.keys()
        return names == set(situation.surprising) and names <= situation.seen.keys() and hypothesis.unseen <= known

    def _is_clear(self, situation: Situation, ranking: Sequence[Candidate]) -> bool:
        patience = situation.config.explain_patience
        if not self._is_complete and situation.evidence < 2.0 * patience:  # then even an incomplete search must do
            return False
        if situation.evidence >= patience:
            return True
        best = ranking[0].hypothesis
        if best.camera_moved or not (best.moves or best.unseen):
            return False
        rival = next((other for other in ranking[1:] if _differ(ranking[0], other)), None)
        return rival is None or rival.score.total - ranking[0].score.total >= situation.config.explain_margin

    def _explanation(self, situation: Situation, ranking: Sequence[Candidate]) -> Explanation:
        best = ranking[0]
        hypothesis = best.hypothesis
        if hypothesis.camera_moved:
            return self._of_camera(situation, ranking)
        placed = set(best.drafted.placements)
        seen = {name for name in placed if name in situation.seen}
        settled = {name: best.settled[name] for name in placed - seen}
        wanted = {name: best.drafted.solids[name] for name in seen}
        pushed = {
            name: solid
            for name, solid in best.settled.items()
            if name not in placed | situation.seen.keys() | situation.held
            and math.dist(solid.position, situation.believed[name].position) > RESOLUTION
        }
        told = {move.name for move in hypothesis.moves} | hypothesis.unseen | hypothesis.kept
        return Explanation(
            changes=describe(situation, best),
            about=tuple(sorted(told | set(situation.surprising))),
            solids={**pushed, **settled, **wanted},
            placements={name: best.drafted.placements[name] for name in seen},
            held=best.drafted.held - situation.held,
            removed=hypothesis.removed,
            unexplained=frozenset(best.score.residuals),
            changes_belief=bool(placed or hypothesis.removed),
            score=best.score.total,
            alternatives=self._alternatives(situation, ranking),
            hypothesis=hypothesis,
        )

    def _of_camera(self, situation: Situation, ranking: Sequence[Candidate]) -> Explanation:
        """Nothing is put anywhere: what moved beside the camera is seen once it is known where that is."""
        return Explanation(
            changes=describe(situation, ranking[0]),
            about=tuple(sorted(situation.seen.keys() | set(situation.surprising))),
            changes_belief=False,
            score=ranking[0].score.total,
            alternatives=self._alternatives(situation, ranking),
            hypothesis=ranking[0].hypothesis,
        )

    def _alternatives(self, situation: Situation, ranking: Sequence[Candidate]) -> tuple[tuple[float, str], ...]:
        """The best of what was rejected, each in other words: as many as there may be worlds of the belief."""
        best: dict[str, float] = {}
        for candidate in ranking:
            best.setdefault(text_of(describe(situation, candidate)), candidate.score.total)
        return tuple((score, text) for text, score in list(best.items())[1 : 1 + MOST_WORLDS])

    def _simulate(self, situation: Situation, drafts: Sequence[Draft]) -> list[Mapping[str, Solid] | None]:
        scenes = [scene_of(situation, drafted) for drafted in drafts]
        left, now = None, self._clock.monotonic()
        if self._pool.pids:  # the first of an explanation have all of the budget, however long it took to draft them
            self._deadline = now + situation.config.explain_budget if self._deadline is None else self._deadline
            left = max(self._deadline - now, 0.0)
        outcomes = self._pool.run(scenes, situation.config.rollout_seconds, left)
        self._is_complete = self._is_complete and None not in outcomes
        return [
            None
            if outcome is None
            else {name: solid.at(*outcome.poses[name]) for name, solid in drafted.solids.items()}
            for drafted, outcome in zip(drafts, outcomes, strict=True)
        ]


def _differ(a: Candidate, b: Candidate) -> bool:
    """Whether two hypotheses leave something in different places."""
    return a.settled.keys() != b.settled.keys() or any(
        math.dist(solid.position, b.settled[name].position) > SAME_OUTCOME for name, solid in a.settled.items()
    )


def scene_of(situation: Situation, drafted: Draft) -> RolloutScene:
    """Make the scene of a draft that is to be simulated."""
    bodies = []
    for solid in (*situation.fixtures.values(), *drafted.solids.values()):
        fixed = solid.name in situation.fixtures
        properties = situation.properties[solid.name]
        motion = drafted.motions.get(solid.name)
        bodies.append(
            RolloutBody(
                solid.name,
                solid.size,
                solid.position,
                solid.rotation,
                mass=0.0 if fixed else properties.mass,
                friction=properties.friction,
                fixed=fixed or solid.name in drafted.held,
                shape=solid.shape,
                rolling_friction=properties.rolling_friction,
                velocity=motion.velocity if motion else STILL,
                spin=motion.spin if motion else STILL,
            )
        )
    return RolloutScene(tuple(bodies))
