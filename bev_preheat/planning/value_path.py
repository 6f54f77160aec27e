# SPDX-License-Identifier: Apache-2.0
"""
The path of the pass before, and prices of what departs from it: `value_function` has axes for neither.

Charge and heat under way are those of the path. The worth of charge beyond its energy, the cost of heat that
arrives late, and the power that a heater is still to draw are prices beside it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.heat_run import heat_to_come_k
from bev_preheat.planning.steps_ahead import best_of, StepsAhead
from bev_preheat.tunables import HEATING_PRICE, PRICED_K, PRICED_SOC, WATCHED_BELOW_K, WATCHED_SOC

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.steps_ahead import Layer, StepEnds
    from bev_preheat.planning.trip import Trip
    from bev_preheat.planning.value_run import ValueRun


class ValuePath:
    """
    Charge, temperature with the heat under way, and that heat [K], at each instant (N + 1,) of the path.

    `price_j` is the worth of charge beyond its energy [J], `late_price_j` the cost of a kelvin under way [J].
    """

    def __init__(self, trip: Trip, run: ValueRun, lack_price: float) -> None:
        """Take the Trip and its run; `lack_price` is the cost of a joule that the battery cannot deliver."""
        steps = len(trip.route)
        self._trip, self._run, self._lack_price = trip, run, lack_price
        self._ahead = StepsAhead(trip, run.price)
        self.soc, self.settled_c, self.under_way_k = np.zeros((3, steps + 1))
        self.price_j, self.late_price_j = np.zeros((2, steps + 1))
        self._due_price = np.ones(steps + 1)
        self._watched = [(True, True)] * steps
        # The most that charge is worth for the power of a step from the latest instant on [J], in a backward pass.
        self._for_power_j = 0.0
        self._k_per_watt, self._share_of_excess = heat_to_come_k(trip.vehicle)

    def take_last(self, other: ValuePath) -> None:
        """Take the prices of a path whose last steps are those of this trip."""
        steps = len(self._trip.route)
        self._watched = other._watched[-steps:]
        self.soc, self.price_j, self.late_price_j, self._due_price = (
            values[-steps - 1:] for values in (other.soc, other.price_j, other.late_price_j, other._due_price))

    def keep(self) -> float:
        """Take the run as the path for the next pass; return how far it lies from the path before [K]."""
        before_c = self.settled_c
        self.soc = self._run.states[0].copy()
        self.under_way_k = self.all_to_come_k()
        self.settled_c = self._run.states[1] + self.under_way_k
        if self._trip.vehicle.heat_path.heater_lag_s > 0.0:
            self._price_what_is_due()
        return float(np.abs(self.settled_c - before_c).max())

    def to_come_k(self, k: int) -> float:
        """Return the warming by the end of the trip from the heat under way in the run at instant k [K]."""
        heater, coolant = self._ahead.arriving_by_the_end(k)
        states = self._run.states
        return float(heater * self._k_per_watt * states[2, k] + coolant * self._share_of_excess * states[3, k])

    def all_to_come_k(self) -> FloatArray:
        """Return `to_come_k` of all instants (N + 1,) [K]."""
        return np.array([self.to_come_k(k) for k in range(len(self.soc))])

    def ends(self, k: int, soc: FloatArray, settled_c: FloatArray, under_way_k: float,
             lack_price: float | None = None) -> StepEnds:
        """Return the ends of step k from charges and temperatures (P,), at their prices."""
        ahead, vehicle = self._ahead, self._trip.vehicle
        lack_price = self._lack_price if lack_price is None else lack_price
        ends = ahead.ends(k, soc, settled_c, under_way_k, self._watched[k], lack_price)
        cost_j = ends.cost_j + self.price_j[k + 1] * (ends.soc - self.soc[k + 1])
        # Power that the heater draws later is paid for later; and late heat costs where limits miss it.
        heater_j = ends.command_w * float(self._trip.route.duration_s[k])
        cost_j = cost_j + ahead.due_share[k] * (heater_j * self._due_price[k + 1] - (cost_j - cost_j[0]))
        late_k = ahead.late_share[k] * heater_j * vehicle.hvch.efficiency / vehicle.battery.heat_capacity_j_per_k
        return ends._replace(cost_j=cost_j + self.late_price_j[k + 1] * late_k
                             + HEATING_PRICE * self._run.price[k]
                             * (ends.drawn_w * float(self._trip.route.duration_s[k])))

    def forget_prices(self) -> None:
        """Price neither charge nor heat under way."""
        self.price_j[:], self.late_price_j[:], self._for_power_j = 0.0, 0.0, 0.0

    def price(self, k: int, following: Layer) -> None:
        """Price charge and heat under way at instant k."""
        self.price_j[k] = self._price_of_charge(k, following)
        if self._watched[k][1] and self._lack_price > 0.0:
            # Charge that is worth so much for a later step is there for this one, too.
            for_power_j = self._worth_for_power_j(k)
            self.price_j[k] -= max(for_power_j - self._for_power_j, 0.0)
            self._for_power_j = max(for_power_j, self._for_power_j)
        if self._trip.vehicle.heat_path.heat_lag_s > 0.0:
            self.late_price_j[k] = self._price_of_lateness(k, following)

    def watch(self, k: int, grid_c: FloatArray, next_grid_c: FloatArray) -> None:
        """Find out whether the charge limit, and the discharge limit, may matter within two layers of step k."""
        trip, soc = self._trip, np.array((self.soc[k:k + 2],) * 2).ravel()
        ends_c = np.array((grid_c[0] - WATCHED_BELOW_K, next_grid_c[0] - WATCHED_BELOW_K,
                           2.0 * grid_c[-1] - grid_c[-2], 2.0 * next_grid_c[-1] - next_grid_c[-2]))
        ends_c = ends_c - np.array((self.under_way_k[k:k + 2],) * 2).ravel()
        idle_w = float(trip.idle_power_w[k])
        _, most_w = self._ahead.limits_w(k, np.maximum(soc - WATCHED_SOC, 0.0), ends_c)
        least_w, _ = self._ahead.limits_w(k, np.minimum(soc + WATCHED_SOC, 1.0), ends_c)
        self._watched[k] = (bool(trip.route.propulsion_power_w[k] < 0.0 and not (idle_w >= least_w).all()),
                            not (idle_w + float(trip.drawing_limit_w[k]) <= most_w).all())

    def _ends_beside(self, k: int, following: Layer, soc: FloatArray, moved_k: FloatArray | float,
                     lack_price: float) -> StepEnds | None:
        """
        Return the end of step k, heated as is best on the path, from two starts (2,) beside it.

        Their charges, and how much more heat has arrived in their battery [K]; None if the battery is empty then.
        """
        path_c = self.settled_c[k:k + 1]
        ends = self.ends(k, self.soc[k:k + 1], path_c, self.under_way_k[k], lack_price)
        if ends.is_empty[0]:
            return None
        choice = best_of(ends, following, self._run.joules_per_k, self._run.is_certain).only(0, 0.0)
        beside = self._ahead.end(
            k, soc, np.repeat(path_c, 2), self.under_way_k[k] - moved_k, self._watched[k], lack_price,
            choice.wanted_w(ends), choice.end + choice.share > ends.colds)
        return None if beside.is_empty.any() else beside._replace(
            cost_j=beside.cost_j + self.price_j[k + 1] * beside.soc)

    def _price_of_charge(self, k: int, following: Layer) -> float:
        """
        Return what charge at instant k is worth beyond its energy [J]: how the cost on the path changes with it.

        Heated as is best there. That less charge delivers less is left out: heat repairs it, at the price of heat.
        """
        soc = np.array((max(self.soc[k] - PRICED_SOC, PRICED_SOC), min(self.soc[k] + PRICED_SOC, 1.0)))
        beside = self._ends_beside(k, following, soc, 0.0, 0.0) if soc[1] > soc[0] else None
        if beside is None:
            return 0.0
        return self._change_beside_j(following, beside) / float(soc[1] - soc[0])

    def _worth_for_power_j(self, k: int) -> float:
        """
        Return the worth of charge for the power of step k [J].

        That is the cost of the missing power without it, at most the heat that would replace it: if heat can,
        because it costs charge.
        """
        idle_w = float(self._trip.idle_power_w[k])
        less_w, more_w = (self._most_beside_w(k, more_soc, 0.0) for more_soc in (-PRICED_SOC, PRICED_SOC))
        if not idle_w > less_w or not more_w > less_w:
            return 0.0
        lacking_j = self._lack_price * float(self._trip.route.duration_s[k]) * (
            idle_w - less_w - max(idle_w - more_w, 0.0))
        voltage_v = self._run.voltage_v(self.soc[k:k + 1], self.settled_c[k:k + 1])[0]
        soc_per_k = self._run.joules_per_k / (self._trip.vehicle.battery.capacity_as * voltage_v)
        per_k_w = (self._most_beside_w(k, 0.0, PRICED_K) - self._most_beside_w(k, 0.0, -PRICED_K)
                   ) / (2.0 * PRICED_K) - soc_per_k * (more_w - less_w) / (2.0 * PRICED_SOC)
        repaired_j = self._run.joules_per_k * (more_w - less_w) / per_k_w if per_k_w > 0.0 else math.inf
        return min(lacking_j, repaired_j) / (2.0 * PRICED_SOC)

    def _most_beside_w(self, k: int, more_soc: float, more_k: float) -> float:
        """Return the most power of step k at both ends of the path, with more charge or warmth there [W]."""
        soc = np.clip(self.soc[k:k + 2] + more_soc, PRICED_SOC, 1.0)
        temperature_c = self.settled_c[k:k + 2] - self.under_way_k[k:k + 2] + more_k
        return float(self._ahead.limits_w(k, soc, temperature_c)[1].min())

    def _price_of_lateness(self, k: int, following: Layer) -> float:
        """Return the cost of a kelvin under way at instant k [J]: a colder battery has tighter limits."""
        beside = self._ends_beside(
            k, following, self.soc[[k, k]], np.array((-PRICED_K, PRICED_K)), self._lack_price)
        if beside is None:
            return 0.0
        change_j = -self._change_beside_j(following, beside)
        lag_s = self._trip.vehicle.heat_path.heat_lag_s
        left = math.exp(-float(self._trip.route.duration_s[k]) / lag_s)
        return float(np.clip(0.5 * change_j / PRICED_K + left * self.late_price_j[k + 1],
                             -self._run.joules_per_k, self._run.joules_per_k))

    def _change_beside_j(self, following: Layer, beside: StepEnds) -> float:
        """Return how much more the second end costs [J]; heat repairs a difference in warmth, at its price."""
        ahead_c = beside.settled_c[0]
        most_j = self._run.joules_per_k * abs(ahead_c[1] - ahead_c[0])
        warmth_j = np.diff(following.worth_j(ahead_c, True, self._run.joules_per_k))[0]
        return float(np.diff(beside.cost_j[0])[0] + np.clip(warmth_j, -most_j, most_j))

    def _price_what_is_due(self) -> None:
        """Price a joule that the heater is still to draw: the battery pays what surplus does not cover."""
        trip, lag_s = self._trip, self._trip.vehicle.heat_path.heater_lag_s
        for k in reversed(range(len(trip.route))):
            full_w, paid = float(trip.heater_limit_w[k]), 1.0
            left = math.exp(-float(trip.route.duration_s[k]) / lag_s)
            if trip.route.propulsion_power_w[k] < 0.0 and full_w > 0.0:
                least_w, _ = self._ahead.limits_w(k, self.soc[[k]], self._run.states[1, [k]])
                paid = 1.0 - min(max((float(least_w[0]) - float(trip.idle_power_w[k])) / full_w, 0.0), 1.0)
            self._due_price[k] = (1.0 - left) * paid + left * self._due_price[k + 1]
