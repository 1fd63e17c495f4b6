"""Who sees what: time for 50 things from 5 perspectives at 320 x 240, and agreement with exact ray casting.

    python -m benchmarks.visibility --scenes 1000
    python -m benchmarks.visibility --begin 500 --scenes 500 --json part.json

The peer is the renderer of pybullet on the processor (TinyRenderer), which draws the same scene once from the same
place and tells no shares. Agreement: in random scenes of 4 to 24 things, whether each is seen, compared with rays that
know of no pixels (576 over each thing, at all parts of everything), where the share is not within 0.05 of the
threshold.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np

from benchmarks.group import Group, Run
from benchmarks.rows import Peer, Spec
from benchmarks.visibility_scene import TABLE, random_things, shares
from dsr.math3d.transforms import Pose, looking_at
from dsr.visibility import LEAST_SHARE, Body, Picture
from dsr.vocabulary.intrinsics import Intrinsics

THINGS, PERSPECTIVES = 50, 5
LENS = Intrinsics.from_fov(320, 240, 1.05)
AWAY = 0.05
"""Of a share, from the threshold, within which a decision may go either way."""
TIME = Spec(
    f"visibility of {THINGS} things from one perspective", "ms",
    about="picture of 320 x 240 px and the share of each thing, CPU time; peer: TinyRenderer draws the same once",
)  # fmt: skip
AGREEMENT = Spec(
    "visibility: agreement with exact ray casting", "%", 99.0, "higher",
    about=f"whether things are seen, in random scenes, where the share is not within {AWAY} of the threshold",
)  # fmt: skip
SPECS = (TIME, AGREEMENT)


class Agreement(NamedTuple):
    """How decisions compare with exact ones."""

    scenes: int
    decisions: int
    """Away from the threshold."""
    agreed: int
    near: int
    """Within `AWAY` of it."""
    worst: float
    """Largest difference of a share."""

    @property
    def percent(self) -> float:
        """Of the decisions."""
        return 100.0 * self.agreed / max(1, self.decisions)


def measure(run: Run) -> None:
    """Both rows."""
    run.step("visibility: time")
    ours, tiny = times(run.pick(20, 3))
    run.row(TIME, ours, [Peer("TinyRenderer", tiny)], f"median of {PERSPECTIVES} perspectives")
    run.step("visibility: agreement")
    found = agreement(0, run.pick(100, 5))
    run.row(AGREEMENT, found.percent, note=f"{found.decisions} decisions in {found.scenes} scenes")


def times(rounds: int) -> tuple[float, float]:
    """Median CPU ms for one perspective: ours, and that of the peer."""
    from benchmarks.peers.tiny_renderer import TinyScene  # its library says something when it is loaded

    rng = np.random.default_rng(0)
    bodies = [TABLE, *random_things(rng, THINGS)]
    names = [body.name for body in bodies[1:]]
    views = [view_from(angle) for angle in np.linspace(0.0, 2 * np.pi, PERSPECTIVES, endpoint=False)]
    ours, tiny = [], []
    with TinyScene(bodies) as scene:
        for view in views * rounds:
            begin = process_time()
            picture = Picture(view, LENS, bodies, names)
            for name in names:
                picture.visible(name)
            middle = process_time()
            scene.picture(view, LENS)
            ours.append(middle - begin)
            tiny.append(process_time() - middle)
    return 1e3 * statistics.median(ours), 1e3 * statistics.median(tiny)


def agreement(begin: int, count: int) -> Agreement:
    """Of `count` random scenes, by their seeds from `begin` on."""
    total = Agreement(0, 0, 0, 0, 0.0)
    for seed in range(begin, begin + count):
        rng = np.random.default_rng(seed)
        bodies = [TABLE, *random_things(rng, int(rng.integers(4, 25)))]
        view = view_from(float(rng.uniform(0.0, 2 * np.pi)), float(rng.uniform(0.6, 1.5)), float(rng.uniform(0.1, 0.9)))
        total = _added(total, view, bodies)
    return total


def _added(total: Agreement, view: Pose, bodies: Sequence[Body]) -> Agreement:
    exact = shares(view, LENS, bodies)
    picture = Picture(view, LENS, bodies, [body.name for body in bodies[1:]])
    decisions = agreed = near = 0
    worst = total.worst
    for body in bodies[1:]:
        share = picture.visible(body.name).share
        worst = max(worst, abs(share - exact[body.name]))
        if abs(exact[body.name] - LEAST_SHARE) < AWAY:
            near += 1
            continue
        decisions += 1
        agreed += (share >= LEAST_SHARE) == (exact[body.name] >= LEAST_SHARE)
    return Agreement(
        total.scenes + 1, total.decisions + decisions, total.agreed + agreed, total.near + near, worst
    )  # fmt: skip


def view_from(angle: float, distance: float = 1.1, height: float = 0.5) -> Pose:
    """world_from_view of somebody at the table who looks at its middle."""
    return looking_at((distance * np.cos(angle), distance * np.sin(angle), height), (0.0, 0.0, 0.0))


GROUP = Group("visibility", SPECS, measure)


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser("python -m benchmarks.visibility", description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", type=int, default=100, help="random scenes to compare (default: 100)")
    parser.add_argument("--begin", type=int, default=0, help="seed of the first one (default: 0)")
    parser.add_argument("--rounds", type=int, default=20, help="of timing (default: 20; 0 for none)")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    options = parser.parse_args()
    figures: dict[str, float] = {}
    if options.rounds:
        ours, tiny = times(options.rounds)
        figures |= {"perspective_ms": ours, "tiny_renderer_ms": tiny}
        print(f"{THINGS} things from one perspective: {ours:.1f} ms of CPU; TinyRenderer {tiny:.1f} ms")
    if options.scenes:
        found = agreement(options.begin, options.scenes)
        figures |= {**found._asdict(), "agreement_percent": found.percent}
        print(
            f"{found.scenes} scenes: {found.percent:.2f} % of {found.decisions} decisions agree; {found.near} within "
            f"{AWAY} of the threshold; largest difference of a share {found.worst:.3f}"
        )
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
