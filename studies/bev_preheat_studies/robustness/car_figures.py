# SPDX-License-Identifier: Apache-2.0
"""The figures of each method in a study, and the requirements on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.comparison import SAME_SHORTFALL_K

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from typing import Any

    from bev_preheat_studies.robustness.car_study import CarResult
    from bev_preheat_studies.robustness.drives import DriveOutcome

    # Plain values, as in JSON.
    Figures = dict[str, Any]

# Requirements on a planner in the car; it must also accept every valid input.
LEAST_ARRIVAL_ERROR_K = -0.5
MOST_ARRIVAL_ERROR_K = 1.0
MOST_SWITCH_ONS = 3
MOST_EXCESS = 0.04


@dataclass(frozen=True)
class Requirement:
    """A figure (None: not available), its bound as a text, and whether the bound is met (None: unknown)."""

    name: str
    bound: str
    value: float | None
    unit: str
    met: bool | None


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
        updates = sum(drive.updates for drive in drives)
        summary[method] = {
            'arrival_error_k': _errors(drives, informed),
            'verdicts': sum(bool(drive.verdicts) for drive in drives),
            'fault': _fault_figures(drives),
            'switch_ons': {'mean': _mean([drive.switch_ons for drive in drives]),
                           'most': max(drive.switch_ons for drive in drives)},
            'heating_energy_wh': _mean([drive.heating_energy_wh for drive in drives]),
            'heating_excess': energy_excess(results, method, 'heating_energy_wh'),
            'battery_energy_wh': _mean([drive.battery_energy_wh for drive in drives]),
            'battery_excess': energy_excess(results, method, 'battery_energy_wh'),
            'partial_duty_s': {'mean': _mean([drive.partial_duty_s for drive in drives]),
                               'most': max(drive.partial_duty_s for drive in drives)},
            'refused_inputs': sum(drive.refused_inputs for drive in drives),
            'updates_without_plan': sum(drive.updates_without_plan for drive in drives),
            'ran_empty': sum(drive.ran_empty for drive in drives),
            'planner_cpu_per_update_s': sum(drive.planner_cpu_s for drive in drives) / updates,
            'worst_trips': _worst(results, method),
        }
        summary[method]['requirements'] = [
            vars(requirement) for requirement in requirements(summary[method])]
    return summary


def requirements(figures: Figures) -> list[Requirement]:
    """Return the Requirements on a method's figures in a summary."""
    errors, excess = figures['arrival_error_k'], figures['heating_excess']['mean']
    if excess is not None:
        is_economical: bool | None = excess <= MOST_EXCESS
    else:
        # If no heating is needed, any heating is waste. A colder arrival proves nothing.
        is_economical = figures['heating_energy_wh'] == 0.0 if figures['heating_excess']['trips'] else None
    return [
        Requirement('arrival error, 5 %', f'at least {LEAST_ARRIVAL_ERROR_K:+.1f} K',
                    errors['5 %'], 'K', errors['5 %'] >= LEAST_ARRIVAL_ERROR_K),
        Requirement('arrival error, 95 %', f'at most {MOST_ARRIVAL_ERROR_K:+.1f} K',
                    errors['95 %'], 'K', errors['95 %'] <= MOST_ARRIVAL_ERROR_K),
        Requirement('switch-ons in any run', f'at most {MOST_SWITCH_ONS}',
                    figures['switch_ons']['most'], '',
                    figures['switch_ons']['most'] <= MOST_SWITCH_ONS),
        Requirement('heating energy above plan with true car, mean', f'at most {100 * MOST_EXCESS:.0f} %',
                    None if excess is None else 100.0 * excess, '%', is_economical),
        Requirement('refused inputs', 'none', figures['refused_inputs'], '',
                    figures['refused_inputs'] == 0),
    ]


def _fault_figures(drives: Iterable[DriveOutcome]) -> dict[str, float | None]:
    """
    Return how the planner coped with a heater fault, over the drives in which the fault had an effect.

    The share that found it, the time until then, and how long it had an effect if it was not found [s].
    """
    shown = [drive for drive in drives if drive.fault_shown_s is not None]
    found_s = [drive.fault_found_after_s for drive in shown if drive.fault_found_after_s is not None]
    missed_s = [drive.fault_shown_s for drive in shown
                if drive.fault_found_after_s is None and drive.fault_shown_s is not None]
    return {'shown': len(shown),
            'found': len(found_s) / len(shown) if shown else None,
            'median_s': float(np.median(found_s)) if found_s else None,
            'most_s': max(found_s, default=None),
            'missed_most_s': max(missed_s, default=None)}


def _errors(drives: Iterable[DriveOutcome],
            informed: Iterable[DriveOutcome]) -> dict[str, float]:
    """Return the arrival errors, without the part that the informed drive has too."""
    errors_k = [drive.arrival_error_k - min(best.arrival_error_k, 0.0)
                for drive, best in zip(drives, informed)]
    return {'5 %': float(np.percentile(errors_k, 5.0)),
            'median': float(np.percentile(errors_k, 50.0)),
            '95 %': float(np.percentile(errors_k, 95.0)),
            'worst': max(errors_k, key=abs)}


def energy_excess(results: Iterable[CarResult], method: str,
                  field: str) -> dict[str, float | None]:
    """
    Return a method's relative energy excess over the informed drives: {'mean', '95 %', 'trips'}.

    `field` is a field of DriveOutcome. Compares only trips that end as warm as the informed drive or at least
    at the target; 'trips' is their number. The mean is the ratio of the sums; None without such a trip or
    if the informed drives (for '95 %': a single drive) spent nothing.
    """
    compared = [result for result in results
                if reaches_the_same(result.methods[method], result.informed)]
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
    return (min(drive.arrival_error_k, 0.0) >= min(informed.arrival_error_k, 0.0) - SAME_SHORTFALL_K
            and not drive.ran_empty)


def _worst(results: Sequence[CarResult], method: str) -> dict[str, int]:
    """Return the numbers of the extreme trips."""
    def number_of(figure: Callable[[CarResult], float]) -> int:
        return max(results, key=figure).number

    return {
        'coldest': number_of(lambda result: -result.methods[method].arrival_error_k),
        'warmest': number_of(lambda result: result.methods[method].arrival_error_k),
        'most switch-ons': number_of(lambda result: result.methods[method].switch_ons),
        'most energy above informed': number_of(
            lambda result: (result.methods[method].heating_energy_wh
                            - result.informed.heating_energy_wh))}


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
