# SPDX-License-Identifier: Apache-2.0
"""
The ends of a step from many temperatures at once, within the limits: the steps of `value_function`, run backward.

As `limits`, vectorised over temperatures: the limits at the end are found in rounds, each under those to which the
one before led. Heat of the heater acts at once, as far as it arrives before the trip ends.
"""
from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import AnyNumber, ARRAYS, BoolArray, FloatArray, IntArray
from bev_preheat.planning.heat_run import heat_to_come_k, heated_heat_capacity_j_per_k, mean_share_left
from bev_preheat.planning.limited_drive import Foresight
from bev_preheat.tunables import (
    BELOW_HIGHEST_K,
    BEYOND_PRICE,
    END_TOLERANCE_W,
    HALVINGS,
    HIGHEST_TOLERANCE_K,
    LACK_TOLERANCE_W,
    LEAST_HEATING_W,
    LEAST_MIXED_SHARE,
    MOST_SPREAD,
    MOST_TRIALS,
    ROUNDING_W,
    SHORT_PRICE,
)
from bev_preheat.vehicle.model import heat_under_w, hottest_c, make_rates, make_runge_kutta_4, make_terminal_limits

if TYPE_CHECKING:
    from bev_preheat.planning.trip import Trip


class StepEnds(NamedTuple):
    """
    Ends (E) of a step from temperatures (P), in the order of their heat; the first `colds` ones cool.

    Battery energy with the price of a power deficit [J], temperature with the heat under way [deg C], heater
    command and electrical power of the heat sources [W], charge, and the command that was asked for [W], each
    (E, P); whether the battery is empty then (P,).
    """

    cost_j: FloatArray
    settled_c: FloatArray
    command_w: FloatArray
    drawn_w: FloatArray
    soc: FloatArray
    wanted_w: FloatArray
    is_empty: BoolArray
    colds: int = 0


class StepsAhead:
    """The steps of one trip."""

    def __init__(self, trip: Trip, price: FloatArray) -> None:
        """Take the Trip, and factors of the battery energy of its steps (N,)."""
        vehicle, path = trip.vehicle, trip.vehicle.heat_path
        self._trip, self._vehicle, self._price = trip, vehicle, price
        self._step = make_runge_kutta_4(make_rates(vehicle, ARRAYS))
        self._limits = make_terminal_limits(vehicle, ARRAYS)
        self._voltage_v = vehicle.battery.open_circuit_voltage.function(ARRAYS)
        self._highest_c, self._hottest_c = vehicle.battery.temperature_range_c[1], hottest_c(vehicle)
        self._lag_s, self._coolant_lag_s = path.heat_lag_s, path.coolant_lag_s
        self._foresight = Foresight(trip, ARRAYS) if path.heater_lag_s > 0.0 else None
        battery_j_per_k = vehicle.battery.heat_capacity_j_per_k
        both_j_per_k = heated_heat_capacity_j_per_k(vehicle)
        self._battery_j_per_k = battery_j_per_k
        self._joules_per_k = battery_j_per_k / vehicle.hvch.efficiency
        duration_s = trip.route.duration_s
        self._left_s = float(trip.time_s[-1]) - trip.time_s
        # The share of a step's heat in the battery, and of its heat from the heater, in the battery at the end; of
        # heat that enters a shell, how much less.
        self._kept_share, self._arriving_share = np.ones(len(duration_s)), np.ones(len(duration_s))
        self._drained_share = np.zeros(len(duration_s))
        # Of its heat from the heater, the share that is still under way at its end and arrives; of the heater's
        # energy, the share that it draws later.
        self.late_share, self.due_share = np.zeros(len(duration_s)), mean_share_left(path, duration_s)
        if self._coolant_lag_s > 0.0:
            self._kept_share = 1.0 + heat_to_come_k(vehicle)[1] * np.expm1(
                -(self._left_s[1:] + 0.5 * duration_s) / self._coolant_lag_s)
        if self._lag_s > 0.0:
            mean_left = -np.expm1(-duration_s / self._lag_s) * self._lag_s / duration_s
            self._arriving_share = battery_j_per_k / both_j_per_k * (
                1.0 - np.exp(-self._left_s[1:] / self._lag_s) * mean_left)
            self.late_share = battery_j_per_k / both_j_per_k * mean_left * -np.expm1(
                -self._left_s[1:] / self._lag_s)
        if path.is_shell:
            # All heat but Joule heat enters the shell, and leaks more than from the core.
            held = 1.0 / (1.0 + trip.leakage_w_per_k * (1.0 - path.shell_share) / path.coolant_conductance_w_per_k)
            self._drained_share = self._kept_share - held * (self._kept_share - np.exp(
                -(self._left_s[1:] + 0.5 * duration_s) / self._coolant_lag_s))
            self._arriving_share *= held

    def limits_w(self, k: int, soc: FloatArray, temperature_c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and most terminal power [W] of step k at states, each of their shape."""
        return self._limits(soc, temperature_c, np.full(len(soc), self._trip.power_variance_w2[k]))

    def arriving_by_the_end(self, k: int) -> tuple[float, float]:
        """Return the shares of the heat in heater and coolant at instant k that reach the battery in time."""
        left_s = float(self._left_s[k])
        return (-math.expm1(-left_s / self._lag_s) if self._lag_s > 0.0 else 1.0,
                -math.expm1(-left_s / self._coolant_lag_s) if self._coolant_lag_s > 0.0 else 0.0)

    def ends(self, k: int, soc: FloatArray, settled_c: FloatArray, under_way_k: float,
             watched: tuple[bool, bool], lack_price: float) -> StepEnds:
        """
        Return the StepEnds from charges and temperatures (P,): off, with the surplus, at full power.

        With several heat sources the best one, the two best and so on take the place of full power; those that
        cool come before off. `settled_c` includes the heat under way; `watched`: the charge and the discharge
        limit may matter; `lack_price`: the cost of a joule that the battery cannot deliver.
        """
        full_w = float(self._trip.heater_limit_w[k])
        merit = self._trip.mix.at(k, settled_c - under_way_k)
        warm: list[tuple[AnyNumber, bool]] = [*([(0.0, True)] if watched[0] else []), *(
            [(command_w, True) for command_w in merit.ends_w or [full_w]] if full_w > LEAST_HEATING_W else [])]
        cold: list[tuple[AnyNumber, bool]] = [(command_w, False) for command_w in merit.cold_ends_w]
        off = self.end(k, soc, settled_c, under_way_k, watched, lack_price, 0.0, False)
        found = [off]
        for sign, kinds in (-1.0, cold), (1.0, warm):
            before = off
            for wanted_w, takes_surplus in kinds:
                end = self.end(k, soc, settled_c, under_way_k, watched, lack_price, wanted_w, takes_surplus)
                # A step that empties the battery, or is the same as the one before, is left out.
                is_other = (sign * end.command_w[0] > sign * before.command_w[0] + ROUNDING_W) & ~end.is_empty
                if is_other.any():
                    before = StepEnds._make([
                        *(np.where(is_other, new, old) for new, old in zip(end[:5], before[:5])), end.wanted_w,
                        off.is_empty, 0])
                    found.insert(len(found) if sign > 0.0 else 0, before)
        return StepEnds._make([*map(np.concatenate, zip(*(each[:6] for each in found))), off.is_empty,
                               next(place for place, each in enumerate(found) if each is off)])

    def end(self, k: int, soc: FloatArray, settled_c: FloatArray, under_way_k: FloatArray | float,
            watched: tuple[bool, bool], lack_price: float, wanted_w: AnyNumber, takes_surplus: bool) -> StepEnds:
        """Return the one end (E = 1) under a wanted heater power [W], with surplus or without."""
        trip, vehicle = self._trip, self._vehicle
        (duration_s, idle_w, variance_w2, idle_heat_w, leakage_w_per_k, full_w, propulsion_w) = (
            float(column[k]) for column in (
                trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w,
                trip.leakage_w_per_k, trip.heater_limit_w, trip.route.propulsion_power_w))
        start_c = settled_c - under_way_k
        may_overcharge = watched[0]
        is_cold, merit = start_c < self._highest_c, trip.mix.at(k, start_c)
        asked_w, cap_w = (merit.capped_w(np.where(is_cold | (power_w < 0.0), power_w, 0.0)) for power_w in (
            np.minimum(wanted_w, full_w), np.array(full_w)))
        foresight, in_time_w, lasting_w = self._foresight, None, None
        if foresight is not None:
            in_time_w = foresight.off_in_time_w(k, soc, start_c, 0.0)
            lasting_w = foresight.lasting_surplus_w(k, soc, start_c) if may_overcharge and takes_surplus else None
        all_w = np.zeros(len(soc))
        least_w, most_w = self.limits_w(k, soc, start_c) if any(watched) else (all_w - np.inf, all_w + np.inf)
        first_w, coolest_w = (least_w, most_w), all_w + np.inf

        def driven(command_w: FloatArray, brake_w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            end_soc, end_c, _, joule_w = self._step(
                soc, start_c, all_w + duration_s, idle_w + merit.electric_w(command_w) + brake_w,
                all_w + variance_w2,
                heat_under_w(vehicle, idle_heat_w, command_w, brake_w), all_w + leakage_w_per_k)
            return end_soc, end_c, joule_w

        for _ in range(MOST_TRIALS):
            room_w = np.maximum(most_w - idle_w, 0.0)
            command_w = asked_w if not any(watched) else np.clip(
                asked_w, merit.cold_w(room_w), merit.heat_w(room_w))
            paid_w = command_w
            if may_overcharge and takes_surplus:
                surplus_w = merit.heat_w(least_w - idle_w)
                if lasting_w is not None:
                    surplus_w = np.where(surplus_w > 0.0, np.minimum(surplus_w, lasting_w), surplus_w)
                free_w = np.minimum(cap_w, surplus_w)
                is_free = command_w <= free_w
                command_w, paid_w = np.where(is_free, free_w, command_w), np.where(is_free, 0.0, paid_w)
            if in_time_w is not None:
                command_w = np.clip(command_w, 0.0, np.maximum(in_time_w, 0.0))
            command_w = np.minimum(command_w, coolest_w)
            brake_w = (np.clip(least_w - idle_w - merit.electric_w(command_w), 0.0, max(-propulsion_w, 0.0))
                       if may_overcharge else all_w)
            end_soc, end_c, joule_w = driven(command_w, brake_w)
            # Near the highest temperature surplus goes to the brake.
            beyond_k = end_c - np.where(
                command_w > paid_w, self._highest_c - BELOW_HIGHEST_K, self._highest_c)
            is_hot = (beyond_k > HIGHEST_TOLERANCE_K) & (command_w > 0.0)
            coolest_w = np.where(is_hot, np.maximum(
                command_w - beyond_k * self._joules_per_k / duration_s, 0.0), coolest_w)
            is_settled = not is_hot.any()
            if any(watched):
                before_w = least_w, most_w
                end_least_w, end_most_w = self.limits_w(
                    k, np.clip(end_soc, 0.0, 1.0), np.minimum(end_c, self._hottest_c))
                least_w, most_w = np.maximum(first_w[0], end_least_w), np.minimum(first_w[1], end_most_w)
                is_settled &= np.allclose((least_w, most_w), before_w, rtol=0.0, atol=END_TOLERANCE_W)
            if is_settled:
                break
        if (end_soc > 1.0).any():
            brake_w = self._brake_when_full_w(brake_w, max(-propulsion_w, 0.0), end_soc > 1.0,
                                              lambda braked_w: driven(command_w, braked_w)[0])
            end_soc, end_c, joule_w = driven(command_w, brake_w)
        drawn_w = merit.electric_w(command_w)
        terminal_w = idle_w + drawn_w + brake_w
        is_empty = ~(end_soc > 0.0)
        end_soc, end_c = np.clip(end_soc, 0.0, 1.0), np.minimum(end_c, self._hottest_c)
        price = float(self._price[k])
        # No heating exceeds the highest temperature; a drive that does is a reason to cool.
        hot_k = np.maximum(end_c - self._highest_c, 0.0) if trip.mix.cools else all_w
        cost_j = price * (terminal_w + joule_w) * duration_s
        if any(watched):
            voltage_v = 0.5 * (self._voltage_v(soc, start_c) + self._voltage_v(end_soc, end_c))
            cost_j = price * vehicle.battery.capacity_as * voltage_v * (soc - end_soc)
        if watched[1] and lack_price > 0.0:
            _, end_most_w = self.limits_w(k, end_soc, end_c)
            lacking_w = terminal_w - np.minimum(first_w[1], end_most_w)
            cost_j = cost_j + lack_price * duration_s * np.where(lacking_w > LACK_TOLERANCE_W, lacking_w, 0.0)
        heater_k = vehicle.hvch.efficiency * duration_s / self._battery_j_per_k * command_w
        outer_k = duration_s / self._battery_j_per_k * (idle_heat_w - leakage_w_per_k * start_c)
        ahead_c = (settled_c + self._kept_share[k] * (end_c - start_c - heater_k)
                   - self._drained_share[k] * outer_k + self._arriving_share[k] * heater_k)
        cost_j = cost_j + SHORT_PRICE * self._joules_per_k * hot_k
        return StepEnds(cost_j[None], ahead_c[None], command_w[None], drawn_w[None], end_soc[None],
                        (wanted_w + all_w)[None], is_empty)

    @staticmethod
    def _brake_when_full_w(brake_w: FloatArray, most_w: float, is_full: BoolArray,
                           soc_under: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the brake power [W]; of a full battery, with what would overfill it."""
        enough_w, too_little_w = np.where(is_full, most_w, brake_w), brake_w
        for _ in range(HALVINGS):
            middle_w = 0.5 * (enough_w + too_little_w)
            is_enough = soc_under(middle_w) <= 1.0
            enough_w = np.where(is_enough & is_full, middle_w, enough_w)
            too_little_w = np.where(is_enough, too_little_w, middle_w)
        return enough_w


def direction_of(power_w: FloatArray) -> IntArray:
    """Return the direction of heat under powers [W]: 1 heats, -1 cools, 0 is off, each of their shape."""
    direction: IntArray = np.sign(power_w).astype(int) * (np.abs(power_w) > LEAST_HEATING_W)
    return direction


class Layer(NamedTuple):
    """Values [J] at one instant: temperatures (P,) [deg C], rows for a heater that was off and that was on."""

    grid_c: FloatArray
    values_j: FloatArray

    def worth_j(self, settled_c: FloatArray, is_on: BoolArray | bool, joules_per_k: float) -> FloatArray:
        """Return the value of temperatures; outside the layer the path must come back."""
        grid_c = self.grid_c
        place = (settled_c - grid_c[0]) / (grid_c[1] - grid_c[0])
        below = np.clip(place.astype(int), 0, len(grid_c) - 2)
        row_j = np.where(is_on, self.values_j[1, below], self.values_j[0, below])
        next_j = np.where(is_on, self.values_j[1, below + 1], self.values_j[0, below + 1])
        inside_j = row_j + np.clip(place - below, 0.0, 1.0) * (next_j - row_j)
        below_k, above_k = np.maximum(grid_c[0] - settled_c, 0.0), np.maximum(settled_c - grid_c[-1], 0.0)
        value_j: FloatArray = inside_j + (2.0 * SHORT_PRICE * below_k + BEYOND_PRICE * above_k) * joules_per_k
        return value_j

    def spread(self, variance_k2: float) -> Layer:
        """Return the values averaged over a deviation in temperature, of this variance [K^2]."""
        values_j, left = self.values_j.copy(), variance_k2 / (self.grid_c[1] - self.grid_c[0]) ** 2
        while left > 0.0:
            share = 0.5 * min(left, MOST_SPREAD)
            values_j[:, 1:-1] += share * (values_j[:, :-2] - 2.0 * values_j[:, 1:-1] + values_j[:, 2:])
            left -= MOST_SPREAD
        return self._replace(values_j=values_j)


class _Mixtures(NamedTuple):
    """Mixtures of two neighbouring ends from temperatures (P,): value [J], end, and share of the next end."""

    value_j: FloatArray
    end: IntArray
    share: FloatArray

    def with_better(self, value_j: FloatArray, end: int, share: FloatArray | float) -> _Mixtures:
        """Return the better of these and others from one end."""
        is_better = value_j < self.value_j
        return _Mixtures(np.where(is_better, value_j, self.value_j), np.where(is_better, end, self.end),
                         np.where(is_better, share, self.share))


class Choice(NamedTuple):
    """The mixture to take from one temperature: end, share of the next end, and 1: they heat, -1: cool, 0."""

    end: int
    share: float
    direction: int

    def takes_surplus(self, ends: StepEnds) -> bool:
        """Return whether regeneration beyond the charge limit heats."""
        return self.end > ends.colds and self.share == 0.0

    def wanted_w(self, ends: StepEnds) -> float:
        """Return the command that leads there [W]."""
        if self.share > 0.0:
            low_w, high_w = ends.command_w[self.end, 0], ends.command_w[self.end + 1, 0]
            return float(low_w + self.share * (high_w - low_w))
        return float(ends.wanted_w[self.end, 0])


class Best(NamedTuple):
    """The best mixtures that neither heat nor cool, that heat and that cool: without the price of switching on."""

    unheated: _Mixtures
    heated: _Mixtures
    cooled: _Mixtures

    def value_j(self, switch_on_j: float) -> FloatArray:
        """Return the value at a price of switching on [J]."""
        value_j: FloatArray = np.minimum(self.unheated.value_j, np.minimum(
            self.heated.value_j, self.cooled.value_j) + switch_on_j)
        return value_j

    def only(self, before: int, switch_on_j: float) -> Choice:
        """Return the Choice at the one temperature after a direction of heat: the other one is switched on."""
        better = min((0, -1, 1), key=lambda direction: self[direction].value_j[0] + (
            0.0 if direction in (0, before) else switch_on_j))
        return Choice(int(self[better].end[0]), float(self[better].share[0]), better)


def best_of(ends: StepEnds, following: Layer, joules_per_k: float, is_mixed: bool) -> Best:
    """
    Return the best of a step's ends and, if `is_mixed`, of their mixtures.

    Between two ends, the best lies at a temperature of the next layer, as values are straight in between.
    """
    points = ends.cost_j.shape[1]
    none = _Mixtures(np.full(points, np.inf), np.zeros(points, dtype=int), np.zeros(points))
    best = Best(none, none, none)
    rows = list(zip(*ends[:3]))
    for end, (cost_j, settled_c, command_w) in enumerate(rows):
        direction = direction_of(command_w)
        value_j = cost_j + following.worth_j(settled_c, direction != 0, joules_per_k)
        best = Best._make(each.with_better(np.where(direction == at, value_j, np.inf), end, 0.0)
                          for at, each in zip((0, 1, -1), best))
    for end, (low, high) in enumerate(zip(rows, rows[1:]) if is_mixed else ()):
        cost_j, settled_c, command_w = (row[:, None] for row in low)
        more_j, wide_k, more_w = (next_row[:, None] - row[:, None] for row, next_row in zip(low, high))
        share = (following.grid_c - settled_c) / np.where(wide_k > 0.0, wide_k, np.nan)
        least_w = np.maximum(LEAST_HEATING_W, LEAST_MIXED_SHARE * np.maximum(
            np.abs(command_w), np.abs(command_w + more_w)))
        is_between = (share > 0.0) & (share <= 1.0) & (np.abs(command_w + share * more_w) > least_w)
        value_j = np.where(is_between, cost_j + share * more_j + following.values_j[1], np.inf)
        found = value_j.argmin(axis=1)[:, None]
        at = 1 if end >= ends.colds else -1
        mixed = best[at].with_better(np.take_along_axis(value_j, found, 1)[:, 0], end,
                                     np.take_along_axis(share, found, 1)[:, 0])
        best = best._replace(**{Best._fields[at]: mixed})
    return best
