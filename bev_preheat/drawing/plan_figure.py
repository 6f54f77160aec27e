# SPDX-License-Identifier: Apache-2.0
"""Plans over time, in the five panels of the paper's Figure 6."""

import numpy as np

from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.model import make_runge_kutta_4
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.simulate import JOULES_PER_WH, keep_accounts
from bev_preheat.planning.trip import make_trip

COLOURS = ('tab:red', 'tab:blue', 'tab:green', 'tab:purple')
STYLES = ('-', '--', ':', '-.')


def draw_plans(path, vehicle, route, plans, title):
    """
    Draw plans for one route: temperature, HVCH power, heat sources, leakage, speed and energy.

    Plans are told apart by line style; the suffix of `path` says which kind of picture it is.
    """
    trip = make_trip(vehicle, route)
    minutes = trip.time_s / 60.0
    figure, (temperature, heater, heat, leakage, drive) = stacked_figure(5, title)
    energy = drive.twinx()
    for plan, style in zip(plans, STYLES):
        accounts = keep_accounts(trip, Schedule(
            plan.heating_start_s, plan.hvch_battery_power_w, plan.friction_brake_power_w,
            plan.soc, plan.battery_temperature_c, make_runge_kutta_4))
        temperature.plot(minutes, plan.battery_temperature_c, style, color='tab:red',
                         label=f'battery ({plan.method})')
        _steps(heater, minutes, plan.hvch_battery_power_w / 1e3, style, 'tab:orange', plan.method)
        _steps(heat, minutes, accounts.joule_heat_w / 1e3, style, 'tab:purple',
               f'Joule ({plan.method})')
        _steps(leakage, minutes, accounts.leakage_w / 1e3, style, 'tab:cyan', plan.method)
        spent_wh = np.cumsum(accounts.battery_power_w * route.duration_s) / JOULES_PER_WH
        energy.plot(minutes, np.concatenate(([0.0], spent_wh)) / 1e3, style, color='tab:green',
                    label=f'battery energy ({plan.method})')
    if plans[0].status.name != 'NO_CHARGING_PLANNED':
        temperature.axhline(plans[0].target_temperature_c, color='black', linewidth=0.8,
                            linestyle='--', label='target')
    _steps(temperature, minutes, route.ambient_temperature_c, '-', 'tab:blue', 'ambient')
    temperature.set_ylabel('temperature\n[°C]')
    _steps(heater, minutes, trip.heater_limit_w / 1e3, ':', 'gray', 'left by the cabin')
    heater.set_ylabel('HVCH power\nfor battery [kW]')
    _steps(heat, minutes, trip.drivetrain_heat_w / 1e3, '-', 'tab:brown', 'drivetrain')
    heat.set_ylabel('heat into\nbattery [kW]')
    leakage.set_ylabel('heat from\nambient [kW]')
    _steps(drive, minutes, route.speed_mps * 3.6, '-', 'tab:gray', 'speed')
    drive.set_ylabel('speed\n[km/h]')
    energy.set_ylabel('battery energy\n[kWh]')
    energy.spines['top'].set_visible(False)
    drive.set_xlabel('trip time [min]')
    drive.set_xlim(minutes[0], minutes[-1])
    for axis in (temperature, heater, heat, leakage):
        legend_above(axis)
    legend_above(drive, energy)
    save_figure(figure, path)


def _steps(axis, edges, values, style, colour, label):
    """Draw one value a step as a staircase."""
    axis.plot(edges, np.append(values, values[-1]), style, color=colour, label=label,
              drawstyle='steps-post')
