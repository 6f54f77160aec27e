# SPDX-License-Identifier: Apache-2.0
"""A vehicle file as curves: voltage, resistance, power limits, warming and cooling, and fast charging."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.charging.published_time import USUAL_WARM_C, warm_session
from bev_preheat.numerics import ARRAYS, Curve, FloatArray, S_PER_MIN
from bev_preheat.vehicle.charging import session_charging
from bev_preheat.vehicle.plausibility import AMBIENT_C, CHARGING_TEMPERATURES_C, KMH_100_MPS, warmed_by_k

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.vehicle import Vehicle
    from bev_preheat.vehicle.description import Battery

SOCS = (0.1, 0.2, 0.5, 0.8)
SOC_COLOURS = ('tab:purple', 'tab:blue', 'tab:orange', 'tab:green')
SOC_STYLES = (':', '-.', '-', '--')
# The solid line is wide and below the others, so that no line hides another.
SOC_WIDTHS = (1.6, 1.6, 3.5, 1.6)
COLDEST_C, WARMEST_C = -30.0, 45.0
HOUR_MIN = 60.0
TEMPERATURE_COLOURS = ('tab:purple', 'tab:blue', 'tab:green', 'tab:orange', 'tab:red')
COOLING_FROM_C = 25.0


def make_vehicle_figure(vehicle: Vehicle) -> Figure:
    """Return the figure of a Vehicle's curves, warming and cooling without the heat of driving."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=(11.0, 11.5), layout='constrained')
    panels = figure.subplots(3, 2)
    # A dollar sign would begin a formula.
    figure.suptitle(f'Vehicle {vehicle.name}'.replace('$', r'\$'))
    battery = vehicle.battery
    temperatures_c = np.linspace(max(COLDEST_C, battery.temperature_range_c[0]),
                                 min(WARMEST_C, battery.temperature_range_c[1]), 151)
    _draw_voltage(panels[0, 0], battery)
    _draw_over_temperature(panels[0, 1], battery.resistance, temperatures_c, 1e3)
    panels[0, 1].set(title='internal resistance', ylabel='resistance [mΩ]')
    panels[0, 1].legend(title='state of charge', fontsize='small', title_fontsize='small', ncols=2)
    limits = panels[1, 0]
    _draw_over_temperature(limits, battery.discharge_power_limit, temperatures_c, 1e-3)
    limits.legend(title='state of charge', fontsize='small', title_fontsize='small', ncols=2, loc='upper left')
    _draw_over_temperature(limits, battery.charge_power_limit, temperatures_c, 1e-3)
    limits.set(title='power limits of the battery\ndischarging above 0, charging below 0',
               ylabel='battery power [kW]')
    _draw_warming(panels[1, 1], vehicle)
    _draw_charging_curves(panels[2, 0], vehicle)
    _draw_sessions(panels[2, 1], vehicle)
    for axis in panels.flat:
        axis.grid(True, alpha=0.3)
        axis.spines[['top', 'right']].set_visible(False)
    return figure


def _draw_voltage(axis: Axes, battery: Battery) -> None:
    low, high = battery.soc_range
    socs = np.linspace(low, high, 401)
    voltage_v = battery.open_circuit_voltage.function(ARRAYS)(
        socs, np.full_like(socs, 25.0)) + np.zeros_like(socs)
    axis.plot(100.0 * socs, voltage_v, color='tab:blue')
    axis.set(title='open-circuit voltage at 25 °C', xlabel='state of charge [%]',
             ylabel='battery voltage [V]', xlim=(0.0, 100.0))
    if battery.cells_in_series:
        cells = battery.cells_in_series
        per_cell = axis.secondary_yaxis(
            'right', functions=(lambda volt: np.asarray(volt) / cells,
                                lambda volt: np.asarray(volt) * cells))
        per_cell.set_ylabel(f'cell voltage ({cells} in series) [V]')


def _draw_over_temperature(axis: Axes, curve: Curve, temperatures_c: FloatArray,
                           scale: float) -> None:
    values = curve.function(ARRAYS)
    for soc, colour, style, width in zip(SOCS, SOC_COLOURS, SOC_STYLES, SOC_WIDTHS):
        axis.plot(temperatures_c, scale * (values(np.full_like(temperatures_c, soc), temperatures_c)
                                           + np.zeros_like(temperatures_c)),
                  style, color=colour, linewidth=width, zorder=2.0 if style == '-' else 3.0,
                  label=f'{100 * soc:.0f} %')
    axis.axhline(0.0, color='black', linewidth=0.8)
    axis.set(xlabel='battery temperature [°C]', xlim=(temperatures_c[0], temperatures_c[-1]))


def _draw_charging_curves(axis: Axes, vehicle: Vehicle) -> None:
    """Draw the power limit of charging sessions over the state of charge, within the inlet's limit."""
    charging = session_charging(vehicle)
    limit_w = charging.power_limit.function(ARRAYS)
    socs = np.linspace(*vehicle.battery.soc_range, 401)
    for at_c, colour in _temperatures(vehicle):
        power_w = np.minimum(-limit_w(socs, np.full_like(socs, at_c)) + np.zeros_like(socs),
                             charging.maximum_inlet_power_w)
        axis.plot(100.0 * socs, 1e-3 * power_w, color=colour, linewidth=_width(at_c), label=f'{at_c:g} °C')
    axis.set(title='charging curve at a fast charger', xlabel='state of charge [%]', ylabel='charging power [kW]',
             xlim=(0.0, 100.0))
    axis.set_ylim(0.0, 1.25 * axis.get_ylim()[1])
    axis.legend(title='battery', fontsize='small', title_fontsize='small', loc='upper right', ncols=3)


def _draw_sessions(axis: Axes, vehicle: Vehicle) -> None:
    """Draw the sessions from 10 to 80 %, by the battery temperature on arrival."""
    longest_min = 0.0
    for at_c, colour in _temperatures(vehicle):
        session = warm_session(vehicle, battery_c=at_c)
        minutes = session.time_s / S_PER_MIN
        axis.plot(minutes, 100.0 * session.soc, color=colour, linewidth=_width(at_c),
                  label=f'{at_c:g} °C: ' + ('never' if session.problem else f'{minutes[-1]:.0f} min'))
        if not session.problem:
            longest_min = max(longest_min, minutes[-1])
    if longest_min > 0.0:
        axis.set_xlim(0.0, 1.02 * longest_min)
    axis.set(title='session from 10 to 80 %\nair 20 °C, or as cold as the battery', xlabel='time [min]',
             ylabel='state of charge [%]')
    axis.legend(title='battery on arrival', fontsize='small', title_fontsize='small', loc='lower right')


def _width(at_c: float) -> float:
    """Return a line width: a warm battery's is wide, because hotter ones may charge alike."""
    return SOC_WIDTHS[2] if at_c == USUAL_WARM_C else SOC_WIDTHS[0]


def _temperatures(vehicle: Vehicle) -> list[tuple[float, str]]:
    """Return the temperatures within the vehicle's range [deg C], with their colours."""
    low_c, high_c = vehicle.battery.temperature_range_c
    return [(at_c, colour) for at_c, colour in zip(CHARGING_TEMPERATURES_C, TEMPERATURE_COLOURS)
            if low_c <= at_c <= high_c]


def _draw_warming(axis: Axes, vehicle: Vehicle) -> None:
    minutes = np.linspace(0.0, HOUR_MIN, 61)
    leakage = vehicle.battery.leakage
    heater_w = vehicle.hvch.maximum_power_w
    left_w = max(heater_w - vehicle.defaults.cabin_heating_power_w, 0.0)
    for label, start_c, power_w, speed_mps, style, colour in (
            ('full heater power, at rest', AMBIENT_C, heater_w, 0.0, '-', 'tab:red'),
            ('full heater power, 100 km/h', AMBIENT_C, heater_w, KMH_100_MPS, '--', 'tab:red'),
            ('with cabin heating, 100 km/h', AMBIENT_C, left_w, KMH_100_MPS, ':', 'tab:red'),
            ('heater off, at rest', COOLING_FROM_C, 0.0, 0.0, '-', 'tab:blue'),
            ('heater off, 100 km/h', COOLING_FROM_C, 0.0, KMH_100_MPS, '--', 'tab:blue')):
        coefficient = leakage.coefficient_w_per_k(speed_mps)
        axis.plot(minutes, [start_c + warmed_by_k(vehicle, power_w, coefficient, start_c,
                                                  duration_s=60.0 * minute)
                            for minute in minutes], style, color=colour, label=label)
    axis.axhline(vehicle.defaults.target_battery_temperature_c, color='gray', linewidth=0.9,
                 linestyle='--', label='target temperature')
    at_rest, driven = leakage.coefficient_w_per_k(0.0), leakage.coefficient_w_per_k(KMH_100_MPS)
    axis.set(title=f'warming and cooling, air at {AMBIENT_C:g} °C\n'.replace('-', '−')
             + f'leakage {at_rest:.0f} W/K at rest, {driven:.0f} W/K at 100 km/h',
             xlabel='time [min]', ylabel='battery temperature [°C]', xlim=(0.0, HOUR_MIN))
    # Space for the legend away from the curves.
    low, high = axis.get_ylim()
    axis.set_ylim(low - 0.55 * (high - low), high)
    axis.legend(fontsize='small', loc='lower center', ncols=2)
