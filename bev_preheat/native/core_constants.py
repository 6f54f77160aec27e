# SPDX-License-Identifier: Apache-2.0
"""Constants that the core shares with the Python modules: defined there, converted to C here."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

from bev_preheat import tunables
from bev_preheat.numerics import factors, folded_normal, truncated_normal

NAMES: Mapping[ModuleType, str] = {
    truncated_normal: 'LOG_ROOT_2_PI ROOT_2',
    folded_normal: 'CERTAIN_DEVIATIONS ROOT_2_OVER_PI',
    factors: 'JOULES_PER_WH',
    tunables: (
        'ABOVE_K ARRIVAL_TOLERANCE_K BELOW_HIGHEST_K BELOW_K BEYOND_PRICE COLDER_BY_K COMPARED_TOLERANCE_K '
        'DEFICIT_WH_PER_K EDGE_SHARE EMPTY_J END_TOLERANCE_W EXPECTED_PASSES FIRST_STEP_K HALVINGS '
        'HEATING_ALLOWANCE HEATING_PRICE HEATING_SHARE HIGHEST_TOLERANCE_K LACK_PRICE LACK_TOLERANCE_W '
        'LAGS_AHEAD LASTING_LAGS LAST_K LAST_STEP_K LEAST_HEATING_W LEAST_MIXED_SHARE LEAST_SAVING_WH '
        'LONGEST_STEP_S LOOK_WH LOST_ABOVE_TARGET_K MOST_LAGS MOST_LOOKS MOST_SPREAD MOST_TRIALS MOVED_K '
        'NARROW_K NARROW_STEP_K NEAR_K NEAR_PRICE NEAR_RESERVE_K NO_WORSE_W OFF_RESOLUTION_S '
        'POWER_TOLERANCE PRICED_K PRICED_SOC ROUNDING_W SHORT_PRICE SOC_DIFFERENCE SOC_TOLERANCE SPARE_SOC '
        'STRETCH_J STRETCH_K SURE_SHARE SWITCH_ON_EXPECTED_WH SWITCH_ON_WH TAIL TEMPERATURE_DIFFERENCE_K '
        'WATCHED_BELOW_K WATCHED_SOC WIDER_DEVIATIONS WIDE_K WIDE_STEP_K')}


def constants() -> dict[str, int | float]:
    """Return {name in C: value}."""
    return {f'BEV_{name}': getattr(module, name) for module, names in NAMES.items() for name in names.split()}


def constant_lines() -> list[str]:
    """Return a definition in C for each constant: bit-exact, by the shortest decimal."""
    return [f'#define {name} {value!r}' if value >= 0 else f'#define {name} ({value!r})'
            for name, value in constants().items()]
