# SPDX-License-Identifier: Apache-2.0
"""Figures of a study of days, and requirements on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat_studies.robustness.car_figures import (
    LEAST_ARRIVAL_ERROR_K,
    MOST_ARRIVAL_ERROR_K,
    MOST_SWITCH_ONS,
    Requirement,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from bev_preheat_studies.robustness.car_figures import Figures
    from bev_preheat_studies.robustness.day_drives import DayResult, TripOutcome

# A trip whose duration differs from its route's by at most this share is on time.
ON_TIME_WITHIN = 0.005
LEAST_FOUND = 0.95


def summarise_days(results: Sequence[DayResult], has_fault: bool, hilly: Collection[int] = ()) -> Figures:
    """
    Return the summary of DayResults as plain values.

    `has_fault`: the heaters really fail, so verdicts on them are correct. `hilly` are the numbers of the
    routes on which each climb and descent has its own heating interval.
    """
    trips = [trip for result in results for trip in result.trips]
    known = [trip for trip in trips if is_time_known(trip)]
    groups = {
        'first, time known': [trip for trip in known if trip.position == 0],
        'later, time known': [trip for trip in known if trip.position > 0],
        'early or late without a word': [trip for trip in trips if not is_time_known(trip)]}
    with_power = [result for result in results if result.knows_power]
    without = [result for result in results if not result.knows_power]
    shown = [result for result in results if result.fault_shown_s is not None]
    found_s = [result.fault_found_after_s for result in shown if result.fault_found_after_s is not None]
    summary: Figures = {
        'days': len(results), 'trips': len(trips), 'hours': sum(result.hours for result in results),
        'arrival_error_k': {name: _errors(group) for name, group in groups.items()},
        'heater_accused': _named(results, 'heater_verdicts'),
        'signals_accused': _named(results, 'signal_verdicts'),
        'heated_charging_s': {'with power': _most(with_power, 'heated_charging_s'),
                              'without': _most(without, 'heated_charging_s')},
        'heated_parked_s': {'with power': _most(with_power, 'heated_parked_s'),
                            'without': _most(without, 'heated_parked_s')},
        'switch_ons': {'mean': float(np.mean([trip.switch_ons for trip in trips])) if trips else 0.0,
                       'most': _most_switch_ons(trip for trip in trips if trip.route not in hilly),
                       'most over hills': _most_switch_ons(trip for trip in trips if trip.route in hilly)},
        'fault': {'shown': len(shown), 'found': len(found_s) / len(shown) if shown else None,
                  'median_s': float(np.median(found_s)) if found_s else None,
                  'most_s': max(found_s, default=None)},
        'cpu_s': sum(result.cpu_s for result in results), 'steps': sum(result.steps for result in results)}
    summary['requirements'] = [vars(each) for each in _requirements(summary, has_fault)]
    return summary


def is_time_known(trip: TripOutcome) -> bool:
    """Return whether the planner can know the arrival time: the trip is on time, or the position is known."""
    return trip.is_told or abs(trip.pace - 1.0) <= ON_TIME_WITHIN


def _requirements(figures: Figures, has_fault: bool) -> list[Requirement]:
    if has_fault:
        share = figures['fault']['found']
        return [Requirement('faults found', f'at least {100 * LEAST_FOUND:.0f} %',
                            None if share is None else 100.0 * share, '%',
                            None if share is None else share >= LEAST_FOUND)]
    requirements = []
    for name in ('first, time known', 'later, time known'):
        errors = figures['arrival_error_k'][name]
        low_k, high_k = errors['5 %'], errors['95 %']
        requirements += [
            Requirement(f'arrival error 5 %, {name}', f'at least {LEAST_ARRIVAL_ERROR_K:+.1f} K', low_k, 'K',
                        None if low_k is None else low_k >= LEAST_ARRIVAL_ERROR_K),
            Requirement(f'arrival error 95 %, {name}', f'at most {MOST_ARRIVAL_ERROR_K:+.1f} K', high_k, 'K',
                        None if high_k is None else high_k <= MOST_ARRIVAL_ERROR_K)]
    for name, value, bound in (
            ('healthy heaters reported as faulty', len(figures['heater_accused']), 0),
            ('good signals reported as in doubt', len(figures['signals_accused']), 0),
            ('heating while charging, beyond the stated time',
             figures['heated_charging_s']['with power']['total'], 0),
            ('heating while parked, beyond the stated time', figures['heated_parked_s']['with power']['total'], 0),
            ('switch-ons in any trip, except over hills', figures['switch_ons']['most'], MOST_SWITCH_ONS)):
        requirements.append(Requirement(name, f'at most {bound}' if bound else 'none', value,
                                        's' if 'heating' in name else '', value <= bound))
    return requirements


def _errors(trips: Iterable[TripOutcome]) -> dict[str, float | int | None]:
    errors_k = [trip.arrival_error_k for trip in trips if trip.arrival_error_k is not None]
    figures: dict[str, float | int | None] = {'trips': len(errors_k)}
    for name, percent in (('5 %', 5.0), ('median', 50.0), ('95 %', 95.0)):
        figures[name] = float(np.percentile(errors_k, percent)) if errors_k else None
    return {**figures, 'worst': max(errors_k, key=abs, default=None)}


def _named(results: Iterable[DayResult], field: str) -> list[str]:
    """Return a line for each day with a verdict."""
    return [f'day {result.number}: {"; ".join(getattr(result, field))}' for result in results
            if getattr(result, field)]


def _most(results: Sequence[DayResult], field: str) -> Figures:
    """Return the total and the maximum of a time [s], and the day of the maximum."""
    if not results:
        return {'total': 0.0, 'most': 0.0, 'day': None}
    worst = max(results, key=lambda result: getattr(result, field))
    return {'total': float(sum(getattr(result, field) for result in results)), 'most': getattr(worst, field),
            'day': worst.number if getattr(worst, field) > 0.0 else None}


def _most_switch_ons(trips: Iterable[TripOutcome]) -> int:
    return max((trip.switch_ons for trip in trips), default=0)
