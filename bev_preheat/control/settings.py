# SPDX-License-Identifier: Apache-2.0
"""What an integrator may set; the one source of the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H
from bev_preheat.planning.planner import DEFAULT_METHOD

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Defaults, Vehicle

# Longer legs are planned in longer steps, so that a plan never keeps the next command waiting.
MOST_PLANNED_STEPS = 360
# What lies beyond the next stop is planned at once when a route comes: that must not take long.
MOST_STOPS = 20


@dataclass(frozen=True)
class Settings:
    """
    Settings of the planner; times in seconds.

    `battery_state_timeout_s`: an older battery state is stale. `clock_tolerance_s`: how far a stamp
    may lie in the future. `command_period_s`: the command is repeated this often.
    `lease_s`: a command is valid this long. `planning_step_s`: routes are planned in such steps.
    `target_temperature_c` [deg C]: target where the route names none; None: the vehicle's default.
    `arrival_soc_margin` (0 ... 1): is left on top of the state of charge that a route asks for.
    `estimation`: plans start from the estimated state of the battery, with the corrected model and
    a margin for what is uncertain; without it they start from what was measured.
    `minimum_on_time_s`, `minimum_off_time_s`: the heater is not switched more often than that.
    `energy_price_per_kwh`, `value_of_time_per_h`: what the target is chosen by where the charger is
    known, in one currency. `heat_while_charging`: heat on while the vehicle charges, where it does so.
    `coldest_cell_limits`: power limits are those of the coldest cell, where cell temperatures are known.
    `compiled_core`: plans are made with the compiled core where it is built; it changes no plan.
    """

    method: str = DEFAULT_METHOD
    target_temperature_c: float | None = None
    battery_state_timeout_s: float = 5.0
    clock_tolerance_s: float = 1.0
    command_period_s: float = 1.0
    lease_s: float = 2.5
    planning_step_s: float = 30.0
    arrival_soc_margin: float = 0.0
    estimation: bool = True
    minimum_on_time_s: float = 20.0
    minimum_off_time_s: float = 120.0
    route_progress_timeout_s: float = 10.0
    energy_price_per_kwh: float = ENERGY_PRICE_PER_KWH
    value_of_time_per_h: float = VALUE_OF_TIME_PER_H
    heat_while_charging: bool = False
    compiled_core: bool = True
    coldest_cell_limits: bool = True

    @property
    def prices(self) -> Prices:
        """The charging.worth.Prices."""
        return Prices(self.energy_price_per_kwh, self.value_of_time_per_h)


def defaults_of(vehicle: Vehicle, settings: Settings) -> Defaults:
    """Return a vehicle's Defaults, with the target of the settings where they have one."""
    target_c = settings.target_temperature_c
    return vehicle.defaults if target_c is None else replace(
        vehicle.defaults, target_battery_temperature_c=target_c)


# Parameters of the planner by name, and the settings that they are.
FIELD_OF_PARAMETER = {
    'method': 'method',
    'target_battery_temperature': 'target_temperature_c',
    'battery_state_timeout': 'battery_state_timeout_s',
    'clock_tolerance': 'clock_tolerance_s',
    'command_period': 'command_period_s',
    'command_lease': 'lease_s',
    'planning_step': 'planning_step_s',
    'arrival_soc_margin': 'arrival_soc_margin',
    'estimation': 'estimation',
    'minimum_on_time': 'minimum_on_time_s',
    'minimum_off_time': 'minimum_off_time_s',
    'route_progress_timeout': 'route_progress_timeout_s',
    'energy_price': 'energy_price_per_kwh',
    'value_of_time': 'value_of_time_per_h',
    'heat_while_charging': 'heat_while_charging',
    'compiled_core': 'compiled_core',
    'coldest_cell_limits': 'coldest_cell_limits',
}


def settings_of(parameters: Mapping[str, Any]) -> Settings:
    """
    Return the Settings of parameters by name; what is missing keeps its default.

    A target of 0 or NaN is the vehicle's. Raises KeyError where a name is none of FIELD_OF_PARAMETER.
    """
    values = {FIELD_OF_PARAMETER[name]: value for name, value in parameters.items()}
    target_c = values.get('target_temperature_c')
    if target_c is not None and (target_c == 0.0 or math.isnan(target_c)):
        values['target_temperature_c'] = None
    return Settings(**values)
