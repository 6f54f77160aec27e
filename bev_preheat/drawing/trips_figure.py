# SPDX-License-Identifier: Apache-2.0
"""Recorded trips beside their prediction: temperature and state of charge over time, one row per trip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.curves import draw_course, draw_steps, TimeAxis
from bev_preheat.drawing.figure import grid_figure, legend_above, save_figure
from bev_preheat.drawing.palette import BLUE, GRAY, ORANGE, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.identification.check import Check, TripCheck

# Beyond this many trips a figure is too tall to be read; the others are in the table.
MOST_TRIPS_DRAWN = 24
ROW_HEIGHT_IN = 1.9


def draw_check(path: AnyPath, check: Check) -> None:
    """Draw a Check; the suffix of the path gives the format."""
    save_figure(check_figure(check), path)


def check_figure(check: Check) -> Figure:
    """Return the figure of a Check: a row for each trip, temperature on the left, charge on the right."""
    shown = check.trips[:MOST_TRIPS_DRAWN]
    left_out = len(check.trips) - len(shown)
    figure, axes = grid_figure(
        len(shown), 2, f'vehicle {check.vehicle.name}: RMSE {check.rmse_k:.2f} K, worst {check.worst_k:.2f} K on '
        f'{len(check.trips)} trips' + (f', the first {len(shown)} drawn' if left_out else ''),
        ROW_HEIGHT_IN * len(shown) + 0.8)
    for row, trip in zip(axes, shown):
        draw_trip(row[0], row[1], trip)
    legend_above(axes[0, 0], columns=1)
    legend_above(axes[0, 1], columns=1)
    return figure


def draw_arrival_errors(axis: Axes, check: Check) -> None:
    """Draw the error on arrival of each trip of a Check on an axis of any figure."""
    axis.barh([trip.trip.name for trip in check.trips], [trip.arrival_error_k for trip in check.trips], color=BLUE)
    axis.invert_yaxis()
    axis.set_xlabel('predicted minus measured temperature on arrival [K]')


def draw_trip(temperature: Axes, charge: Axes, check: TripCheck) -> None:
    """Draw a TripCheck: readings as intervals of the sensor's step, prediction as a line."""
    trip, predicted = check.trip, check.prediction
    time = TimeAxis(len(trip))
    edges = time(np.arange(len(trip) + 1.0))
    half_k = 0.5 * trip.resolution_k
    readings_c = trip.battery_temperature_c
    if half_k:
        temperature.fill_between(edges[:-1], readings_c - half_k, readings_c + half_k, step='post', color=GRAY,
                                 alpha=0.3, linewidth=0.0, label='measured, within the step of the sensor')
    else:
        draw_course(temperature, edges[:-1], readings_c, color=GRAY, linewidth=2.5, label='measured')
    draw_course(temperature, time(predicted.time_s), predicted.reading_c, color=BLUE, linewidth=1.6,
                label='predicted from the first reading')
    if trip.heats:
        heater = temperature.twinx()
        draw_steps(heater, edges, 1e-3 * trip.heater_w, color=ORANGE, linewidth=0.8)
        heater.set_ylabel('heater [kW]', fontsize='small', color=ORANGE)
    temperature.set_ylabel(f'{trip.name}\n[°C]', fontsize='small')
    temperature.annotate(f'{check.arrival_error_k:+.2f} K'.replace('-', '\N{MINUS SIGN}'), (0.99, 0.06),
                         xycoords='axes fraction', horizontalalignment='right', fontsize='small')
    draw_course(charge, edges[:-1], 100.0 * trip.soc, color=GRAY, linewidth=2.5, label='measured')
    draw_course(charge, time(predicted.time_s), 100.0 * predicted.soc, color=VERMILLION, linewidth=1.2,
                label='predicted')
    charge.set_ylabel('charge [%]', fontsize='small')
    for axis in (temperature, charge):
        time.finish(axis, 0.0, float(len(trip)))
