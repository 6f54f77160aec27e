# SPDX-License-Identifier: Apache-2.0
"""A simulated drive over time: battery temperature, predicted arrival temperature, and heater command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.drawing.curves import draw_course, TimeAxis
from bev_preheat.drawing.figure import legend_above, stacked_figure
from bev_preheat.drawing.palette import BLACK, BLUE, GRAY, PREDICTION, TARGET

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.numerics.arrays import FloatArray

# In the order in which they are drawn.
MEASURED, TRUE, ESTIMATED, PREDICTED = 'measured', 'true', 'estimated', 'predicted on arrival'
STYLES = {
    MEASURED: {'color': GRAY, 'linewidth': 1.0},
    TRUE: {'color': BLUE, 'linewidth': 2.4},
    ESTIMATED: {'color': BLACK, 'linewidth': 1.0, 'linestyle': '--'},
    PREDICTED: {'color': PREDICTION, 'linewidth': 1.2},
}


def make_drive_figure(time_s: FloatArray, temperatures_c: dict[str, FloatArray], command_w: FloatArray,
                      target_c: float) -> Figure:
    """
    Return the figure of a drive.

    Arrays (N,): instants [s], `temperatures_c` [deg C] by the names in STYLES, command [W].
    """
    time = TimeAxis(float(time_s[-1]))
    figure, (battery, heater) = stacked_figure(2, 'Simulated drive under the planner', panel_height_in=2.4)
    draw_temperatures(battery, time_s, temperatures_c, target_c)
    battery.set_xlabel('')
    heater.step(time(time_s), command_w / 1000.0, where='post', color=BLUE)
    heater.set_ylabel('heater command [kW]')
    time.finish(heater, float(time_s[0]), float(time_s[-1]))
    return figure


def draw_temperatures(axis: Axes, time_s: FloatArray, temperatures_c: dict[str, FloatArray],
                      target_c: float) -> None:
    """Draw the temperatures of a drive and the target [deg C] on an axis of any figure."""
    time = TimeAxis(float(time_s[-1]))
    axis.axhline(target_c, **TARGET, label='target')
    for name, style in STYLES.items():
        draw_course(axis, time(time_s), temperatures_c[name], label=name, **style)
    axis.set_ylabel('battery [°C]')
    legend_above(axis)
    time.finish(axis, float(time_s[0]), float(time_s[-1]))
