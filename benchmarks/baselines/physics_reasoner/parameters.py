"""The parameters of the published physics reasoner: Table I of Sallami et al., and what the paper leaves open."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from simulation_handler.physics.simulator import TIME_STEP
from simulation_handler.scales import GRAVITY

_Positive = Annotated[float, Meta(gt=0.0)]


class PublishedConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Tolerances of Algorithms 1 and 2."""

    perceived_max_age: _Positive = 0.7
    """s, T_perceived: an object that was not seen for longer is not perceived"""
    simulation_tolerance: _Positive = 0.045
    """m, D_sim/perc: simulated further from its percept, an object is not physically plausible"""
    perception_tolerance: _Positive = 0.032
    """m, D_perc/prev: seen further from where it was seen before, an object has moved"""
    prediction_horizon: _Positive = 0.08
    """s, P_horizon: that each update simulates. It falls 31 mm in that time, less than the simulation tolerance"""
    epsilon: _Positive = 0.015
    """m, of isIn and isOnTop"""

    @property
    def steps(self) -> int:
        """Physics steps of one update, Eq. 1."""
        return max(1, round(self.prediction_horizon / TIME_STEP))

    @property
    def calm_updates(self) -> int:
        """Updates without divergence after which an object is plausible again; the paper does not say.

        One more than free fall needs to cross the simulation tolerance: else a hovering object would be plausible in
        every other update, as it starts anew from its percept whenever it has diverged.
        """
        return math.ceil(math.sqrt(2.0 * self.simulation_tolerance / GRAVITY) / self.prediction_horizon) + 1
