"""All times and distances of the planner in one place."""

from __future__ import annotations

import msgspec

from dsr.perception.scales import CONFIRMED_IN, CONTACT_DELAY, SAME_PLACE, STEADY
from dsr.vocabulary.what_if import USUAL_WORLDS


class PlannerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Times and places of the planner. The defaults are for cubes of 4 cm and a Gen3."""

    arm_agent: str = "arm_controller"
    """Name of the agent that carries out actions; while it is away no action begins."""
    belief_agents: tuple[str, ...] = ("scene_estimator", "simulation_handler")
    """Names of the agents that see and believe; while one of them is away no action begins."""
    robot: str = "arm"
    """Node at the arm's base, from which the reach is measured."""

    solver_limit: float = 20.0
    """s after which a search for a plan is ended, and one for what of an unsolvable goal conflicts."""
    solver_delay: float = 0.5
    """s of a manual clock after which the solver's result is there: as long as it takes on a slow machine. On the wall
    clock the result is taken as soon as it is there."""

    settle: float = CONFIRMED_IN + CONTACT_DELAY
    """s that relations must last to count: what false images make of contacts is over then. A plan is made of those
    that were the same for so long, with nothing surprising. A change that nobody planned halts the arm after that
    time."""
    still: float = SAME_PLACE
    """m that a thing may move and still count as staying where it is. That holds in a scene that is left alone, and in
    the simulation of what is to be put down."""
    believed: float = STEADY
    """s within which what is in view is seen and believed. A goal must hold for so long without a break to be reached.
    A camera that the arm carries stays so long at each place from which it looks."""
    explained: float = 2.0 * believed
    """s within which what is surprising is seen and then explained; by default twice `believed`.

    Until then the relations flicker. What is nowhere then is not in view, and the arm looks for it.
    """
    calm: float = explained + believed
    """s that the scene must have been left alone, after somebody changed it, before the arm reaches into it again:
    until what that left is explained and believed. By default the sum of both."""
    patience: float = 10.0
    """s that the belief may take to know where the things of a goal are, while agents that see and believe run.
    That is long enough for a hand in front of a camera to go away.
    """
    start_up: float = 30.0
    """s that the belief may take to know where anything at all is, from when agents that see and believe run.
    Their devices and models may start for half a minute on a slow machine.
    """
    look_height: float = 0.3
    """m above the table from which it looks: there it reads tags of 2 cm, and the arm is above all towers."""
    sure: float = 0.8
    """1, probability of success from which an action is tried without looking before. A failed one costs some 20 s, a
    look 4 s. A place on the table must be free with this probability."""
    least_information: float = 0.1
    """nats that a look must be expected to tell: with less, it would change the probability of a thing by some 0.05."""
    return_within: float = 5.0
    """s for which another process may do nothing and yet be there: one that died is started again within 2 s. So long
    the work of an arm waits whose controller has gone. An arm may take so long to begin or to halt. An intention that
    was reached stays in the graph for so long."""
    action_limit: float = 90.0
    """s that an action may take; then it is halted."""
    most_failures: int = 4
    """Times that the same may be tried in vain. That may be an action that fails without anything put where it belongs.
    A plan is in vain that ends without the goal holding, and a place on which something would not stay."""

    widest_grip: float = 0.08
    """m, the widest thing that can be grasped."""
    clearance: float = 0.05
    """m between a thing put on the table and all others: room for the fingers."""
    least_clearance: float = 0.02
    """m between a thing put on the table and the table's edge, and all others where the table is full. Places that are
    considered are as far apart."""
    least_reach: float = 0.25
    """m from the arm's base, along the ground: nothing is put nearer."""
    most_reach: float = 0.60
    """m from the arm's base, along the ground: nothing is put farther."""
    what_if_seconds: float = STEADY
    """s that are simulated for a what-if question: an object that topples has left its place by then."""
    what_if_patience: float = what_if_seconds
    """s that the answer may take whether something would topple where it is to be put: simulations are faster than what
    they simulate. With 0 nobody is asked."""
    what_if_worlds: int = USUAL_WORLDS
    """Worlds of the belief in which a what-if question is tried."""
