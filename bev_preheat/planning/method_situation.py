# SPDX-License-Identifier: Apache-2.0
"""The input of an installed planning method: the situation, and the model's prediction for a choice of powers."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.engine import keep_accounts
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.tunables import ROUNDING_W

if TYPE_CHECKING:
    from typing import Self

    from numpy.typing import ArrayLike

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    The model's prediction of a trip under heater powers, within the battery's limits.

    `battery_temperature_c` [deg C] and `soc` (0 ... 1) have shape (N + 1,), at the ends of the steps;
    `hvch_battery_power_w` (N,) is the heater's power in each step after the limits have cut it [W];
    `battery_energy_wh` is the energy from the cells until arrival, including losses [Wh].
    """

    battery_temperature_c: FloatArray
    soc: FloatArray
    hvch_battery_power_w: FloatArray
    battery_energy_wh: float

    @property
    def arrival_temperature_c(self) -> float:
        """Battery temperature on arrival [deg C]."""
        return self.battery_temperature_c.item(-1)

    @property
    def arrival_soc(self) -> float:
        """State of charge on arrival, 0 ... 1."""
        return self.soc.item(-1)


@dataclass(frozen=True, eq=False)
class MethodSituation:
    """
    The situation that a planning method plans for, from now until arrival; all arrays are read-only.

    `vehicle` is the model to plan with, `route` the rest of the route in N steps, `state` the battery's current
    state, `goal` the conditions to meet on arrival. In a running planner, `vehicle` and `state` are estimated and
    the goal's target includes the margin for the uncertainty. `time_s` (N + 1,) are the ends of the steps [s],
    from 0 to the arrival; `heater_limit_w` (N,) is the most electrical power that the heater can give to the
    battery in each step [W], after cabin heating and derating.
    """

    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    time_s: FloatArray
    heater_limit_w: FloatArray
    _trip: Trip

    @classmethod
    def of_trip(cls, trip: Trip, state: BatteryState, goal: Goal) -> Self:
        """Return the MethodSituation of a Trip."""
        return cls(trip.vehicle, trip.route.read_only(), state, goal, _read_only(trip.time_s),
                   _read_only(trip.heater_limit_w), trip)

    def full_power(self, start_s: float = 0.0, end_s: float = math.inf) -> FloatArray:
        """
        Return the powers (N,) [W] of heating at `heater_limit_w` between two instants [s] of `time_s`.

        A step that is heated in part has its mean. Add the powers of intervals that do not overlap.
        """
        heated_s = np.minimum(self.time_s[1:], end_s) - np.maximum(self.time_s[:-1], start_s)
        share: FloatArray = np.clip(heated_s / self.route.duration_s, 0.0, 1.0)
        return share * self.heater_limit_w

    def predict(self, heater_power_w: ArrayLike) -> Prediction:
        """
        Return the Prediction for heater powers (N,) [W]; powers above `heater_limit_w` are clipped.

        Raises ValueError if the powers are not N finite numbers from 0 W on.
        """
        schedule = self.driven(checked_powers(heater_power_w, len(self.route)))
        return Prediction(schedule.temperature_c, schedule.soc, schedule.heater_power_w,
                          keep_accounts(self._trip, schedule).energy_wh.battery_total)

    def driven(self, power_w: FloatArray) -> Schedule:
        """Return the planning.schedule.Schedule of checked powers (N,) [W], within heater and battery limits."""
        return drive_as_planned(self._trip, self.state, np.minimum(power_w, self._trip.heater_limit_w))


def _read_only(values: FloatArray) -> FloatArray:
    """Return a copy that cannot be written to: the planner uses the original again for later plans."""
    values = values.copy()
    values.flags.writeable = False
    return values


def checked_powers(answer: ArrayLike, steps: int) -> FloatArray:
    """
    Return heater powers as an array (N,) [W] of its own, with negative rounding removed.

    Raises ValueError with the reason if they are not `steps` finite numbers from 0 W on.
    """
    given = np.asarray(answer)
    if given.dtype.kind not in 'fiu':
        raise ValueError(f'{type(answer).__name__} of {given.dtype} is not allowed; it must be an array of powers '
                         'in W, one for each step')
    if given.shape != (steps,):
        raise ValueError(f'shape {given.shape} is not allowed; it must be ({steps},), a power in W for each step')
    power_w = given.astype(float)
    bad = ~(np.isfinite(power_w) & (power_w >= -ROUNDING_W))
    if bad.any():
        at, others = int(bad.argmax()), int(bad.sum()) - 1
        more = f' (and {others} more)' if others else ''
        raise ValueError(
            f'{power_w[at]:g} W in step {at} is not allowed; it must be finite and at least 0 W{more}')
    positive_w: FloatArray = np.maximum(power_w, 0.0)
    return positive_w
