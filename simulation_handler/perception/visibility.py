"""How much of each object a camera should see: rays to its tag, or to all of its surface that could be seen.

No physics engine is asked: a `RayVisibility` is cheap, deterministic, and can be sent to another process.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.believing.absence import learned_recognition
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Shape
from dsr.math3d.surfaces import GAP, crossings, meets, seen_alone
from dsr.math3d.tolerance import SAME_POSE
from dsr.math3d.transforms import Pose
from dsr.perception.noise import NOTHING_SEEN
from dsr.perception.scales import RESOLUTION, SURE_SIGMAS
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.nats import SURPRISING
from dsr.vocabulary.tags import TAG_RATIO
from simulation_handler.scales import PLACE_FLOOR, ROUNDING
from simulation_handler.shapes.geometry import Solid

Array = NDArray[np.float64]
Indexes = NDArray[np.int64]
Flags = NDArray[np.bool_]

STEEPEST = math.radians(75)
"""rad between a tag's normal and the viewing ray, beyond which it is not found"""
SMALLEST = 12.0
"""px, the side of the smallest tag that is found, and the width of the smallest spot of a colour"""

_EYE_MARGIN = SURE_SIGMAS * PLACE_FLOOR  # m around an obstacle within which a camera counts as in it
_HOUSING = 0.03  # m from a camera within which a body that the camera is in hides nothing: it may be its housing
_IMAGE_SIGMAS = math.sqrt(2.0 * SURPRISING)
"""Standard deviations by which what should be in the image may be elsewhere in it: farther off would be surprising"""
_FARTHEST_SHOWN = RESOLUTION / sys.float_info.epsilon
"""m; whatever is said to be further away, or larger, is there and so large: beyond, no number tells lengths apart"""
_KINDS = ("box", "cylinder", "sphere")  # as in dsr.math3d.surfaces.Solids

_RAY_GRID = math.ceil(math.sqrt(1.0 / NOTHING_SEEN))
"""Rays along each side of a tag: what a single ray tells counts as nothing seen."""
_SIDE = (2.0 * np.arange(_RAY_GRID) + 1.0) / _RAY_GRID - 1.0  # the middles of as many equal parts
_RAYS = np.stack(np.meshgrid(_SIDE, _SIDE), axis=-1).reshape(-1, 2)  # (rays, 2), in half sides of the tag
_POINTS = 2 * len(_RAYS)
"""Points, at most, on the surface of an object that is recognised by its colour: twice, since their shares differ."""


@dataclass(frozen=True)
class CameraView:
    """A camera and its pose."""

    camera: str
    """Name of its node."""
    world_from_camera: Pose
    """Pose of the optical frame: z forward, x right, y down. It has the covariance of its mount, if this is known."""
    intrinsics: Intrinsics
    obstacles: tuple[Solid, ...] = ()
    """Bodies that may hide something from this camera alone."""

    def is_as(self, other: CameraView) -> bool:
        """Whether another view is the same, but for less than counts: an arm at rest trembles."""
        one, same = self.world_from_camera, other.world_from_camera
        is_same = (self.camera, self.intrinsics, one.cov) == (other.camera, other.intrinsics, same.cov)
        return is_same and SAME_POSE.covers(one, same) and are_at(self.obstacles, other.obstacles)


class ExpectedVisibility(NamedTuple):
    """The predicted visibility of one object to a camera."""

    share: float
    """Visible share of the tag's area, or of the image of an object recognised by its colour, 0 to 1."""
    hidden_by: str
    """Name of the solid or obstacle that hides most of the object; empty if nothing does."""
    tagged: bool = True
    """Whether it is recognised by a tag."""

    @property
    def recognised(self) -> float:
        """Probability that the camera recognises it, as learned."""
        return learned_recognition().probability(self.share, tagged=self.tagged)


class _Bodies(NamedTuple):
    """n bodies, as the boxes around them."""

    names: list[str]
    centre: Array
    """(n, 3) m"""
    rotation: Array
    """(n, 3, 3) world_from_body"""
    half: Array
    """(n, 3) m, half the edge lengths"""

    @staticmethod
    def of(solids: Sequence[Solid]) -> _Bodies:
        rotations = [quaternions.to_matrix(solid.rotation) for solid in solids]
        half = 0.5 * np.array([solid.size for solid in solids], dtype=np.float64).reshape(-1, 3)
        return _Bodies(
            [solid.name for solid in solids],
            _bounded([solid.position for solid in solids]),
            np.array(rotations, dtype=np.float64).reshape(-1, 3, 3),
            np.minimum(half, _FARTHEST_SHOWN),
        )

    def contain(self, point: Array, margin: float) -> Flags:
        """(n,) whether a point (3,) is inside, or outside by at most `margin` m."""
        inside: Flags = np.all(np.abs(self.into(point)) <= self.half + margin, axis=1)
        return inside

    def into(self, point: Array) -> Array:
        """(n, 3) a point (3,) of the world in the frame of each body."""
        local: Array = ((point - self.centre)[:, None, :] @ self.rotation)[:, 0]
        return local


class _Parts(NamedTuple):
    """All convex parts of some bodies."""

    bodies: _Bodies
    """The parts themselves, under the names of what they are parts of."""
    kinds: Indexes
    """(p,) as in `dsr.math3d.surfaces.Solids`"""
    owner: Indexes
    """(p,) index of the body that each is part of"""
    radius: Array
    """(p,) m, of a ball around it"""
    spared: Array
    """(p,) m from the camera up to which it hides nothing"""

    @staticmethod
    def of(solids: Sequence[Solid], spared: Array | None = None) -> _Parts:
        """The parts of some solids; of each (n,) is `spared` what that says, or nothing."""
        parts = [(index, part) for index, solid in enumerate(solids) for part in solid.parts]
        bodies = _Bodies.of([part for _, part in parts])
        owner = np.array([index for index, _ in parts], dtype=np.int64)
        return _Parts(
            bodies,
            np.array([_KINDS.index(part.kind or "box") for _, part in parts], dtype=np.int64),
            owner,
            np.sqrt((bodies.half * bodies.half).sum(axis=1)),
            np.zeros(len(parts)) if spared is None else spared[owner],
        )

    def and_also(self, others: _Parts, before: int) -> _Parts:
        """These, and those of bodies that come after the `before` ones of these."""
        names = self.bodies.names + others.bodies.names
        arrays = [np.concatenate(pair) for pair in zip(self.bodies[1:], others.bodies[1:], strict=True)]
        return _Parts(
            _Bodies(names, *arrays),
            np.concatenate([self.kinds, others.kinds]),
            np.concatenate([self.owner, others.owner + before]),
            np.concatenate([self.radius, others.radius]),
            np.concatenate([self.spared, others.spared]),
        )


class _Among:
    """All that may hide a solid, made ready for many looks."""

    def __init__(self, given: list[Solid], solids: list[Solid]) -> None:
        self.given = given
        """As somebody has said where they are"""
        self.solids = solids
        """The same, but for less than counts"""
        self.parts = _Parts.of(solids)
        self.names = [solid.name for solid in solids]
        self._place = {name: place for place, name in enumerate(self.names)}

    def places(self, solids: Sequence[Solid]) -> Indexes:
        """(n,) the index of what has the name of each of n solids; -1 without it."""
        return np.array([self._place.get(solid.name, -1) for solid in solids], dtype=np.int64)


class _Targets(NamedTuple):
    """What a camera looks for of n bodies: m points of each."""

    points: Array
    """(n, m, 3) m, world"""
    weights: Array
    """(n, m), 1 together for each body; 0 where there is no point"""
    middle: Array
    """(n, 3) m, and how far the points are from there, at most (n,) m"""
    reach: Array


class _Camera:
    """A view made ready for many looks."""

    def __init__(self, view: CameraView, obstacles: Sequence[Solid], housing: float) -> None:
        """`housing`: m from the camera up to which what it is in hides nothing."""
        self.view = view
        self.eye = _bounded([view.world_from_camera.t])[0]
        self.rotation = np.array(quaternions.to_matrix(view.world_from_camera.q))
        obstacles = (*obstacles, *view.obstacles)
        around = _Bodies.of(obstacles).contain(self.eye, _EYE_MARGIN)
        self.obstacles = [obstacle.name for obstacle in obstacles]
        self.parts = _Parts.of(obstacles, np.where(around, housing, 0.0))


class RayVisibility:
    """Predicts which objects some cameras should see.

    Args:
        views: the cameras.
        obstacles: bodies that hide and are not looked for, such as parts of the arm. One that a camera is in is its
            housing where it ends just before the camera; where it does not, nobody knows what of it is in the way, and
            it hides what is behind.
        by_color: names of the solids that are recognised by their colour; all others are by tags.
        whole: it is not asked what can be recognised, but how much of the image of each solid is seen, as in
            `dsr.visibility`: nothing is too small or too far askew, a camera is where it is believed to be, and what it
            is in hides nothing from it.
    """

    def __init__(
        self,
        views: Sequence[CameraView],
        obstacles: Sequence[Solid] = (),
        by_color: Collection[str] = (),
        *,
        whole: bool = False,
    ) -> None:
        seen_from, housing = (map(_certain, views), math.inf) if whole else (views, _HOUSING)
        self._cameras = [_Camera(view, obstacles, housing) for view in seen_from]
        self._by_color = frozenset(by_color)
        self._smallest = 0.0 if whole else SMALLEST
        self._whole = whole
        self._among: _Among | None = None
        """What was there in the question before"""
        self._all: list[dict[str, ExpectedVisibility] | None] = []
        """What cameras see of each of that, once somebody has asked"""
        self._told: tuple[_Told, ...] = ()
        """The last two answers about other places: who asks about things that are missing asks about their places"""

    def shares(self, solids: Sequence[Solid]) -> dict[tuple[str, str], float]:
        """Share (0 to 1) of each solid that each camera should see, by (camera, name).

        It is that of the tag, a square of `TAG_RATIO` in the middle of the +z face; one that faces away by more than
        `STEEPEST` or would be smaller than `SMALLEST` counts as unseen. Of what is recognised by its colour, it is that
        of its image, were nothing else there. What lies outside the image is unseen, and so is what may lie there as
        far as the pose of the camera is uncertain.
        """
        return {key: visible.share for key, visible in self.visibilities(solids).items()}

    def visibilities(self, solids: Sequence[Solid]) -> dict[tuple[str, str], ExpectedVisibility]:
        """The same, also saying what hides most of each, by (camera, name)."""
        found = zip(solids, self.look_for(solids, solids), strict=True)
        return {(camera, solid.name): visible for solid, by_camera in found for camera, visible in by_camera.items()}

    def look_for(self, solids: Sequence[Solid], among: Sequence[Solid]) -> list[dict[str, ExpectedVisibility]]:
        """What each camera, by its name, should see of each of some solids, if the others are as `among` says.

        What has the name of a solid hides nothing of it. So one question may be about several places of a solid.
        A question about all that is there is answered anew only for what has moved, or may be hidden or revealed by it.
        """
        there = self._noted(list(among))
        if (asked_for := list(solids)) != there.given:
            return self._told_of(asked_for, there)
        if asked := [place for place, known in enumerate(self._all) if known is None]:
            for place, found in zip(asked, self._look([there.solids[place] for place in asked], there), strict=True):
                self._all[place] = found
        return [dict(known) for known in self._all if known is not None]

    def _told_of(self, solids: list[Solid], there: _Among) -> list[dict[str, ExpectedVisibility]]:
        """The answer about any places, which is that of before if somebody asks the same of the same."""
        told = next((told for told in self._told if told.there is there and told.solids == solids), None)
        if told is None:
            told = _Told(there, solids, self._look(solids, there))
            self._told = (*self._told[-1:], told)
        return [dict(by_camera) for by_camera in told.answer]

    def _noted(self, given: list[Solid]) -> _Among:
        """All that is there, made ready; what has not moved is where it was."""
        before = self._among
        if before is not None and before.given == given:
            return before
        is_known = before is not None and _are_told_apart(before.given) and _are_told_apart(given)
        there = {solid.name: solid for solid in before.solids} if before is not None and is_known else {}
        stay = {solid.name for solid in given if solid.name in there and solid.is_at(there[solid.name])}
        solids = [there[solid.name] if solid.name in stay else solid for solid in given]
        if before is not None and before.solids == solids:
            before.given = given
            return before
        now = self._among = _Among(given, solids)
        known = dict(zip(there, self._all, strict=is_known))
        moved = [solid for solid in (*there.values(), *solids) if solid.name not in stay]
        if 2 * len(stay) < len(solids):  # to ask about all costs no more than to find out about whom
            self._all = [None] * len(solids)
            return now
        (centres, reach), disturbed = _balls(solids), np.array([name not in stay for name in now.names], dtype=bool)
        for camera in self._cameras:
            disturbed |= _meet(camera.eye, centres, reach, *_balls(moved)).any(axis=1)
        asked = zip(now.names, disturbed.tolist(), strict=True)
        self._all = [None if is_disturbed else known[name] for name, is_disturbed in asked]
        return now

    def _look(self, solids: Sequence[Solid], among: _Among) -> list[dict[str, ExpectedVisibility]]:
        by_image = np.array([self._whole or solid.name in self._by_color for solid in solids], dtype=bool)
        found: list[dict[str, ExpectedVisibility]] = [{} for _ in solids]
        for camera in self._cameras:
            shares, hiding = _visibility(camera, solids, among, by_image, self._smallest)
            names = among.names + camera.obstacles
            most = hiding.argmax(axis=1) if names else np.zeros(len(solids), dtype=np.int64)
            for index, (share, which) in enumerate(zip(shares.tolist(), most.tolist(), strict=True)):
                hidden_by = names[which] if names and hiding[index, which] > 0.0 else ""
                found[index][camera.view.camera] = ExpectedVisibility(share, hidden_by, not by_image[index])
        return found


class _Told(NamedTuple):
    """An answer about places of solids."""

    there: _Among
    """All that was there"""
    solids: list[Solid]
    answer: list[dict[str, ExpectedVisibility]]


def are_at(some: Sequence[Solid], others: Sequence[Solid]) -> bool:
    """Whether all of some solids are at the places of others, one by one, but for less than counts."""
    return len(some) == len(others) and all(one.is_at(other) for one, other in zip(some, others, strict=True))


def _are_told_apart(solids: Collection[Solid]) -> bool:
    """Whether each has a name of its own."""
    return len({solid.name for solid in solids}) == len(solids)


def _certain(view: CameraView) -> CameraView:
    """The view as if there were no doubt about where the camera is."""
    return replace(view, world_from_camera=view.world_from_camera.with_covariance(None), obstacles=())


def _visibility(
    camera: _Camera, solids: Sequence[Solid], among: _Among, by_image: Flags, smallest: float
) -> tuple[Array, Array]:
    """Shares (n,) of n solids, and how much (n, all) of each all that is `among` them and every obstacle cut off.

    Of those `by_image` (n,) all of their surface counts, if it is `smallest` px wide; of the others the tag.
    """
    bodies = _Bodies.of(solids)
    targets = _targets(camera, bodies, solids, by_image)
    seen = _found(camera, bodies, targets, by_image, smallest)
    parts = among.parts.and_also(camera.parts, len(among.solids))
    hiding = np.zeros((len(solids), len(among.solids) + len(camera.obstacles)))
    target, part = _candidates(camera.eye, targets, seen, parts, among.places(solids))
    if len(target):
        cut_off = _cut_off(camera.eye, targets.points[target], parts, part) & seen[target]
        pairs, which = np.unique(target * hiding.shape[1] + parts.owner[part], return_inverse=True)
        by_owner = np.zeros((len(pairs), seen.shape[1]), dtype=bool)
        np.logical_or.at(by_owner, which.ravel(), cut_off)
        hidden_target, owner = np.divmod(pairs, hiding.shape[1])
        hiding[hidden_target, owner] = (by_owner * targets.weights[hidden_target]).sum(axis=1)
        hidden = np.zeros_like(seen)
        np.logical_or.at(hidden, hidden_target, by_owner)
        seen &= ~hidden
    return np.minimum((seen * targets.weights).sum(axis=1).round(9), 1.0), hiding


def _targets(camera: _Camera, bodies: _Bodies, solids: Sequence[Solid], colored: Flags) -> _Targets:
    """The points of the tags, or those on the surfaces that would be seen if nothing else were there."""
    count = len(solids)
    most = max(len(_RAYS), _POINTS) if colored.any() else len(_RAYS)
    local, weights = np.zeros((count, most, 3)), np.zeros((count, most))
    rays = len(_RAYS)
    local[:, :rays, :2] = _RAYS * (TAG_RATIO * bodies.half[:, :2].min(axis=1, initial=np.inf))[:, None, None]
    local[:, :rays, 2] = bodies.half[:, 2, None]
    weights[:, :rays] = 1.0 / rays
    eyes = bodies.into(camera.eye)
    for index in np.flatnonzero(colored).tolist():
        x, y, z = np.rint(eyes[index] / RESOLUTION).tolist()
        points, shares = _surface(
            solids[index].shape, solids[index].size, (x * RESOLUTION, y * RESOLUTION, z * RESOLUTION)
        )
        weights[index] = 0.0
        local[index], weights[index, : len(shares)] = 0.0, shares
        local[index, : len(points)] = points
    points = local @ bodies.rotation.transpose(0, 2, 1) + bodies.centre[:, None, :]
    middle = np.where(colored[:, None], bodies.centre, points[:, rays // 2])
    corner = points[:, 0] - middle
    around = np.where(colored, (bodies.half**2).sum(axis=1), (corner * corner).sum(axis=1))
    return _Targets(points, weights, middle, np.sqrt(around))


@functools.lru_cache(maxsize=1024)
def _surface(shape: Shape, size: Vector3, eye: Vector3) -> tuple[Array, Array]:
    """At most `_POINTS` points (k, 3) of what is seen of a body from a place, in its frame, with their shares (k,)."""
    points, weights = seen_alone(shape, size, np.array(eye))
    step = max(1, math.ceil(len(points) / _POINTS))
    points, weights = points[::step], weights[::step]
    return points, weights / max(float(weights.sum()), ROUNDING)


def _found(camera: _Camera, bodies: _Bodies, targets: _Targets, colored: Flags, smallest: float) -> Flags:
    """(n, m) which points would be seen if nothing were in the way."""
    intrinsics = camera.view.intrinsics
    points = (targets.points - camera.eye) @ camera.rotation
    depth = points[..., 2]
    ahead = depth > ROUNDING
    safe = np.where(ahead, depth, 1.0)
    pixels = intrinsics.project(np.where(ahead[..., None], points, 1.0))
    u, v = pixels[..., 0], pixels[..., 1]
    ray = targets.middle - camera.eye
    across, down = _margins(camera.view, ray @ camera.rotation).T[..., None]
    inside: Flags = ahead & (u >= across) & (u <= intrinsics.width - 1 - across)
    inside &= (v >= down) & (v <= intrinsics.height - 1 - down) & (targets.weights > 0.0)
    cosine = -(ray * bodies.rotation[:, :, 2]).sum(axis=1)
    side = 2 * TAG_RATIO * bodies.half[:, :2].min(axis=1, initial=np.inf) * intrinsics.fx
    found: Flags = cosine >= math.cos(STEEPEST) * np.sqrt((ray * ray).sum(axis=1))
    found &= side >= SMALLEST * safe[:, len(_RAYS) // 2]
    if colored.any():
        width = np.minimum(_span(u, inside), _span(v, inside))
        found = np.where(colored, width >= smallest, found)
    inside &= found[:, None]
    return inside


def _margins(view: CameraView, points: Array) -> Array:
    """(n, 2) px by which points (n, 3), in the camera's frame, may be elsewhere in the image, across and down."""
    if view.world_from_camera.covariance is None:
        return np.zeros((len(points), 2))
    intrinsics, depth = view.intrinsics, np.where(points[:, 2] > ROUNDING, points[:, 2], 1.0)
    shifts = np.zeros((len(points), 2, 3))  # of the pixel with the point
    shifts[:, 0, 0], shifts[:, 1, 1] = intrinsics.fx / depth, intrinsics.fy / depth
    shifts[:, :, 2] = -points[:, :2] / depth[:, None] * (intrinsics.fx, intrinsics.fy) / depth[:, None]
    shifts = np.concatenate([shifts, np.cross(points[:, None], shifts)], axis=2)  # minus that with the camera
    variances = np.einsum("nki,ij,nkj->nk", shifts, view.world_from_camera.covariance, shifts)
    margins: Array = _IMAGE_SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    return margins


def _span(values: Array, counted: Flags) -> Array:
    """(n,) from the least to the greatest of the values (n, m) that count; negative without any."""
    greatest = np.where(counted, values, -_FARTHEST_SHOWN).max(axis=1)
    span: Array = greatest - np.where(counted, values, _FARTHEST_SHOWN).min(axis=1)
    return span


def _candidates(eye: Array, targets: _Targets, seen: Flags, parts: _Parts, own: Indexes) -> tuple[Indexes, Indexes]:
    """Pairs (target, part) of which the part may hide it: its ball meets the tube around the rays to the target.

    What a body hides of itself is no target: a part of the body `own` (n,) of a target is left out.
    """
    near = _meet(eye, targets.middle, targets.reach, parts.bodies.centre, parts.radius)
    near &= np.any(seen, axis=1)[:, None]
    near &= own[:, None] != parts.owner[None]
    target, part = np.nonzero(near)
    return target, part


def _meet(eye: Array, targets: Array, reach: Array, centres: Array, radius: Array) -> Flags:
    """(n, k) whether balls about centres (k, 3) meet the tubes from the eye to targets (n, 3), as wide as `reach`."""
    ray, to_centre = targets - eye, centres - eye
    along = np.clip((ray @ to_centre.T) / np.maximum((ray * ray).sum(axis=1), ROUNDING)[:, None], 0.0, 1.0)
    gap = to_centre[None] - along[:, :, None] * ray[:, None]
    both: Array = radius[None] + reach[:, None]
    near: Flags = np.less_equal((gap * gap).sum(axis=2), both * both)
    return near


def _balls(solids: Sequence[Solid]) -> tuple[Array, Array]:
    """Centres (n, 3) and radii (n,) of balls around solids, m."""
    radii = np.array([solid.radius for solid in solids])
    return _bounded([solid.position for solid in solids]), np.minimum(radii, _FARTHEST_SHOWN)


def _cut_off(eye: Array, targets: Array, parts: _Parts, part: Indexes) -> Flags:
    """(k, m) which rays to the points (k, m, 3) meet part `part[k]` before."""
    ray = targets - eye
    start = parts.bodies.into(eye)[part][:, None]
    enters, leaves = crossings(parts.kinds[part], parts.bodies.half[part], start, ray @ parts.bodies.rotation[part])
    length = np.maximum(np.sqrt((ray * ray).sum(axis=2)), GAP)
    hides: Flags = leaves > parts.spared[part][:, None] / length
    return hides & meets(enters, leaves, 1.0 - GAP / length)


def _bounded(positions: Sequence[Vector3]) -> Array:
    """(n, 3) m, none of it so far that squares of it overflow."""
    return np.clip(np.array(positions, dtype=np.float64).reshape(-1, 3), -_FARTHEST_SHOWN, _FARTHEST_SHOWN)
