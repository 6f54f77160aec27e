# SPDX-License-Identifier: Apache-2.0
"""
A winter fleet at fast chargers: the minutes that preheating saves there, and the energy that it takes.

Drives random winter trips: not heated, heated from the start by a thermostat, by the rules of makers, by a plan to
the car's usual target, and to the target that the planner chooses. After each the battery is charged to 80 %.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
import math
from typing import Any

import numpy as np
from rich.console import Console

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.target_worth import ENERGY_PRICE_PER_KWH, Prices, VALUE_OF_TIME_PER_H
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_figures, print_records
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import JOULES_PER_WH, S_PER_MIN, WH_PER_KWH
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat_studies.fleet.winter_trips import (
    ALWAYS,
    AMBIENTS,
    BEST,
    CARS,
    draw_winter_trip,
    LENGTHS,
    NONE,
    USUAL,
    WAYS,
    WinterTrip,
)
from bev_preheat_studies.study import add_study, check_study_arguments, distribution, Study, text_of

# Plain values, as in JSON.
Figures = dict[str, Any]

PRICES = Prices(ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H)
# An arrival this much below the car's usual target is too cold [K].
TOO_COLD_K = 2.0
PERCENTILES = {'5 %': 5.0, 'median': 50.0, '95 %': 95.0}
# Rows of the table: heading, value from a way's figures, format.
ROWS: tuple[tuple[str, Callable[[Figures], float], str], ...] = (
    ('Heater before arrival [kWh]', lambda figures: figures['heater_kwh'], '.2f'),
    ('Battery on arrival [degC]', lambda figures: figures['arrival_c'], '.1f'),
    (f'… {TOO_COLD_K:g} K below the usual target [%]', lambda figures: 100.0 * figures['too_cold'], '.0f'),
    ('At the charger [min]', lambda figures: figures['charging_min'], '.1f'),
    ('… saved, mean', lambda figures: figures['saved_min']['mean'], '+.1f'),
    ('… 5 %', lambda figures: figures['saved_min']['5 %'], '+.1f'),
    ('… median', lambda figures: figures['saved_min']['median'], '+.1f'),
    ('… 95 %', lambda figures: figures['saved_min']['95 %'], '+.1f'),
    ('Energy bought, more, mean [kWh]', lambda figures: figures['more_kwh']['mean'], '+.2f'),
    ('… 95 %', lambda figures: figures['more_kwh']['95 %'], '+.2f'),
    ('Cost, more, mean', lambda figures: figures['more_cost'], '+.2f'))


@dataclass(frozen=True)
class Stop:
    """One way to heat a trip: energy before arrival, arrival and how far below the usual target, and session."""

    heater_wh: float
    arrival_c: float
    below_k: float
    charging_s: float
    bought_wh: float

    @property
    def cost(self) -> float:
        """Cost of the stop."""
        return PRICES.cost(self.bought_wh, self.charging_s)


@dataclass(frozen=True)
class FleetResult:
    """One trip; `ways` is empty if the car cannot drive it or never gets charged, and `left_out` says why."""

    number: int
    car: str
    ambient_c: float
    length_min: float
    ways: dict[str, Stop]
    left_out: str = ''


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    add_study(subparsers, 'fleet', run, __doc__, 'what preheating saves a winter fleet at the charger', most=1000,
              plots=True)


def run(arguments: Namespace) -> int:
    """Run the study; returns 0."""
    check_study_arguments(arguments)

    def show(console: Console, results: list[FleetResult]) -> dict[str, Any]:
        summary = summarise_fleet(results)
        if arguments.plot and summary['groups']:
            from bev_preheat.drawing.figure import save_figure
            from bev_preheat_studies.fleet.figure import make_fleet_figure
            save_figure(make_fleet_figure(summary), arguments.plot)
        print_fleet(console, summary)
        return {'summary': summary}

    return Study(partial(drive_trip, arguments.seed), FleetResult, arguments.trips,
                 {'study': 'fleet', 'seed': arguments.seed}).conduct(arguments, show)


def drive_trip(seed: int, number: int) -> FleetResult:
    """Return the FleetResult of one drawn trip."""
    trip = draw_winter_trip(seed, number)
    head = number, trip.car, trip.ambient_c, trip.route.total_duration_s / S_PER_MIN
    try:
        worth = find_worth(trip.vehicle, trip.route, trip.state, trip.goal, trip.stop.charger_power_w,
                           trip.stop.departure_soc, PRICES, with_rules=True)
        usual_c = trip.goal.target_temperature_c
        ways = {name: Stop(found.hvch_electric_wh, found.arrival_temperature_c,
                           usual_c - found.arrival_temperature_c, found.charging_time_s, found.bought_energy_wh)
                for name, found in {NONE: worth.without_heating, USUAL: worth.fixed, BEST: worth.best,
                                    **worth.by_rule}.items()}
        ways[ALWAYS] = _always_on(trip)
    except InvalidInput as error:
        return FleetResult(*head, {}, str(error))
    if not all(math.isfinite(stop.charging_s) for stop in ways.values()):
        return FleetResult(*head, {}, 'never charged')
    return FleetResult(*head, {way: ways[way] for way in WAYS})


def _always_on(trip: WinterTrip) -> Stop:
    """Return the Stop of a car that heats from the start and then holds its target: a thermostat."""
    driven = make_trip(trip.vehicle, trip.route)
    schedule = drive_as_planned(
        driven, trip.state, driven.heater_limit_w, below_c=trip.goal.target_temperature_c)
    arrival = BatteryState(float(schedule.temperature_c[-1]), float(max(schedule.soc[-1], 0.0)))
    session = ChargerHeating(trip.vehicle, trip.stop, PRICES).choose(arrival).session
    return Stop(float(driven.route.duration_s @ schedule.heater_power_w) / JOULES_PER_WH, arrival.temperature_c,
                trip.goal.target_temperature_c - arrival.temperature_c, session.charging_time_s,
                session.bought_energy_wh)


def tables_of(trips: Sequence[FleetResult]) -> dict[str, dict[str, list[FleetResult]]]:
    """Return the groups of trips by name, for each table by its title."""
    def within(field: str, intervals: Sequence[tuple[str, float, float]]) -> dict[str, list[FleetResult]]:
        return {name: [trip for trip in trips if low <= getattr(trip, field) < high]
                for name, low, high in intervals}

    return {'air temperature': within('ambient_c', AMBIENTS),
            'driving time to the charger': within('length_min', LENGTHS),
            'car': {name: [trip for trip in trips if trip.car == name] for name in CARS}}


def summarise_fleet(results: Sequence[FleetResult]) -> Figures:
    """Return the figures of all trips and of each group that has some."""
    charged = [result for result in results if result.ways]
    groups = {'all': charged}
    for table in tables_of(charged).values():
        groups.update(table)
    return {'trips': len(charged), 'left_out': len(results) - len(charged),
            'groups': {name: _figures(trips) for name, trips in groups.items() if trips}}


def _figures(trips: Sequence[FleetResult]) -> Figures:
    figures: Figures = {'trips': len(trips), 'ways': {}}
    for way in WAYS:
        pairs = [(trip.ways[way], trip.ways[NONE]) for trip in trips]
        saved = [(unheated.charging_s - stop.charging_s) / S_PER_MIN for stop, unheated in pairs]
        more = [(stop.bought_wh - unheated.bought_wh) / WH_PER_KWH for stop, unheated in pairs]
        figures['ways'][way] = {
            'heater_kwh': float(np.mean([stop.heater_wh for stop, _ in pairs])) / WH_PER_KWH,
            'arrival_c': float(np.mean([stop.arrival_c for stop, _ in pairs])),
            'too_cold': float(np.mean([stop.below_k > TOO_COLD_K for stop, _ in pairs])),
            'charging_min': float(np.mean([stop.charging_s for stop, _ in pairs])) / S_PER_MIN,
            'saved_min': {'mean': float(np.mean(saved)), **distribution(saved, **PERCENTILES)},
            'more_kwh': {'mean': float(np.mean(more)), **distribution(more, **PERCENTILES)},
            'more_cost': float(np.mean([stop.cost - unheated.cost for stop, unheated in pairs]))}
    return figures


def print_fleet(console: Console, summary: Figures) -> None:
    """Print the tables of a summary."""
    groups = summary['groups']
    console.print(f'{summary["trips"]} trips, {summary["left_out"]} left out: they cannot be driven or charged')
    if not groups:
        return
    print_figures(console, 'A winter fleet at the charger; saved and more: relative to no heating', ('', *WAYS), [
        (heading, *(text_of(figure(groups['all']['ways'][way]), form) for way in WAYS))
        for heading, figure, form in ROWS])
    for title, names in tables_of([]).items():
        print_records(
            console, f'By {title}: mean minutes saved/additional kWh bought',
            ('', 'trips [%]', 'unheated [degC]', '[min]', *WAYS[1:]),
            [(name, f'{100.0 * groups[name]["trips"] / summary["trips"]:.1f}',
              f'{groups[name]["ways"][NONE]["arrival_c"]:.1f}',
              f'{groups[name]["ways"][NONE]["charging_min"]:.1f}',
              *(f'{ways[way]["saved_min"]["mean"]:+.1f}/{ways[way]["more_kwh"]["mean"]:+.2f}'
                for ways in [groups[name]['ways']] for way in WAYS[1:]))
             for name in names if name in groups], ('left', *['right'] * (2 + len(WAYS))))
