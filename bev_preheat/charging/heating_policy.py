# SPDX-License-Identifier: Apache-2.0
"""
The cheapest heating at a charger, from every battery state at once, by dynamic programming.

    V(s, T) = min over off, hold and full power of [ rate · time + V(s + Delta s, T') ],  V(s_departure, T) = 0
    rate = price · (P_c + P_aux + P_cabin + P_h) + value of time + price of ageing

The rows are states of charge, because the charge only rises; the columns are battery temperatures. Within a row
the temperature follows the session's own equations. Full power pays below some temperature, so the result is a
`HeatingLimit`, which holds from every state, whatever happened before (but where a battery is so dear that heat,
which raises the current, makes plating worse in the cold: there the limit may cost 1 % too much). Heat arrives at
once here; with a heat path the temperature is that with the heat under way, and the heat capacity includes the
coolant's.
"""
from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
import math
from math import inf
from typing import NamedTuple

import numpy as np

from bev_preheat.charging.ageing import cost_per_s
from bev_preheat.charging.equations import heater_power_of, make_charging_rates, make_cooling, supply_of
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.numerics import ARRAYS, FloatArray, JOULES_PER_WH, S_PER_H, WH_PER_KWH
from bev_preheat.planning.heat_run import heated_heat_capacity_j_per_k
from bev_preheat.vehicle.charging import charging_of, vehicle_at_charger
from bev_preheat.vehicle.description import DIRECT, Vehicle
from bev_preheat.vehicle.model import hottest_c, idle_heat_w, make_rates


@dataclass(frozen=True)
class HeatingLimit:
    """
    A limit of heating over the state of charge: the car heats its battery while it is colder.

    `soc` (N,) rises (0 ... 1); `temperature_c` (N,) [deg C] is linear between its points and constant beyond them.
    Without points the car's own limit holds. The car never heats above its own limit.
    """

    soc: tuple[float, ...] = ()
    temperature_c: tuple[float, ...] = ()

    def shifted(self, by_k: float) -> HeatingLimit:
        """Return the limit, higher by this [K]."""
        return HeatingLimit(self.soc, tuple(limit_c + by_k for limit_c in self.temperature_c))

    def function(self, highest_c: float) -> Callable[[float], float]:
        """Return `f(soc)` [deg C], at most `highest_c`; -inf if that is the car's way to say never."""
        if not self.soc or highest_c == -inf:
            return lambda soc: highest_c
        socs, limits_c, last = self.soc, self.temperature_c, len(self.soc) - 1
        if min(limits_c) >= highest_c:
            return lambda soc: highest_c
        first_c, last_c = (min(limits_c[place], highest_c) for place in (0, last))

        def limit_c(soc: float) -> float:
            place = bisect_right(socs, soc)
            if place == 0:
                return first_c
            if place > last:
                return last_c
            low_soc, low_c = socs[place - 1], limits_c[place - 1]
            return min(highest_c, low_c + (limits_c[place] - low_c) * (soc - low_soc) / (socs[place] - low_soc))

        return limit_c


ALWAYS = HeatingLimit()
NEVER = HeatingLimit((0.0,), (-inf,))


# Spacing of the grid [K] up to the car's limit of heating, and above it, where only the unheated battery matters.
COLUMN_K, HOT_COLUMN_K = 0.5, 2.0
ROWS = 120
# A lane that warms by more than this [K] within a row is followed column by column.
MOST_RISE_K = 1.5
# The slowest charging [1/s]: a battery that is not charged at all stays for longer than any session.
SLOWEST_PER_S = 1e-9
# Below the coldest column: never.
NEVER_K = 1.0


class _Action(NamedTuple):
    """One power of the heater over a row, by state: time and rise of the temperature, and its cost."""

    time_s: FloatArray
    rise_k: FloatArray
    cost: FloatArray


@dataclass(frozen=True, eq=False)
class HeatingPolicy:
    """
    The HeatingLimit of the cheapest heating, and estimates of the costs by state.

    Rows of the costs are the states of charge `soc` (N,), columns the temperatures `columns_c` (M,) [deg C];
    `cost_never` and `cost_always` (N, M) are those of no heating, and of heating up to the car's own limit.
    """

    limit: HeatingLimit
    soc: FloatArray
    columns_c: FloatArray
    cost_never: FloatArray
    cost_always: FloatArray

    def cost_at(self, costs: FloatArray, soc: float, temperature_c: float) -> float:
        """Return a cost of `costs` (N, M), interpolated at a state of charge and a temperature [deg C]."""
        row = min(max(int(np.searchsorted(self.soc, soc)), 1), len(self.soc) - 1)
        before, after = (float(np.interp(temperature_c, self.columns_c, costs[place])) for place in (row - 1, row))
        share = (soc - self.soc[row - 1]) / (self.soc[row] - self.soc[row - 1])
        return before + float(share) * (after - before)


def find_policy(vehicle: Vehicle, stop: ChargingStop, prices: Prices, from_soc: float,
                from_c: float) -> HeatingPolicy | None:
    """Return the HeatingPolicy for arrivals from a charge and temperature up; None: nothing to heat or charge."""
    limit_c = charging_of(vehicle).heated_below_c
    heater_w = heater_power_of(vehicle, stop)
    coldest_c = min(from_c, stop.ambient_c) - COLUMN_K
    if heater_w <= 0.0 or limit_c <= coldest_c or from_soc >= stop.departure_soc:
        return None
    columns = math.ceil((limit_c - coldest_c) / COLUMN_K) + 1
    heated_c = np.linspace(coldest_c, limit_c, columns)
    hot_c = np.arange(limit_c + HOT_COLUMN_K, hottest_c(vehicle) + HOT_COLUMN_K, HOT_COLUMN_K)
    soc = np.linspace(from_soc, stop.departure_soc, ROWS + 1)
    table = _Table(vehicle, stop, prices, soc, np.concatenate([heated_c, hot_c]), columns)
    return table.policy()


class _Table:
    """The costs of a row's actions, and the limit that follows from them."""

    def __init__(self, vehicle: Vehicle, stop: ChargingStop, prices: Prices, soc: FloatArray,
                 columns_c: FloatArray, heated: int) -> None:
        """Compute the actions at all states; the first `heated` columns are up to the limit of heating."""
        self._soc, self._columns_c, self._heated = soc, columns_c, heated
        self._row_soc = float(soc[1] - soc[0])
        vehicle = vehicle_at_charger(vehicle)
        battery = replace(vehicle.battery, heat_capacity_j_per_k=heated_heat_capacity_j_per_k(vehicle))
        car = replace(vehicle, battery=battery, heat_path=DIRECT)
        self._efficiency, self._heat_j_per_k = car.hvch.efficiency, battery.heat_capacity_j_per_k
        self._leakage_w_per_k = battery.leakage.coefficient_w_per_k(0.0)
        self._idle_heat_w = idle_heat_w(self._leakage_w_per_k, stop.ambient_c, 0.0)
        self._side_w = stop.cabin_heating_power_w + stop.auxiliary_power_w
        self._supply_w, self._heater_w = supply_of(car, stop), heater_power_of(car, stop)
        self._per_j = prices.energy_per_kwh / (WH_PER_KWH * JOULES_PER_WH)
        self._per_s, self._ageing = prices.time_per_h / S_PER_H, charging_of(car).ageing
        self._rates = make_charging_rates(
            charging_of(car).power_limit.function(ARRAYS),
            make_cooling(charging_of(car).cooling, stop.ambient_c, ARRAYS), make_rates(car, ARRAYS), ARRAYS)
        middle = np.repeat(0.5 * (soc[:-1] + soc[1:])[:, None], len(columns_c), axis=1)
        states_c = np.repeat(columns_c[None, :], len(soc) - 1, axis=0)
        self._middle_soc, self._states_c = middle, states_c
        self._off = self._action(np.zeros_like(middle))
        full_w = np.where(states_c < columns_c[heated - 1], self._heater_w, 0.0)
        self._full = self._action(full_w)
        _, rate_k_per_s, _ = self._at(states_c, np.zeros_like(middle))
        holding_w = np.clip(-rate_k_per_s * self._heat_j_per_k / self._efficiency, 0.0, full_w.max())
        self._holds = (rate_k_per_s <= 0.0) & (holding_w < self._heater_w)
        self._hold = self._action(np.where(self._holds, holding_w, 0.0))

    def _at(self, temperature_c: FloatArray, heater_w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the rates of charge [1/s] and temperature [K/s], and the power into battery and cooling [W]."""
        soc_per_s, rate_k_per_s, powers = self._rates(
            self._middle_soc, temperature_c, heater_w - self._supply_w, 0.0,
            self._idle_heat_w + self._efficiency * heater_w, self._leakage_w_per_k)
        return np.maximum(soc_per_s, SLOWEST_PER_S), rate_k_per_s, powers.terminal_w + powers.cooling_w

    def _action(self, heater_w: FloatArray) -> _Action:
        """Return the _Action of heater powers [W], with the rates at the middle of the row."""
        soc_per_s, rate_k_per_s, _ = self._at(self._states_c, heater_w)
        rise_k = self._rise_k(rate_k_per_s, self._row_soc / soc_per_s)
        middle_c = np.clip(self._states_c + 0.5 * np.clip(rise_k, -MOST_RISE_K, MOST_RISE_K),
                           self._columns_c[0], self._columns_c[-1])
        soc_per_s, middle_rate_k_per_s, terminal_w = self._at(middle_c, heater_w)
        time_s = self._row_soc / soc_per_s
        # The rate at the middle is the mean rate of a short rise; a long rise levels off.
        is_short = np.abs(rise_k) <= MOST_RISE_K
        rise_k = np.where(is_short, middle_rate_k_per_s * time_s, self._rise_k(rate_k_per_s, time_s))
        return _Action(time_s, rise_k, time_s * (
            self._per_j * (terminal_w + self._side_w + heater_w) + self._per_s
            + cost_per_s(self._ageing, self._middle_soc, middle_c, soc_per_s)))

    def _rise_k(self, rate_k_per_s: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return the rise of the temperature [K] in a time [s], towards the temperature at which it settles."""
        constant_s = self._heat_j_per_k / self._leakage_w_per_k if self._leakage_w_per_k else np.inf
        if not np.isfinite(constant_s):
            return rate_k_per_s * time_s
        return rate_k_per_s * constant_s * -np.expm1(-time_s / constant_s)

    def policy(self) -> HeatingPolicy:
        """Return the HeatingPolicy, from the last row back to the first."""
        columns_c, heated = self._columns_c, self._heated
        rows, last = len(self._soc) - 1, heated - 1
        costs, never, always = (np.zeros((rows + 1, len(columns_c))) for _ in range(3))
        limits_c = np.empty(rows)
        for row in reversed(range(rows)):
            off, hold = self._unheated(row, costs[row + 1]), self._held(row, costs[row + 1])
            full = self._fully_heated(row, costs[row + 1], np.minimum(off, hold))
            limits_c[row] = _crossing_c(columns_c[:heated], (full - off)[:heated])
            costs[row] = np.minimum(np.minimum(off, hold), full)
            never[row] = self._unheated(row, never[row + 1])
            otherwise = self._unheated(row, always[row + 1])
            if self._holds[row, last]:
                otherwise[last] = self._held(row, always[row + 1])[last]
            always[row] = self._fully_heated(row, always[row + 1], otherwise, must=True)
        middle = 0.5 * (self._soc[:-1] + self._soc[1:])
        return HeatingPolicy(HeatingLimit(tuple(middle.tolist()), tuple(limits_c.tolist())), self._soc, columns_c,
                             never, always)

    def _unheated(self, row: int, cost: FloatArray) -> FloatArray:
        unheated: FloatArray = self._off.cost[row] + self._later(cost, self._columns_c + self._off.rise_k[row])
        return unheated

    def _held(self, row: int, cost: FloatArray) -> FloatArray:
        held: FloatArray = np.where(self._holds[row], self._hold.cost[row] + cost, np.inf)
        return held

    def _later(self, cost: FloatArray, temperature_c: FloatArray) -> FloatArray:
        return np.interp(temperature_c, self._columns_c, cost)

    def _fully_heated(self, row: int, cost: FloatArray, otherwise: FloatArray, must: bool = False) -> FloatArray:
        """
        Return the cost of full power in a row, up to the limit and held there.

        `otherwise` is the cost without full power; it may replace full power within the row unless it `must` heat.
        """
        columns_c, last = self._columns_c, self._heated - 1
        rise_k, price = self._full.rise_k[row], self._full.cost[row]
        room_k = columns_c[last] - columns_c
        with np.errstate(divide='ignore', invalid='ignore'):
            share = np.where(rise_k > room_k, np.clip(room_k / rise_k, 0.0, 1.0), 1.0)
        at_limit = otherwise[last]
        full = share * price + np.where(share < 1.0, (1.0 - share) * at_limit + share * cost[last],
                                        self._later(cost, columns_c + rise_k))
        full[last:] = otherwise[last:]
        # Lanes that warm much within the row: to the next column, from the warmest down.
        best = otherwise.copy()
        for column in reversed(np.flatnonzero(rise_k[:last] > MOST_RISE_K).tolist()):
            width_k = columns_c[column + 1] - columns_c[column]
            part = float(width_k / rise_k[column])
            after = column + 1
            best[after] = full[after] if must else min(otherwise[after], full[after])
            full[column] = part * price[column] + (1.0 - part) * best[after] + part * cost[after]
        heated: FloatArray = full
        return heated


def _crossing_c(columns_c: FloatArray, more_cost: FloatArray) -> float:
    """Return the highest temperature [deg C] below which full power costs less, or one below all columns."""
    pays = np.flatnonzero(more_cost < 0.0)
    if not len(pays):
        return float(columns_c[0]) - NEVER_K
    place = int(pays[-1])
    if place + 1 >= len(columns_c) - 1:
        return float(columns_c[-1])
    below, above = float(more_cost[place]), float(more_cost[place + 1])
    share = below / (below - above) if above > 0.0 else 1.0
    return float(columns_c[place] + share * (columns_c[place + 1] - columns_c[place]))
