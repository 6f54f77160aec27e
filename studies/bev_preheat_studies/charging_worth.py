# SPDX-License-Identifier: Apache-2.0
"""
`python3 -m bev_preheat_studies.charging_worth`: the worth of heating on the reference trip.

With `--winter`: minutes and energy of the best target by air temperature and charger.
"""

from __future__ import annotations

from argparse import RawDescriptionHelpFormatter
from dataclasses import dataclass, replace
from itertools import product
import sys
from typing import TYPE_CHECKING

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import ENERGY_PRICE_PER_KWH, find_worth, VALUE_OF_TIME_PER_H
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.program import run_program
from bev_preheat.console.terminal import print_records, progress_bar, result_console
from bev_preheat.numerics.factors import S_PER_MIN, W_PER_KW, WH_PER_KWH
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bev_preheat.charging.worth import Worth
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

CHARGERS_W = (150e3, 50e3)
AMBIENT_C = (-7.0, -15.0)
ARRIVAL_SOCS = (0.1, 0.2)
DEPARTURE_SOC = 0.8
PRICES = Prices(ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H)
WINTER_CHARGERS_W = (50e3, 100e3, 150e3, 250e3)
WINTER_AMBIENT_C = (-20.0, -15.0, -10.0, -5.0, 0.0)
WINTER_ARRIVAL_SOC = 0.1
# The drive's consumption hardly depends on the initial charge.
MOST_TRIALS, SOC_TOLERANCE = 20, 1e-6


@dataclass(frozen=True)
class WorthCase:
    """One arrival: charger [W], ambient and battery at the start [deg C], arrival without heating."""

    charger_w: float
    ambient_c: float
    arrival_soc: float


def cases() -> list[WorthCase]:
    """Return the cases of the table."""
    return [WorthCase(*values) for values in product(CHARGERS_W, AMBIENT_C, ARRIVAL_SOCS)]


def trip_of(case: WorthCase) -> tuple[Vehicle, Route, BatteryState, Goal]:
    """Return the reference vehicle on the reference trip, soaked at the start, that arrives as `case` says."""
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    route = replace(route, ambient_temperature_c=np.full(len(route), case.ambient_c))
    goal = Goal(vehicle.defaults.target_battery_temperature_c)
    return vehicle, route, BatteryState(case.ambient_c, start_soc(vehicle, route, goal, case)), goal


def worth_of(case: WorthCase) -> Worth:
    """Return the Worth of heating in a case."""
    return find_worth(*trip_of(case), case.charger_w, DEPARTURE_SOC, PRICES)


def start_soc(vehicle: Vehicle, route: Route, goal: Goal, case: WorthCase) -> float:
    """Return the initial state of charge with which the unheated drive arrives as `case` says."""
    soc = case.arrival_soc + 0.3
    for _ in range(MOST_TRIALS):
        deficit = case.arrival_soc - plan_unheated(
            vehicle, route, BatteryState(case.ambient_c, soc), goal).arrival_soc
        soc += deficit
        if abs(deficit) < SOC_TOLERANCE:
            break
    return soc


def row(case: WorthCase, worth: Worth) -> tuple[str, ...]:
    """Return the row of the table of one case."""
    without, best, fixed = worth.without_heating, worth.best, worth.fixed
    break_even = worth.break_even_value_of_time_per_h
    return (f'{case.charger_w / W_PER_KW:.0f} kW', f'{case.ambient_c:.0f}',
            f'{100.0 * case.arrival_soc:.0f} %', f'{without.arrival_temperature_c:.1f}',
            duration_text(without.charging_time_s), duration_text(fixed.charging_time_s),
            f'{fixed.cost - without.cost:+.2f}',
            'none' if best is without else f'{best.target_c:.1f}',
            duration_text(best.charging_time_s), f'{best.cost - without.cost:+.2f}',
            '–' if break_even is None else f'{break_even:.2f}')


def winter_cases() -> list[WorthCase]:
    """Return the cases of the winter table."""
    return [WorthCase(charger_w, ambient_c, WINTER_ARRIVAL_SOC)
            for ambient_c, charger_w in product(WINTER_AMBIENT_C, WINTER_CHARGERS_W)]


def winter_row(case: WorthCase, worth: Worth) -> tuple[str, ...]:
    """
    Return the row of the winter table of one case.

    The minutes that the best target saves at the charger, the extra energy that it buys [kWh] and the cost
    are differences from no heating and from the fixed target.
    """
    without, best, fixed = worth.without_heating, worth.best, worth.fixed
    return (f'{case.ambient_c:.0f}', f'{case.charger_w / W_PER_KW:.0f} kW',
            'none' if best is without else f'{best.target_c:.1f}',
            *(f'{item.charging_time_s / S_PER_MIN:.1f}' for item in (without, fixed, best)),
            *(text for other in (without, fixed) for text in (
                _signed((other.charging_time_s - best.charging_time_s) / S_PER_MIN, 1),
                _signed((best.bought_energy_wh - other.bought_energy_wh) / WH_PER_KWH, 2),
                _signed(best.cost - other.cost, 2))))


def _signed(value: float, digits: int) -> str:
    # Adding 0.0 turns -0.0 into 0.0.
    return f'{round(value, digits) + 0.0:+.{digits}f}'


def _print_worth() -> int:
    rows = [row(case, worth_of(case)) for case in cases()]
    print_records(
        result_console(), f'Reference trip, to {100.0 * DEPARTURE_SOC:.0f} %, '
        f'{PRICES.energy_per_kwh:.2f} per kWh, {PRICES.time_per_h:.2f} per h',
        ('charger', 'air [degC]', 'arrival', 'unheated [degC]', 'charging', 'at 25 degC', 'cost',
         'best [degC]', 'charging', 'cost', 'pays from [per h]'), rows, ('right',) * 11)
    return 0


def _print_winter() -> int:
    rows = []
    with progress_bar(TextColumn('cases'), BarColumn(), MofNCompleteColumn()) as progress:
        for case in progress.track(winter_cases()):
            rows.append(winter_row(case, worth_of(case)))
    print_records(
        result_console(), f'Reference trip, unheated arrival with {100.0 * WINTER_ARRIVAL_SOC:.0f} %, to '
        f'{100.0 * DEPARTURE_SOC:.0f} %, {PRICES.energy_per_kwh:.2f} per kWh, '
        f'{PRICES.time_per_h:.2f} per h; the best target compared with no heating and with the fixed target',
        ('air [degC]', 'charger', 'best [degC]', 'none [min]', 'fixed [min]', 'best [min]',
         'saved [min]', 'more [kWh]', 'cost', 'saved, fixed [min]', 'more, fixed [kWh]', 'cost, fixed'),
        rows, ('right',) * 12)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the requested table; returns the exit status."""
    return run_program('charging_worth', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat_studies.charging_worth', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument('--winter', action='store_true',
                        help='table by air temperature and charger')
    return _print_winter if parser.parse_args(arguments).winter else _print_worth


if __name__ == '__main__':
    sys.exit(main())
