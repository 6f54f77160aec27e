# SPDX-License-Identifier: Apache-2.0
"""What heating is worth on the reference trip: `python3 -m bev_preheat.experiments.charging_worth`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
import sys
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.charging.worth import (
    ENERGY_PRICE_PER_KWH,
    find_worth,
    Prices,
    VALUE_OF_TIME_PER_H,
)
from bev_preheat.console.program import run_program
from bev_preheat.console.terminal import print_records, result_console
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.charging.worth import Worth
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

CHARGERS_W = (150e3, 50e3)
AMBIENT_C = (-7.0, -15.0)
ARRIVAL_SOCS = (0.1, 0.2)
DEPARTURE_SOC = 0.8
PRICES = Prices(ENERGY_PRICE_PER_KWH, VALUE_OF_TIME_PER_H)
# The drive's consumption hardly depends on the charge it starts with.
MOST_TRIALS, SOC_TOLERANCE = 20, 1e-6


@dataclass(frozen=True)
class Case:
    """One arrival: charger [W], ambient and battery at the start [deg C], arrival without heating."""

    charger_w: float
    ambient_c: float
    arrival_soc: float


def cases() -> list[Case]:
    """Return the cases of the table."""
    return [Case(*values) for values in product(CHARGERS_W, AMBIENT_C, ARRIVAL_SOCS)]


def worth_of(case: Case) -> Worth:
    """Return the Worth of heating of the reference on the reference trip, soaked at the start."""
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    route = replace(route, ambient_temperature_c=np.full(len(route), case.ambient_c))
    goal = Goal(vehicle.defaults.target_battery_temperature_c)
    state = BatteryState(case.ambient_c, start_soc(vehicle, route, goal, case))
    return find_worth(vehicle, route, state, goal, case.charger_w, DEPARTURE_SOC, PRICES)


def start_soc(vehicle: Vehicle, route: Route, goal: Goal, case: Case) -> float:
    """Return the state of charge to start with, so that the unheated drive arrives as the case says."""
    soc = case.arrival_soc + 0.3
    for _ in range(MOST_TRIALS):
        lacking = case.arrival_soc - plan_unheated(
            vehicle, route, BatteryState(case.ambient_c, soc), goal).arrival_soc
        soc += lacking
        if abs(lacking) < SOC_TOLERANCE:
            break
    return soc


def row(case: Case, worth: Worth) -> tuple[str, ...]:
    """Return the row of the table of one case."""
    without, best, fixed = worth.without_heating, worth.best, worth.fixed
    break_even = worth.break_even_value_of_time_per_h
    return (f'{case.charger_w / 1000.0:.0f} kW', f'{case.ambient_c:.0f}',
            f'{100.0 * case.arrival_soc:.0f} %', f'{without.arrival_temperature_c:.1f}',
            duration_text(without.charging_time_s), duration_text(fixed.charging_time_s),
            f'{fixed.cost - without.cost:+.2f}',
            'none' if best is without else f'{best.target_c:.1f}',
            duration_text(best.charging_time_s), f'{best.cost - without.cost:+.2f}',
            '–' if break_even is None else f'{break_even:.2f}')


def main() -> int:
    """Print the table; returns the exit status."""
    rows = [row(case, worth_of(case)) for case in cases()]
    print_records(
        result_console(), f'Reference trip, to {100.0 * DEPARTURE_SOC:.0f} %, '
        f'{PRICES.energy_per_kwh:.2f} per kWh, {PRICES.time_per_h:.2f} per h',
        ('charger', 'air [degC]', 'arrival', 'unheated [degC]', 'charging', 'at 25 degC', 'cost',
         'best [degC]', 'charging', 'cost', 'pays from [per h]'), rows, ('right',) * 11)
    return 0


def _load() -> Callable[[], int]:
    return main


if __name__ == '__main__':
    sys.exit(run_program('charging_worth', _load, ends_process=True))
