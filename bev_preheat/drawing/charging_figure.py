# SPDX-License-Identifier: Apache-2.0
"""Charging sessions side by side: power, battery temperature and state of charge over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing.figure import (
    draw_course,
    draw_steps,
    legend_above,
    show_range,
    stacked_figure,
    TimeAxis,
)
from bev_preheat.drawing.palette import AMBIENT, look_of, TARGET, WITHOUT_PREHEATING
from bev_preheat.numerics import W_PER_KW
from bev_preheat.vehicle.charging import charging_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.charging.session import Session
    from bev_preheat.charging.stop import ChargingStop
    from bev_preheat.vehicle import Vehicle

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
    temperature.axhline(stop.ambient_c, **AMBIENT)
    bounds = [stop.ambient_c]
    if charging.battery_heating and charging.heating_limit_c is not None:
        temperature.axhline(charging.heating_limit_c, **TARGET, label='heated up to')
        bounds.append(charging.heating_limit_c)
    soc.axhline(100.0 * stop.departure_soc, **TARGET, label='departure')
    show_range(power, *powers_kw, least=10.0)
    show_range(temperature, *temperatures_c, least=10.0, bounds=bounds)
    show_range(soc, *(100.0 * session.soc for session in sessions.values()),
               [100.0 * stop.departure_soc], least=10.0)
    power.set_ylabel('charging power\n[kW]')
    temperature.set_ylabel('battery temperature\n[°C]')
    soc.set_ylabel('state of charge\n[%]')
    for axis in (power, temperature, soc):
        legend_above(axis)
    time.finish(soc, 0.0, shown_s, 'time at the charger')
    figure.align_ylabels()
    return figure
