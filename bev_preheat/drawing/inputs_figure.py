# SPDX-License-Identifier: Apache-2.0
"""Inputs over time: a route with its speed and power, and the signals of a recording with their gaps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.figure import (
    draw_steps,
    finish_panel,
    legend_above,
    shade_steps,
    stacked_figure,
    TimeAxis,
)
from bev_preheat.drawing.palette import BLACK, BLUE, GREEN, ORANGE, POWER, PURPLE, ROUTE, SKY_BLUE, VERMILLION
from bev_preheat.logs.recording import gaps, Recording, Series

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bev_preheat.numerics import FloatArray
    from bev_preheat.route import Route

# Panels: label, factor from the signals' unit, and signals with colour and name.
PANELS = (
    ('temperature\n[°C]', 1.0, (
        ('battery_temperature_c', VERMILLION, 'battery'), ('ambient_c', SKY_BLUE, 'ambient'),
        ('coolant_c', GREEN, 'coolant'))),
    ('state of\ncharge [%]', 100.0, (('soc', BLACK, 'state of charge'),)),
    ('voltage\n[V]', 1.0, (('voltage_v', BLUE, 'voltage'),)),
    ('current\n[A]', 1.0, (('current_a', PURPLE, 'current'),)),
    ('power\n[kW]', 1e-3, (('power_w', VERMILLION, 'battery'), ('propulsion_power_w', GREEN, 'propulsion'))),
    ('heaters,\nauxiliaries\n[kW]', 1e-3, (
        ('heater_w', VERMILLION, 'heater'), ('battery_heater_w', PURPLE, 'battery heater'),
        ('cabin_heater_w', ORANGE, 'cabin heater'), ('aircon_w', SKY_BLUE, 'air conditioning'),
        ('auxiliary_w', BLACK, 'auxiliaries'))),
    ('speed\n[km/h]', 3.6, (('speed_mps', BLACK, 'speed'),)),
    ('elevation\n[m]', 1.0, (('elevation_m', GREEN, 'elevation'),)))


def make_route_figure(name: str, route: Route) -> Figure:
    """Return the figure of a Route; shading shows the variation of the power within each segment."""
    time = TimeAxis(route.total_duration_s)
    edges = time(route.time_s)
    figure, (speed, power, ambient) = stacked_figure(
        3, f'route {name}: {edges[-1]:.3g} {time.unit}, {route.distance_m / 1000.0:.1f} km, '
           f'{route.propulsion_power_w @ route.duration_s / 3.6e6:.1f} kWh of propulsion',
        panel_height_in=2.2)

    draw_steps(speed, edges, 3.6 * route.speed_mps, color=ROUTE)
    finish_panel(speed, 'speed\n[km/h]', [0.0], 3.6 * route.speed_mps, least=20.0)

    mean_kw = route.propulsion_power_w / 1000.0
    deviation_kw = np.sqrt(route.propulsion_power_variance_w2) / 1000.0
    low_kw, high_kw = mean_kw - deviation_kw, mean_kw + deviation_kw
    draw_steps(power, edges, mean_kw, color=POWER, label='mean of the segment')
    if deviation_kw.max() > 0.0:
        shade_steps(power, edges, low_kw, high_kw, color=POWER, alpha=0.3,
                    label='± standard deviation within the segment (rms² = mean² + deviation²)')
    power.axhline(0.0, color='black', linewidth=0.6)
    finish_panel(power, 'propulsion power\n[kW]', [0.0], low_kw, high_kw, least=10.0)

    draw_steps(ambient, edges, route.ambient_temperature_c, color=SKY_BLUE)
    finish_panel(ambient, 'ambient temperature\n[°C]', route.ambient_temperature_c, least=5.0)
    time.finish(ambient, 0.0, route.total_duration_s)
    figure.align_ylabels()
    return figure


def make_recording_figure(recording: Recording) -> Figure:
    """Return the figure of a Recording: a panel a quantity; lines break at gaps."""
    panels = [(label, factor, found) for label, factor, signals in PANELS
              if (found := [each for each in signals if each[0] in recording.signals])]
    if not panels:
        panels = [(f'{signal}', 1.0, [(signal, BLACK, signal)]) for signal in recording.signals]
    time = TimeAxis(recording.duration_s)
    figure, axes = stacked_figure(
        len(panels), f'log {recording.name}: {recording.format}, signal map {recording.signal_map}',
        panel_height_in=1.5)
    for axis, (label, factor, signals) in zip(axes, panels):
        for signal, colour, name in signals:
            time_s, value = _broken(recording.signals[signal])
            few = len(value) < 2
            axis.plot(time(time_s), factor * value, color=colour, linewidth=1.0, label=name,
                      marker='.' if few else None)
        axis.set_ylabel(label)
        if len(signals) > 1:
            legend_above(axis)
    time.finish(axes[-1], 0.0, recording.duration_s)
    figure.align_ylabels()
    return figure


def _broken(series: Series) -> tuple[FloatArray, FloatArray]:
    """Return times and values with a NaN in each gap."""
    if len(series.time_s) < 2:
        return series.time_s, series.value
    after = np.flatnonzero(gaps(series)) + 1
    return (np.insert(series.time_s, after, 0.5 * (series.time_s[after - 1] + series.time_s[after])),
            np.insert(series.value, after, np.nan))
