# SPDX-License-Identifier: Apache-2.0
"""What a plan is made from besides vehicle and route: the battery's state and the goal."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

from bev_preheat.errors import figure_beyond, InvalidInput

if TYPE_CHECKING:
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

# No coolant is this much colder or warmer than the battery.
MOST_EXCESS_K = 150.0


@dataclass(frozen=True)
class BatteryState:
    """
    Battery temperature [deg C] and state of charge (0 ... 1), measured.

    Where the vehicle has a heat path: the electrical power that its heater takes [W], and how much
    warmer than the battery the coolant is [K]. What a vehicle without one says there is not used.
    """

    temperature_c: float
    soc: float
    heater_power_w: float = 0.0
    coolant_excess_k: float = 0.0


@dataclass(frozen=True)
class Goal:
    """
    What the driver is to find on arrival.

    Without `heating_pays` nothing is heated for the sake of arrival, and the target is what comes of
    that; the battery is heated only where the drive itself needs it.
    """

    target_temperature_c: float
    minimum_arrival_soc: float = 0.0
    charging_planned: bool = True
    heating_pays: bool = True


def reserve_soc(vehicle: Vehicle, goal: Goal) -> float:
    """State of charge that must be left on arrival: the goal's, at least the vehicle's lowest."""
    return max(goal.minimum_arrival_soc, vehicle.battery.soc_range[0])


def check_situation(vehicle: Vehicle, route: Route | None = None,
                    state: BatteryState | None = None, goal: Goal | None = None) -> None:
    """
    Raise InvalidInput, one problem a quantity, where the vehicle's model does not hold.

    What is None is not checked.
    """
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    in_battery_range = "degC, the range of the vehicle's battery"
    # Value, least, most, what it is, and what the bounds are.
    checks: list[tuple[float, float, float, str, str]] = []
    if state is not None:
        checks += (
            (state.temperature_c, lowest_c, highest_c, 'battery temperature', in_battery_range),
            (state.soc, 0.0, 1.0, 'state of charge', ''),
            (state.heater_power_w, 0.0, vehicle.hvch.maximum_power_w, 'heater power', 'W'),
            (state.coolant_excess_k, -MOST_EXCESS_K, MOST_EXCESS_K, 'coolant excess temperature', 'K'))
    if goal is not None:
        checks.append((goal.minimum_arrival_soc, 0.0, 1.0, 'minimum arrival state of charge', ''))
        if goal.charging_planned:
            checks.append((goal.target_temperature_c, lowest_c, highest_c, 'target battery temperature',
                           in_battery_range))
    if route is not None:
        checks.append((route.lowest_ambient_temperature_c, lowest_c, math.inf, 'ambient temperature',
                       "degC: the vehicle's battery is not described below that"))
    problems = [
        f'{name}: {figure_beyond(value, low, high)} is not allowed; it must be '
        + (f'at least {low:g} {what}' if high == math.inf else
           f'{low:g} ... {high:g} {what}').rstrip()
        for value, low, high, name, what in checks if not low <= value <= high]
    if problems:
        raise InvalidInput(problems)
