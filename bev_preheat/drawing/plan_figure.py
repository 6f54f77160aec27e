# SPDX-License-Identifier: Apache-2.0
"""Plans over time: the five panels of the paper's Figure 6, and the battery's power limits."""

import numpy as np

from bev_preheat.arithmetic import ARRAYS
from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.model import make_runge_kutta_4
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.simulate import JOULES_PER_WH, keep_accounts
from bev_preheat.planning.trip import make_trip

COLOURS = ('tab:red', 'tab:orange', 'tab:green', 'black')
STYLES = ('-', '-', '--', ':')


def draw_plans(path, vehicle, route, plans, title):
    """
    Draw plans for one route: temperature, HVCH power, heat sources, leakage, battery power with its
    limits along the first plan, speed and energy.

    Plans are told apart by colour and line style; the suffix of `path` says which kind of picture it
    is.
    """
    trip = make_trip(vehicle, route)
    minutes = trip.time_s / 60.0
    figure, (temperature, heater, heat, leakage, power, drive) = stacked_figure(6, title)
    energy = drive.twinx()
    for plan, style, colour in zip(plans, STYLES, COLOURS):
        accounts = keep_accounts(trip, Schedule(
            plan.heating_start_s, plan.hvch_battery_power_w, plan.friction_brake_power_w,
            plan.soc, plan.battery_temperature_c, make_runge_kutta_4))
        temperature.plot(minutes, plan.battery_temperature_c, style, color=colour,
                         label=plan.method)
        _steps(heater, minutes, plan.hvch_battery_power_w / 1e3, style, colour)
        _steps(heat, minutes, accounts.joule_heat_w / 1e3, style, colour,
               'Joule' if plan is plans[0] else None)
        _steps(leakage, minutes, accounts.leakage_w / 1e3, style, colour)
        _steps(power, minutes, accounts.battery_power_w / 1e3, style, colour)
        spent_wh = np.cumsum(accounts.battery_power_w * trip.route.duration_s) / JOULES_PER_WH
        energy.plot(minutes, np.concatenate(([0.0], spent_wh)) / 1e3, style, color=colour,
                    label='battery energy' if plan is plans[0] else None)
    figure.legend(*temperature.get_legend_handles_labels(), loc='outside lower center', ncols=4,
                  frameon=False)
    for line in temperature.get_lines():
        line.set_label('battery' if line is temperature.get_lines()[0] else '_')
    if plans[0].status.name != 'NO_CHARGING_PLANNED':
        temperature.axhline(plans[0].target_temperature_c, color='gray', linewidth=0.9,
                            linestyle='--', label='target')
    _steps(temperature, minutes, trip.route.ambient_temperature_c, '-', 'tab:blue', 'ambient')
    temperature.set_ylabel('temperature\n[°C]')
    _steps(heater, minutes, trip.heater_limit_w / 1e3, ':', 'gray', 'left by the cabin')
    heater.set_ylabel('HVCH power\nfor battery [kW]')
    _steps(heat, minutes, trip.drivetrain_heat_w / 1e3, '-', 'tab:brown', 'drivetrain')
    heat.set_ylabel('heat into\nbattery [kW]')
    leakage.set_ylabel('heat from\nambient [kW]')
    _draw_limits(power, minutes, trip, plans[0])
    power.set_ylabel('battery power\n[kW]')
    _steps(drive, minutes, trip.route.speed_mps * 3.6, '-', 'tab:gray', 'speed')
    drive.set_ylabel('speed\n[km/h]')
    energy.set_ylabel('battery energy\n[kWh]')
    energy.spines['top'].set_visible(False)
    drive.set_xlabel('trip time [min]')
    drive.set_xlim(minutes[0], minutes[-1])
    for axis in (temperature, heater, heat, power):
        legend_above(axis)
    legend_above(drive, energy)
    save_figure(figure, path)


def _draw_limits(axis, minutes, trip, plan):
    """Draw what the battery may take and deliver along a plan, where the plan comes near to it."""
    battery = trip.vehicle.battery
    states = plan.soc[:-1], plan.battery_temperature_c[:-1]
    low, high = axis.get_ylim()
    for limit, label in ((battery.charge_power_limit, 'charge limit'),
                         (battery.discharge_power_limit, 'discharge limit')):
        values = limit.function(ARRAYS)(*states)
        _steps(axis, minutes, values / 1e3, '-', 'tab:purple', label)
    margin = 0.25 * (high - low)
    axis.set_ylim(low - margin, high + margin)


def _steps(axis, edges, values, style, colour, label=None):
    """Draw one value a step as a staircase."""
    axis.plot(edges, np.append(values, values[-1]), style, color=colour, label=label,
              drawstyle='steps-post')
