# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of the charging time, from the spreads of the model's parameters."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import arrival_state, stop_after
from bev_preheat.estimation.prior import factor_deviations
from bev_preheat.estimation.state import HEAT_CAPACITY, HEATER, LEAKAGE, PROPULSION, RESISTANCE
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

if TYPE_CHECKING:
    from bev_preheat.charging.target_worth import Prices
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class TimeDeviation:
    """
    Standard deviations [s] of the charging time without heating, with heating, and of the time saved.

    Infinite if a session within the spread never ends.
    """

    without_heating_s: float
    heated_s: float
    saved_s: float

    def as_dictionary(self) -> dict[str, float]:
        """Return it as JSON-compatible data."""
        return dict(vars(self))


def time_deviation(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                   charger_power_w: float, departure_soc: float, prices: Prices) -> TimeDeviation:
    """
    Return the TimeDeviation of heating to the target of a Goal.

    The spreads are those of a car known only from its file (`estimation.prior`): heat capacity, leakage,
    resistance, heater and consumption, each varied alone, with their squares added. The planner learns these on
    the way and still reaches its target, so each car is planned as it is. The map of the charging power is that of
    the file. At the charger each car heats as the file's car would, by its HeatingChoice under Prices.
    """
    heating = ChargerHeating(vehicle, stop_after(route, charger_power_w, departure_soc), prices)
    limits = [heating.choose(arrival_state(plan)).limit for plan in (
        plan_unheated(vehicle, route, state, goal), plan_preheating(vehicle, route, state, goal))]
    squares = [0.0, 0.0, 0.0]
    for index, deviation in factor_deviations(vehicle.uncertainty).items():
        ends = []
        for factor in (math.exp(-deviation), math.exp(deviation)):
            car = corrected_vehicle(vehicle, Corrections(**{
                name: factor if index == at else 1.0 for name, at in (
                    ('heat_capacity', HEAT_CAPACITY), ('leakage', LEAKAGE),
                    ('resistance', RESISTANCE), ('heater_efficiency', HEATER))}))
            driven = route.with_propulsion(factor) if index == PROPULSION else route
            stop = stop_after(driven, charger_power_w, departure_soc)
            without_s, heated_s = (
                charge(car, stop, arrival_state(plan), heating=limit).charging_time_s for plan, limit in zip((
                    plan_unheated(car, driven, state, goal),
                    plan_preheating(car, driven, state, goal)), limits))
            ends.append((without_s, heated_s, without_s - heated_s))
        for at, (low_s, high_s) in enumerate(zip(*ends)):
            squares[at] += (0.5 * (high_s - low_s))**2
    return TimeDeviation(*(math.sqrt(value) if math.isfinite(value) else math.inf
                           for value in squares))
