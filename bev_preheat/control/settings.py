# SPDX-License-Identifier: Apache-2.0
"""Settings for the integrator; the only source of the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
import math
import re
from typing import Any

from bev_preheat.charging.target_worth import ENERGY_PRICE_PER_KWH, Prices, VALUE_OF_TIME_PER_H
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.planner import DEFAULT_METHOD, REPLACED
from bev_preheat.vehicle.description import Defaults, Vehicle


@dataclass(frozen=True)
class Settings:
    """
    Settings of the planner, each a ROS parameter, which describes it (`nodes.planner_parameters`).

    A target of None is the vehicle's default.
    """

    method: str = DEFAULT_METHOD
    target_battery_temperature_c: float | None = None
    battery_state_timeout_s: float = 5.0
    clock_tolerance_s: float = 1.0
    command_period_s: float = 1.0
    command_lease_s: float = 2.5
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
        """The Prices of a charging session."""
        return Prices(self.energy_price_per_kwh, self.value_of_time_per_h)


def defaults_of(vehicle: Vehicle, settings: Settings) -> Defaults:
    """Return a vehicle's Defaults, with the target of the settings if they have one."""
    target_c = settings.target_battery_temperature_c
    return vehicle.defaults if target_c is None else replace(
        vehicle.defaults, target_battery_temperature_c=target_c)


# Field of Settings by parameter name, which has no unit.
FIELD_OF_PARAMETER = {re.sub('_(s|c|per_kwh|per_h)$', '', field.name): field.name for field in fields(Settings)}


def settings_of(parameters: Mapping[str, Any]) -> Settings:
    """
    Return the Settings of parameters by name; a missing parameter keeps its default.

    A target of 0 or NaN means the vehicle's; a method of earlier versions is replaced by its successor. Raises
    KeyError if a name is not in FIELD_OF_PARAMETER, InvalidInput if the lease ends before the next command.
    """
    values = {FIELD_OF_PARAMETER[name]: value for name, value in parameters.items()}
    target_c = values.get('target_battery_temperature_c')
    if target_c is not None and (target_c == 0.0 or math.isnan(target_c)):
        values['target_battery_temperature_c'] = None
    if 'method' in values:
        values['method'] = REPLACED.get(values['method'], values['method'])
    settings = Settings(**values)
    if settings.command_lease_s <= settings.command_period_s:
        raise InvalidInput(
            f'command_lease: {settings.command_lease_s:g} s must be longer than command_period, '
            f'{settings.command_period_s:g} s, or the heater drops out between two commands')
    return settings
