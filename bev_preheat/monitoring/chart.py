# SPDX-License-Identifier: Apache-2.0
"""A small chart for a terminal: the battery's temperature so far and as planned, and the heater."""

import math

from rich.text import Text

from bev_preheat.monitoring.heard import stamp_s

HEIGHT, HEATER_HEIGHT = 12, 7
MARGIN = 6
MOST_POINTS = 400
# Less is no course yet, more is no drive [min].
LEAST_SPAN_MIN, MOST_SPAN_MIN = 0.01, 1e5
# Larger values are no temperature [degC] and no heater power [W].
MOST_VALUE = 1e6


def chart(heard, width):
    """Return the chart of a Heard as a rich Text; a sentence, or nothing, where there is none."""
    try:
        return _chart(heard, width)
    except (ArithmeticError, ValueError):
        # Of figures that are no battery's the plotting library cannot find the scale.
        return Text('')


def _chart(heard, width):
    plan = heard.latest.get('preheat_plan')
    measured, commanded = _finite(heard.temperatures), _finite(heard.powers)
    planned, heating = _planned(plan)
    if not (measured or planned):
        return Text('')
    try:
        import plotext
    except ImportError:
        return Text('For a chart here: python3 -m pip install plotext', style='dim')
    now_s = (measured or planned)[-1 if measured else 0][0]
    # Both panels show the same time.
    instants_s = [at_s for at_s, _ in measured + planned]
    span = tuple((edge_s - now_s) / 60.0 for edge_s in (min(instants_s), max(instants_s)))
    if not LEAST_SPAN_MIN < span[1] - span[0] < MOST_SPAN_MIN:
        return Text('')
    figure = _figure(plotext, width, HEIGHT, span)
    for points, label in ((measured, 'measured'), (planned, 'planned')):
        if points:
            figure.plot(*_minutes(points, now_s), label=label)
    target_c = plan.target_battery_temperature if plan is not None else math.nan
    if _is_drawable(target_c):
        figure.horizontal_line(target_c)
    figure.title('battery (degC) over time from now (min)')
    lines = figure.build()
    # A line to a point far beyond the panel's end is drawn all the way, in memory.
    powers = [(at_s, power_w / 1000.0) for at_s, power_w in commanded + heating
              if min(instants_s) <= at_s <= max(instants_s)]
    if powers:
        strip = _figure(plotext, width, HEATER_HEIGHT, span)
        strip.ylim(0.0, max(1.0, *(power_kw for _, power_kw in powers)))
        strip.plot(*_minutes(powers, now_s))
        strip.title('heater (kW)')
        lines += '\n' + strip.build()
    return Text.from_ansi(lines)


def _figure(plotext, width, height, span_min):
    plotext.clear_figure()
    plotext.xlim(*span_min)
    plotext.theme('clear')
    plotext.plotsize(max(width - MARGIN, 30), height)
    return plotext


def _planned(plan):
    """Return the planned (instant [s], deg C) and (instant [s], W); empty where there is no plan."""
    if plan is None or not 1 < len(plan.time) == len(plan.battery_temperature):
        return [], []
    start_s = stamp_s(plan.header.stamp)
    temperatures = [(start_s + at_s, value)
                    for at_s, value in zip(plan.time, plan.battery_temperature)]
    powers = [(start_s + at_s, value) for at_s, value in zip(plan.time, plan.hvch_power)]
    return _finite(temperatures), _finite(powers)


def _finite(points):
    """Return the points that are numbers, thinned out where they are many."""
    points = [(at_s, value) for at_s, value in points
              if math.isfinite(at_s) and _is_drawable(value)]
    return points[::max(1, len(points) // MOST_POINTS)]


def _is_drawable(value):
    return math.isfinite(value) and abs(value) < MOST_VALUE


def _minutes(points, now_s):
    return [(at_s - now_s) / 60.0 for at_s, _ in points], [value for _, value in points]
