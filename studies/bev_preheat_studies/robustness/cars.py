# SPDX-License-Identifier: Apache-2.0
"""Trips of cars that differ from their vehicle file: the study, its figures, and the requirements on them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np
from rich.console import Console

from bev_preheat.commands.terminal import print_figures, print_records
from bev_preheat.simulation.imperfect_car import Mismatch
from bev_preheat.tunables import SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle.description import HeatPath
from bev_preheat_studies.robustness.drawn_cars import Conditions, draw_car
from bev_preheat_studies.robustness.driven import (
    drive_informed,
    drive_with_planner,
    DriveOutcome,
    LEADS_S,
    settings_of_compared,
)
from bev_preheat_studies.study import at_least, at_most, distribution, Requirement, text_of

# Plain values, as in JSON.
Figures = dict[str, Any]

# Requirements on a planner in the car; it must also accept every valid input.
LEAST_ARRIVAL_ERROR_K = -0.5
MOST_ARRIVAL_ERROR_K = 1.0
MOST_SWITCH_ONS = 3
MOST_EXCESS = 0.04


# Rows of the table: heading, place in a method's figures, format, factor.
ROWS: tuple[tuple[str, tuple[str, ...], str, float], ...] = (
    ('Arrival error, 5 % [K]', ('arrival_error_k', '5 %'), '+.2f', 1.0),
    ('… median', ('arrival_error_k', 'median'), '+.2f', 1.0),
    ('… 95 %', ('arrival_error_k', '95 %'), '+.2f', 1.0),
    ('… worst', ('arrival_error_k', 'worst'), '+.2f', 1.0),
    ('Switch-ons, mean', ('switch_ons', 'mean'), '.2f', 1.0),
    ('… most', ('switch_ons', 'most'), 'd', 1.0),
    ('Heating energy, mean [Wh]', ('heating_energy_wh',), '.1f', 1.0),
    ('… trips compared', ('heating_excess', 'trips'), 'd', 1.0),
    ('… above plan with true car, mean [%]', ('heating_excess', 'mean'), '+.2f', 100.0),
    ('… above plan with true car, 95 % [%]', ('heating_excess', '95 %'), '+.2f', 100.0),
    ('Battery energy above it, mean [%]', ('battery_excess', 'mean'), '+.2f', 100.0),
    ('Drives with a heater fault reported', ('verdicts',), 'd', 1.0),
    ('Drives in which a real fault has an effect', ('fault', 'shown'), 'd', 1.0),
    ('… is found [%]', ('fault', 'found'), '.0f', 100.0),
    ('… after, median [s]', ('fault', 'median_s'), '.0f', 1.0),
    ('… after, most [s]', ('fault', 'most_s'), '.0f', 1.0),
    *(row for lead_s in LEADS_S for row in (
        (f'Arrival predicted {lead_s / 60.0:.0f} min before, mean error [K]',
         ('predictions', f'{lead_s:g}', 'bias_k'), '+.2f', 1.0),
        ('… within the stated deviation [%]', ('predictions', f'{lead_s:g}', 'covered'), '.0f', 100.0))),
    ('Drives with a refused input', ('refused',), 'd', 1.0),
    ('Trips with an empty battery', ('ran_empty',), 'd', 1.0),
)


@dataclass(frozen=True)
class CarResult:
    """One trip: the true car, the drive planned with it, those by method, and the duration over the route's."""

    number: int
    mismatch: Mismatch
    heat_path: HeatPath
    informed: DriveOutcome
    methods: dict[str, DriveOutcome]
    pace: float = 1.0


def drive_car(conditions: Conditions, seed: int, methods: Sequence[str], number: int) -> CarResult:
    """Return the CarResult of one drawn trip."""
    trip, goal = draw_car(conditions, seed, number), conditions.goal
    return CarResult(number, trip.mismatch, trip.heat_path, drive_informed(trip.car(), goal), {
        method: drive_with_planner(trip.car(), goal, settings_of_compared(method, conditions.period_s))
        for method in methods}, trip.pace)


def summarise_drives(results: Sequence[CarResult], methods: Iterable[str]) -> Figures:
    """
    Return the summary of CarResults as plain values, one entry per method.

    Energies are relative to the informed drive's (0.02: 2 % more); the mean is the ratio of the sums. Shares
    are None if the informed drive did not heat.
    """
    informed = [result.informed for result in results]
    summary: Figures = {'informed': {
        'arrival_error_k': _errors(informed, informed),
        'heating_energy_wh': _mean([drive.heating_energy_wh for drive in informed]),
        'battery_energy_wh': _mean([drive.battery_energy_wh for drive in informed])}}
    for method in methods:
        drives = [result.methods[method] for result in results]
        figures = summary[method] = {
            'arrival_error_k': _errors(drives, informed),
            'verdicts': sum(bool(drive.verdicts) for drive in drives),
            'fault': fault_figures([(drive.fault_shown_s, drive.fault_found_after_s) for drive in drives]),
            'switch_ons': {'mean': _mean([drive.switch_ons for drive in drives]),
                           'most': max(drive.switch_ons for drive in drives)},
            'heating_energy_wh': _mean([drive.heating_energy_wh for drive in drives]),
            'heating_excess': energy_excess(results, method, 'heating_energy_wh'),
            'battery_excess': energy_excess(results, method, 'battery_energy_wh'),
            'predictions': {f'{lead_s:g}': _predictions(drives, lead_s) for lead_s in LEADS_S},
            'refused': sum(drive.refused for drive in drives),
            'ran_empty': sum(drive.ran_empty for drive in drives)}
        figures['requirements'] = [asdict(requirement) for requirement in requirements(figures)]
    return summary


def requirements(figures: Figures) -> list[Requirement]:
    """Return the Requirements on a method's figures in a summary."""
    errors, excess = figures['arrival_error_k'], figures['heating_excess']['mean']
    economical = at_most('heating energy above plan with true car, mean', 100.0 * MOST_EXCESS,
                         None if excess is None else 100.0 * excess, '%')
    if excess is None and figures['heating_excess']['trips']:
        # If no heating is needed, any heating is waste. A colder arrival proves nothing.
        economical = at_most('heating energy where none is needed', 0.0, figures['heating_energy_wh'], 'Wh')
    return [
        at_least('arrival error, 5 %', LEAST_ARRIVAL_ERROR_K, errors['5 %'], 'K'),
        at_most('arrival error, 95 %', MOST_ARRIVAL_ERROR_K, errors['95 %'], 'K'),
        at_most('switch-ons in any run', MOST_SWITCH_ONS, figures['switch_ons']['most'], form='g'),
        economical, at_most('drives with a refused input', 0, figures['refused'])]


def fault_figures(times: Sequence[tuple[float | None, float | None]]) -> Figures:
    """
    Return how the planner coped with a heater fault, from `fault_times` of each drive or day.

    The number on which it had an effect, the share of them on which it was found, and the time until then [s].
    """
    shown = [found_s for shown_s, found_s in times if shown_s is not None]
    found = [found_s for found_s in shown if found_s is not None]
    return {'shown': len(shown), 'found': len(found) / len(shown) if shown else None,
            'median_s': float(np.median(found)) if found else None, 'most_s': max(found, default=None)}


def _predictions(drives: Iterable[DriveOutcome], lead_s: float) -> dict[str, float | None]:
    """Return mean error [K] of the arrival predicted `lead_s` [s] before, and the share within its deviation."""
    said = [(error_k, deviation_k) for drive in drives for at_s, error_k, deviation_k in drive.predictions
            if at_s == lead_s]
    return {'bias_k': _mean([error_k for error_k, _ in said]) if said else None,
            'covered': _mean([abs(error_k) <= deviation_k for error_k, deviation_k in said]) if said else None}


def _errors(drives: Iterable[DriveOutcome], informed: Iterable[DriveOutcome]) -> dict[str, float]:
    """Return the arrival errors, without the part that the informed drive has too."""
    errors_k = [drive.arrival_error_k - min(best.arrival_error_k, 0.0) for drive, best in zip(drives, informed)]
    return {**distribution(errors_k, **{'5 %': 5.0, 'median': 50.0, '95 %': 95.0}),
            'worst': max(errors_k, key=abs)}


def energy_excess(results: Iterable[CarResult], method: str, field: str) -> dict[str, float | None]:
    """
    Return a method's relative energy excess over the informed drives: {'mean', '95 %', 'trips'}.

    `field` is a field of DriveOutcome. Compares only trips that end as warm as the informed drive or at least
    at the target; 'trips' is their number. The mean is the ratio of the sums; None without such a trip or
    if the informed drives (for '95 %': a single drive) spent nothing.
    """
    compared = [result for result in results if reaches_the_same(result.methods[method], result.informed)]
    excess: dict[str, float | None] = {'mean': None, '95 %': None, 'trips': len(compared)}
    own = np.array([getattr(result.methods[method], field) for result in compared])
    best = np.array([getattr(result.informed, field) for result in compared])
    if best.sum() > 0.0:
        excess['mean'] = float(own.sum() / best.sum() - 1.0)
        if (best > 0.0).all():
            excess['95 %'] = float(np.percentile(own / best - 1.0, 95.0))
    return excess


def reaches_the_same(drive: DriveOutcome, informed: DriveOutcome) -> bool:
    """Return whether a drive falls short of the target by no more than the informed drive."""
    return (min(drive.arrival_error_k, 0.0) >= min(informed.arrival_error_k, 0.0) - SHORTFALL_TOLERANCE_K
            and not drive.ran_empty)


def print_summary(console: Console, summary: Figures, methods: Sequence[str]) -> None:
    """Print the tables of a summary."""
    informed = summary['informed']
    console.print(f'plan with the true car ("informed"): {informed["heating_energy_wh"]:.1f} Wh of heating, '
                  f'{informed["battery_energy_wh"]:.1f} Wh from the battery on average; arrival '
                  f'error {informed["arrival_error_k"]["worst"]:+.3f} K at worst', soft_wrap=True)
    print_figures(console, 'In closed loop', ('', *methods), [
        (heading, *(text_of(reduce(getitem, place, summary[method]), form, factor) for method in methods))
        for heading, place, form, factor in ROWS])
    print_records(console, 'Requirements', ('', 'bound', *methods), [
        (row[0].name, row[0].bound, *(each.judged for each in row))
        for row in zip(*(
            [Requirement(**each) for each in summary[method]['requirements']] for method in methods))],
        ('left', 'left', *('right' for _ in methods)))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
