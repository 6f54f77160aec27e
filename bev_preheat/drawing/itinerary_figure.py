# SPDX-License-Identifier: Apache-2.0
"""A trip with stops over time: the plans of its legs one after the other, the stops shaded."""

import numpy as np

from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.planning.trip import make_trip


def draw_itinerary(path, vehicle, legs, plans, title):
    """
    Draw temperature, HVCH power, state of charge and speed of the Plans for the Legs of a trip.

    During a stop, the line from arrival to the departure that was given is dashed. The suffix of
    `path` says which kind of picture it is.
    """
    figure, axes = stacked_figure(4, title)
    temperature, heater, charge, drive = axes
    trips = [make_trip(vehicle, leg.route) for leg in legs]
    minutes = [(leg.start_ns / NS_PER_S + trip.time_s) / 60.0 for leg, trip in zip(legs, trips)]

    def lines(axis, columns, style, colour, label, at_ends=False):
        # NaN between the legs: nothing is drawn over a stop, and the legend has one line.
        parts = [np.append(values if at_ends else np.append(values, values[-1]), np.nan)
                 for values in columns]
        axis.plot(np.concatenate([np.append(part, np.nan) for part in minutes]),
                  np.concatenate(parts), style, color=colour, label=label,
                  drawstyle='default' if at_ends else 'steps-post')

    def over_stops(axis, columns, colour):
        for before, after, leave, arrive in zip(columns, columns[1:], minutes, minutes[1:]):
            axis.plot((leave[-1], arrive[0]), (before[-1], after[0]), '--', color=colour,
                      linewidth=0.8)

    temperatures = [plan.battery_temperature_c for plan in plans]
    lines(temperature, temperatures, '-', 'tab:red', 'battery', at_ends=True)
    over_stops(temperature, temperatures, 'tab:red')
    targets = [(part[-1], plan.target_temperature_c)
               for leg, part, plan in zip(legs, minutes, plans) if leg.charging_planned]
    if targets:
        temperature.plot(*zip(*targets), 'k_', markersize=14, label='target')
    lines(temperature, [trip.route.ambient_temperature_c for trip in trips], '-', 'tab:blue',
          'ambient')
    temperature.set_ylabel('temperature\n[°C]')
    lines(heater, [plan.hvch_battery_power_w / 1e3 for plan in plans], '-', 'tab:orange',
          'for the battery')
    lines(heater, [trip.heater_limit_w / 1e3 for trip in trips], ':', 'gray', 'left by the cabin')
    heater.set_ylabel('HVCH power\n[kW]')
    charges = [100.0 * plan.soc for plan in plans]
    lines(charge, charges, '-', 'tab:green', 'state of charge', at_ends=True)
    over_stops(charge, charges, 'tab:green')
    charge.set_ylabel('state of charge\n[%]')
    lines(drive, [trip.route.speed_mps * 3.6 for trip in trips], '-', 'tab:gray', 'speed')
    drive.set_ylabel('speed\n[km/h]')
    drive.set_xlabel('trip time [min]')
    drive.set_xlim(minutes[0][0], minutes[-1][-1])
    for axis in axes:
        for number, (leave, arrive) in enumerate(zip(minutes, minutes[1:])):
            axis.axvspan(leave[-1], arrive[0], color='tab:olive', alpha=0.15,
                         label='stop' if axis is temperature and number == 0 else None)
        legend_above(axis)
    save_figure(figure, path)
