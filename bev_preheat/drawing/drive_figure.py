# SPDX-License-Identifier: Apache-2.0
"""A drive under the planner over time, and a week of departures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import tzinfo
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing import palette
from bev_preheat.drawing.figure import draw_course, drawn, finish_panel, legend_above, stacked_figure, TimeAxis
from bev_preheat.drawing.palette import BLACK, BLUE, GRAY, look_of, ORANGE, PREDICTION, TARGET, WITHOUT_PREHEATING
from bev_preheat.numerics import FloatArray, NS_PER_S, W_PER_KW
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.control.departures import GridPrices
    from bev_preheat.control.preparation import PreparedDeparture
    from bev_preheat.drawing.palette import Style

    # Instants [s] and values, shape (N,) each.
    Course = tuple[FloatArray, ...]


AMBIENT, PREDICTED, MEASURED, TRUE, BATTERY, ESTIMATED, UNHEATED = (
    'ambient', 'predicted on arrival', 'measured', 'true', 'battery', 'estimated', WITHOUT_PREHEATING)
STYLES: dict[str, Style] = {
    AMBIENT: {key: value for key, value in palette.AMBIENT.items() if key != 'label'},
    # Wide and pale, because it mostly lies on the target.
    PREDICTED: {'color': PREDICTION, 'linewidth': 5.0, 'alpha': 0.5, 'zorder': 2.0},
    MEASURED: {'color': GRAY, 'linewidth': 1.0},
    TRUE: {'color': BLUE, 'linewidth': 2.4},
    BATTERY: look_of('planner').line(linewidth=1.6),
    ESTIMATED: {'color': BLACK, 'linewidth': 1.0, 'linestyle': '--'},
    UNHEATED: look_of(WITHOUT_PREHEATING).line(),
}
# The legend has the value of these on arrival.
ENDS = (TRUE, BATTERY, UNHEATED)


def make_drive_figure(title: str, temperatures_c: Mapping[str, Course], command_w: Course, target_c: float,
                      socs: Mapping[str, Course] | None = None) -> Figure:
    """Return a drive's figure: temperatures [deg C], command [W], charges (0 ... 1; None: no panel)."""
    end_s = max(float(times_s[-1]) for times_s, *_ in temperatures_c.values())
    figure, (temperature, heater, *charges) = stacked_figure(3 if socs else 2, title, panel_height_in=2.3)
    draw_temperatures(temperature, temperatures_c, target_c)
    temperature.set_xlabel('')
    time, (times_s, power_w) = TimeAxis(end_s), command_w
    on_s = times_s[power_w > 0.0]
    # The last command holds until the vehicle stands.
    edges = time([*times_s, max(end_s, float(times_s[-1]))])
    label = f'command, on after {duration_text(on_s[0])}' if len(on_s) else 'command, never on'
    heater.step(edges, [*power_w / 1e3, power_w[-1] / 1e3], where='post',
                **look_of('planner').line(linewidth=1.6, label=label))
    finish_panel(heater, 'heater power\nfor the battery [kW]', [0.0], power_w / 1e3, least=1.0)
    for charge in charges:
        for name, (instants_s, soc) in (socs or {}).items():
            draw_course(charge, time(instants_s), 100.0 * soc, **STYLES[name],
                        label=f'{name}, ends at {100.0 * soc[-1]:.1f} %')
        finish_panel(charge, 'state of charge\n[%]', *drawn(charge), least=5.0)
    time.finish(figure.axes[-1], 0.0, end_s)
    figure.align_ylabels()
    return figure


def draw_temperatures(axis: Axes, temperatures_c: Mapping[str, Course], target_c: float) -> None:
    """Draw the temperatures of a drive and the target [deg C] on an axis of any figure."""
    end_s = max(float(times_s[-1]) for times_s, *_ in temperatures_c.values())
    time = TimeAxis(end_s)
    for name, (times_s, values_c) in temperatures_c.items():
        draw_course(axis, time(times_s), values_c, **STYLES[name],
                    label=f'{name}, ends at {values_c[-1]:.1f} °C' if name in ENDS else name)
    axis.axhline(target_c, **TARGET, label=f'target {target_c:.1f} °C')
    finish_panel(axis, 'temperature\n[°C]', *drawn(axis), least=5.0)
    time.finish(axis, 0.0, end_s)


# Matplotlib counts days since 1970.
S_PER_DAY = 86400.0


def make_week_figure(prepared: Sequence[PreparedDeparture], prices: GridPrices | None, zone: tzinfo,
                     title: str) -> Figure:
    """Return the figure of the preparations of a week, in local time."""
    from matplotlib.dates import AutoDateLocator, DateFormatter
    figure, axes = stacked_figure(2 if prices is None else 3, title)
    temperature, power = axes[:2]
    for number, one in enumerate(prepared):
        days = _days(one.start_ns) + one.plan.time_s / S_PER_DAY
        temperature.plot(days, one.plan.battery_temperature_c, color=BLUE, label='' if number else 'battery')
        temperature.plot(days[-1:], [one.plan.target_temperature_c], 'o', color=ORANGE,
                         label='' if number else 'target at departure')
        power.stairs(one.plan.hvch_battery_power_w / W_PER_KW, days, color=ORANGE, fill=True)
        for axis in axes:
            axis.axvline(float(days[-1]), color=BLACK, linewidth=0.8, linestyle=':')
    temperature.set_ylabel('temperature [°C]')
    legend_above(temperature)
    power.set_ylabel('heater [kW]')
    if prices is not None and prepared:
        _draw_prices(axes[2], prices, prepared[0].start_ns, prepared[-1].occurrence.instant_ns)
    axes[-1].xaxis.set_major_locator(AutoDateLocator(tz=zone, maxticks=8))  # type: ignore[no-untyped-call]
    axes[-1].xaxis.set_major_formatter(DateFormatter('%Y-%m-%d\n%H:%M', tz=zone))  # type: ignore[no-untyped-call]
    axes[-1].set_xlabel(f'local time, {zone}')
    return figure


def _draw_prices(axis: Axes, prices: GridPrices, from_ns: int, until_ns: int) -> None:
    """Draw the known prices between two instants [ns]."""
    for period in prices.periods(from_ns, until_ns):
        if period.price_per_kwh is not None:
            axis.plot(_days(np.array([period.from_ns, period.until_ns])), 2 * [period.price_per_kwh],
                      color=GRAY, linewidth=1.8)
    axis.set_ylabel(f'price [{prices.currency or "1"}/kWh]')


def _days(instant: FloatArray | float) -> FloatArray:
    """Return instants [ns] in days since 1970."""
    return np.asarray(instant) / (S_PER_DAY * NS_PER_S)
