# SPDX-License-Identifier: Apache-2.0
"""All that a plan depends on, as one value, and the trip that is planned for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import check_situation
from bev_preheat.planning.trip import heated_throughout, make_trip
from bev_preheat.tunables import BELOW_HIGHEST_K, LEAST_PRICE_SHARE

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.kept_values import KeptValues
    from bev_preheat.planning.schedule import StepPrices
    from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


class PlanningCase(NamedTuple):
    """
    A vehicle with a battery state at the start of a route, its goal, and how to plan.

    `method` is a name in `planner.method_names()`; `options` are its own. With an `uncertainty` `value_function`
    plans for the least expected energy; other methods do not know it. Only `value_function` knows `step_prices`; a
    negative price counts as 0. `kept` has the values of earlier plans of the drive, which save time while they
    hold.

    `heater_share` (0 ... 1) is the share of its power that the heater gives. With `heats_throughout` the heater
    heats regardless of the plan; the energies include that. The heat arrives `heat_lag_s` [s] late; heat that
    would come after the end is not planned. (This is for a vehicle without a heat path; a heat path is planned as
    such, and `state` gives the heat under way.) Without `no_regret` the method's plan is returned even if it is
    worse than not heating: for comparing methods, never for driving.
    """

    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    method: str
    uncertainty: Uncertainty | None
    step_prices: StepPrices | None
    heater_share: float
    heats_throughout: bool
    heat_lag_s: float
    no_regret: bool
    kept: KeptValues | None
    options: Mapping[str, Any]

    @property
    def aim_c(self) -> float:
        """The target of the plan [deg C]: the goal's, or the lowest if no warm arrival is asked for."""
        if self.goal.charging_planned and self.goal.heating_pays:
            return self.goal.target_temperature_c
        return self.vehicle.battery.temperature_range_c[0]

    def check(self) -> None:
        """Raise InvalidInput if state, goal or route are outside the range of the vehicle's model."""
        check_situation(self.vehicle, self.route, self.state, self.goal, self.uncertainty)

    def aimed_at(self, target_c: float) -> Goal:
        """Return the goal with another target [deg C]."""
        return replace(self.goal, target_temperature_c=target_c)

    def trip_that_obeys(self) -> Trip:
        """Return the Trip with all the heat that the heater can give, as commanded."""
        vehicle = self.vehicle
        if self.step_prices is not None:
            vehicle = _storing_no_hotter(vehicle, max(self.state.temperature_c, self.goal.target_temperature_c))
        return make_trip(vehicle, self.route, self.heater_share, self.heat_lag_s)

    def trip(self, obeyed: Trip) -> Trip:
        """Return the Trip to plan for; `obeyed` is `trip_that_obeys`."""
        return heated_throughout(obeyed, self.uncommanded_w(obeyed)) if self.heats_throughout else obeyed

    def uncommanded_w(self, obeyed: Trip) -> FloatArray:
        """Return the power that a heater which heats throughout takes in each step [W] (N,)."""
        return make_trip(obeyed.vehicle, self.route, self.heater_share).heater_limit_w

    def method_options(self, trip: Trip, knows_uncertainty: bool) -> dict[str, Any]:
        """Return the method's options for a Trip, those from the case included."""
        options = dict(self.options)
        if self.uncertainty is not None and knows_uncertainty:
            options |= {'uncertainty': self.uncertainty, 'kept': self.kept}
        if self.step_prices is not None:
            options['price'] = _as_shares(self.step_prices(trip.time_s))
        return options


def _as_shares(price_per_kwh: FloatArray) -> FloatArray:
    """Return prices (N,) as shares of the highest one; no price at all: 1 everywhere. Raises InvalidInput."""
    if not np.isfinite(price_per_kwh).all():
        raise InvalidInput('price of energy: is not a number in every step; a finite price per kWh is needed')
    highest = float(price_per_kwh.max())
    return np.maximum(price_per_kwh / highest, LEAST_PRICE_SHARE) if highest > 0.0 else np.ones(len(price_per_kwh))


def _storing_no_hotter(vehicle: Vehicle, needed_c: float) -> Vehicle:
    """Return the Vehicle that stores cheap heat to BELOW_HIGHEST_K below its highest temperature, or as needed."""
    low_c, high_c = vehicle.battery.temperature_range_c
    return replace(vehicle, battery=replace(
        vehicle.battery, temperature_range_c=(low_c, max(high_c - BELOW_HIGHEST_K, needed_c))))
