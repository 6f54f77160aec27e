# SPDX-License-Identifier: Apache-2.0
"""A trip with stops over time: the plans of its legs in sequence, the stops shaded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.drawing.curves import draw_course, draw_steps, show_range, TimeAxis
from bev_preheat.drawing.figure import legend_above, save_figure, stacked_figure
from bev_preheat.drawing.palette import (
    AMBIENT,
    BLACK,
    HEATER_LIMIT,
    look_of,
    RESERVE,
    ROUTE,
    STOP,
    WITHOUT_PREHEATING,
)
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.trip import make_trip

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bev_preheat.control.inputs import Leg
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.planning.plan import Plan
    from bev_preheat.vehicle import Vehicle

# With more legs than this, arrivals are not listed one by one.
MOST_TOLD_LEGS = 6


def draw_itinerary(path: AnyPath, vehicle: Vehicle, legs: Sequence[Leg], plans: Sequence[Plan],
                   title: str) -> None:
    """Draw the Plans for the Legs of a trip into a file; its suffix gives the format."""
    save_figure(make_itinerary_figure(vehicle, legs, plans, title), path)


def make_itinerary_figure(vehicle: Vehicle, legs: Sequence[Leg], plans: Sequence[Plan],
                          title: str) -> Figure:
    """
    Return the figure of the Plans for the Legs of a trip, and of the same legs without preheating.

    During a stop, the line from arrival to the given departure is dotted.
    """
    unheated = [_plan_unheated(vehicle, leg, plan) for leg, plan in zip(legs, plans)]
    told = [_on_arrival(number, leg, *both) for number, (leg, *both) in enumerate(
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
                edges[-1], plan.target_temperature_c, '_', color=BLACK, markersize=14,
                label='target' if leg is next(item for item in legs if item.charging_planned)
                else None)
        draw_steps(temperature, edges, trip.route.ambient_temperature_c,
                   **{**AMBIENT, **named(AMBIENT['label'])})
        draw_steps(heater, edges, plan.hvch_battery_power_w / 1e3,
                   **heated.line(linewidth=1.7, **named('for the battery')))
        draw_steps(heater, edges, trip.heater_limit_w / 1e3,
                   **{**HEATER_LIMIT, **named(HEATER_LIMIT['label'])})
        draw_course(charge, edges[[0, -1]],
                    [100.0 * reserve_soc(vehicle, leg.goal(plan.target_temperature_c))] * 2,
                    color=RESERVE, linestyle='--', linewidth=0.9, **named('reserve'))
        draw_steps(drive, edges, trip.route.speed_mps * 3.6, color=ROUTE)
    _draw_stops(axes, time, starts_s, plans, heated.colour)
    for axis, least, shown in ((temperature, 5.0, []), (heater, 1.0, [0.0]), (charge, 5.0, []),
                               (drive, 20.0, [0.0])):
        show_range(axis, shown, *(line.get_ydata() for line in axis.get_lines()), least=least)
        legend_above(axis)
    for axis, label in zip(axes, ('temperature\n[°C]', 'HVCH for\nbattery [kW]',
                                  'state of\ncharge [%]', 'speed\n[km/h]')):
        axis.set_ylabel(label)
    time.finish(drive, starts_s[0], starts_s[-1] + plans[-1].arrival_time_s)
    figure.align_ylabels()
    return figure


def _on_arrival(number: int, leg: Leg, plan: Plan, unheated: Plan) -> str:
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
            axis.axvspan(*stop, color=STOP, alpha=0.2, linewidth=0.0,
                         label='stop' if axis is axes[0] and number == 0 else None)
        for axis, before, after in (
                (axes[0], plan.arrival_temperature_c, following.battery_temperature_c[0]),
                (axes[2], 100.0 * plan.arrival_soc, 100.0 * following.soc[0])):
            axis.plot(stop, (before, after), ':', color=colour, linewidth=1.0)
