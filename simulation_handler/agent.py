"""The simulation handler: keeps an internal physics simulation in step with the working memory, both ways."""

from __future__ import annotations

from dsr.agent import Access, Agent
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.believing.worlds import PREFIX
from dsr.config.plugins import REASONERS, load
from dsr.frames.tree import WORLD
from dsr.graph.access import EVERYTHING
from dsr.graph.schema import WORLD_RECORD
from dsr.network.keys import BASE
from dsr.perception.scales import TICK_RATE
from dsr.timeline import WRITTEN_ATTRIBUTES, WRITTEN_EDGES, WRITTEN_NODES
from dsr.vocabulary.calibration import CALIBRATION
from dsr.vocabulary.intrinsics import INTRINSICS
from dsr.vocabulary.observed_actions import DEEDS
from simulation_handler.belief import Belief
from simulation_handler.config import BeliefConfig
from simulation_handler.explaining import make_policy
from simulation_handler.graph_io.reading import FIXTURES, OBJECTS, GraphReader
from simulation_handler.graph_io.seeing import SEEN, Seeing
from simulation_handler.graph_io.views import PARTS
from simulation_handler.graph_io.what_if import KEY, WhatIfService
from simulation_handler.graph_io.writing import Writing
from simulation_handler.reasoner import Reasoner
from simulation_handler.shapes.meshes import Forms


class SimulationHandler(Agent):
    """Reads percepts (RT edges from cameras), lets physics correct them, and writes what it then believes.

    Writes Virtual_RT edges from the world to each object, with covariance, relations `on` from contact and `in`, what
    human hands hold (`grasping`), `whereabouts` of what may be in several ways, and the worlds `belief_1`, ... of the
    leading alternatives,
    `plausible`: whether what is perceived of an object is possible by what else is known, and edges `sees`: how much
    of an object each camera should see, and whether it will recognise it. Answers what-if questions
    (`dsr.vocabulary.what_if`) about the belief of its last tick. After a restart it goes on from what the graph says
    was believed and explained.
    """

    name = "simulation_handler"
    rate_hz = TICK_RATE
    reads = Access(
        nodes=(*FIXTURES, *OBJECTS, *PARTS, "world", "camera", "gripper", "action", CALIBRATION, *WRITTEN_NODES),
        edges=("RT", "Virtual_RT", "on", "in", "sees", "grasping", "let_go", "has"),
        attributes=(
            *("size", "shape", "mass", "friction", "rolling_friction", "plausible", "source", "since", "bounds"),
            *(*INTRINSICS, *SEEN),
            *("surprising", "present", "skill", "target", "destination", "status", "held_at", "handling"),
            *("perceived", "last_seen", "side", "mount", "mesh", "report", DEEDS),
        ),
    )
    writes = Access(
        nodes=(*OBJECTS, *WRITTEN_NODES, WORLD_RECORD, WORLD),
        edges=("Virtual_RT", "on", "in", "sees", "grasping", "let_go", *WRITTEN_EDGES),
        attributes=(
            *("plausible", "source", "since", "handling", "held_at", "probability", *SEEN),
            *(WHEREABOUTS, DEEDS, "weight", "things", "note"),
            *("present", "explanation", "score", "alternatives", "changes", "policy", "target", *WRITTEN_ATTRIBUTES),
        ),
        exclusive=(
            *("Virtual_RT", "on", "in", "let_go", "plausible", "present", "detectable", "covered_by"),
            *(WHEREABOUTS, DEEDS),
        ),
        worlds=(BASE, f"{PREFIX}{EVERYTHING}"),
    )
    publishes = (KEY,)
    Config = BeliefConfig
    config: BeliefConfig

    def setup(self) -> None:
        """Begin with an empty simulation; the first tick fills it."""
        self._belief = self._make_reasoner()
        forms = self._forms = Forms(self.memory)
        self._reading = GraphReader(self.memory, self._belief, self.log, forms)
        self._writing = Writing(self.memory, self._belief, self.log)
        self._seeing = Seeing(self.memory, self._belief, forms)
        self._what_if = WhatIfService(self.bus, self.keys, self.clock)

    def _make_reasoner(self) -> Reasoner:
        if self.config.reasoner != "belief":
            reasoner: Reasoner = load(REASONERS, self.config.reasoner)(self.config)
            return reasoner
        return Belief(self.config, make_policy(self.config, self.clock))

    @property
    def belief(self) -> Reasoner:
        """The belief that it keeps, from `setup` on."""
        return self._belief

    def tick(self, now: float) -> None:
        """Bring the belief to time `now` (s), and the graph into step with it."""
        self._reading.update(now)
        self._belief.set_visibility(self._seeing.visibility)
        self._belief.step(now)
        self._writing.update(now)
        self._seeing.update(now)
        self._what_if.offer(self._belief.scene(), self._writing.islands, now)
        first, *others = self._reading.problems.values() or [""]
        self.degraded = f"{first}; and {len(others)} more" if others else first

    def teardown(self) -> None:
        """Free the simulations."""
        for taken in (getattr(self, part, None) for part in ("_writing", "_what_if", "_forms", "_belief")):
            if taken is not None:
                taken.close()
