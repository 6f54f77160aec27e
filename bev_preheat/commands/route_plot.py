# SPDX-License-Identifier: Apache-2.0
"""The plot of `preheat route`: speed, propulsion power and ambient temperature over time."""

import numpy as np

from bev_preheat.drawing.figure import save_figure, stacked_figure


def save_plot(path, name, route):
    """
    Draw a Route into a file; its suffix says which kind of picture it is.

    Raises InvalidInput where the file cannot be written.
    """
    minutes = route.time_s / 60.0
    figure, (speed, power, ambient) = stacked_figure(
        3, f'Route {name}: {minutes[-1]:.0f} min, {route.distance_m / 1000.0:.1f} km, '
           f'{route.propulsion_power_w @ route.duration_s / 3.6e6:.1f} kWh of propulsion',
        panel_height_in=2.4)

    speed.stairs(3.6 * route.speed_mps, minutes, baseline=None, color='tab:gray',
                 label='mean of the segment')
    _set_range(speed, np.append(3.6 * route.speed_mps, 0.0), least=10.0)
    speed.set_ylabel('speed\n[km/h]')

    mean_kw = route.propulsion_power_w / 1000.0
    deviation_kw = np.sqrt(route.propulsion_power_variance_w2) / 1000.0
    low_kw, high_kw = mean_kw - deviation_kw, mean_kw + deviation_kw
    if deviation_kw.max() > 0.0:
        power.stairs(high_kw, minutes, baseline=low_kw, fill=True, color='tab:orange', alpha=0.35,
                     linewidth=0.0,
                     label='± standard deviation within the segment (rms² = mean² + deviation²)')
    power.stairs(mean_kw, minutes, baseline=None, color='tab:red', label='mean of the segment')
    power.axhline(0.0, color='black', linewidth=0.8)
    _set_range(power, np.concatenate((low_kw, high_kw, [0.0])), least=10.0)
    power.set_ylabel('propulsion power\n[kW]')

    ambient.stairs(route.ambient_temperature_c, minutes, baseline=None, color='tab:blue',
                   label='mean of the segment')
    _set_range(ambient, route.ambient_temperature_c, least=4.0)
    ambient.set_ylabel('ambient temperature\n[°C]')
    ambient.set_xlabel('trip time [min]')
    ambient.set_xlim(minutes[0], minutes[-1])

    for axes in (speed, power, ambient):
        # Above the panel, where no curve can hide behind it.
        axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False,
                    fontsize='small', borderaxespad=0.0)
    figure.align_ylabels()
    save_figure(figure, path)


def _set_range(axes, values, least):
    """Show all values with a margin, in a span of at least `least`: no noise is blown up."""
    low, high = float(values.min()), float(values.max())
    margin = max(0.06 * (high - low), 0.5 * (least - (high - low)))
    axes.set_ylim(low - margin, high + margin)
