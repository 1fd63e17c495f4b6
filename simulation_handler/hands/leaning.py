"""How what is in a hand leans, as far as the hand tells."""

from __future__ import annotations

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from simulation_handler.shapes.geometry import Solid

_LEVEL, _TILTED = 0.2, 0.4  # rad up to which tilt is the hand's noise, and from which it is all tilt


def levelled(solid: Solid) -> Quaternion:
    """How a solid is turned that seems to be so by its hand: level, where it may be."""
    flat, tilt = solid.face_down()
    return quaternions.slerp(flat.rotation, solid.rotation, min(max((tilt - _LEVEL) / (_TILTED - _LEVEL), 0.0), 1.0))


def without_yaw(rotation: Quaternion) -> Quaternion:
    """The tilt of a rotation alone: hands tell less of yaws than what is known of the objects in them."""
    return quaternions.product(rotation, quaternions.conjugate(quaternions.about_z(rotation)))
