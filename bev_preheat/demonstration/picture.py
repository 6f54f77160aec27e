# SPDX-License-Identifier: Apache-2.0
"""Draws a drive: temperature, heater command and state of charge over time."""

import numpy as np

from bev_preheat.drawing.figure import save_figure, stacked_figure
from bev_preheat.nodes.convert import nanoseconds


def draw_drive(path, drive, title):
    """Draw a `Drive` over what was planned at its start; the suffix of `path` tells how."""
    figure, (temperature, heater, charge) = stacked_figure(3, title, panel_height_in=2.4)
    instants_s, temperatures_c, socs = np.array(drive.states).T
    plan = drive.first_plan
    plan_start_s = (nanoseconds(plan.header.stamp) - drive.start_ns) * 1e-9
    planned_minutes = (plan_start_s + np.array(plan.time)) / 60.0
    edges_minutes = np.concatenate(([0.0], np.cumsum(drive.route.segment_duration))) / 60.0

    planned = {'linewidth': 5.0, 'alpha': 0.3, 'label': 'planned at the start'}
    temperature.plot(planned_minutes, plan.battery_temperature, color='tab:red', **planned)
    temperature.plot(instants_s / 60.0, temperatures_c, color='tab:red', label='battery')
    prediction_s, predicted_c = np.array(drive.predictions).T
    temperature.plot(prediction_s / 60.0, predicted_c, color='tab:purple', linewidth=1.0,
                     label='predicted for arrival')
    temperature.axhline(drive.target_c, color='black', linewidth=0.8, linestyle='--',
                        label='target')
    ambient_c = np.broadcast_to(drive.route.ambient_temperature, len(edges_minutes) - 1)
    _staircase(temperature, edges_minutes, ambient_c, color='tab:blue', label='ambient')
    temperature.set_ylabel('temperature [°C]')

    command_s, power_w = np.array(drive.commands).T
    _staircase(heater, planned_minutes, np.array(plan.hvch_power) / 1e3, color='tab:orange',
               **planned)
    heater.plot(command_s / 60.0, power_w / 1e3, color='tab:orange', drawstyle='steps-post',
                label='command')
    heater.set_ylabel('heater power\nfor the battery [kW]')

    charge.plot(planned_minutes, 100.0 * np.array(plan.soc), color='tab:green', **planned)
    charge.plot(instants_s / 60.0, 100.0 * socs, color='tab:green', label='battery')
    charge.set_ylabel('state of charge [%]')
    charge.set_xlabel('trip time [min]')
    charge.set_xlim(0.0, edges_minutes[-1])
    for axis, place in ((temperature, 'center left'), (heater, 'upper left'),
                        (charge, 'lower left')):
        axis.legend(loc=place, fontsize='small')
    save_figure(figure, path)


def _staircase(axis, edges, values, **style):
    """Draw one value a step."""
    axis.plot(edges, np.append(values, values[-1]), drawstyle='steps-post', **style)
