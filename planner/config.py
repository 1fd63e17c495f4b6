"""All times and distances of the planner in one place."""

from __future__ import annotations

import msgspec

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
    """s after which a search for a plan is ended."""
    solver_delay: float = 0.5
    """s of a manual clock after which the solver's result is there: as long as it takes on a slow machine. On the wall
    clock the result is taken as soon as it is there."""
    conflict_limit: float = 10.0
    """s for which the planner tries, with the solver, which relations of an unsolvable goal conflict.
    Each try takes about `solver_delay`: this is enough for goals of some twenty relations.
    """

    settle: float = 0.5
    """s that the relations must have been the same, and nothing surprising, before a plan is made of them."""
    calm: float = 3.0
    """s that the scene must have been left alone, after somebody changed it, before the arm reaches into it again."""
    still: float = 0.01
    """m that a thing may move in a scene that is left alone."""
    debounce: float = 0.4
    """s that a change which nobody planned must last to count."""
    explain: float = 2.0
    """s more that it may last while objects are surprising: they are being explained, and the relations flicker."""
    verify: float = 4.0
    """s that the effects of an action may take to be believed."""
    confirm: float = 1.0
    """s that a goal must hold without a break to be reached."""
    patience: float = 10.0
    """s that the belief may take to know where the things of a goal are, while agents that see and believe run.
    That is long enough for a hand in front of a camera to go away.
    """
    start_up: float = 30.0
    """s that the belief may take to know where anything at all is, from when agents that see and believe run.
    Their devices and models may start for half a minute on a slow machine.
    """
    look_after: float = 2.0
    """s after which the arm looks for things that are nowhere: a thing in view is seen and believed within one."""
    look_for: float = 1.0
    """s that a camera which the arm carries stays at each place from which it looks: for some ten images."""
    look_height: float = 0.3
    """m above the table from which it looks: there it reads tags of 2 cm, and the arm is above all towers."""
    sure: float = 0.8
    """1, probability of success from which an action is tried without looking before. A failed one costs some 20 s, a
    look 4 s. A place on the table must be free with this probability."""
    least_information: float = 0.1
    """nats that a look must be expected to tell: with less, it would change the probability of a thing by some 0.05."""
    most_looks: int = 8
    """Places from which the arm looks at most, 3 s each: after half a minute a sought thing counts as not there."""
    begin: float = 5.0
    """s that the arm may take to begin an action; then the status says that it does not."""
    action_limit: float = 90.0
    """s that an action may take; then it is halted."""
    halt_limit: float = 10.0
    """s that the arm may take to halt."""
    return_within: float = 5.0
    """s for which the work of an arm waits whose controller has gone: one that died is started again within 2 s."""
    linger: float = 4.0
    """s after which an intention that was reached is removed."""
    most_failures: int = 4
    """Actions that may fail without anything put where it belongs; then the goal counts as failed."""
    most_plans_in_vain: int = 6
    """Plans that may be carried out to their end without the goal holding then; then it counts as failed."""

    widest_grip: float = 0.08
    """m, the widest thing that can be grasped."""
    clearance: float = 0.05
    """m between a thing put on the table and all others: room for the fingers."""
    edge_margin: float = 0.02
    """m between a thing put on the table and the table's edge."""
    least_reach: float = 0.25
    """m from the arm's base, along the ground: nothing is put nearer."""
    most_reach: float = 0.60
    """m from the arm's base, along the ground: nothing is put farther."""
    image_margin: float = 0.06
    """Share of the image's width and height: an object is put down only where it is seen at least so far inside the
    image.
    """
    what_if_patience: float = 1.0
    """s that the answer may take whether something would topple where it is to be put; with 0 nobody is asked."""
    what_if_worlds: int = USUAL_WORLDS
    """Worlds of the belief in which a what-if question is tried."""
    what_if_seconds: float = 1.0
    """s that are simulated for a what-if question: an object that topples has left its place by then."""
    what_if_shift: float = 0.015
    """m that an object may move in the simulation and still count as staying."""
    what_if_turn: float = 0.3
    """rad that an object may turn in the simulation and still count as staying."""
