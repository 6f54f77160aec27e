# SPDX-License-Identifier: Apache-2.0
"""A route over time: speed, propulsion power and ambient temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.curves import draw_steps, shade_steps, show_range, TimeAxis
from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.drawing.palette import POWER, ROUTE, SKY_BLUE

if TYPE_CHECKING:

    from matplotlib.figure import Figure

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.route import Route


def draw_route(path: AnyPath, name: str, route: Route) -> None:
    """Draw a Route into a file; its suffix gives the format."""
    save_figure(make_route_figure(name, route), path)


def make_route_figure(name: str, route: Route) -> Figure:
    """Return the figure of a Route; shading shows the variation of the power within each segment."""
    time = TimeAxis(route.total_duration_s)
    edges = time(route.time_s)
    figure, (speed, power, ambient) = stacked_figure(
        3, f'route {name}: {edges[-1]:.3g} {time.unit}, {route.distance_m / 1000.0:.1f} km, '
           f'{route.propulsion_power_w @ route.duration_s / 3.6e6:.1f} kWh of propulsion',
        panel_height_in=2.2)

    draw_steps(speed, edges, 3.6 * route.speed_mps, color=ROUTE)
    show_range(speed, [0.0], 3.6 * route.speed_mps, least=20.0)
    speed.set_ylabel('speed\n[km/h]')

    mean_kw = route.propulsion_power_w / 1000.0
    deviation_kw = np.sqrt(route.propulsion_power_variance_w2) / 1000.0
    low_kw, high_kw = mean_kw - deviation_kw, mean_kw + deviation_kw
    draw_steps(power, edges, mean_kw, color=POWER, label='mean of the segment')
    if deviation_kw.max() > 0.0:
        shade_steps(power, edges, low_kw, high_kw, color=POWER, alpha=0.3,
                    label='± standard deviation within the segment (rms² = mean² + deviation²)')
    power.axhline(0.0, color='black', linewidth=0.6)
    show_range(power, [0.0], low_kw, high_kw, least=10.0)
    power.set_ylabel('propulsion power\n[kW]')
    legend_above(power)

    draw_steps(ambient, edges, route.ambient_temperature_c, color=SKY_BLUE)
    show_range(ambient, route.ambient_temperature_c, least=5.0)
    ambient.set_ylabel('ambient temperature\n[°C]')
    time.finish(ambient, 0.0, route.total_duration_s)
    figure.align_ylabels()
    return figure
