# SPDX-License-Identifier: Apache-2.0
"""
The value of a kelvin by time and temperature, as a picture.

The table of values behind a plan of method `value_function`, and the plan's path through it.
"""

from __future__ import annotations

from argparse import Namespace

from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
import numpy as np

from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.program import FAILED, say
from bev_preheat.commands.situation import add_situation_arguments, read_situation
from bev_preheat.drawing.figure import (
    draw_course,
    draw_steps,
    grid_figure,
    legend_above,
    save_figure,
    show_range,
    TimeAxis,
)
from bev_preheat.drawing.palette import look_of, name_of, POWER, TARGET, WITHOUT_PREHEATING
from bev_preheat.files.output_files import check_outputs, OutputFile, PICTURE_SUFFIXES
from bev_preheat.numerics import FloatArray, W_PER_KW
from bev_preheat.planning.engine import limits_of_steps_w
from bev_preheat.planning.heat_run import initial_states
from bev_preheat.planning.methods import Requirements
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.recursion import Recursion, ValueTable
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc, Uncertainty
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.tunables import LACK_PRICE, LEAST_HEATING_W

# Range of the colours: a kelvin worth nothing, its cost, and twice its cost or more.
LEAST_RATIO, EVEN_RATIO, MOST_RATIO = 0.0, 1.0, 2.0
COLOURS = 'RdBu_r'
MAP_ALPHA = 0.6
# Panels: temperature, heater, power of the drive.
HEIGHT_IN, HEIGHTS = 8.0, (3.6, 1.0, 1.0)
ROOM_K = 4.0


def add_parser(subparsers: Subparsers) -> None:
    """Add the picture."""
    parser = subparsers.add_parser('value_picture', help='the value of a kelvin by time and temperature',
                                   description=__doc__)
    add_situation_arguments(parser)
    parser.add_argument('--plot', metavar='FILE', required=True, help='picture: .png, .pdf or .svg')
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Make the picture; returns the exit status."""
    situation = read_situation(arguments)
    check_outputs([OutputFile('--plot', arguments.plot, PICTURE_SUFFIXES)], situation.files)
    inputs = situation.vehicle, situation.route, situation.state, situation.goal
    trip = make_trip(situation.vehicle, situation.route)
    table = value_table(trip, situation.state, situation.goal)
    if table is None:
        say('value_picture: the charge does not carry the trip, so there is no value of heat')
        return FAILED
    plan = plan_preheating(*inputs)
    title = f'vehicle {situation.vehicle.name}, route {arguments.route}\n{plan.status.name}: {plan.explanation}'
    save_figure(make_value_figure(trip, table, plan, plan_unheated(*inputs), title), arguments.plot)
    return 0


def value_table(trip: Trip, state: BatteryState, goal: Goal) -> ValueTable | None:
    """Return the ValueTable with the charge of the plan, heater off before; None: the charge does not last."""
    certain = Uncertainty(0.0, int(state.heater_power_w > LEAST_HEATING_W))
    recursion = Recursion(trip, initial_states(state), Requirements(
        goal.target_temperature_c, reserve_soc(trip.vehicle, goal), certain), LACK_PRICE)
    return None if recursion.plan() is None else recursion.table()


def make_value_figure(trip: Trip, table: ValueTable, plan: Plan, unheated: Plan, title: str) -> Figure:
    """Return the figure of a ValueTable, the value of a kelvin over its cost, with the plan and without heat."""
    time = TimeAxis(plan.arrival_time_s)
    edges = time(plan.time_s)
    figure, axes = grid_figure(3, 1, title, HEIGHT_IN, sharex=True, height_ratios=HEIGHTS)
    temperature, heater, power = axes[:, 0]
    ratio = worth_over_cost(table)
    # The value at the end of a step decides on the step.
    mesh = temperature.pcolormesh(
        edges, table.temperature_c, ratio[1:].T, cmap=COLOURS, alpha=MAP_ALPHA, rasterized=True,
        norm=TwoSlopeNorm(EVEN_RATIO, LEAST_RATIO, MOST_RATIO))
    figure.colorbar(mesh, ax=temperature, pad=0.01, extend='max',
                    label='value of a kelvin / its cost')
    lines = [draw_course(temperature, edges, made.battery_temperature_c, **look_of(name).line(
        label=name if name == WITHOUT_PREHEATING else name_of(name)))
        for name, made in ((plan.method, plan), (WITHOUT_PREHEATING, unheated))]
    lines.append(temperature.axhline(plan.target_temperature_c, **TARGET, label='target'))
    shown_c = (*plan.battery_temperature_c, *unheated.battery_temperature_c, plan.target_temperature_c)
    temperature.set_ylim(max(min(shown_c) - ROOM_K, table.temperature_c[0]),
                         min(max(shown_c) + ROOM_K, table.temperature_c[-1]))
    temperature.set_ylabel('battery temperature [°C]')
    legend_above(temperature, lines)
    draw_steps(heater, edges, plan.hvch_battery_power_w / W_PER_KW, **look_of(plan.method).line(linewidth=1.7))
    show_range(heater, [0.0], plan.hvch_battery_power_w / W_PER_KW, least=1.0)
    heater.set_ylabel('heater for\nbattery [kW]')
    idle_kw = trip.idle_power_w / W_PER_KW
    draw_steps(power, edges, idle_kw, color=POWER, linewidth=1.5, label='without heating the battery')
    show_range(power, [0.0], idle_kw, least=10.0)
    for name, made in ((plan.method, plan), (WITHOUT_PREHEATING, unheated)):
        limit_w, _ = limits_of_steps_w(trip.vehicle, made.soc, made.battery_temperature_c, trip.power_variance_w2)
        draw_steps(power, edges, np.where(idle_kw < 0.0, limit_w / W_PER_KW, np.nan), **look_of(name).line(
            linewidth=1.5, label='charge limit, plan' if made is plan else 'charge limit, unheated'))
    power.set_ylabel('terminal\npower [kW]')
    legend_above(power)
    time.finish(power, 0.0, plan.arrival_time_s)
    return figure


def worth_over_cost(table: ValueTable) -> FloatArray:
    """Return by how much a kelvin lowers the cost of the rest of the trip, over the heater's energy for it."""
    slope: FloatArray = -np.diff(table.values_j, axis=1) / np.diff(table.temperature_c) / table.joules_per_k
    return slope
