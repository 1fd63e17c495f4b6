"""Value types of the scenario format: a unit and the range that is plausible for it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

Seconds = Annotated[float, Meta(ge=0, le=3600)]
"""s, from 0 to one hour"""
Metres = Annotated[float, Meta(ge=-10, le=10)]
"""m, a coordinate or an offset"""
Length = Annotated[float, Meta(gt=0, le=5)]
"""m, a size or a clearance"""
Noise = Annotated[float, Meta(ge=0, le=0.5)]
"""m, a tolerance, a standard deviation or a range"""
Bias = Annotated[float, Meta(ge=-0.5, le=0.5)]
"""m, a systematic error"""
Radians = Annotated[float, Meta(ge=-6.2832, le=6.2832)]
"""rad, at most one turn (so degrees are noticed)"""
Turn = Annotated[float, Meta(ge=0, le=3.1416)]
"""rad, the angle between two orientations"""
Share = Annotated[float, Meta(gt=0, le=1)]
"""A share of a whole; more than nothing."""
Speed = Annotated[float, Meta(gt=0, le=5)]
"""A speed in m/s or rad/s, more than 0"""
Velocity = Annotated[float, Meta(ge=-5, le=5)]
"""m/s, along one axis"""
Impulse = Annotated[float, Meta(ge=-500, le=500)]
"""N s, along one axis: at most that which gives the heaviest object 5 m/s"""

Count = Annotated[int, Meta(ge=0, le=1000000)]
"""A number of times, 0 or more."""

Vector2 = tuple[Metres, Metres]
Vector3 = tuple[Metres, Metres, Metres]
Velocity2 = tuple[Velocity, Velocity]
Velocity3 = tuple[Velocity, Velocity, Velocity]
Impulse3 = tuple[Impulse, Impulse, Impulse]
Size = tuple[Length, Length, Length]
Rotation = tuple[Radians, Radians, Radians]
"""Rotation vector: axis times angle, rad."""

UNITS = {
    **dict.fromkeys(("at", "after", "delay", "duration", "linger", "settle", "within"), "s"),
    **dict.fromkeys(("position", "look_at", "size", "to", "by", "offset", "above", "height"), "m"),
    **dict.fromkeys(("translation", "tolerance"), "m"),
    **dict.fromkeys(("direction", "side"), "along x and y"),
    **dict.fromkeys(("depth_bias", "depth_jitter"), "m"),
    **dict.fromkeys(("yaw", "turn", "angle", "start", "rotation", "lean"), "rad"),
    "mass": "kg",
    "velocity": "m/s",
    "impulse": "N s",
    "speed": "m/s (tilt: rad/s)",
    "grey_noise": "grey levels",
    "shape": "kind, three lengths in m (of round parts, too), position, rotation of each part",
}
"""Unit by field name, for error messages."""
