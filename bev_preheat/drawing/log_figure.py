# SPDX-License-Identifier: Apache-2.0
"""The signals of a recording over time, with their gaps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.curves import TimeAxis
from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.drawing.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILLION
from bev_preheat.logs.recording import gaps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.logs.recording import Recording, Series
    from bev_preheat.numerics.arrays import FloatArray

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


def draw_recording(path: AnyPath, recording: Recording) -> None:
    """Draw a Recording into a file; its suffix gives the format."""
    save_figure(make_recording_figure(recording), path)


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
