# SPDX-License-Identifier: Apache-2.0
"""The reference trip in doubt: over the probability, the arrival's deviation, and the spread of the cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.charging.prospect import chance_text, ChargingProspect
from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.worth import find_worth
from bev_preheat.console.terminal import print_records
from bev_preheat.numerics.factors import S_PER_MIN
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import limited_by_coldest_cell

if TYPE_CHECKING:
    from rich.console import Console

    from bev_preheat.charging.worth import Worth
    from bev_preheat.vehicle import Vehicle

STATE, CHARGER_W, DEPARTURE_SOC = BatteryState(-7.0, 0.5), 150e3, 0.8
# An hour is worth more than by default, so that heating pays clearly if charging is certain.
PRICES = Prices(0.60, 30.0)
PROBABILITIES = (1.0, 0.9, 0.7, 0.5, 0.4, 0.3, 0.25, 0.2, 0.1)
DEVIATIONS_S = (0.0, 60.0, 180.0, 300.0, 600.0)
SPREADS_K = (0.0, 2.0, 5.0, 8.0)


def print_tables(console: Console) -> None:
    """Print the three tables."""
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    inputs = route, STATE, Goal(vehicle.defaults.target_battery_temperature_c)

    def worth(prospect: ChargingProspect, car: Vehicle = vehicle) -> Worth:
        return find_worth(car, *inputs, CHARGER_W, DEPARTURE_SOC, PRICES, prospect=prospect)

    def row(name: str, found: Worth) -> tuple[str, ...]:
        best = found.best
        if best is found.without_heating:
            return name, 'none', '–', f'{best.cost:.3f}', f'{best.cost:.3f}'
        start_s = plan_preheating(vehicle, route, STATE, Goal(best.target_c)).heating_start_s
        started = '–' if start_s is None else f'{(route.total_duration_s - start_s) / S_PER_MIN:.1f}'
        return name, f'{best.target_c:.1f}', started, f'{best.cost:.3f}', f'{found.without_heating.cost:.3f}'

    right = ('right',) * 5
    for known_s in (0.0, 600.0):
        title = ('Reference trip over the chance of charging, '
                 + (f'known {known_s / S_PER_MIN:.0f} min before arrival' if known_s else 'known on arrival'))
        print_records(console, title, ('chance', 'target [degC]', 'before arrival [min]', 'cost', 'unheated'), [
            row(chance_text(p), worth(ChargingProspect(p, known_before_arrival_s=known_s)))
            for p in PROBABILITIES], right)
    print_records(
        console, 'Reference trip over the deviation of the arrival time, charging is certain',
        ('deviation [min]', 'target [degC]', 'before arrival [min]', 'cost', 'unheated'),
        [row(f'{deviation_s / S_PER_MIN:.0f}', worth(ChargingProspect(1.0, deviation_s)))
         for deviation_s in DEVIATIONS_S], right)
    exact = worth(ChargingProspect()).best
    rows = []
    for spread_k in SPREADS_K:
        found = worth(ChargingProspect(), limited_by_coldest_cell(vehicle, spread_k))
        best = found.best
        # The target of a planner that knows nothing of the cells.
        blind = min(found.targets, key=lambda item: abs(item.target_c - exact.target_c))
        rows.append((f'{spread_k:.0f}', f'{best.target_c:.1f}', f'{best.charging_time_s / S_PER_MIN:.2f}',
                     f'{best.cost:.3f}', f'{blind.charging_time_s / S_PER_MIN:.2f}', f'{blind.cost:.3f}'))
    print_records(
        console,
        'Reference trip over the distance of the coldest cell from the mean: best target, and that of no spread',
        ('spread [K]', 'target [degC]', 'charging [min]', 'cost', 'without spread: charging [min]', 'cost '), rows,
        ('right',) * 6)
