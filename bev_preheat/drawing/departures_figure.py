# SPDX-License-Identifier: Apache-2.0
"""A week of departures: battery temperature, heater power, and prices of energy from the grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.dates import DateFormatter, DayLocator
import numpy as np

from bev_preheat.drawing.figure import legend_above, stacked_figure
from bev_preheat.drawing.palette import BLACK, BLUE, GRAY, ORANGE
from bev_preheat.numerics import NS_PER_S, W_PER_KW

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import tzinfo

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.control.departures import GridPrices
    from bev_preheat.control.preparation import PreparedDeparture
    from bev_preheat.numerics import FloatArray

# Matplotlib counts days since 1970.
S_PER_DAY = 86400.0


def make_week_figure(prepared: Sequence[PreparedDeparture], prices: GridPrices | None, zone: tzinfo,
                     title: str) -> Figure:
    """Return the figure of the preparations of a week, in local time."""
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
    axes[-1].xaxis.set_major_locator(DayLocator(tz=zone))  # type: ignore[no-untyped-call]
    axes[-1].xaxis.set_major_formatter(DateFormatter('%Y-%m-%d', tz=zone))  # type: ignore[no-untyped-call]
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
