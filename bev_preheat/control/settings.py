# SPDX-License-Identifier: Apache-2.0
"""Settings for the integrator; the only source of the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any, TYPE_CHECKING

from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H
from bev_preheat.planning.planner import DEFAULT_METHOD, REPLACED

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Defaults, Vehicle


@dataclass(frozen=True)
class Settings:
    """
    Settings of the planner; times in seconds.

    `battery_state_timeout_s`: an older battery state is stale. `clock_tolerance_s`: how far a stamp
    may lie in the future. `command_period_s`: period at which the command is repeated.
    `lease_s`: lease of a command. `planning_step_s`: step in which routes are planned.
    `target_temperature_c` [deg C]: target if the route names none; None: the vehicle's default.
    `arrival_soc_margin` (0 ... 1): margin added to the state of charge that a route asks for.
    `estimation`: plan from the estimated battery state, with the corrected model and a margin for the
    uncertainty; otherwise plan from the measured state.
    `minimum_on_time_s`, `minimum_off_time_s`: least time between two switchings of the heater.
    `energy_price_per_kwh`, `value_of_time_per_h`: prices, in one currency, by which the target is chosen if the
    charger is known. `heat_while_charging`: heat while the vehicle charges as far as it pays, if it can.
    `coldest_cell_limits`: use the power limits of the coldest cell if cell temperatures are known.
    `compiled_core`: plan with the native core if it is built; it changes no plan.
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
    """Return a vehicle's Defaults, with the target of the settings if they have one."""
    target_c = settings.target_temperature_c
    return vehicle.defaults if target_c is None else replace(
        vehicle.defaults, target_battery_temperature_c=target_c)


# Field of Settings by parameter name.
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
    Return the Settings of parameters by name; a missing parameter keeps its default.

    A target of 0 or NaN means the vehicle's; a method of earlier versions is replaced by its successor. Raises
    KeyError if a name is not in FIELD_OF_PARAMETER.
    """
    values = {FIELD_OF_PARAMETER[name]: value for name, value in parameters.items()}
    target_c = values.get('target_temperature_c')
    if target_c is not None and (target_c == 0.0 or math.isnan(target_c)):
        values['target_temperature_c'] = None
    if 'method' in values:
        values['method'] = REPLACED.get(values['method'], values['method'])
    return Settings(**values)
