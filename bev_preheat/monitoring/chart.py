# SPDX-License-Identifier: Apache-2.0
"""A small chart for a terminal: measured and planned battery temperature, and heater power."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from bev_preheat.monitoring.heard import stamp_s
from bev_preheat.optional_packages import advice, is_installed

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bev_preheat.monitoring.heard import Heard
    from bev_preheat_msgs.msg import PreheatPlan

    # (Instant [s], value).
    Points = list[tuple[float, float]]
    # Instants and values.
    Curve = tuple[list[float], list[float]]

# Rows of the two panels with title and axis; a smaller chart is unreadable.
MOST_HEIGHT, LEAST_HEIGHT, HEATER_HEIGHT = 12, 8, 7
LEAST_WIDTH = 40
# The same in both panels, so that an instant has the same column in both.
LABEL_WIDTH = 4
COLUMNS_A_TICK = 12
# Rows of title, frame and axis.
FRAME_HEIGHT = 4
CHART_POINTS = 400
# Shorter is no curve yet, longer is no drive [min].
LEAST_SPAN_MIN, MOST_SPAN_MIN = 0.01, 1e5
LEAST_SPAN_K = 1.0
# Larger values are implausible as temperature [degC] and heater power [W].
LARGEST_CHARTED = 1e6
KNOWN_COLOR, PLANNED_COLOR, TARGET_COLOR = 'cyan', 'orange', 'red'


def chart(heard: Heard, width: int, height: int = MOST_HEIGHT + HEATER_HEIGHT) -> Text:
    """
    Return the chart of a Heard as a rich Text of at most `width` columns and `height` rows.

    Without plotext it is a sentence; without data or room it is empty.
    """
    if width < LEAST_WIDTH or height < LEAST_HEIGHT:
        return Text('')
    try:
        return _chart(heard, width, height)
    except (ArithmeticError, ValueError):
        # No scale fits values far beyond any battery's.
        return Text('')


def _chart(heard: Heard, width: int, height: int) -> Text:
    plan = heard.latest.get('preheat_plan')
    measured, commanded = _finite(heard.temperatures), _finite(heard.powers)
    planned, heating = _planned(plan)
    if not (measured or planned):
        return Text('')
    if not is_installed('plotext'):
        return Text(f'No chart: {advice("plotext")}.', style='dim')
    now_s = (measured or planned)[-1 if measured else 0][0]
    # Both panels share the time axis.
    instants_s = [at_s for at_s, _ in measured + planned]
    span_min = (min(instants_s) - now_s) / 60.0, (max(instants_s) - now_s) / 60.0
    if not LEAST_SPAN_MIN < span_min[1] - span_min[0] < MOST_SPAN_MIN:
        return Text('')
    has_heater = bool(commanded or heating) and height >= LEAST_HEIGHT + HEATER_HEIGHT
    rows = min(height - HEATER_HEIGHT * has_heater, MOST_HEIGHT)
    target_c = plan.target_battery_temperature if plan is not None else math.nan
    targets_c = [target_c] if _is_drawable(target_c) else []
    low_c, high_c = _limits([value for _, value in measured + planned] + targets_c)
    panels = [_panel('battery (degC)', ', measured and planned, over time from now (min)', width, rows, span_min,
                     round_numbers(low_c, high_c, (rows - FRAME_HEIGHT) // 2), (low_c, high_c),
                     _minutes(planned, now_s), _minutes(measured, now_s), targets_c)]
    if has_heater:
        # plotext would draw a line to a point far outside of the panel all the way, in memory.
        shown, shown_plan = (_minutes([(at_s, power_w / 1000.0) for at_s, power_w in points
                                       if min(instants_s) <= at_s <= max(instants_s)], now_s)
                             for points in (commanded, heating))
        top_kw = float(max([1, *map(math.ceil, shown[1] + shown_plan[1])]))
        panels.append(_panel('heater (kW)', ', commanded and planned', width, HEATER_HEIGHT, span_min,
                             [0.0, top_kw / 2.0, top_kw], (0.0, top_kw), shown_plan, shown))
    return Text.from_ansi('\n'.join(panels))


def _panel(title: str, details: str, width: int, height: int, span_min: tuple[float, float],
           ticks: Sequence[float], limits: tuple[float, float], planned: Curve, known: Curve,
           levels: Sequence[float] = ()) -> str:
    """Return a panel as text with ANSI colors; `levels` are horizontal lines."""
    import plotext
    plotext.clear_figure()
    # Otherwise the size of the terminal would limit the panel, too.
    plotext.limit_size(False, False)
    plotext.theme('clear')
    plotext.plotsize(width, height)
    plotext.xlim(*span_min)
    minutes = round_numbers(*span_min, width // COLUMNS_A_TICK)
    plotext.xticks(minutes, [f'{minute:g}' for minute in minutes])
    plotext.ylim(*limits)
    plotext.yticks(ticks, [f'{tick:g}'.rjust(LABEL_WIDTH) for tick in ticks])
    for level in levels:
        plotext.horizontal_line(level, color=TARGET_COLOR)
    for (instants_min, values), color in ((planned, PLANNED_COLOR), (known, KNOWN_COLOR)):
        if instants_min:
            plotext.plot(instants_min, values, color=color)
    plotext.title(title + details if len(title + details) < width - LABEL_WIDTH - 2 else title)
    text: str = plotext.build()
    return text.rstrip('\n')


def _limits(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    return (low, high) if high - low >= LEAST_SPAN_K else (high - LEAST_SPAN_K, low + LEAST_SPAN_K)


def round_numbers(low: float, high: float, most: int) -> list[float]:
    """Return at most `most` multiples of 1, 2 or 5 times a power of ten in a range."""
    for exponent in range(math.floor(math.log10(high - low)) - 1, 10):
        for step in (1.0, 2.0, 5.0):
            step *= 10.0 ** exponent
            numbers = [count * step
                       for count in range(math.ceil(low / step), math.floor(high / step) + 1)]
            if len(numbers) <= max(1, most):
                return numbers
    raise ValueError(f'no round numbers between {low:g} and {high:g}')


def _planned(plan: PreheatPlan | None) -> tuple[Points, Points]:
    """Return the planned (instant [s], deg C) and (instant [s], W); empty without a plan."""
    if plan is None or not 1 < len(plan.time) == len(plan.battery_temperature):
        return [], []
    start_s = stamp_s(plan.header.stamp)
    temperatures = [(start_s + at_s, value)
                    for at_s, value in zip(plan.time, plan.battery_temperature)]
    powers = [(start_s + at_s, value) for at_s, value in zip(plan.time, plan.hvch_power)]
    return _finite(temperatures), _finite(powers)


def _finite(points: Iterable[tuple[float, float]]) -> Points:
    """Return the finite points, thinned if there are many."""
    points = [(at_s, value) for at_s, value in points
              if math.isfinite(at_s) and _is_drawable(value)]
    return points[::max(1, len(points) // CHART_POINTS)]


def _is_drawable(value: float) -> bool:
    return math.isfinite(value) and abs(value) < LARGEST_CHARTED


def _minutes(points: Points, now_s: float) -> Curve:
    return [(at_s - now_s) / 60.0 for at_s, _ in points], [value for _, value in points]
