# SPDX-License-Identifier: Apache-2.0
"""The distribution of energy gaps, arrival errors and times over a study."""

from __future__ import annotations

from collections import Counter
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat_studies.optimality.gap_study import disagreements, FEASIBLE, SOLVER_FAILED

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from typing import Any

    from bev_preheat_studies.optimality.gap_study import GapResult

    # Plain values, as in JSON.
    Figures = dict[str, Any]

PERCENTILES = {'median': 50.0, '95 %': 95.0, 'worst': 100.0}


def summarise_gaps(results: Sequence[GapResult], methods: Iterable[str]) -> Figures:
    """Return the summary of GapResults as a dictionary of plain values."""
    feasible = [result for result in results if result.outcome == FEASIBLE]
    summary: Figures = {
        'trips': len(results),
        'outcomes': dict(Counter(result.outcome for result in results)),
        'solver_failures': [{'number': result.number, 'detail': result.detail}
                            for result in results if result.outcome == SOLVER_FAILED],
        'solve_time_s': _distribution([result.solve_time_s for result in feasible
                                       if result.solve_time_s is not None]),
        'methods': {},
    }
    for method in methods:
        own = [result.methods[method] for result in feasible]
        compared = [(gap_wh, result.number) for result in feasible
                    if (gap_wh := result.methods[method].gap_wh) is not None]
        summary['methods'][method] = {
            # Trips on which the method reaches the same target and reserve as the program.
            'compared_trips': len(compared),
            'gap_wh': _distribution([gap_wh for gap_wh, _ in compared]),
            'arrival_error_k': _distribution([
                _arrival_error_k(result.methods[method].arrival_temperature_c, result.target_c,
                                 result.optimal_arrival_c)
                for result in feasible if result.optimal_arrival_c is not None]),
            'violation': _distribution([result.violation for result in own]),
            'plans_that_break_limits': sum(not result.keeps_limits for result in own),
            'planning_time_s': _distribution([result.planning_time_s for result in own]),
            'disagreements': [
                {'number': result.number, 'outcome': result.outcome,
                 'status': result.methods[method].status}
                for result in disagreements(results, method)],
            'worst_trip': max(compared, key=itemgetter(0))[1] if compared else None,
        }
    return summary


def _arrival_error_k(arrival_c: float, target_c: float, optimal_arrival_c: float) -> float:
    """Return the distance of an arrival from the interval between target and the program's arrival [K]."""
    # If heat pays for itself, the program may end above the target.
    return max(target_c - arrival_c, arrival_c - max(target_c, optimal_arrival_c), 0.0)


def _distribution(values: Sequence[float]) -> dict[str, float]:
    if not values:
        return {}
    return {name: float(np.percentile(values, share)) for name, share in PERCENTILES.items()}
