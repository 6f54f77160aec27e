# SPDX-License-Identifier: Apache-2.0
"""A small chart for a terminal: measured and planned battery temperature, and the heater."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.text import Text

from bev_preheat.monitoring.heard import stamp_s
from bev_preheat.optional_packages import advice, is_installed

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from typing import Any

    from bev_preheat.monitoring.heard import Heard
    from bev_preheat_msgs.msg import PreheatPlan

    # (Instant [s], value).
    Points = list[tuple[float, float]]
    # Instants and values.
    Curve = tuple[list[float], list[float]]

# Rows of the two panels with title and axis; smaller panels are illegible.
MOST_HEIGHT, LEAST_HEIGHT, HEATER_HEIGHT = 12, 8, 7
LEAST_WIDTH = 40
# Equal in both panels, so that their time axes align.
LABEL_WIDTH = 4
COLUMNS_A_TICK = 12
# Rows of a panel besides the curve: title, frame, axis.
FRAME_HEIGHT = 4
MOST_POINTS = 400
# Shortest and longest time shown; outside, there is no drive to draw [min].
LEAST_SPAN_MIN, MOST_SPAN_MIN = 0.01, 1e5
LEAST_SPAN_K = 1.0
# Larger values are implausible as temperature [degC] and heater power [W].
MOST_VALUE = 1e6
KNOWN_COLOR, PLANNED_COLOR, TARGET_COLOR = 'cyan', 'orange', 'red'


def chart(heard: Heard, width: int, height: int = MOST_HEIGHT + HEATER_HEIGHT) -> Text:
    """
    Return the chart of a Heard as a rich Text of at most `width` columns and `height` rows.

    It is a sentence if plotext is missing, and empty if there are no data or there is no room.
    """
    if width < LEAST_WIDTH or height < LEAST_HEIGHT:
        return Text('')
    try:
        return _chart(heard, width, height)
    except (ArithmeticError, ValueError):
        # The plotting library cannot scale absurd figures.
        return Text('')


def _chart(heard: Heard, width: int, height: int) -> Text:
    plan = heard.latest.get('preheat_plan')
    measured, commanded = _finite(heard.temperatures), _finite(heard.powers)
    planned, heating = _planned(plan)
    if not (measured or planned):
        return Text('')
    if not is_installed('plotext'):
        return Text(f'No chart: {advice("plotext")}.', style='dim')
    import plotext
    now_s = (measured or planned)[-1 if measured else 0][0]
    # Both panels share the time axis.
    instants_s = [at_s for at_s, _ in measured + planned]
    span = (min(instants_s) - now_s) / 60.0, (max(instants_s) - now_s) / 60.0
    if not LEAST_SPAN_MIN < span[1] - span[0] < MOST_SPAN_MIN:
        return Text('')
    # A line to a point far beyond the panel's end would be drawn in full, in memory.
    commanded, heating = ([(at_s, power_w / 1000.0) for at_s, power_w in points
                           if min(instants_s) <= at_s <= max(instants_s)]
                          for points in (commanded, heating))
    has_heater = bool(commanded or heating) and height >= LEAST_HEIGHT + HEATER_HEIGHT
    rows = min(height - HEATER_HEIGHT * has_heater, MOST_HEIGHT)
    target_c = plan.target_battery_temperature if plan is not None else math.nan
    panel = _Panel(plotext, width, rows, span)
    panel.draw_temperature(_minutes(measured, now_s), _minutes(planned, now_s),
                           target_c if _is_drawable(target_c) else None)
    lines = panel.lines()
    if has_heater:
        panel = _Panel(plotext, width, HEATER_HEIGHT, span)
        panel.draw_heater(_minutes(commanded, now_s), _minutes(heating, now_s))
        lines += '\n' + panel.lines()
    return Text.from_ansi(lines)


class _Panel:
    """A picture of plotext, which has only one at a time."""

    def __init__(self, plotext: Any, width: int, height: int,
                 span_min: tuple[float, float]) -> None:
        self._plotext, self._width, self._rows = plotext, width, height - FRAME_HEIGHT
        plotext.clear_figure()
        # Otherwise the terminal's size would limit the picture, too.
        plotext.limit_size(False, False)
        plotext.theme('clear')
        plotext.plotsize(width, height)
        plotext.xlim(*span_min)
        minutes = round_numbers(*span_min, width // COLUMNS_A_TICK)
        plotext.xticks(minutes, [f'{minute:g}' for minute in minutes])

    def lines(self) -> str:
        """Return the panel as text with ANSI colors."""
        text: str = self._plotext.build()
        return text.rstrip('\n')

    def draw_temperature(self, measured: Curve, planned: Curve, target_c: float | None) -> None:
        """Draw curves of ([min], [degC]); `target_c` [degC] may be None."""
        values_c = [*measured[1], *planned[1], *(() if target_c is None else (target_c,))]
        low_c, high_c = min(values_c), max(values_c)
        if high_c - low_c < LEAST_SPAN_K:
            low_c, high_c = high_c - LEAST_SPAN_K, low_c + LEAST_SPAN_K
        self._set_scale(low_c, high_c, round_numbers(low_c, high_c, self._rows // 2))
        if target_c is not None:
            self._plotext.horizontal_line(target_c, color=TARGET_COLOR)
        self._draw(measured, planned)
        self._set_title('battery (degC)', ', measured and planned, over time from now (min)')

    def draw_heater(self, commanded: Curve, planned: Curve) -> None:
        """Draw curves of ([min], [kW]) above 0 kW."""
        top_kw = float(max(1, math.ceil(max(commanded[1] + planned[1]))))
        self._set_scale(0.0, top_kw, (0.0, top_kw / 2.0, top_kw))
        self._draw(commanded, planned)
        self._set_title('heater (kW)', ', commanded and planned')

    def _set_scale(self, low: float, high: float, ticks: Sequence[float]) -> None:
        self._plotext.ylim(low, high)
        self._plotext.yticks(ticks, [f'{tick:g}'.rjust(LABEL_WIDTH) for tick in ticks])

    def _draw(self, known: Curve, planned: Curve) -> None:
        for (minutes, values), color in ((planned, PLANNED_COLOR), (known, KNOWN_COLOR)):
            if minutes:
                self._plotext.plot(minutes, values, color=color)

    def _set_title(self, title: str, details: str) -> None:
        self._plotext.title(title + details if len(title + details) < self._width - LABEL_WIDTH - 2
                            else title)


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
    return points[::max(1, len(points) // MOST_POINTS)]


def _is_drawable(value: float) -> bool:
    return math.isfinite(value) and abs(value) < MOST_VALUE


def _minutes(points: Points, now_s: float) -> Curve:
    return [(at_s - now_s) / 60.0 for at_s, _ in points], [value for _, value in points]
