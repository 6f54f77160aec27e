# SPDX-License-Identifier: Apache-2.0
"""The inputs of a plan besides vehicle and route: the battery's state and the goal."""

from __future__ import annotations

from dataclasses import dataclass
import math

from bev_preheat.errors import InvalidInput, range_problem, share_hint
from bev_preheat.route.segments import Route
from bev_preheat.tunables import HOTTEST_BEYOND_RANGE_K, MOST_EXCESS_K, WIDEST_FORECAST_K
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.model import hottest_c


@dataclass(frozen=True)
class BatteryState:
    """
    Measured battery temperature [deg C] and state of charge (0 ... 1).

    With a heat path also the heater's electrical power [W] and the coolant's temperature above the battery's [K];
    a vehicle without a heat path ignores both.
    """

    temperature_c: float
    soc: float
    heater_power_w: float = 0.0
    coolant_excess_k: float = 0.0


@dataclass(frozen=True)
class Goal:
    """
    The conditions to meet on arrival.

    A battery that would arrive warmer than `maximum_arrival_temperature_c` [deg C] is cooled, if the vehicle can;
    a place in it that is `local_rise_k` [K] warmer then counts.
    Without `heating_pays` the battery is heated only if the drive itself needs it, not for the arrival; the target
    is then the resulting temperature. With `heats_until_arrival` a heater whose heat arrives late is not switched
    off before arrival, because the heat under way reaches the battery at the charger.
    """

    target_temperature_c: float
    minimum_arrival_soc: float = 0.0
    charging_planned: bool = True
    heating_pays: bool = True
    heats_until_arrival: bool = False
    maximum_arrival_temperature_c: float = math.inf
    local_rise_k: float = 0.0

    @property
    def highest_arrival_c(self) -> float:
        """Highest battery temperature on arrival that keeps the maximum and meets the target [deg C]."""
        return max(self.maximum_arrival_temperature_c - self.local_rise_k, self.target_temperature_c)


@dataclass(frozen=True)
class Uncertainty:
    """
    How much warmer or colder the rest of the drive may turn out than forecast; a plan with it is made again often.

    `deviation_k`: standard deviation [K] of the arrival, of what becomes known on the way, evenly over the time
    that is left. `direction`: 1 if the vehicle heats now, -1 if it cools, else 0.
    """

    deviation_k: float
    direction: int = 0


def reserve_soc(vehicle: Vehicle, goal: Goal) -> float:
    """Return the state of charge to keep until arrival: the goal's, at least the vehicle's lowest."""
    return max(goal.minimum_arrival_soc, vehicle.battery.soc_range[0])


def highest_start_c(vehicle: Vehicle) -> float:
    """Return the highest battery temperature that is planned from [deg C]: a vehicle that cools begins hotter."""
    return hottest_c(vehicle) if vehicle.cools else vehicle.battery.temperature_range_c[1]


def check_situation(vehicle: Vehicle, route: Route | None = None,
                    state: BatteryState | None = None, goal: Goal | None = None,
                    uncertainty: Uncertainty | None = None) -> None:
    """Raise InvalidInput, one problem per quantity, if an input that is not None is out of the model's range."""
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    in_battery_range = "degC, the range of the vehicle's battery"
    # Value, least, most, name, and meaning of the bounds.
    checks: list[tuple[float, float, float, str, str]] = []
    if state is not None:
        most_c = highest_start_c(vehicle)
        is_hot = most_c < state.temperature_c <= hottest_c(vehicle)
        meaning = in_battery_range + (f' and {HOTTEST_BEYOND_RANGE_K:g} K that it cools' if vehicle.cools else
                                      '; no heat source cools it' if is_hot else '')
        checks += (
            (state.temperature_c, lowest_c, most_c, 'battery temperature', meaning),
            (state.soc, 0.0, 1.0, 'state of charge', ''),
            (state.heater_power_w, 0.0, vehicle.hvch.maximum_power_w, 'heater power', 'W'),
            (state.coolant_excess_k, -MOST_EXCESS_K, MOST_EXCESS_K, 'coolant excess temperature', 'K'))
    if goal is not None:
        checks.append((goal.minimum_arrival_soc, 0.0, 1.0, 'minimum arrival state of charge', ''))
        if goal.charging_planned:
            checks.append((goal.local_rise_k, 0.0, MOST_EXCESS_K, 'local rise', 'K'))
            checks.append((goal.target_temperature_c, lowest_c, highest_c, 'target battery temperature',
                           in_battery_range))
            most_c = goal.maximum_arrival_temperature_c
            if goal.heating_pays and most_c != math.inf:
                checks.append((most_c, goal.target_temperature_c, highest_c,
                               'maximum arrival temperature', 'degC, from the target to the highest temperature'))
    if uncertainty is not None:
        checks.append((uncertainty.deviation_k, 0.0, WIDEST_FORECAST_K, 'uncertainty of the arrival', 'K'))
    if route is not None:
        checks.append((route.lowest_ambient_temperature_c, lowest_c, math.inf, 'ambient temperature',
                       "degC: the vehicle's battery is not described below that"))
    problems = [
        range_problem(name, value, low, high, what, share_hint(value) if high == 1.0 else '')
        for value, low, high, name, what in checks if not low <= value <= high]
    if problems:
        raise InvalidInput(problems)
