# SPDX-License-Identifier: Apache-2.0
"""Whole days in one process of the planner: the study, its figures, and the requirements on them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from rich.console import Console

from bev_preheat.commands.terminal import print_figures, print_records
from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.imperfect_car import ImperfectCar, PhaseReport
from bev_preheat.simulation.phases import Charge, DrivePhase, Park
from bev_preheat.simulation.scenario_drive import DriveRecord, HEALTHY
from bev_preheat.simulation.traffic import Kind
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat_studies.robustness.cars import (
    fault_figures,
    Figures,
    LEAST_ARRIVAL_ERROR_K,
    MOST_ARRIVAL_ERROR_K,
    MOST_SWITCH_ONS,
)
from bev_preheat_studies.robustness.drawn_cars import Conditions
from bev_preheat_studies.robustness.drawn_days import draw_day
from bev_preheat_studies.robustness.driven import drive, fault_times, settings_of_compared
from bev_preheat_studies.study import at_least, at_most, distribution, Requirement, text_of

# Heating must end within these times after the start of charging or parking [s], plus a command period
# (docs/explanation/safety.md).
ALLOWED_S: dict[type, float] = {Charge: 10.0, Park: 180.0}
# A trip whose duration differs from its route's by at most this share is on time.
ON_TIME_WITHIN = 0.005
LEAST_FOUND = 0.95
# Most lines printed for false verdicts; the file of --json has all.
MOST_LINES = 10


@dataclass(frozen=True)
class TripOutcome:
    """
    Outcome of trip `position` (0: the first) of a day.

    `arrival_error_k` [K] is the true temperature on arrival above the target, or above the reachable
    temperature closest to it; None if the trip was cut short or the battery ran empty. `route` is the number
    of the route, `pace` the duration as a multiple of the route's, `is_told`: the car reported its position.
    `switch_ons` counts the rises of the command from 0 W.
    """

    position: int
    route: int
    pace: float
    is_told: bool
    arrival_error_k: float | None
    switch_ons: int

    @property
    def is_time_known(self) -> bool:
        """Whether the planner can know the arrival time: the trip is on time, or the position is known."""
        return self.is_told or abs(self.pace - 1.0) <= ON_TIME_WITHIN


@dataclass(frozen=True)
class DayResult:
    """
    One day.

    `knows_power`: battery states carry voltage and current. `heater_verdicts` and `signal_verdicts` list all
    reported faults of the heater and of signals in order, as texts 'name, phase, instant'.
    `heated_charging_s` and `heated_parked_s` are the times [s] of commanded heating while charging or parked,
    beyond ALLOWED_S. `fault_shown_s` and `fault_found_after_s` are those of `fault_times`. `hours` is the length
    of the day.
    """

    number: int
    knows_power: bool
    trips: tuple[TripOutcome, ...]
    heater_verdicts: tuple[str, ...] = ()
    signal_verdicts: tuple[str, ...] = ()
    heated_charging_s: float = 0.0
    heated_parked_s: float = 0.0
    fault_shown_s: float | None = None
    fault_found_after_s: float | None = None
    hours: float = 0.0


def drive_day(conditions: Conditions, seed: int, number: int) -> DayResult:
    """Return the DayResult of one drawn day."""
    day = draw_day(conditions, seed, number)
    car = day.car()
    within_c: list[tuple[float, float]] = []
    phases: list[object] = []

    def begin_phase() -> None:
        if not phases or car.phase is not phases[-1]:
            phases.append(car.phase)
            if isinstance(car.phase, DrivePhase):
                within_c.append((_end_c(car, 0.0), _end_c(car, car.vehicle.hvch.maximum_power_w)))

    record = drive(car, settings_of_compared('planner', conditions.period_s), conditions.goal.target_temperature_c,
                   begin_phase)
    drives = [report for report in car.reports if isinstance(report.phase, DrivePhase)]
    trips = tuple(
        TripOutcome(position, day.route_numbers[position], day.paces[position], day.conditions.tells_position,
                    _arrival_error_k(report, *within), _switch_ons(record, report))
        for position, (report, within) in enumerate(zip(drives, within_c)))
    shown_s, found_s = fault_times(record, car.imperfections.heater_faults,
                                   [(report.started_s, report.ended_s) for report in drives])
    return DayResult(
        number, day.conditions.reports_power, trips,
        _where(car, [each for each in record.heater_verdicts if each[1] != HEALTHY]), _where(car, record.signals),
        _heated_s(record, car, Charge, conditions.period_s), _heated_s(record, car, Park, conditions.period_s),
        shown_s, found_s, car.time_s / 3600.0)


def _end_c(car: ImperfectCar, heater_power_w: float) -> float:
    """Return the battery temperature at the end of the drive [deg C] with a constant heater power [W]."""
    plant = car.plant
    state = BatteryState(plant.temperature_c, plant.soc, coolant_excess_k=plant.coolant_c - plant.temperature_c)
    driven = VehiclePlant(plant.vehicle, plant.route, state)
    driven.advance(driven.duration_s, heater_power_w)
    return driven.temperature_c


def _arrival_error_k(report: PhaseReport, unheated_c: float, heated_c: float) -> float | None:
    phase = report.phase
    assert isinstance(phase, DrivePhase)
    if report.ran_empty or any(event.kind is Kind.ARRIVE_EARLY for event in phase.events):
        return None
    return report.temperature_c - min(max(phase.goal.target_temperature_c, unheated_c), heated_c)


def _commands(record: DriveRecord, report: PhaseReport) -> list[tuple[float, float, float]]:
    """Return (instant [s], until [s], power [W]) of a phase, at whose start the command before still holds."""
    before_w = [power_w for at_s, power_w, _ in record.commands if at_s < report.started_s][-1:]
    within = [(at_s, power_w) for at_s, power_w, _ in record.commands if report.started_s <= at_s < report.ended_s]
    pieces = [(report.started_s, power_w) for power_w in before_w] + within
    return [(at_s, until_s, power_w) for (at_s, power_w), until_s in zip(
        pieces, [*(at_s for at_s, _ in pieces[1:]), report.ended_s])]


def _switch_ons(record: DriveRecord, report: PhaseReport) -> int:
    powers_w = [power_w for _, _, power_w in _commands(record, report)]
    # A command that continues from the previous phase is not a switch-on of this trip.
    first = report.started_s == 0.0 and bool(powers_w) and powers_w[0] > 0.0
    return first + sum(before_w == 0.0 < after_w for before_w, after_w in zip(powers_w, powers_w[1:]))


def _heated_s(record: DriveRecord, car: ImperfectCar, kind: type[Charge] | type[Park], period_s: float) -> float:
    """Return how long heating was commanded in phases of a kind, beyond ALLOWED_S and a command period [s]."""
    return sum(max(0.0, until_s - max(at_s, report.started_s + ALLOWED_S[kind] + period_s))
               for report in car.reports if isinstance(report.phase, kind)
               for at_s, until_s, power_w in _commands(record, report) if power_w > 0.0)


def _where(car: ImperfectCar, named: Iterable[tuple[float, str]]) -> tuple[str, ...]:
    """Return texts 'name, phase, instant' of (instant [s], name) pairs."""
    texts = []
    for at_s, name in named:
        number, report = next(((number, report) for number, report in enumerate(car.reports, start=1)
                               if at_s < report.ended_s), (len(car.reports), car.reports[-1]))
        texts.append(f'{name}, {type(report.phase).__name__.lower()} {number}, {at_s - report.started_s:.0f} s')
    return tuple(texts)


def summarise_days(results: Sequence[DayResult], has_fault: bool, hilly: Collection[int] = ()) -> Figures:
    """
    Return the summary of DayResults as plain values.

    `has_fault`: the heaters really fail, so verdicts on them are correct. `hilly` are the numbers of the
    routes on which each climb and descent has its own heating interval.
    """
    trips = [trip for result in results for trip in result.trips]
    groups = {
        'first, time known': [trip for trip in trips if trip.is_time_known and trip.position == 0],
        'later, time known': [trip for trip in trips if trip.is_time_known and trip.position > 0],
        'early or late without a word': [trip for trip in trips if not trip.is_time_known]}
    summary: Figures = {
        'days': len(results), 'trips': len(trips), 'hours': sum(result.hours for result in results),
        'arrival_error_k': {name: _errors(group) for name, group in groups.items()},
        **{f'{what}_accused': [f'day {result.number}: {"; ".join(named)}' for result in results
                               if (named := getattr(result, f'{what}_verdicts'))]
           for what in ('heater', 'signal')},
        **{f'heated_{where}_s': {
            known: {'total': float(sum(times_s)), 'most': max(times_s, default=0.0)}
            for known, times_s in ((name, [getattr(result, f'heated_{where}_s') for result in results
                                           if result.knows_power == knows])
                                   for name, knows in (('with power', True), ('without', False)))}
           for where in ('charging', 'parked')},
        'switch_ons': {'mean': float(np.mean([trip.switch_ons for trip in trips])) if trips else 0.0,
                       **{name: max((trip.switch_ons for trip in trips if (trip.route in hilly) == is_hilly),
                                    default=0)
                          for name, is_hilly in (('most', False), ('most over hills', True))}},
        'fault': fault_figures([(result.fault_shown_s, result.fault_found_after_s) for result in results])}
    summary['requirements'] = [asdict(each) for each in requirements(summary, has_fault)]
    return summary


def requirements(figures: Figures, has_fault: bool) -> list[Requirement]:
    """Return the Requirements on a summary."""
    if has_fault:
        found = figures['fault']['found']
        return [at_least('faults found', 100.0 * LEAST_FOUND, None if found is None else 100.0 * found, '%', 'g')]
    return [
        *(each for name, errors in figures['arrival_error_k'].items() if name.endswith('time known')
          for each in (at_least(f'arrival error 5 %, {name}', LEAST_ARRIVAL_ERROR_K, errors['5 %'], 'K'),
                       at_most(f'arrival error 95 %, {name}', MOST_ARRIVAL_ERROR_K, errors['95 %'], 'K'))),
        at_most('healthy heaters reported as faulty', 0, len(figures['heater_accused'])),
        at_most('good signals reported as in doubt', 0, len(figures['signal_accused'])),
        *(at_most(f'heating while {where}, beyond the stated time', 0,
                  figures[f'heated_{where}_s']['with power']['total'], 's') for where in ('charging', 'parked')),
        at_most('switch-ons in any trip, except over hills', MOST_SWITCH_ONS, figures['switch_ons']['most'],
                form='g')]


def _errors(trips: Iterable[TripOutcome]) -> dict[str, float | int | None]:
    errors_k = [trip.arrival_error_k for trip in trips if trip.arrival_error_k is not None]
    return {'trips': len(errors_k), '5 %': None, 'median': None, '95 %': None,
            **distribution(errors_k, **{'5 %': 5.0, 'median': 50.0, '95 %': 95.0}),
            'worst': max(errors_k, key=abs, default=None)}


def print_days(console: Console, summary: Figures, has_fault: bool) -> None:
    """Print the tables of a summary."""
    console.print(f'{summary["days"]} days with {summary["trips"]} trips, {summary["hours"]:.0f} h.')
    groups = summary['arrival_error_k']
    print_figures(console, 'Arrival error [K]', ('trips', *groups), [
        (name, *(text_of(group[key], form) for group in groups.values()))
        for name, key, form in (('number', 'trips', 'd'), ('5 %', '5 %', '+.2f'), ('median', 'median', '+.2f'),
                                ('95 %', '95 %', '+.2f'), ('worst', 'worst', '+.2f'))])
    switch_ons, fault = summary['switch_ons'], summary['fault']
    print_figures(console, 'In all days', ('', 'all', 'most in one'), [
        *((f'Heating while {where}, beyond the stated time, {which} [s]', f'{times[key]["total"]:.0f}',
           f'{times[key]["most"]:.0f}')
          for where, times in ((each, summary[f'heated_{each}_s']) for each in ('charging', 'parked'))
          for which, key in (('voltage and current known', 'with power'), ('not known', 'without'))),
        ('Switch-ons per trip, except over hills', f'mean {switch_ons["mean"]:.2f}', str(switch_ons['most'])),
        ('Switch-ons per trip, over hills', '', str(switch_ons['most over hills']))])
    if has_fault:
        console.print(
            f'Heater fault: has an effect on {fault["shown"]} days, found on '
            f'{text_of(fault["found"], ".0f", 100.0)} % of them, after '
            f'{text_of(fault["median_s"], ".0f")} s of driving (median), '
            f'{text_of(fault["most_s"], ".0f")} s (maximum).', soft_wrap=True)
    print_records(console, 'Requirements', ('', 'bound', ''), [
        (each.name, each.bound, each.judged)
        for each in (Requirement(**plain) for plain in summary['requirements'])], ('left', 'left', 'right'))
    for what in ('heater', 'signal'):
        lines = summary[f'{what}_accused']
        for line in lines[:MOST_LINES]:
            console.print(f'{what}: {line}', markup=False, soft_wrap=True)
        if len(lines) > MOST_LINES:
            console.print(f'{what}: … {len(lines) - MOST_LINES} more')
