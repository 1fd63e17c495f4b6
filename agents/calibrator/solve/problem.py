"""The problem of a calibration: objects as a camera sees them, and their believed poses in the frame of its parent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.math3d import batches
from dsr.math3d.transforms import Array, Pose

_LEAST_VARIANCES = np.array([1e-4**2] * 3 + [2e-4**2] * 3)  # m^2, rad^2: nothing is known better


class ObjectSighting(NamedTuple):
    """One object as it was seen in one view."""

    name: str
    """Name of the object."""
    view: int
    """Sightings of one view have one pose of the camera."""
    seen: Pose
    """camera_from_object, with covariance."""
    believed: Pose
    """parent_from_object, with covariance or exact: the belief, in the frame of what carries the camera."""


class Problem:
    """Sightings as arrays: the problem is the camera pose, in its parent, by which percepts agree with beliefs.

    The error of a sighting under the pose X is the twist log(seen^-1 X^-1 believed) in the frame of the object, m and
    rad; *whitened*, its squared length is the squared Mahalanobis distance, with 6 degrees of freedom.

    Args:
        sightings: one or more.
        prior: parent_from_camera that is likeliest before anything is seen, with covariance; None if all are alike.

    Raises:
        ValueError: without sightings, or for one whose percept, or a prior, has no covariance.
    """

    def __init__(self, sightings: Sequence[ObjectSighting], prior: Pose | None = None) -> None:
        if not sightings:
            raise ValueError("no object was seen; a calibration needs at least one")
        self.sightings = tuple(sightings)
        self.prior = prior
        self._prior_information = _information(prior)
        self.seen = np.array([sighting.seen.matrix for sighting in sightings])
        """(n, 4, 4) camera_from_object"""
        self.believed = np.array([sighting.believed.matrix for sighting in sightings])
        """(n, 4, 4) parent_from_object"""
        self.covariances = np.array([_covariance(sighting) for sighting in sightings])
        """(n, 6, 6) of the errors"""
        self._object_from_camera = batches.inverses(self.seen)
        self._adjoints = batches.adjoints(self._object_from_camera)
        self._whitening = np.linalg.inv(np.linalg.cholesky(self.covariances))

    def __len__(self) -> int:
        return len(self.sightings)

    def subset(self, chosen: NDArray[np.bool_]) -> Problem:
        """The problem of the sightings whose flag in `chosen` (n,) is set."""
        return Problem([sighting for sighting, taken in zip(self.sightings, chosen, strict=True) if taken], self.prior)

    def errors(self, pose: Array) -> Array:
        """(n, 6) errors under the camera pose (4, 4), m and rad."""
        return batches.logs(self._object_from_camera @ (batches.inverses(pose) @ self.believed))

    def whitened(self, pose: Array) -> Array:
        """(n, 6) errors in standard deviations."""
        result: Array = np.einsum("nij,nj->ni", self._whitening, self.errors(pose))
        return result

    def squared(self, pose: Array) -> Array:
        """(n,) squared Mahalanobis distances."""
        result: Array = (self.whitened(pose) ** 2).sum(axis=1)
        return result

    def linearised(self, pose: Array) -> tuple[Array, Array]:
        """Whitened errors (n, 6) and their derivatives (n, 6, 6) by a right perturbation of the camera pose."""
        errors = self.errors(pose)
        derivatives = -self._whitening @ batches.inverse_left_jacobians(errors) @ self._adjoints
        return np.einsum("nij,nj->ni", self._whitening, errors), derivatives

    def normal_equations(self, pose: Array, weights: Array) -> tuple[Array, Array]:
        """Information (6, 6) about a right perturbation of the camera pose, and gradient (6,); `weights` are (n,)."""
        errors, derivatives = self.linearised(pose)
        information = np.einsum("n,nki,nkj->ij", weights, derivatives, derivatives)
        gradient = np.einsum("n,nki,nk->i", weights, derivatives, errors)
        return information + self._prior_information, gradient + self._prior_information @ self._from_prior(pose)

    def squared_of_prior(self, pose: Array) -> float:
        """Squared Mahalanobis distance of the camera pose (4, 4) from the prior; 0 without one."""
        twist = self._from_prior(pose)
        return float(twist @ self._prior_information @ twist)

    def _from_prior(self, pose: Array) -> Array:
        """(6,) twist from the prior to a camera pose (4, 4), in the frame of the camera; 0 without a prior."""
        if self.prior is None:
            return np.zeros(6)
        twist: Array = batches.logs(batches.inverses(self.prior.matrix[None]) @ pose)[0]
        return twist

    def candidates(self) -> Array:
        """(n, 4, 4) camera poses under which one sighting each has no error."""
        return self.believed @ self._object_from_camera

    def distances(self, pose: Array) -> tuple[Array, Array]:
        """How far what is seen is from what is believed under the camera pose: (n,) m and (n,) rad."""
        errors = self.errors(pose)
        offsets = (pose @ self.seen)[:, :3, 3] - self.believed[:, :3, 3]
        return np.linalg.norm(offsets, axis=1), np.linalg.norm(errors[:, 3:], axis=1)


def solved(information: Array, gradient: Array) -> Array:
    """(6,) x of information @ x = gradient."""
    result: Array = np.linalg.solve(information, gradient).astype(np.float64)
    return result


def _information(prior: Pose | None) -> Array:
    """(6, 6) that a prior gives about the camera pose."""
    if prior is None:
        return np.zeros((6, 6))
    if prior.covariance is None:
        raise ValueError("a prior without covariance says nothing")
    result: Array = np.linalg.inv(prior.covariance).astype(np.float64)
    return result


def _covariance(sighting: ObjectSighting) -> Array:
    """Of the error: both are perturbations in the frame of the object."""
    seen, believed = sighting.seen.covariance, sighting.believed.covariance
    if seen is None:
        raise ValueError(f"{sighting.name}: the percept has no covariance")
    total: Array = seen + np.diag(_LEAST_VARIANCES)
    return total if believed is None else total + believed
