# SPDX-License-Identifier: Apache-2.0
"""
The best target within a range of temperatures, for any value of the state on arrival.

    cost = price · bought energy + value of time · charging time + ageing

Time and energy after an arrival come from the car's session, or from a table of charging times over the arrival
state.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bev_preheat.charging.expectation import spent_wh
from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import ChargingStop, refuse_stranded
from bev_preheat.charging.target_worth import check_prices, Prices, TargetWorth
from bev_preheat.charging.worth_search import TARGET_RESOLUTION_K, targets_between
from bev_preheat.errors import InvalidInput, share_hint
from bev_preheat.files.table import read_table
from bev_preheat.numerics import FLOATS
from bev_preheat.planning.bracketing import scan
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, reserve_soc
from bev_preheat.route.segments import Route
from bev_preheat.tunables import SHORTFALL_TOLERANCE_K, SOC_TOLERANCE
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Vehicle

COLUMNS = ('arrival_soc', 'arrival_temperature_c', 'charging_time_s')
# Bounds of the columns.
LIMITS = ((0.0, 1.0), (-60.0, 100.0), (0.0, 86400.0))


class AfterArrival(NamedTuple):
    """Charging time [s], bought energy [Wh] and ageing after an arrival; infinite if charging never ends."""

    time_s: float
    bought_wh: float
    ageing_cost: float = 0.0
    ageing_outside_share: float = 0.0


def by_session(vehicle: Vehicle, stop: ChargingStop, prices: Prices) -> Callable[[BatteryState], AfterArrival]:
    """Return the AfterArrival of each arrival at a ChargingStop, by the car's session."""
    heating = ChargerHeating(vehicle, stop, prices)

    def after(arrival: BatteryState) -> AfterArrival:
        session = heating.choose(arrival).session
        return AfterArrival(session.charging_time_s, session.bought_energy_wh, session.ageing_cost,
                            0.0 if session.ageing is None else session.ageing.outside_share)

    return after


def by_table(vehicle: Vehicle, times: Table, departure_soc: float) -> Callable[[BatteryState], AfterArrival]:
    """
    Return the AfterArrival of each arrival, by a Table of charging times [s] and the energy stored.

    The table is linear between its points and constant beyond. Raises InvalidInput for a charge not allowed, and
    for a vehicle whose ageing has a price.
    """
    low, high = vehicle.battery.soc_range
    if not low <= departure_soc <= high:
        raise InvalidInput(f'departure state of charge: {departure_soc:g} is not allowed; it must be {low:g} ... '
                           f"{high:g} (the vehicle's soc_range){share_hint(departure_soc)}")
    if vehicle.charging is not None and vehicle.charging.ageing is not None:
        raise InvalidInput('charging.ageing: a table of charging times has no temperatures for the model of '
                           'ageing; leave out the key or the table')
    time_s = times.function(FLOATS)

    def after(arrival: BatteryState) -> AfterArrival:
        return AfterArrival(time_s(arrival.soc, arrival.temperature_c), spent_wh(
            vehicle, arrival.soc, arrival.temperature_c, max(departure_soc - arrival.soc, 0.0)))

    return after


def read_charging_times(path: str | Path) -> Table:
    """
    Return the charging times [s] over state of charge and battery temperature [deg C] on arrival, of a table file.

    It has the columns COLUMNS and one row for each pair. Raises InvalidInput naming file, column and value.
    """
    table = read_table(path)
    missing = [name for name in COLUMNS if name not in table.header]
    if missing:
        raise InvalidInput(f'{path}: has no column {", ".join(missing)}; it must have {", ".join(COLUMNS)}')
    soc, temperature_c, time_s = columns = [table.numbers(name) for name in COLUMNS]
    problems = [f'{path}: {name}: {value:g} is not allowed; it must be {low:g} ... {high:g}'
                for name, values, (low, high) in zip(COLUMNS, columns, LIMITS)
                for value in values[~((low <= values) & (values <= high))][:1]]
    rows, columns_c = np.unique(soc), np.unique(temperature_c)
    values = np.full((len(rows), len(columns_c)), np.nan)
    values[np.searchsorted(rows, soc), np.searchsorted(columns_c, temperature_c)] = time_s
    if not problems and (len(soc) != values.size or np.isnan(values).any()):
        problems.append(f'{path}: {len(soc)} rows for {len(rows)} states of charge and {len(columns_c)} '
                        'temperatures; each pair must have one row')
    if problems:
        raise InvalidInput(problems)
    return Table(tuple(rows.tolist()), tuple(columns_c.tolist()), tuple(map(tuple, values.tolist())))


def targets_in_range(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, range_c: tuple[float, float],
                     after: Callable[[BatteryState], AfterArrival], prices: Prices) -> list[TargetWorth]:
    """
    Return the TargetWorth of each target tried between two temperatures [deg C], the cheapest first.

    The goal gives the reserve on arrival. The cost is infinite if the arrival is colder than the range, has less
    charge than the reserve, or is never charged. A battery that arrives warm is not heated. Raises InvalidInput.
    """
    low_c, high_c = range_c
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    if not lowest_c <= low_c <= high_c <= highest_c:
        raise InvalidInput(f'target range: {low_c:g} ... {high_c:g} degC is not allowed; it must rise within '
                           f"{lowest_c:g} ... {highest_c:g} degC, the range of the vehicle's battery")
    check_situation(vehicle, route, state, goal)
    check_prices(prices)
    unheated = plan_unheated(vehicle, route, state, goal)
    refuse_stranded(unheated)
    found: dict[float, TargetWorth] = {}

    def cost_at(target_c: float) -> float:
        if target_c not in found:
            plan = unheated if target_c <= unheated.arrival_temperature_c else plan_preheating(
                vehicle, route, state, replace(goal, target_temperature_c=target_c, heats_until_arrival=True))
            is_short = (plan.arrival_temperature_c < low_c - SHORTFALL_TOLERANCE_K
                        or plan.arrival_soc < reserve_soc(vehicle, goal) - SOC_TOLERANCE)
            charged = after(plan.arrival_state)
            found[target_c] = TargetWorth(
                target_c, plan.arrival_temperature_c, plan.arrival_soc, plan.energy_wh.hvch_electric,
                charged.time_s, charged.bought_wh,
                math.inf if is_short else (
                    prices.cost(charged.bought_wh, charged.time_s) + charged.ageing_cost),
                ageing_cost=charged.ageing_cost, ageing_outside_share=charged.ageing_outside_share)
        return found[target_c].cost

    first_c = max(low_c, unheated.arrival_temperature_c)
    scan([first_c, *targets_between(first_c, high_c)], cost_at, TARGET_RESOLUTION_K)
    return sorted(found.values(), key=lambda item: (item.cost, item.target_c))
