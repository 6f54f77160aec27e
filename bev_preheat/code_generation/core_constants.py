# SPDX-License-Identifier: Apache-2.0
"""Constants that the core shares with the Python modules: defined there, converted to C here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import ModuleType

from bev_preheat.estimation import truncated_normal
from bev_preheat.numerics import folded_normal, linear_program
from bev_preheat.planning import (
    both_ends,
    bracketing,
    charge_acceptance,
    cheapest_steps,
    dynamics,
    exchange,
    free_heat,
    heated_limits,
    heating_intervals,
    limited_prices,
    limited_switch,
    limits,
    merit_order,
    no_regret,
    optimal_switch,
    outcome,
    paper,
    prices,
    schedule,
    steps_ahead,
    strides,
    threshold_search,
    thresholds,
    trip,
    two_switches,
    uncertainty_margin,
    value_curve,
    value_function,
)

# Names in each module; if another module has the same name, the name in C follows after a colon.
NAMES: Mapping[ModuleType, str] = {
    truncated_normal: 'LOG_ROOT_2_PI ROOT_2 TAIL',
    folded_normal: 'CERTAIN_DEVIATIONS ROOT_2_OVER_PI',
    linear_program: 'LEAST_CHANGE LEAST_GAIN:PIVOT_LEAST_GAIN MOST_ROUNDS:MOST_PIVOTS PENALTY:PIVOT_PENALTY',
    both_ends: 'END_TOLERANCE_W HIGHEST_TOLERANCE_K',
    bracketing: 'ARRIVAL_TOLERANCE_K HALVINGS MOST_TRIALS',
    charge_acceptance: 'SOC_DIFFERENCE:ACCEPTANCE_SOC_DIFFERENCE',
    cheapest_steps: 'LEAST_SAVING_THEN_WH LEAST_SAVING_WH MOST_ORDERS',
    dynamics: 'JOULES_PER_WH',
    exchange: ('FIRST_SHARE GOOD_SHARE LEAST_LEFT MENDED_SHARE MOST_LEFT MOST_MENDS '
               'MOST_TRIALS:MOST_EXCHANGE_TRIALS POOR_SHARE'),
    heated_limits: 'LAGS_AHEAD LASTING_LAGS',
    free_heat: ('ABOVE_TARGET_K AIM_K FULL_SOC HIGHER_K LEAST_GAIN LEAST_KEPT MISSED_K MORE_AIM MOST_CEILINGS '
                'PIECES WARMER_K WIDER'),
    heating_intervals: 'SURPLUS_TOLERANCE_W',
    limited_prices: ('BRAKE_DIFFERENCE_W LEAST_ROOM_W LOWEST_SOC_AIM LOWEST_SOC_MARGIN NEAR_HIGHEST_K '
                     'NEAR_LOWEST_SOC POWER_ROUNDING'),
    limited_switch: 'MOST_RUNS:MOST_LIMITED_SWITCH_RUNS',
    limits: 'ACTIVE_W COLDER_BY_K',
    merit_order: 'LEAST_SAVING_SOC LEAST_WARMER_K MOST_PASSES SOC_AGREEMENT SOC_AGREEMENT_FOR_EXCHANGES',
    no_regret: ('BELOW_UNHEATED_K MOST_HALVINGS MOST_TARGETS NO_WORSE_W POWER_WEIGHT_W SOC_AIM '
                'SOC_TOLERANCE TARGET_TOLERANCE_K TARGET_TOLERANCE_OF_POWER_K'),
    optimal_switch: 'HEATING_ALLOWANCE',
    outcome: 'POWER_TOLERANCE',
    paper: 'LOST_ABOVE_TARGET_K',
    prices: 'SOC_DIFFERENCE TEMPERATURE_DIFFERENCE_K',
    schedule: 'HEATING_SHARE',
    steps_ahead: 'LACK_TOLERANCE_W LEAST_HEATING_W SAME_END_W',
    strides: 'COARSE COLDER_MARGIN_K LEAST_WIDTH_K LONGEST_STRIDE_S NEAR_K NEAR_TARGET_K WARMER_MARGIN_K',
    threshold_search: ('ARRIVAL_OVERSHOOT_K CLIMB_OVERSHOOT_K LARGEST_SHIFT_K LARGE_SHIFT_K MOST_CLIMBS '
                       'MOST_RUNS:MOST_SEARCH_RUNS POWER_SURPLUS SMALL_SHIFT_K UNHEATED_SHIFT_K'),
    thresholds: 'GRID_K MARGIN_K NEIGHBOUR_K PENALTY',
    trip: 'BELOW_HIGHEST_K LONGEST_STEP_S',
    two_switches: 'COMPARED_TOLERANCE_K DEFICIT_WH_PER_K MOST_LAGS OFF_RESOLUTION_S SURE_SHARE',
    uncertainty_margin: ('ARRIVAL_TOLERANCE_K:EARLY_TOLERANCE_K END_RESOLUTION_S:EARLY_RESOLUTION_S '
                         'MOST_RUNS:MOST_EARLY_RUNS'),
    value_curve: 'CURVE_TOLERANCE_J INDIFFERENCE_J LEAST_FAN_K LEAST_GAIN_K MOST_POINTS SLOPE_K WIDEST_GAP_K',
    value_function: ('ABOVE_K BELOW_K BEYOND_PRICE EDGE_SHARE EMPTY_J FIRST_STEP_K LACK_PRICE LAST_K LAST_STEP_K '
                     'MIXTURE_HALVINGS MOST_LOOKS MOVED_K NARROW_K NARROW_STEP_K NEAR_RESERVE_K PRICED_SOC '
                     'RESERVE_TOLERANCE SHORT_PRICE SWITCH_ON_WH WATCHED_BELOW_K WATCHED_SOC WIDE_K WIDE_STEP_K')}


def constants() -> dict[str, int | float]:
    """Return {name in C: value}; raises ValueError if two constants have the same name."""
    found: dict[str, int | float] = {}
    for name, value in _named():
        if name in found:
            raise ValueError(f'{name}: two constants have this name')
        found[name] = value
    return found


def constant_lines() -> list[str]:
    """Return a definition in C for each constant: bit-exact, by the shortest decimal."""
    return [f'#define {name} {value!r}' if value >= 0 else f'#define {name} ({value!r})'
            for name, value in constants().items()]


def _named() -> Iterator[tuple[str, int | float]]:
    for module, names in NAMES.items():
        for name, _, in_c in (each.partition(':') for each in names.split()):
            yield f'BEV_{in_c or name}', getattr(module, name)
