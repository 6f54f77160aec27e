# SPDX-License-Identifier: Apache-2.0
"""Rows of the tables: bytes of each method, and instructions of its plans."""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING, TypeAlias

from bev_preheat.ecu.vectors import LARGEST_TRIP, METHODS, OK
from bev_preheat_studies.footprint.situations import ROUTES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from bev_preheat.vehicle.heat_path import HeatPath
    from bev_preheat_studies.footprint.measured import Measured
    from bev_preheat_studies.footprint.situations import FootprintCase

# Headings, rows, alignment.
Rows: TypeAlias = 'tuple[Sequence[str], Sequence[Sequence[str]], Sequence[str]]'
# Lengths of usual drawn trips [steps].
USUAL = range(40, 61)
SWITCH, BY_VALUES = METHODS
MEMORY_STEPS = (LARGEST_TRIP, 120)


def path_name(path: HeatPath) -> str:
    """Return the name of a vehicle with such a HeatPath."""
    return 'heat at once' if path.is_direct else 'with a heat path'


def byte_rows(results: Sequence[Measured], method: str) -> Rows:
    """Return headings, rows and alignment of the bytes of a method, one column for each build."""
    builds = list(dict.fromkeys(str(measured.build) for measured in results))
    by_build = {build: [each for each in results if str(each.build) == build] for build in builds}
    memory = next(each.memory_bytes for each in results if each.memory_bytes)

    def row(what: str, figure: Callable[[Measured], int], of: slice = slice(1)) -> list[str]:
        """Return a row; `of` selects the results for heat at once, with a heat path, or both."""
        return [what, *(' / '.join(f'{figure(each):,}'.replace(',', ' ') for each in by_build[build][of])
                        for build in builds)]

    def memory_of(by_way: tuple[int, int, int]) -> Callable[[Measured], int]:
        direct, late, values = by_way
        if method == BY_VALUES:
            return lambda each: values
        return lambda each: direct if each.path.is_direct else late

    both = slice(2)
    return ['', *builds], [
        row('code', lambda each: each.plans[method].linked.code),
        row('constants', lambda each: each.plans[method].linked.constants),
        row('of this, the vehicle', lambda each: each.vehicle.constants),
        row('static variables', lambda each: each.plans[method].linked.variables),
        *(row(f'working memory, {steps} steps, heat at once / with a heat path', memory_of(by_way), both)
          for steps, by_way in memory.items()),
        row('stack, heat at once / with a heat path', lambda each: each.plans[method].stack_bytes, both),
        row('code and constants of a program that calls both methods',
            lambda each: each.everything.code + each.everything.constants),
    ], ['left', *['right'] * len(builds)]


def instruction_rows(results: Sequence[Measured]) -> Rows | None:
    """Return headings, rows and alignment of the instructions of plans; None if none were counted."""
    counted = [measured for measured in results if measured.plans[SWITCH].planned[0].instructions is not None]
    if not counted:
        return None
    groups: list[tuple[str, Callable[[FootprintCase], bool]]] = [
        (f'{USUAL[0]} to {USUAL[-1]} steps', lambda each: not each.route and each.steps in USUAL),
        (f'{LARGEST_TRIP} steps', lambda each: not each.route and each.steps == LARGEST_TRIP),
        *((f'route {route}', lambda each, route=route: each.route == route) for route in ROUTES)]
    rows = []
    for measured in counted:
        for method in METHODS:
            for what, is_limited in (('', None),) if method == SWITCH else (
                    (', no limit active', False), (', a limit active', True)):
                rows.append([
                    str(measured.build), path_name(measured.path), f'{method}{what}',
                    *(_told(_millions(measured, method, belongs, is_limited)) for _, belongs in groups)])
    return (['build', 'heat', 'method', *(name for name, _ in groups)], rows,
            [*['left'] * 3, *['right'] * len(groups)])


def _millions(measured: Measured, method: str, belongs: Callable[[FootprintCase], bool],
              is_limited: bool | None) -> Iterable[float]:
    """Return the instructions of a group's heated plans; `is_limited`: optimal_switch has no plan."""
    number = METHODS.index(method)
    for situation, each, switched in zip(
            measured.situations, measured.plans[method].planned, measured.plans[SWITCH].planned):
        has_limit = switched.status != OK
        if (belongs(situation) and situation.vector.answers[number].heats
                and is_limited in (None, has_limit) and each.instructions is not None):
            yield 1e-6 * each.instructions


def _told(millions: Iterable[float]) -> str:
    values = sorted(millions)
    if not values:
        return '-'
    if len(values) == 1:
        return f'{values[0]:.2g}'
    return f'{values[0]:.2g}, {median(values):.2g}, {values[-1]:.2g} ({len(values)})'
