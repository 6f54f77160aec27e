# SPDX-License-Identifier: Apache-2.0
"""The planner's parameters: their table, and how values take effect."""

from __future__ import annotations

from collections.abc import Callable

from bev_preheat.charging.target_worth import MOST_PRICE_PER_KWH, MOST_VALUE_PER_H
from bev_preheat.control.departures import load_departures, load_grid_prices
from bev_preheat.control.settings import FIELD_OF_PARAMETER, Settings, settings_of
from bev_preheat.errors import located
from bev_preheat.estimation.state_file import check_state_file
from bev_preheat.nodes.node import LIFECYCLE, Values
from bev_preheat.nodes.parameters import Parameter, StartParameter
from bev_preheat.planning.installed_methods import limit_answer_time
from bev_preheat.planning.planner import check_method, installed_names, METHODS, REPLACED
from bev_preheat.vehicle import load_vehicle, Vehicle
from bev_preheat.vehicle.core_library import use_core

DEFAULTS = Settings()
PARAMETERS = (
    Parameter('vehicle', 'reference', 'Vehicle: a name in config/vehicles or a YAML file.'),
    Parameter('method', DEFAULTS.method, 'Planning method.', choices=tuple(METHODS), more_choices=installed_names,
              earlier_choices=tuple(REPLACED),
              more_in_words=', or a method of an installed package (planner --help lists them)'),
    Parameter('target_battery_temperature', 0.0,
              'Battery temperature on arrival if the route names none', 'degC', (-40.0, 60.0),
              unset_means="the vehicle's default"),
    Parameter('battery_state_timeout', DEFAULTS.battery_state_timeout_s,
              'A battery state older than this is stale', 's', (0.1, 60.0)),
    Parameter('clock_tolerance', DEFAULTS.clock_tolerance_s,
              'A battery state may be stamped this far in the future', 's', (0.0, 10.0)),
    Parameter('command_period', DEFAULTS.command_period_s,
              'The command is repeated this often', 's', (0.02, 10.0)),
    Parameter('command_lease', DEFAULTS.command_lease_s,
              'A command is valid this long; longer than command_period', 's', (0.05, 30.0)),
    Parameter('planning_step', DEFAULTS.planning_step_s,
              'Routes are planned in steps of this length', 's', (1.0, 300.0)),
    Parameter('arrival_soc_margin', DEFAULTS.arrival_soc_margin,
              'Margin on top of the state of charge that a route requires', '', (0.0, 0.5)),
    Parameter('estimation', DEFAULTS.estimation,
              'Estimate temperature and model on line, and plan for the uncertainty.'),
    Parameter('minimum_on_time', DEFAULTS.minimum_on_time_s,
              'The heater, or another heat source, once on, stays on at least this long', 's', (0.0, 600.0)),
    Parameter('minimum_off_time', DEFAULTS.minimum_off_time_s,
              'The heater, once off, stays off at least this long', 's', (0.0, 3600.0)),
    Parameter('route_progress_timeout', DEFAULTS.route_progress_timeout_s,
              'Without route progress for this long the planner continues by time', 's', (0.1, 300.0)),
    Parameter('energy_price', DEFAULTS.energy_price_per_kwh,
              'Price of energy, by which the target for a known charger is chosen', 'per kWh',
              (0.0, MOST_PRICE_PER_KWH)),
    Parameter('value_of_time', DEFAULTS.value_of_time_per_h,
              'Value of time at the charger, in the same currency', 'per h',
              (0.0, MOST_VALUE_PER_H)),
    Parameter('heat_while_charging', DEFAULTS.heat_while_charging,
              'Heat at the charger as far as it pays, if the vehicle can.'),
    Parameter('compiled_core', DEFAULTS.compiled_core,
              'Plan with the native core if it is built; plans are the same without.'),
    Parameter('coldest_cell_limits', DEFAULTS.coldest_cell_limits,
              "Battery and charger have the coldest cell's power limits, if cell_temperature is known."),
    Parameter('flight_recorder', '', 'Folder for recordings of all inputs and commands; empty: none.'),
    Parameter('flight_recorder_size', 500.0, 'The oldest recordings are deleted beyond this size of the folder',
              'MB', (100.0, 1e6)),
    Parameter('state_file', '', "File for learned factors, the running trip and the driver's choices; "
              'empty: none.'),
    Parameter('departures', '', 'File of recurring departures (YAML); empty: none.'),
    Parameter('grid_prices', '', 'File of prices of energy from the grid (YAML): a plugged-in battery is heated '
              'in the cheapest hours; empty: as late as possible.'),
    StartParameter('locked', False, 'Refuse changes of safety-relevant parameters and of use_sim_time at run '
                   'time.'),
    LIFECYCLE,
)
# A driver or a backend may change these although the others are locked.
NEVER_LOCKED = frozenset(('target_battery_temperature', 'energy_price', 'value_of_time'))
CHECKS_OF_FILES: dict[str, Callable[[str], object]] = {
    'state_file': check_state_file, 'departures': load_departures, 'grid_prices': load_grid_prices}
# Share of the time by which the lease is longer than the command period.
ANSWER_SHARE = 0.1


def read(values: Values) -> tuple[Vehicle, Settings]:
    """Return (Vehicle, Settings) of values in their ranges; raise InvalidInput if they do not fit."""
    settings = settings_of({name: values[name] for name in FIELD_OF_PARAMETER})
    # A method of an installed package is loaded before it is needed.
    check_method(values['method'])
    return load_vehicle(values['vehicle']), settings


def take_effect(settings: Settings) -> None:
    """Set what holds for the whole process: the core, and the time of an installed method for an answer."""
    use_core(settings.compiled_core)
    # A step may ask it several times.
    limit_answer_time(ANSWER_SHARE * (settings.command_lease_s - settings.command_period_s))


def check_changes(values: Values, changed: Values) -> None:
    """Raise InvalidInput if values, of which some have changed, do not fit, or name an unusable file."""
    read(values)
    # A faulty file must not block other parameters; the diagnostics report it.
    for name, check in CHECKS_OF_FILES.items():
        if changed.get(name):
            with located(name):
                check(changed[name])
