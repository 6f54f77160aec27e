# SPDX-License-Identifier: Apache-2.0
"""Pictures of recorded trips beside their prediction, and of an identification."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.figure import draw_course, draw_steps, grid_figure, legend_above, picture_of, TimeAxis
from bev_preheat.drawing.palette import BLACK, BLUE, GRAY, ORANGE, SKY_BLUE, VERMILLION
from bev_preheat.identification.uncertainty import QUANTILE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.identification.check import Check, TripCheck
    from bev_preheat.identification.result import Identification
    from bev_preheat.identification.trips import Trip

# Beyond this many trips a figure is too tall to be read; the others are in the table.
MOST_TRIPS_DRAWN = 24
ROW_HEIGHT_IN = 1.9
PANEL_HEIGHT_IN = 3.4
# One residual a minute is enough for a picture.
RESIDUAL_STEP_S = 60.0


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


def report_pictures(result: Identification) -> dict[str, str]:
    """Return the pictures of a report by name, as SVG elements."""
    return {'trips': _svg(check_figure(result.check)), 'unseen': _svg(_unseen(result)),
            'resistance': _svg(_resistance(result)), 'residuals': _svg(_residuals(result.check)),
            'coverage': _svg(_coverage(result.check))}


def _svg(figure: Figure) -> str:
    text = picture_of(figure, 'svg', metadata={'Date': None}).decode()
    return text[text.index('<svg'):]


def _unseen(result: Identification) -> Figure:
    """Errors on each trip left out, with 90 % intervals."""
    figure, axes = grid_figure(1, 1, 'arrival error of each trip, predicted from all others; bars: 90 % interval',
                               PANEL_HEIGHT_IN)
    axis: Axes = axes[0, 0]
    at = np.arange(len(result.left_out))
    axis.bar(at, [2.0 * QUANTILE * trip.deviation_k for trip in result.left_out], 0.6,
             bottom=[-QUANTILE * trip.deviation_k for trip in result.left_out], color=SKY_BLUE, alpha=0.4)
    axis.plot(at, [trip.error_k for trip in result.left_out], 'o', color=BLUE)
    axis.axhline(0.0, color=BLACK, linewidth=0.8)
    axis.set_xticks(at, [trip.name for trip in result.left_out], rotation=30, ha='right', fontsize='small')
    axis.set_ylabel('predicted − measured [K]')
    return figure


def _resistance(result: Identification) -> Figure:
    """Resistance over temperature with its interval, and where trips cover it."""
    curve, coverage = result.resistance, result.coverage
    figure, axes = grid_figure(1, 1, 'resistance at half charge; shaded: 90 % interval, hatched: extrapolated',
                               PANEL_HEIGHT_IN)
    axis: Axes = axes[0, 0]
    axis.fill_between(curve.temperature_c, 1e3 * curve.low_ohm, 1e3 * curve.high_ohm, color=BLUE, alpha=0.25,
                      linewidth=0.0)
    axis.plot(curve.temperature_c, 1e3 * curve.estimate_ohm, color=BLUE, label='identified')
    axis.plot(curve.temperature_c, 1e3 * curve.start_ohm, color=GRAY, linestyle='--', label=f'{result.start_name}')
    low_c, high_c = coverage.resistance_from_c, coverage.resistance_to_c
    ends = (curve.temperature_c[0], curve.temperature_c[-1])
    for begin, end in (((ends[0], low_c), (high_c, ends[1])) if low_c is not None
                       and high_c is not None else (ends,)):
        axis.axvspan(begin, end, facecolor='none', edgecolor=GRAY, alpha=0.35, hatch='//', linewidth=0.0)
    covered = (curve.temperature_c >= coverage.battery_c[0] - 10.0) & (
        curve.temperature_c <= coverage.battery_c[1] + 10.0)
    axis.set_ylim(0.0, 1.3e3 * float(np.max(curve.high_ohm[covered])))
    axis.set(xlabel='battery temperature [°C]', ylabel='resistance [mΩ]', xlim=ends)
    axis.legend(fontsize='small')
    return figure


def _residuals(check: Check) -> Figure:
    """Predicted minus measured temperature over time, temperature and current."""
    figure, axes = grid_figure(1, 3, 'predicted − measured temperature [K], one point a minute', PANEL_HEIGHT_IN,
                               sharey=True)
    for trip_check in check.trips:
        trip, predicted = trip_check.trip, trip_check.prediction
        time_s = np.arange(RESIDUAL_STEP_S, len(trip) - 1.0, RESIDUAL_STEP_S)
        residual_k = (np.interp(time_s, predicted.time_s, predicted.reading_c)
                      - trip.battery_temperature_c[time_s.astype(int)])
        edges = np.concatenate(([0.0], time_s))
        square = np.sqrt(trip.means((trip.power_w + trip.heater_w)**2
                                    if trip.current_a is None else trip.current_a**2,
                                    edges))
        for axis, values in zip(axes[0], (time_s / 60.0, trip.battery_temperature_c[time_s.astype(int)], square)):
            axis.plot(values, residual_k, '.', markersize=2.5, color=BLUE, alpha=0.5)
    for axis, label in zip(axes[0], ('time [min]', 'battery temperature [°C]',
                                     'current, rms [A]' if check.trips[0].trip.current_a is not None
                                     else 'power, rms [W]')):
        axis.axhline(0.0, color=BLACK, linewidth=0.8)
        axis.set_xlabel(label)
    return figure


def _coverage(check: Check) -> Figure:
    """Hours by battery temperature and by speed; heated, driving, at stand."""
    figure, axes = grid_figure(1, 2, 'recorded hours', PANEL_HEIGHT_IN)
    kinds: tuple[tuple[str, str, Callable[[Trip], bool]], ...] = (
        ('drives', BLUE, lambda trip: trip.kind == 'drive' and not trip.heats),
        ('heated', ORANGE, lambda trip: trip.heats),
        ('charging', VERMILLION, lambda trip: trip.kind == 'charging session' and not trip.heats),
        ('at stand', GRAY, lambda trip: trip.kind == 'night at stand' and not trip.heats))
    for axis, label, bins, values_of in (
            (axes[0, 0], 'battery temperature [°C]', np.arange(-40.0, 61.0, 5.0), 'battery_temperature_c'),
            (axes[0, 1], 'speed [km/h]', np.arange(0.0, 201.0, 10.0), 'speed_mps')):
        scale = 3.6 if values_of == 'speed_mps' else 1.0
        groups = [(name, colour, np.concatenate([
            scale * getattr(item.trip, values_of) for item in check.trips if wanted(item.trip)] or [np.empty(0)]))
            for name, colour, wanted in kinds]
        groups = [group for group in groups if len(group[2])]
        axis.hist([values for _, _, values in groups], bins,
                  weights=[np.full(len(values), 1.0 / 3600.0) for _, _, values in groups], stacked=True,
                  color=[colour for _, colour, _ in groups], label=[name for name, _, _ in groups])
        used = np.concatenate([values for _, _, values in groups])
        axis.set_xlim(float(used.min()) - 5.0, float(used.max()) + 5.0 * scale)
        axis.set(xlabel=label, ylabel='hours')
    axes[0, 0].legend(fontsize='small')
    return figure
