# SPDX-License-Identifier: Apache-2.0
"""Constants that the core shares with the Python modules: defined there, converted to C here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import ModuleType

from bev_preheat.estimation import truncated_normal
from bev_preheat.numerics import factors, folded_normal
from bev_preheat.planning import (
    both_ends,
    bracketing,
    heated_limits,
    heating_intervals,
    limits,
    model_inputs,
    optimal_switch,
    outcome,
    paper,
    prices,
    recursion,
    schedule,
    steps_ahead,
    two_switches,
    value_function,
    value_layers,
    value_path,
    value_run,
)

# Names in each module; if another module has the same name, the name in C follows after a colon.
NAMES: Mapping[ModuleType, str] = {
    truncated_normal: 'LOG_ROOT_2_PI ROOT_2 TAIL',
    folded_normal: 'CERTAIN_DEVIATIONS ROOT_2_OVER_PI',
    factors: 'JOULES_PER_WH',
    both_ends: 'BELOW_HIGHEST_K END_TOLERANCE_W HIGHEST_TOLERANCE_K',
    bracketing: 'ARRIVAL_TOLERANCE_K HALVINGS MOST_TRIALS',
    heated_limits: 'LAGS_AHEAD LASTING_LAGS',
    heating_intervals: 'SURPLUS_TOLERANCE_W',
    limits: 'COLDER_BY_K',
    model_inputs: 'LONGEST_STEP_S',
    optimal_switch: 'HEATING_ALLOWANCE',
    outcome: 'POWER_TOLERANCE',
    paper: 'LOST_ABOVE_TARGET_K',
    prices: 'LEAST_SAVING_WH SOC_DIFFERENCE TEMPERATURE_DIFFERENCE_K',
    recursion: ('ABOVE_K BELOW_K EDGE_SHARE EMPTY_J EXPECTED_PASSES FIRST_STEP_K LACK_PRICE LAST_K LAST_STEP_K '
                'LOOK_WH MOST_LOOKS NARROW_K NARROW_STEP_K NEAR_K NEAR_PRICE NEAR_RESERVE_K NO_WORSE_W '
                'RESERVE_TOLERANCE STRETCH_J STRETCH_K WIDER_DEVIATIONS WIDE_K WIDE_STEP_K'),
    schedule: 'HEATING_SHARE',
    steps_ahead: 'LACK_TOLERANCE_W LEAST_HEATING_W SAME_END_W',
    two_switches: 'COMPARED_TOLERANCE_K DEFICIT_WH_PER_K MOST_LAGS OFF_RESOLUTION_S SURE_SHARE',
    value_function: 'SPARE_SOC',
    value_layers: 'BEYOND_PRICE LEAST_SHARE MOST_SPREAD SHORT_PRICE',
    value_path: 'PRICED_K PRICED_SOC WATCHED_BELOW_K WATCHED_SOC',
    value_run: 'HEATING_PRICE MOVED_K SWITCH_ON_EXPECTED_WH SWITCH_ON_WH'}


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
