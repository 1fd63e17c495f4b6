"""Perception corrects the simulation: bodies are moved to the plausible pose nearest to their percept."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Set

from dsr.math3d.tolerance import PoseTolerance
from dsr.perception.scales import SURE_SIGMAS
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.containment import inside, shifted_along, with_contents
from simulation_handler.contact.placement import Placement, place, placed_again, separate
from simulation_handler.contact.relations import Relation, resting
from simulation_handler.contact.stances import Stance, stances
from simulation_handler.contact.supports import find_beneath
from simulation_handler.motion.leaning import Leaning, neighbours
from simulation_handler.motion.neighbourhood import Neighbourhood
from simulation_handler.motion.unchanged import Unchanged
from simulation_handler.perception.estimate import RayError
from simulation_handler.perception.systematic import KnownErrors
from simulation_handler.scales import ROUNDING, UNSEEN_VARIANCE
from simulation_handler.shapes.geometry import Solid
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject


class Correction:
    """Keeps the bodies where perception has them, as far as physics allows."""

    def __init__(self, bodies: Bodies, config: BeliefConfig) -> None:
        self._bodies = bodies
        self._config = config
        self._leaning = Leaning(bodies, config)
        self._unchanged = Unchanged(config)

    def close(self) -> None:
        """Free the simulation of what leans; harmless when repeated."""
        self._leaning.close()

    def leave_to_physics(self, now: float, let_go: Collection[str]) -> None:
        """Forget the earlier percepts of unseen objects that physics has moved.

        What was on its way when it was last seen is let go; what hovered steadily is still held by something. Of what
        was seen to be moved by somebody, that is known better: it is let go if that is known, or it was falling.
        """
        for item in self._bodies.objects.values():
            if item.is_led or item.hand or item.track.estimate is None or item.track.is_fresh(now):
                continue
            if item.static and self._is_let_go(item, let_go):
                self._bodies.set_static(item, False)
            if self._bodies.has_left(item):
                item.track.forget()
                item.placement = item.put = None

    def _is_let_go(self, item: BelievedObject, let_go: Collection[str]) -> bool:
        if item.was_followed:
            return item.name in let_go or item.falls or (not item.hand and item.vanished_when_let_go)
        return self._was_on_its_way(item)

    def _was_on_its_way(self, item: BelievedObject) -> bool:
        """Whether nothing carried an object when it was last seen, nor had it hovered there for long."""
        if item.placement is None or item.placement.rests:
            return False
        since, last = item.hovering_since, item.track.last_stamp
        return since is None or last - since < self._config.explain_after

    @property
    def supports(self) -> set[Relation]:
        """Pairs (object, support) of which neither moves, for percepts hold the object there, against physics.

        The simulation itself tells of no contact between bodies that cannot move.
        """
        objects, sim = self._bodies.objects, self._bodies.sim
        held = {item.name: item.placement for item in objects.values() if item.static and not item.is_led}
        return {
            (name, base)
            for name, placement in held.items()
            for base in (() if placement is None else placement.supports)
            if base in sim and (name, base) in resting(sim.contacts_between(name, base))
        }

    def follow_perception(self, now: float, waiting: Collection[str] = ()) -> None:
        """Move the bodies of objects that are perceived elsewhere than they are believed to be.

        They are placed from the lowest up, so that each finds its support at its final height. Those that are
        `waiting` for an explanation stay. What rests where it was put, among what has not moved, stays as well.
        """
        free = [item for item in self._bodies.objects.values() if not item.is_led and item.name not in waiting]
        led = [item for item in free if self._is_led_by_perception(item, now)]
        changed = [item for item in led if item.track.take_change()]
        if not changed:
            return
        scene = self._bodies.scene(leaving_out={item.name for item in changed})
        by_height = sorted(changed, key=lambda item: (self._height(item), item.name))
        around = Neighbourhood(self._bodies, scene, self._config)
        errors = KnownErrors(self._config.depth_bias)
        for item in self._bodies.objects.values():
            errors.note(item.name, item.known_error())
        moved = self._unchanged.look(self._bodies.scene(leaving_out=()))
        moving = []
        for item in by_height:
            if not self._stays(item, around) and self._reconsider(item, around, errors, now):
                moving.append(item)
            errors.note(item.name, item.known_error())
        if around.placed or moved:
            self._realise(moving, around, moved, now)

    def _height(self, item: BelievedObject) -> float:
        """Height (m) of the bottom of a perceived object: where its body is, if that is near, for that has no noise."""
        percept = item.percept()
        if item.name not in self._bodies.sim:
            return percept.bottom
        body = self._bodies.solid(item.name)
        is_near = math.dist(body.position, percept.position) <= self._config.hover_tolerance
        return body.bottom if is_near else percept.bottom

    def _is_led_by_perception(self, item: BelievedObject, now: float) -> bool:
        """Whether it is seen; of one without a place even an old percept says the most."""
        has_place = item.name in self._bodies.sim
        return (item.estimate_at(now) if has_place else item.track.estimate) is not None

    def _stays(self, item: BelievedObject, around: Neighbourhood) -> bool:
        """Keep an object on what carries it, if nothing has changed but how well its place is known."""
        placement = item.placement
        if item not in self._unchanged or placement is None or self._bodies.has_left(item) or self._is_aside(item):
            return False
        if item.static or item.leans or item.aslant or item.prop or not item.shows_stance:
            return False
        again = placed_again(item.percept(), item.percept_covariance(self._config), placement, self._config)
        if again is None or self._differs(item, placement, again):
            return False
        item.is_told_to_rest = False
        item.know(again)
        item.learn_error(again)
        around.scene[item.name] = self._bodies.solid(item.name)
        return True

    def _reconsider(self, item: BelievedObject, around: Neighbourhood, errors: KnownErrors, now: float) -> bool:
        """Find the plausible pose of a perceived object and put it into the scene; whether its body must move."""
        item.notice_restart()
        item.is_told_to_rest = False
        if not item.shows_stance:
            item.take_stances(self._stances(item, around, errors), self._config)
        is_astray = self._bodies.has_left(item)
        if is_astray:
            item.strike(now)
        placement = self._placed(item, around, errors)
        if self._is_unexplained(item, placement, now) and self._find_beneath(item, around):
            placement = self._placed(item, around, errors)
        is_new = item.placement is None or self._differs(item, item.placement, placement)
        if is_new:
            is_recalled = self._is_recalled(item, placement)
            item.adopt(placement._replace(solid=self._bodies.solid(item.name)) if is_recalled else placement)
            item.is_recalled = is_recalled
        item.know(placement)
        if item.leans:  # how high it leans is not known so well
            told = errors.of_another(item.name)
            item.learned_error = RayError(told.mean, told.scale)
        else:
            item.learn_error(placement)
        must_move = is_new or is_astray or self._may_return(item)
        believed = item.placement.solid if item.placement and (must_move or item.static) else None
        solid = believed or self._bodies.solid(item.name)
        around.put(solid)
        self._unchanged.note(solid)
        self._unchanged.placed(item)
        return must_move

    def _may_return(self, item: BelievedObject) -> bool:
        """Whether it was put beside its placement because of something that is not in its way any more."""
        if item.static or item.placement is None or not self._is_aside(item):
            return False
        solid = item.placement.solid
        scene = self._bodies.scene(leaving_out={item.name})
        return not separate([*scene.values(), solid], {item.name: 1.0})

    def _is_aside(self, item: BelievedObject) -> bool:
        """Whether it was put beside its placement."""
        if item.put is None or item.placement is None:
            return False
        return math.dist(item.put.t, item.placement.solid.position) > self._config.divergence

    def _placed(self, item: BelievedObject, around: Neighbourhood, errors: KnownErrors) -> Placement:
        percept = item.percept()
        above = self._bodies.above(item, percept.position)
        others = [solid for name, solid in around.scene.items() if name not in above]
        if item.prop is not None:
            others.append(item.prop)
        flat = place(percept, item.percept_covariance(self._config), others, self._config)
        scene = around.of(item)
        near = neighbours(flat, scene)
        item.may_lean, item.leans, item.aslant = bool(near), False, None
        if not near:
            return flat
        seen = item.told_by_others(errors.of_another(item.name))
        leaning, aslant = self._leaning.judge(item, seen, flat, near, scene)
        item.leans = leaning is not None
        item.aslant = (aslant, seen) if aslant > ROUNDING else None
        return leaning or flat

    def _stances(self, item: BelievedObject, around: Neighbourhood, errors: KnownErrors) -> list[Stance]:
        """How an object, whose percepts do not tell, may be turned by its height."""
        seen = item.told_by_others(errors.of_another(item.name))
        above = self._bodies.above(item, seen.solid.position)
        others = [solid for name, solid in around.of(item).items() if name not in above]
        return stances(seen, others, self._config)

    def _is_unexplained(self, item: BelievedObject, placement: Placement, now: float) -> bool:
        """Whether the object has hovered for so long that something must be beneath it."""
        if placement.rests:
            item.was_followed = False
        if placement.rests or item.track.moving:
            item.hovering_since = None
        elif item.hovering_since is None:
            item.hovering_since = now
        if item.was_followed:  # somebody lifted it: that was seen
            return False
        return item.hovering_since is not None and now - item.hovering_since >= self._config.explain_after

    def _find_beneath(self, item: BelievedObject, around: Neighbourhood) -> bool:
        """Put beneath a hovering object what can explain it; false if nothing can."""
        percept = item.percept()
        flat, tilt = percept.face_down()
        if tilt > self._config.tilt_tolerance:
            return False
        beneath = find_beneath(
            flat,
            item.percept_covariance(self._config),
            self._bodies.unplaced(),
            around.scene.values(),
            self._config.explain_sigmas,
        )
        if beneath is None:
            return False
        for solid in beneath.stack:
            self._bodies.put(self._bodies.object(solid.name), solid.position, solid.rotation)
            self._bodies.object(solid.name).track.forget()
            around.put(solid)
        item.prop = beneath.prop
        return True

    def _differs(self, item: BelievedObject, old: Placement, new: Placement) -> bool:
        """Whether a placement changed by more than noise: by one standard deviation, or surely if it was recalled."""
        sigmas = SURE_SIGMAS if item.is_recalled else 1.0
        return old.supports != new.supports or self._is_apart(item, old.solid, new.solid, sigmas)

    def _is_recalled(self, item: BelievedObject, placement: Placement) -> bool:
        """Whether it is first seen where an earlier run has left it: that was averaged for longer."""
        if item.placement is not None or item.name not in self._bodies.sim:
            return False
        return not self._is_apart(item, self._bodies.solid(item.name), placement.solid, SURE_SIGMAS)

    def _is_apart(self, item: BelievedObject, old: Solid, new: Solid, sigmas: float) -> bool:
        """Whether two poses differ by more than so many standard deviations of the estimate."""
        assert item.track.estimate is not None
        noise = PoseTolerance(*item.track.estimate.standard_deviations())
        return not noise.scaled(sigmas).covers(old.pose, new.pose)

    def _realise(
        self, moving: Iterable[BelievedObject], around: Neighbourhood, moved: Collection[str], now: float
    ) -> None:
        """Put bodies where they are believed to be, and what was placed or has `moved` out of others' way."""
        items, scene = {item.name: item for item in moving}, around.scene
        before, in_motion = self._bodies.scene(leaving_out=()), self._bodies.in_motion()
        free = self._free(before, now)
        contents = with_contents({name: scene[name] for name in items if name in before}, before, before.keys() - free)
        scene |= contents
        softness = {name: self._softness(item, now) for name, item in self._bodies.objects.items() if not item.is_led}
        still = [solid for name, solid in scene.items() if name in items or name not in in_motion]
        pushed = separate(still, softness, around.placed | contents.keys() | set(moved))
        scene |= {name: scene[name].moved(position) for name, position in pushed.items()}
        aside = {name: scene[name] for name in pushed.keys() - items.keys()}
        loads = self._loads_of(aside, before, free - contents.keys()) if aside else {}
        scene |= loads
        for name in sorted(items.keys() | contents.keys() | pushed.keys() | loads.keys()):
            self._bodies.put(self._bodies.object(name), scene[name].position, scene[name].rotation)
        for item in items.values():
            self._bodies.set_static(item, item.strikes >= self._config.strikes or not item.is_carried())

    def _free(self, before: Collection[str], now: float) -> set[str]:
        """Names of what nobody sees or moves: it goes along with what it is in or on. All had a place `before`."""
        items = [item for item in self._bodies.objects.values() if item.name in before]
        return {item.name for item in items if not (item.is_led or item.static or item.estimate_at(now))}

    def _loads_of(self, pushed: Mapping[str, Solid], before: Mapping[str, Solid], free: Set[str]) -> dict[str, Solid]:
        """Where what is `free` goes that is on or in objects which are pushed aside."""
        if free <= pushed.keys():
            return {}
        solids = {name: before[name] for name in sorted(free | pushed.keys())}
        return shifted_along(pushed, solids, resting(self._bodies.sim.contacts()) | inside(solids.values()))

    def _softness(self, item: BelievedObject, now: float) -> float:
        """Sideways variance of a body's position, m^2: how easily it gives way to others."""
        if item.placement is None or item.estimate_at(now) is None:
            return UNSEEN_VARIANCE
        return float(item.placement.covariance[0, 0] + item.placement.covariance[1, 1])
