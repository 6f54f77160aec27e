# SPDX-License-Identifier: Apache-2.0
"""
Loss of regeneration in a fuller battery.

If the charge limit is active, a joule saved before it is not a joule on arrival: the fuller battery accepts less
regeneration, and the friction brake or the heater gets the difference. For the same reason a joule spent on heat
before a descent costs less than a joule.
"""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.dynamics import terminal_limits_w
from bev_preheat.planning.wanted_heat import LimitedSteps

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip

# Difference for the slope of the charge limit over the state of charge.
SOC_DIFFERENCE = 1e-4


class AcceptanceLoss(NamedTuple):
    """
    Regeneration that the battery rejects in each step per extra joule in it [J/J, 0 ... 1], shape (N,).

    `to_brake` goes to the friction brake, `to_heater` to the heater.
    """

    to_brake: FloatArray
    to_heater: FloatArray

    @property
    def any(self) -> bool:
        """Whether there is any loss."""
        return bool(self.to_brake.any() or self.to_heater.any())

    def blended(self, other: AcceptanceLoss) -> AcceptanceLoss:
        """Return the mean of this and another AcceptanceLoss."""
        return AcceptanceLoss(0.5 * (self.to_brake + other.to_brake),
                              0.5 * (self.to_heater + other.to_heater))


def no_acceptance_loss(trip: Trip) -> AcceptanceLoss:
    """Return the AcceptanceLoss of a battery whose charge limit does not depend on its charge."""
    nothing = np.zeros(len(trip.route))
    return AcceptanceLoss(nothing, nothing)


def find_acceptance_loss(trip: Trip, watch: LimitedSteps, run: Schedule) -> AcceptanceLoss:
    """Return the AcceptanceLoss along a run (a Schedule) in which surplus goes to the heater."""
    battery = trip.vehicle.battery
    soc, temperature_c = run.soc[:-1], run.temperature_c[:-1]
    least_w, _ = terminal_limits_w(trip.vehicle, soc, temperature_c, trip.power_variance_w2)
    fuller_w, _ = terminal_limits_w(
        trip.vehicle, soc + SOC_DIFFERENCE, temperature_c, trip.power_variance_w2)
    voltage_v = battery.open_circuit_voltage.function(ARRAYS)(soc, temperature_c)
    surplus_w = least_w - trip.idle_power_w
    loss = np.where(watch.charge & (surplus_w > 0.0), np.clip(
        trip.route.duration_s * (fuller_w - least_w)
        / (SOC_DIFFERENCE * battery.capacity_as * voltage_v), 0.0, 1.0), 0.0)
    is_braked = surplus_w >= trip.heater_limit_w
    return AcceptanceLoss(np.where(is_braked, loss, 0.0), np.where(is_braked, 0.0, loss))
