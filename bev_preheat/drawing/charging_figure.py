# SPDX-License-Identifier: Apache-2.0
"""Charging sessions over time, and the value of heating before them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing import palette
from bev_preheat.drawing.figure import (
    draw_course,
    draw_steps,
    finish_panel,
    grid_figure,
    legend_above,
    literal,
    show_range,
    stacked_figure,
    TimeAxis,
)
from bev_preheat.drawing.palette import BLACK, BLUE, GRAY, GREEN, look_of, ORANGE, PURPLE, WITHOUT_PREHEATING
from bev_preheat.numerics import W_PER_KW
from bev_preheat.vehicle.charging import charging_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.charging.chargers import CandidateWorth
    from bev_preheat.charging.session import Session
    from bev_preheat.charging.stop import ChargingStop
    from bev_preheat.charging.target_worth import TargetWorth, Worth
    from bev_preheat.vehicle import Vehicle

    # Coordinates of a target on the axes: x, y.
    Place = Callable[[TargetWorth], tuple[float, float]]

# In the order of the sessions.
LOOKS = (look_of('value_function'), look_of(WITHOUT_PREHEATING))
HEATER_DASHES = (0, (1.0, 1.5))
# Time shown if no session ends [s], and the margin after the first end.
MOST_SHOWN_S = 2.0 * 3600.0
SHOWN_BEYOND = 1.3
LEAST_SHOWN_S = 60.0


def draw_charging_power(axis: Axes, session: Session) -> None:
    """Draw the charging power of a Session over time on an axis of any figure."""
    time = TimeAxis(max(float(session.time_s[-1]), LEAST_SHOWN_S))
    draw_steps(axis, time(session.time_s), session.charging_power_w / W_PER_KW, **LOOKS[0].line())
    axis.set_ylabel('charging power [kW]')
    time.finish(axis, 0.0, max(float(session.time_s[-1]), LEAST_SHOWN_S), 'time at the charger')


def make_session_figure(vehicle: Vehicle, stop: ChargingStop, sessions: Mapping[str, Session],
                        title: str) -> Figure:
    """Return the figure of one or two Sessions by name; the heater power is dotted."""
    ended_s = [session.charging_time_s for session in sessions.values() if not session.problem]
    lasts_s = [float(session.time_s[-1]) for session in sessions.values()]
    shown_s = max(LEAST_SHOWN_S, min(max(lasts_s), MOST_SHOWN_S if not ended_s else (
        max(ended_s) if len(ended_s) == len(sessions) else SHOWN_BEYOND * max(ended_s))))
    time = TimeAxis(shown_s)
    figure, (power, temperature, soc) = stacked_figure(3, title, panel_height_in=2.2)
    powers_kw, temperatures_c = [np.array([0.0])], []
    for (name, session), look in zip(sessions.items(), LOOKS):
        edges, label = time(session.time_s), f'{name}, not charged to the end' if session.problem else name
        style = look.line(label=label)
        if len(edges) == 1:
            # A session that never begins is a mark.
            style.update(marker=look.marker, clip_on=False)
        else:
            charging_kw = session.charging_power_w / W_PER_KW
            draw_course(power, np.concatenate((edges[:1], 0.5 * (edges[1:] + edges[:-1]), edges[-1:])),
                        np.concatenate((charging_kw[:1], charging_kw, charging_kw[-1:])), **style)
            if session.hvch_battery_power_w.any():
                draw_steps(power, edges, session.hvch_battery_power_w / W_PER_KW, **look.line(
                    linestyle=HEATER_DASHES, linewidth=1.6, label=f'heater, {name}'))
            powers_kw.append(charging_kw[session.time_s[:-1] < shown_s])
        draw_course(temperature, edges, session.battery_temperature_c, **style)
        draw_course(soc, edges, 100.0 * session.soc, **style)
        temperatures_c.append(session.battery_temperature_c[session.time_s <= shown_s])
    charging = charging_of(vehicle)
    levels = [temperature.axhline(stop.ambient_c, **palette.AMBIENT)]
    if charging.battery_heating and charging.heating_limit_c is not None:
        levels.append(temperature.axhline(charging.heating_limit_c, **palette.TARGET, label=(
            f"limit of the car's heating, {charging.heating_limit_c:g} °C")))
    soc.axhline(100.0 * stop.departure_soc, **palette.TARGET, label='departure')
    finish_panel(power, 'charging power\n[kW]', *powers_kw, least=10.0)
    finish_panel(temperature, 'battery temperature\n[°C]', *temperatures_c, least=10.0, levels=levels)
    finish_panel(soc, 'state of charge\n[%]', *(100.0 * session.soc for session in sessions.values()),
                 [100.0 * stop.departure_soc], least=10.0)
    time.finish(soc, 0.0, shown_s, 'time at the charger')
    figure.align_ylabels()
    return figure


MARK_POINTS = 9.0
PARTS = (('energy', 'energy_cost', BLUE), ('charging time', 'charging_cost', ORANGE),
         ('detour', 'detour_cost', GREEN), ('expected wait', 'wait_cost', GRAY), ('ageing', 'ageing_cost', PURPLE))


def make_worth_figure(worth: Worth, title: str) -> Figure:
    """Return the figure of a Worth; targets whose session never ends are omitted."""
    figure, ((cost, minutes),) = grid_figure(1, 2, title, height_in=4.8)
    draw_costs(cost, worth)
    _draw(minutes, worth, lambda target: (
        target.bought_energy_wh / 1000.0, target.charging_time_s / 60.0))
    minutes.set(xlabel='energy bought [kWh]', ylabel='time at the charger [min]')
    legend_above(cost, columns=3)
    return figure


def draw_costs(axis: Axes, worth: Worth) -> None:
    """Draw the cost over the target on an axis of any figure."""
    _draw(axis, worth, lambda target: (target.target_c, target.cost))
    axis.set(xlabel='target [°C]', ylabel='cost at the charger')


def _draw(axis: Axes, worth: Worth, place: Place) -> None:
    """Draw the curve of all targets, and mark no heating, the fixed target and the best one."""
    points = np.array([place(target) for target in worth.targets])
    finite = points[np.isfinite(points).all(axis=1)]
    axis.plot(finite[:, 0], finite[:, 1], color=GRAY, linewidth=1.6)
    look = look_of(WITHOUT_PREHEATING)
    for target, name, colour, marker, size in (
            (worth.without_heating, 'no heating', look.colour, look.marker, 1.2 * MARK_POINTS),
            (worth.fixed, f'fixed, {worth.fixed.target_c:g} °C', ORANGE, 's', MARK_POINTS),
            (worth.best, 'best' if worth.best is worth.without_heating else
             f'best, {worth.best.target_c:.1f} °C', BLUE, 'o', 0.7 * MARK_POINTS)):
        at = place(target)
        if np.isfinite(at).all():
            axis.plot(*at, linestyle='', marker=marker, color=colour, markersize=size,
                      markeredgecolor=BLACK, markeredgewidth=0.6, label=name)
    show_range(axis, finite[:, 1], least=1e-3)


def make_chargers_figure(ranked: Sequence[CandidateWorth], title: str) -> Figure:
    """Return the figure of ranked chargers, the cheapest on top; one with a problem shows its name only."""
    figure, ((axis,),) = grid_figure(1, 1, title, height_in=1.8 + 0.5 * len(ranked))
    places = np.arange(len(ranked))
    left = np.zeros(len(ranked))
    for label, name, colour in PARTS if any(item.ageing_cost for item in ranked) else PARTS[:-1]:
        widths = np.array([0.0 if item.problem is not None else getattr(item, name) for item in ranked])
        axis.barh(places, widths, left=left, height=0.6, color=colour, label=label)
        left += widths
    for place, item, end in zip(places, ranked, left):
        text = f' {item.total_cost:.2f}' if item.problem is None else ' not compared'
        axis.annotate(text, (end, place), va='center')
    axis.set_yticks(places, [literal(item.candidate.name) for item in ranked])
    axis.set_axisbelow(True)
    axis.invert_yaxis()
    axis.set_xlim(0.0, max(1.12 * float(left.max(initial=0.0)), 1e-3))
    axis.set(xlabel='cost')
    legend_above(axis, columns=4)
    return figure
