# SPDX-License-Identifier: Apache-2.0
"""Plans over time: the panels of the paper's Figure 6, charge and power limits; legs of a trip with stops."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.drawing import palette
from bev_preheat.drawing.figure import (
    draw_course,
    draw_steps,
    drawn,
    finish_panel,
    legend_above,
    shade_steps,
    show_levels,
    show_range,
    stacked_figure,
    TimeAxis,
)
from bev_preheat.drawing.palette import Look, look_of, name_of, Style, WITHOUT_PREHEATING
from bev_preheat.numerics import ARRAYS, FloatArray, NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.plan import accounts_of, driven_share, Plan
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import Goal, reserve_soc
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.tunables import LEAST_SOURCE_W

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from bev_preheat.control.inputs import Leg
    from bev_preheat.planning.dynamics import Accounts
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

# Actual heater power and heat in the vehicle's heat path.
LATER = {'linestyle': (0, (1.0, 1.0)), 'linewidth': 1.6, 'zorder': 4.0}
# Curves closer than this coincide in a picture [K].
SAME_COURSE_K = 0.15
# With more legs than this, arrivals are not listed one by one.
MOST_TOLD_LEGS = 6


def make_plan_figure(vehicle: Vehicle, route: Route, goal: Goal, plans: Sequence[Plan],
                     title: str, every_panel: bool = False) -> Figure:
    """
    Return the figure of plans for one route, and of the same trip without preheating.

    The battery's power limits are those along the first plan. Several plans are compared in four panels;
    one plan, or `every_panel`, adds heat, leakage and speed.
    """
    first = plans[0]
    if len(plans) == 1:
        title = f'{title}\n{first.status.name}: {first.explanation}'
    unheated = plan_unheated(vehicle, route, first.start_state, goal)
    trip = make_trip(vehicle, route)
    time = TimeAxis(first.arrival_time_s)
    edges = time(trip.time_s)
    every_panel = every_panel or len(plans) == 1
    figure, axes = (stacked_figure(7, title, panel_height_in=1.6) if every_panel else
                    stacked_figure(4, title, panel_height_in=2.2))
    temperature, heater, charge, power = axes[:4]

    lines = []
    courses = [(plan.method, plan) for plan in plans]
    if any(plan.heating_start_s is not None or plan.cooling_start_s is not None for plan in plans):
        courses.append((WITHOUT_PREHEATING, unheated))
    for number, (method, plan) in enumerate(courses):
        look = look_of(method) if len(plans) > 1 else replace(look_of(method), width=1.7)
        lines.append(draw_course(
            temperature, edges, plan.battery_temperature_c,
            **look.line(label=_on_arrival(method, plan, plans[:number]))))
        draw_course(charge, edges, 100.0 * plan.soc, **look.line())
        if plan is unheated:
            continue
        accounts = accounts_of(trip, plan)
        _draw_heater(heater, edges, plan, look.line(), is_divided=len(plans) == 1)
        if plan.heat is not None and not plan.source_power_w:
            later = {**look.line(), **LATER}
            draw_steps(heater, edges, plan.heat.drawn_power_w / 1e3,
                       **later, label='drawn by the lagging heater' if plan is first else None)
        draw_steps(power, edges, accounts.battery_power_w / 1e3, **look.line())
        if every_panel:
            _draw_heat(axes[4], axes[5], edges, plan, accounts, look, labelled=plan is first)
    _draw_temperatures(temperature, edges, trip, goal, plans, lines)

    draw_steps(heater, edges, trip.drawing_limit_w / 1e3, **palette.HEATER_LIMIT)
    show_range(heater, [0.0], *drawn(heater), least=1.0)
    heater.set_ylabel(_power_label(vehicle))

    _draw_reserve(charge, 100.0 * reserve_soc(vehicle, goal))
    charge.set_ylabel('state of\ncharge [%]')

    _draw_limits(power, edges, trip, first)
    power.set_ylabel('battery\npower [kW]')

    if every_panel:
        _draw_drive(axes[4:], edges, trip, first)
    time.finish(axes[-1], 0.0, first.arrival_time_s)

    if first.stranding is not None:
        for axis in axes:
            axis.axvline(float(time(first.stranding.at_s)), color=palette.RESERVE, linestyle='-.', linewidth=1.0,
                         label='battery empty' if axis is charge else None)
    for axis in axes[1:]:
        legend_above(axis)
    figure.align_ylabels()
    return figure


def draw_battery_temperatures(axis: Axes, plans: Sequence[Plan], goal: Goal) -> None:
    """Draw the battery's temperature along plans for one route, and the target, on an axis of any figure."""
    time = TimeAxis(plans[0].arrival_time_s)
    for plan in plans:
        draw_course(axis, time(plan.time_s), plan.battery_temperature_c,
                    **look_of(plan.method).line(label=name_of(plan.method)))
    if goal.charging_planned:
        axis.axhline(goal.target_temperature_c, **palette.TARGET, label='target')
    axis.set_ylabel('battery temperature [°C]')
    axis.legend(fontsize='small')
    time.finish(axis, 0.0, plans[0].arrival_time_s)


def _on_arrival(method: str, plan: Plan, earlier: Iterable[Plan]) -> str:
    """Describe the arrival, and name the earlier plan with the same course."""
    name = name_of(method)
    if plan.cooling_start_s is not None:
        name += ', cools'
    elif plan.heating_start_s is None and method != WITHOUT_PREHEATING:
        name += ', does not heat'
    if plan.stranding is not None:
        return f'{name}: battery empty after {duration_text(plan.stranding.at_s)}'
    hidden = next((other.method.partition(',')[0] for other in earlier if np.abs(
        other.battery_temperature_c - plan.battery_temperature_c).max() < SAME_COURSE_K), None)
    return (f'{name}: {plan.arrival_temperature_c:.1f} °C, {100.0 * plan.arrival_soc:.1f} %, '
            f'{plan.energy_wh.battery_total / 1e3:.3f} kWh'
            + (f' (≈ {hidden})' if hidden else ''))


def _power_label(vehicle: Vehicle) -> str:
    return 'power of heat\nsources [kW]' if vehicle.heat_sources else 'heater power for\nbattery [kW]'


def _draw_heater(axis: Axes, edges: FloatArray, plan: Plan, line: Style, is_divided: bool) -> None:
    """Draw the power of a plan's heat sources and, if it is divided, that of each on top of the one before."""
    power_kw = plan.hvch_battery_power_w / 1e3
    for number, (name, power_w) in enumerate(plan.source_power_w.items()):
        below_kw = power_kw if number else 0.0
        power_kw = below_kw + power_w / 1e3
        if is_divided and power_w.max() >= LEAST_SOURCE_W:
            colour = palette.HEAT_SOURCES[number % len(palette.HEAT_SOURCES)]
            shade_steps(axis, edges, below_kw, power_kw, color=colour, alpha=0.6, label=name)
    draw_steps(axis, edges, power_kw, **line)


def _draw_heat(heat: Axes, leakage: Axes, edges: FloatArray, plan: Plan, accounts: Accounts, look: Look,
               labelled: bool) -> None:
    """Draw the heat of a plan's heater and of the battery itself, and its leakage."""
    if plan.heat is not None:
        draw_steps(heat, edges, plan.heat.arriving_heat_w / 1e3,
                   **{**look.line(), **LATER},
                   label=None if not labelled else 'heat sources' if plan.source_power_w else 'heater')
    draw_steps(heat, edges, accounts.joule_heat_w / 1e3,
               **look.line(label='Joule heat' if labelled else None))
    draw_steps(leakage, edges, accounts.leakage_w / 1e3, **look.line())


def _draw_drive(axes: Sequence[Axes], edges: FloatArray, trip: Trip, plan: Plan) -> None:
    """Draw the heat of the drivetrain and the speed, and finish the panels of heat."""
    heat, leakage, drive = axes
    driven = driven_share(trip, plan)
    draw_steps(heat, edges, (driven * trip.drivetrain_heat_w - trip.vehicle.drivetrain.heat_share
                             * plan.friction_brake_power_w) / 1e3, **palette.DRIVETRAIN)
    show_range(heat, [0.0], *drawn(heat), least=0.5)
    heat.set_ylabel('heat into\nbattery [kW]')
    show_range(leakage, [0.0], *drawn(leakage), least=0.2)
    leakage.set_ylabel('heat from\nambient [kW]')
    draw_steps(drive, edges, driven * trip.route.speed_mps * 3.6, color=palette.ROUTE)
    show_range(drive, [0.0], *drawn(drive), least=20.0)
    drive.set_ylabel('speed\n[km/h]')


def _draw_temperatures(axis: Axes, edges: FloatArray, trip: Trip, goal: Goal,
                       plans: Sequence[Plan], courses: Sequence[Line2D]) -> None:
    """Draw target and ambient around the curves, with legends side by side."""
    others = []
    if goal.charging_planned:
        target_c, most_c, range_c = goal.target_temperature_c, goal.maximum_arrival_temperature_c, ''
        if math.isfinite(most_c):
            axis.axhline(most_c, **palette.TARGET)
            range_c = f' … {most_c:.1f}'
        others.append(axis.axhline(target_c, **palette.TARGET, label=f'target {target_c:.1f}{range_c} °C'))
    others.append(draw_steps(axis, edges, trip.route.ambient_temperature_c, **palette.AMBIENT))
    show_range(axis, *drawn(axis), least=5.0)
    axis.set_ylabel('temperature\n[°C]')
    legend_above(axis, courses, 'battery on arrival: temperature, state of charge, energy taken from it',
                 columns=1)
    legend_above(axis, others, side='right')


def _draw_reserve(axis: Axes, reserve_percent: float) -> None:
    """Draw the reserve, or state that it is below the panel."""
    show_levels(axis, *drawn(axis), least=5.0, levels=[axis.axhline(
        reserve_percent, color=palette.RESERVE, linewidth=0.9, linestyle='--',
        label=f'reserve {reserve_percent:.0f} %')])


def _draw_limits(axis: Axes, edges: FloatArray, trip: Trip, plan: Plan) -> None:
    """Draw the battery's power limits along a plan; if they are far off, state by how much."""
    battery = trip.vehicle.battery
    states = plan.soc[:-1], plan.battery_temperature_c[:-1]
    limits = [('charge limit', palette.CHARGE_LIMIT, 'below', battery.charge_power_limit),
              ('discharge limit', palette.DISCHARGE_LIMIT, 'above', battery.discharge_power_limit)]
    values_kw = [limit.function(ARRAYS)(*states) / 1e3 for *_, limit in limits]
    shown = show_range(axis, [0.0], *drawn(axis), least=10.0, bounds=values_kw)
    panel = axis.get_ylim()
    axis.axhline(0.0, color='black', linewidth=0.6)
    for (label, colour, side, _), limit_kw, is_shown in zip(limits, values_kw, shown):
        label += (' (shaded: not allowed)' if is_shown else
                  f', {" to ".join(dict.fromkeys(f"{end:.0f}" for end in (limit_kw.min(), limit_kw.max())))} kW '
                  f'({side} this range)')
        draw_steps(axis, edges, limit_kw, color=colour, linewidth=1.3, label=label)
        far_kw = panel[0] if side == 'below' else panel[1]
        beyond_kw = np.minimum(limit_kw, far_kw) if side == 'below' else np.maximum(limit_kw, far_kw)
        shade_steps(axis, edges, limit_kw, beyond_kw, color=colour, alpha=0.2)
    axis.set_ylim(panel)


def make_itinerary_figure(vehicle: Vehicle, legs: Sequence[Leg], plans: Sequence[Plan],
                          title: str) -> Figure:
    """Return the figure of the Plans for the Legs of a trip (stops dotted), and without preheating."""
    unheated = [_plan_unheated(vehicle, leg, plan) for leg, plan in zip(legs, plans)]
    told = [_leg_arrival(number, leg, *both) for number, (leg, *both) in enumerate(
        zip(legs, plans, unheated), start=1)]
    if len(told) > MOST_TOLD_LEGS:
        told[MOST_TOLD_LEGS:] = ['…']
    figure, axes = stacked_figure(4, '\n'.join([title, *told]))
    temperature, heater, charge, drive = axes
    starts_s = [leg.start_ns / NS_PER_S for leg in legs]
    time = TimeAxis(starts_s[-1] + plans[-1].arrival_time_s - starts_s[0])
    heated, idle = look_of(plans[0].method), look_of(WITHOUT_PREHEATING)
    for number, (leg, plan, alone, start_s) in enumerate(zip(legs, plans, unheated, starts_s)):
        def named(label: str, is_first: bool = number == 0) -> dict[str, str | None]:
            # In the legend only once, for the first leg.
            return {'label': label if is_first else None}

        trip = make_trip(vehicle, leg.route)
        edges = time(start_s + trip.time_s)
        draw_course(temperature, edges, plan.battery_temperature_c,
                    **heated.line(linewidth=1.7, **named('battery')))
        draw_course(charge, edges, 100.0 * plan.soc,
                    **heated.line(linewidth=1.7, **named('state of charge')))
        for axis, values in ((temperature, alone.battery_temperature_c), (charge, 100.0 * alone.soc)):
            draw_course(axis, edges, values, **idle.line(**named(WITHOUT_PREHEATING)))
        if leg.charging_planned:
            temperature.plot(
                edges[-1], plan.target_temperature_c, '_', color=palette.BLACK, markersize=14,
                label='target' if leg is next(item for item in legs if item.charging_planned)
                else None)
        draw_steps(temperature, edges, trip.route.ambient_temperature_c,
                   **{**palette.AMBIENT, **named(palette.AMBIENT['label'])})
        _draw_heater(heater, edges, plan, heated.line(linewidth=1.7, **named('for the battery')), number == 0)
        draw_steps(heater, edges, trip.drawing_limit_w / 1e3,
                   **{**palette.HEATER_LIMIT, **named(palette.HEATER_LIMIT['label'])})
        draw_course(charge, edges[[0, -1]],
                    [100.0 * reserve_soc(vehicle, leg.goal(plan.target_temperature_c))] * 2,
                    color=palette.RESERVE, linestyle='--', linewidth=0.9, **named('reserve'))
        draw_steps(drive, edges, trip.route.speed_mps * 3.6, color=palette.ROUTE)
    _draw_stops(axes, time, starts_s, plans, heated.colour)
    for axis, label, least, shown in (
            (temperature, 'temperature\n[°C]', 5.0, []), (heater, _power_label(vehicle), 1.0, [0.0]),
            (charge, 'state of\ncharge [%]', 5.0, []), (drive, 'speed\n[km/h]', 20.0, [0.0])):
        finish_panel(axis, label, shown, *drawn(axis), least=least)
    time.finish(drive, starts_s[0], starts_s[-1] + plans[-1].arrival_time_s)
    figure.align_ylabels()
    return figure


def _leg_arrival(number: int, leg: Leg, plan: Plan, unheated: Plan) -> str:
    """Return a line on the arrival of a leg."""
    target = f'target {plan.target_temperature_c:.1f} °C, ' if leg.charging_planned else ''
    return (f'leg {number}: {plan.status.name}, {target}arrival at '
            f'{plan.arrival_temperature_c:.1f} °C'
            + (f', without preheating at {unheated.arrival_temperature_c:.1f} °C'
               if plan.heating_start_s is not None else ''))


def _plan_unheated(vehicle: Vehicle, leg: Leg, plan: Plan) -> Plan:
    """Return the unheated Plan of a Leg that begins at a known state."""
    assert leg.departure is not None
    return plan_unheated(vehicle, leg.route, leg.departure, leg.goal(plan.target_temperature_c))


def _draw_stops(axes: Sequence[Axes], time: TimeAxis, starts_s: Sequence[float],
                plans: Sequence[Plan], colour: str) -> None:
    """Shade the stops, and connect the curves across each stop."""
    for number, (start_s, plan, next_start_s, following) in enumerate(
            zip(starts_s, plans, starts_s[1:], plans[1:])):
        stop = time([start_s + plan.arrival_time_s, next_start_s])
        for axis in axes:
            axis.axvspan(*stop, color=palette.STOP, alpha=0.2, linewidth=0.0,
                         label='stop' if axis is axes[0] and number == 0 else None)
        for axis, before, after in (
                (axes[0], plan.arrival_temperature_c, following.battery_temperature_c[0]),
                (axes[2], 100.0 * plan.arrival_soc, 100.0 * following.soc[0])):
            axis.plot(stop, (before, after), ':', color=colour, linewidth=1.0)
