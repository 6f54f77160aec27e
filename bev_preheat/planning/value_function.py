# SPDX-License-Identifier: Apache-2.0
"""
Method `value_function`: heat where a kelvin is worth more than it costs.

The two passes of the paper, for every temperature instead of one. Backward from arrival, each step takes the best
of its ends: heater off, heated with the surplus of regeneration, at full power, or a mixture of two:

    V_N(T)     = cost of arriving at T: nothing from the target on, SHORT_PRICE below it
    V_k(T, on) = min over the ends of: battery energy + price of switching on + V_(k+1)(T', heated)

Forward from the battery as it is now, each step takes the end of least cost. Limits, cabin and friction brake
enter with the ends (`limits`), so nothing is searched for afterwards. The passes are repeated along the path that
they find, on narrower and finer temperatures; none makes the plan worse. The state of charge is no axis: it is
that of the path before, and what charge is worth beyond its energy enters as a price. Heat under way is no axis
either: T is the temperature that the battery comes to from the heat already in heater and coolant, and heat of a
step counts as far as it arrives in time.

The reserve of charge comes before the power of climbs, the power of climbs before the target, as docs/explanation/
planning.md says. core/src/value_function.c is the same in C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.native import searches as native_searches
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.bracketing import ARRIVAL_TOLERANCE_K, MOST_TRIALS
from bev_preheat.planning.dynamics import JOULES_PER_WH, limits_of_steps_w, native_vehicle
from bev_preheat.planning.heat_run import heat_to_come_k, initial_states
from bev_preheat.planning.limits import drive_as_planned, make_limited_drive, run_unheated
from bev_preheat.planning.schedule import HeldBack
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.steps_ahead import LACK_TOLERANCE_W, LEAST_HEATING_W, StepEnds, StepsAhead

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray, IntArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip

# Each time that the heater is switched on costs this much, so that no plan switches for less.
SWITCH_ON_WH = 0.5
# A kelvin below the target costs this many times the battery energy that heats by a kelvin, and a joule that the
# battery cannot deliver this many times itself: a plan does not save there. Beyond the temperatures of a pass, a
# kelvin costs this share of its energy.
SHORT_PRICE = 30.0
LACK_PRICE = 2000.0
BEYOND_PRICE = 0.5
# A step that empties the battery [J].
EMPTY_J = 1e12
# The passes: temperatures this far apart, and this far around the path before. The first pass covers from below
# the coldest temperature of the unheated run to above target and start.
FIRST_STEP_K, BELOW_K, ABOVE_K = 0.3, 3.0, 25.0
WIDE_STEP_K, WIDE_K = 0.03, 1.5
NARROW_STEP_K, NARROW_K = 0.004, 0.25
LAST_STEP_K, LAST_K = 0.001, 0.06
PASSES = ((FIRST_STEP_K, 0.0), (WIDE_STEP_K, WIDE_K), (WIDE_STEP_K, WIDE_K), (NARROW_STEP_K, NARROW_K),
          (LAST_STEP_K, LAST_K))
# Most temperatures of an instant.
VALUE_POINTS = 256
# After the first pass, mixtures of two ends are refined this many times.
MIXTURE_HALVINGS = 6
# A pass is made again, at most so many times in all: the first one while the reserve of charge is missed or left
# unused by more than so many kelvin of heating, the others while the path reaches this share of their width.
MOST_LOOKS = 7
NEAR_RESERVE_K = 0.1
EDGE_SHARE = 0.9
# Charge is priced by moving it by this.
PRICED_SOC = 5e-4
# A limit may matter in a step if it does for a battery this much colder, or with this much more or less charge.
WATCHED_BELOW_K = 1.0
WATCHED_SOC = 0.02
# The start of the last interval is moved for an exact arrival if the arrival is as close as this.
MOVED_K = 0.1
# Tolerance on the reserve; plans aim at this much more.
RESERVE_TOLERANCE = 1e-5
SPARE_SOC = 1e-7


def plan_by_values(trip: Trip, state: BatteryState, goal: Goal,
                   unheated: Schedule | None = None) -> Schedule:
    """
    Return the Schedule with the least battery energy that reaches the target within limits.

    `unheated` is not needed; the methods have it in common. If the charge does not carry the trip, only surplus
    heats.
    """
    reserve = reserve_soc(trip.vehicle, goal)
    aimed_soc = reserve + SPARE_SOC if reserve > 0.0 else 0.0
    vehicle, start = native_vehicle(trip.vehicle), initial_states(state)
    if trip.vehicle.heat_path.is_direct:
        start = *start[:2], 0.0, 0.0
    found = None if vehicle is None else native_searches.plan_by_values(
        vehicle, trip.native, goal.target_temperature_c, aimed_soc, state.heater_power_w > LEAST_HEATING_W, start)
    if found is None:
        found = _plan_in_python(
            trip, start, state.heater_power_w > LEAST_HEATING_W, goal.target_temperature_c, aimed_soc)
    if found.command_w is None:
        return run_unheated(trip, state)
    schedule = drive_as_planned(trip, state, found.command_w)
    arrival_c, arrival_soc = float(schedule.temperature_c[-1]), float(schedule.soc[-1])
    is_held_back = arrival_c < goal.target_temperature_c and arrival_soc < reserve + RESERVE_TOLERANCE
    return replace(schedule, held_back=HeldBack.RESERVE) if is_held_back else schedule


def _plan_in_python(trip: Trip, start: States, is_heating: bool, target_c: float,
                    reserve: float) -> native_searches.PlanByValues:
    for lack_price in (LACK_PRICE, 0.0):
        recursion = _Recursion(trip, start, is_heating, target_c, reserve, lack_price)
        command_w = recursion.plan()
        # The reserve comes before the power of climbs.
        if command_w is not None and recursion.states[0, -1] >= reserve - RESERVE_TOLERANCE:
            break
    return native_searches.PlanByValues(command_w)


class _Layer(NamedTuple):
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


class _Mixtures(NamedTuple):
    """The best mixtures (P,): value [J], end, share of the next end, and whether they heat."""

    value_j: FloatArray
    end: IntArray
    share: FloatArray
    is_heating: BoolArray


class _Recursion:
    """The passes for one trip."""

    def __init__(self, trip: Trip, start: States, is_heating: bool, target_c: float, reserve: float,
                 lack_price: float) -> None:
        """Take the States at the start; `lack_price` is the cost of a joule that the battery cannot deliver."""
        vehicle, steps = trip.vehicle, len(trip.route)
        self._trip, self._target_c, self._reserve, self._is_heating = trip, target_c, reserve, is_heating
        self._lack_price = lack_price
        self._joules_per_k = (vehicle.battery.heat_capacity_j_per_k
                              + vehicle.heat_path.coolant_heat_capacity_j_per_k) / vehicle.hvch.efficiency
        self._voltage_v = vehicle.battery.open_circuit_voltage.function(ARRAYS)
        self._ahead = StepsAhead(trip)
        self._drives = [make_limited_drive(trip, takes_surplus) for takes_surplus in (False, True)]
        self.states = np.zeros((4, steps + 1))
        self.states[:, 0] = start
        self._powers_w = np.zeros((4, steps))
        self._price_j, self._path_c = np.zeros(steps + 1), np.zeros(steps + 1)
        self._k_per_watt, self._share_of_excess = heat_to_come_k(vehicle)

    def plan(self) -> FloatArray | None:
        """Return the heater commands [W] (N,); None if the charge does not carry the trip."""
        if not self._drive_commands(None):
            return None
        self._keep_path()
        range_c = self._range_c()
        aim_c, looks, number, is_priced = self._target_c, 0, 0, True
        kept = self.states, self._powers_w
        while number < len(PASSES):
            layers = self._find_values(number, range_c, aim_c, is_priced and number > 0)
            if not self._find_path(layers, 0 if number == 0 else MIXTURE_HALVINGS):
                return None
            if number > 0 and self._cost_j(self.states, self._powers_w, aim_c) > self._cost_j(*kept, aim_c):
                # No pass makes the plan worse: charge may be priced wrongly, as limits bend.
                self.states, self._powers_w = (values.copy() for values in kept)
                number, looks, is_priced = (number, looks, False) if is_priced else (number + 1, 0, True)
                continue
            kept = self.states.copy(), self._powers_w.copy()
            moved_k = self._keep_path()
            # The reserve of charge allows this temperature.
            spare_k = -self._beyond_k(self.states, is_short_of_charge=True)
            is_short = spare_k < 0.0 or aim_c < self._target_c
            if is_short:
                aim_c = min(self._target_c, float(self.states[1, -1]) + spare_k)
            looks += 1
            is_found = (not is_short or abs(spare_k) < NEAR_RESERVE_K if number == 0
                        else moved_k < EDGE_SHARE * PASSES[number][1])
            if is_found or looks >= MOST_LOOKS:
                number, looks, is_priced = number + 1, 0, True
        self._arrive_exactly()
        command_w: FloatArray = self._powers_w[0]
        return command_w

    # Backward.

    def _find_values(self, number: int, range_c: tuple[float, float], aim_c: float,
                     is_priced: bool) -> list[_Layer]:
        """Return the layers of a pass, from the arrival at `aim_c` back; `is_priced`: with the price of charge."""
        grids_c = [self._grid_c(k, number, range_c) for k in range(len(self._path_c))]
        short_j = np.maximum(aim_c - grids_c[-1], 0.0) * self._joules_per_k * SHORT_PRICE
        layers = [_Layer(grids_c[-1], np.array((short_j, short_j)))]
        self._price_j[:] = 0.0
        for k in reversed(range(len(self._trip.route))):
            following = layers[-1]
            watched = self._watched(k, grids_c[k], following.grid_c)
            soc = np.full(len(grids_c[k]), self._soc[k])
            ends = self._ends_ahead(k, soc, grids_c[k], watched, self._lack_price)
            halvings = 0 if number == 0 else MIXTURE_HALVINGS
            values_j = np.array([self._best(ends, following, was_on, halvings).value_j
                                 for was_on in (False, True)])
            layers.append(_Layer(grids_c[k], np.where(ends.is_empty, EMPTY_J, values_j)))
            if is_priced:
                self._price_j[k] = self._price_of_charge(k, following, watched)
        return layers[::-1]

    def _grid_c(self, k: int, number: int, range_c: tuple[float, float]) -> FloatArray:
        """Return the temperatures of a layer [deg C]."""
        step_k, half_k = PASSES[number]
        path_c = float(self._path_c[k])
        low_c, high_c = range_c if number == 0 else (path_c - half_k, path_c + half_k)
        points = (high_c - low_c) / step_k + 2.0
        if points > VALUE_POINTS:
            points, step_k = VALUE_POINTS, (high_c - low_c) / (VALUE_POINTS - 1)
        grid_c: FloatArray = low_c + step_k * np.arange(int(points), dtype=float)
        return grid_c

    def _ends_ahead(self, k: int, soc: FloatArray, settled_c: FloatArray, watched: tuple[bool, bool],
                    lack_price: float) -> StepEnds:
        """Return the ends of step k from charges and temperatures (P,), with the price of charge."""
        ends = self._ahead.ends(k, soc, settled_c, self._under_way_k[k], watched, lack_price)
        return ends._replace(cost_j=ends.cost_j + self._price_j[k + 1] * (ends.soc - self._soc[k + 1]))

    def _best(self, ends: StepEnds, following: _Layer, was_on: bool, halvings: int) -> _Mixtures:
        """Return the best mixtures of two neighbouring ends."""
        count, points = ends.cost_j.shape
        best = _Mixtures(np.full(points, np.inf), np.zeros(points, dtype=int), np.zeros(points),
                         np.zeros(points, dtype=bool))
        column = np.arange(points)

        def better(best: _Mixtures, end: IntArray, share: FloatArray) -> _Mixtures:
            after = np.minimum(end + 1, count - 1)

            def mixed(values: FloatArray) -> FloatArray:
                low: FloatArray = values[end, column]
                mixture: FloatArray = low + share * (values[after, column] - low)
                return mixture

            is_heating = mixed(ends.command_w) > LEAST_HEATING_W
            worth_j = following.worth_j(mixed(ends.settled_c), is_heating, self._joules_per_k)
            switched_j = 0.0 if was_on else SWITCH_ON_WH * JOULES_PER_WH
            value_j = mixed(ends.cost_j) + worth_j + switched_j * is_heating
            is_better = value_j < best.value_j
            return _Mixtures(*(np.where(is_better, new, old) for new, old in zip(
                (value_j, end, share, is_heating), best)))

        for n in range(count):
            end = np.full(points, n)
            best = better(best, end, np.zeros(points))
            if n + 1 < count:
                best = better(best, end, np.full(points, 0.5))
        apart = 0.25
        for _ in range(halvings):
            middle, last = best, count - 1
            has_room = (middle.end < last) & (middle.share + apart < 1.0)
            best = better(best, middle.end, np.where(has_room, middle.share + apart, middle.share))
            is_inside, is_below = middle.share - apart > 0.0, (middle.share == 0.0) & (middle.end > 0)
            below = np.where(is_inside, middle.share - apart, middle.share)
            best = better(best, np.where(is_below, middle.end - 1, middle.end),
                          np.where(is_below, 1.0 - apart, below))
            apart *= 0.5
        return best

    def _price_of_charge(self, k: int, following: _Layer, watched: tuple[bool, bool]) -> float:
        """
        Return what charge at instant k is worth beyond its energy [J]: how the cost on the path changes with it.

        Heated as is best there. That less charge delivers less is left out: heat repairs it, at the price of heat.
        """
        soc = np.array((max(self._soc[k] - PRICED_SOC, PRICED_SOC), min(self._soc[k] + PRICED_SOC, 1.0)))
        path_c = self._path_c[k:k + 1]
        ends = self._ends_ahead(k, self._soc[k:k + 1], path_c, watched, 0.0)
        if not soc[1] > soc[0] or ends.is_empty[0]:
            return 0.0
        best = self._best(ends, following, True, MIXTURE_HALVINGS)
        end, share = int(best.end[0]), float(best.share[0])
        wanted_w, takes_surplus = float(ends.wanted_w[end]), end > 0
        if share > 0.0:
            low_w, high_w = ends.command_w[end, 0], ends.command_w[end + 1, 0]
            wanted_w, takes_surplus = low_w + share * (high_w - low_w), True
        moved = self._ahead.end(k, soc, np.repeat(path_c, 2), self._under_way_k[k], watched, 0.0, wanted_w,
                                takes_surplus)
        most_j = self._joules_per_k * abs(moved.settled_c[0, 1] - moved.settled_c[0, 0])
        warmth_j = np.diff(following.worth_j(moved.settled_c[0], True, self._joules_per_k))[0]
        change_j = np.diff(moved.cost_j[0] + self._price_j[k + 1] * moved.soc[0])[0]
        return float((change_j + np.clip(warmth_j, -most_j, most_j)) / (soc[1] - soc[0]))

    def _watched(self, k: int, grid_c: FloatArray, next_grid_c: FloatArray) -> tuple[bool, bool]:
        """Return whether the charge limit, and the discharge limit, may matter within two layers."""
        trip, soc = self._trip, np.array((self._soc[k:k + 2],) * 2).ravel()
        ends_c = np.array((grid_c[0] - WATCHED_BELOW_K, next_grid_c[0] - WATCHED_BELOW_K,
                           2.0 * grid_c[-1] - grid_c[-2], 2.0 * next_grid_c[-1] - next_grid_c[-2]))
        ends_c = ends_c - np.array((self._under_way_k[k:k + 2],) * 2).ravel()
        idle_w = float(trip.idle_power_w[k])
        _, most_w = self._ahead.limits_w(k, np.maximum(soc - WATCHED_SOC, 0.0), ends_c)
        least_w, _ = self._ahead.limits_w(k, np.minimum(soc + WATCHED_SOC, 1.0), ends_c)
        return (bool(trip.route.propulsion_power_w[k] < 0.0 and not (idle_w >= least_w).all()),
                not (idle_w + float(trip.heater_limit_w[k]) <= most_w).all())

    # Forward.

    def _find_path(self, layers: Sequence[_Layer], halvings: int) -> bool:
        """Take the best end of each step; return whether the charge carries the trip."""
        is_on = self._is_heating
        for k in range(len(self._trip.route)):
            ends = self._ends_driven(k)
            if ends is None:
                return False
            best = self._best(ends, layers[k + 1], is_on, halvings)
            end, share = int(best.end[0]), float(best.share[0])
            wanted_w, takes_surplus = float(ends.wanted_w[end]), end > 0
            if share > 0.0:
                low_w, high_w = ends.command_w[end, 0], ends.command_w[end + 1, 0]
                wanted_w, takes_surplus = float(low_w + share * (high_w - low_w)), False
            if not self._drive(k, wanted_w, takes_surplus):
                return False
            is_on = bool(best.is_heating[0])
        return True

    def _ends_driven(self, k: int) -> StepEnds | None:
        """Return the ends of step k as the vehicle is driven; None if the battery is empty then."""
        trip, start = self._trip, self.states[:, k]
        duration_s, full_w = float(trip.route.duration_s[k]), float(trip.heater_limit_w[k])
        found: list[tuple[float, ...]] = []
        for takes_surplus, wanted_w in ((False, 0.0), (True, 0.0), (True, full_w)):
            if wanted_w == 0.0 and takes_surplus and not (
                    trip.route.propulsion_power_w[k] < 0.0 and self._powers_w[1, k] > 0.0):
                continue
            if takes_surplus and wanted_w > 0.0 and full_w <= LEAST_HEATING_W:
                continue
            if not self._drive(k, wanted_w, takes_surplus):
                if found:
                    break
                return None
            end, powers_w = self.states[:, k + 1], self._powers_w[:, k]
            if found and not powers_w[0] > found[-1][2] + 1.0:
                continue
            drawn_w = powers_w[2]
            cost_j = self._energy_j(start[:2], end[:2])
            cost_j += self._lack_price * duration_s * self._lacking_w(k, drawn_w)
            # Power that the heater is going to draw is paid for with the command.
            cost_j += (powers_w[0] - drawn_w) * duration_s
            cost_j += self._price_j[k + 1] * (end[0] - self._soc[k + 1])
            found.append((cost_j, end[1] + self._to_come_k(k + 1), powers_w[0], end[0], wanted_w))
        cost_j, settled_c, command_w, soc, asked_w = np.array(found).T
        return StepEnds(cost_j[:, None], settled_c[:, None], command_w[:, None], soc[:, None], asked_w,
                        np.zeros(1, dtype=bool))

    def _drive(self, k: int, wanted_w: float, takes_surplus: bool) -> bool:
        """Drive step k; return whether the charge carries it."""
        states, powers_w = self._drives[takes_surplus](k, tuple(self.states[:, k].tolist()), wanted_w)
        self._powers_w[:, k] = powers_w
        self.states[:, k + 1] = states
        return states[0] > 0.0

    def _energy_j(self, start: FloatArray, end: FloatArray) -> float:
        """Return the battery energy between two states: charge and temperature."""
        voltage_v = self._voltage_v(np.array((start[0], end[0])), np.array((start[1], end[1]))).mean()
        return float(self._trip.vehicle.battery.capacity_as * voltage_v * (start[0] - end[0]))

    def _lacking_w(self, k: int, drawn_w: float) -> float:
        """Return the power of the step beyond the discharge limit at either end [W]."""
        _, most_w = self._ahead.limits_w(k, self.states[0, k:k + 2], self.states[1, k:k + 2])
        beyond_w = float(self._trip.idle_power_w[k]) + drawn_w + self._powers_w[1, k] - float(most_w.min())
        return float(beyond_w) if beyond_w > LACK_TOLERANCE_W else 0.0

    def _drive_commands(self, command_w: FloatArray | None, first: int = 0) -> bool:
        """Drive commands [W] (N,) from step `first` on; None: only surplus heats."""
        return all(self._drive(k, 0.0 if command_w is None else float(command_w[k]), command_w is None)
                   for k in range(first, len(self._trip.route)))

    # Between the passes.

    def _to_come_k(self, k: int) -> float:
        """Return the warming by the end of the trip from the heat in heater and coolant at instant k [K]."""
        heater, coolant = self._ahead.arriving_by_the_end(k)
        return float(heater * self._k_per_watt * self.states[2, k]
                     + coolant * self._share_of_excess * self.states[3, k])

    def _keep_path(self) -> float:
        """Keep the run as the path for the next pass; return how far it lies from the path before [K]."""
        before_c = self._path_c
        self._soc = self.states[0].copy()
        self._under_way_k = np.array([self._to_come_k(k) for k in range(len(self._soc))])
        self._path_c = self.states[1] + self._under_way_k
        return float(np.abs(self._path_c - before_c).max())

    def _range_c(self) -> tuple[float, float]:
        highest_c = self._trip.vehicle.battery.temperature_range_c[1]
        return (min(float(self._path_c.min()), self._target_c) - BELOW_K,
                min(max(float(self._path_c[0]), self._target_c) + ABOVE_K, highest_c + BELOW_K))

    def _beyond_k(self, states: FloatArray, is_short_of_charge: bool) -> float:
        """Return how much too warm the battery arrives [K]: for the target, or for the reserve of charge."""
        soc, arrival_c = states[0, -1], states[1, -1]
        if not is_short_of_charge:
            return float(arrival_c - self._target_c)
        voltage_v = self._voltage_v(np.array([soc]), np.array([arrival_c]))[0]
        energy_j = (self._reserve - soc) * self._trip.vehicle.battery.capacity_as * voltage_v
        return float(energy_j / self._joules_per_k)

    def _cost_j(self, states: FloatArray, powers_w: FloatArray, aim_c: float) -> float:
        """Return the cost of a run [J]: battery energy, power deficit, switching on, missed target and reserve."""
        trip, (soc, temperature_c) = self._trip, states[:2]
        voltage_v = self._voltage_v(soc, temperature_c)
        energy_j = trip.vehicle.battery.capacity_as * 0.5 * (voltage_v[1:] + voltage_v[:-1]) @ (soc[:-1] - soc[1:])
        _, most_w = limits_of_steps_w(trip.vehicle, soc, temperature_c, trip.power_variance_w2)
        lacking_w = trip.idle_power_w + powers_w[2] + powers_w[1] - most_w
        lacking_w = np.where(lacking_w > LACK_TOLERANCE_W, lacking_w, 0.0)
        is_on = np.append(self._is_heating, powers_w[0] > LEAST_HEATING_W)
        switched_j = SWITCH_ON_WH * JOULES_PER_WH * float((is_on[1:] & ~is_on[:-1]).sum())
        short_k = max(aim_c - float(temperature_c[-1]), 0.0) + max(self._beyond_k(states, True), 0.0)
        return (float(energy_j) + self._lack_price * float(trip.route.duration_s @ lacking_w) + switched_j
                + SHORT_PRICE * self._joules_per_k * short_k)

    def _arrive_exactly(self) -> None:
        """Move the start of the last interval, so that the arrival is exact."""
        command_w = self._powers_w[0].copy()
        heated, braked = command_w > LEAST_HEATING_W, self._powers_w[1] > 1.0
        starts = np.flatnonzero(heated & ~braked & ~np.append(False, heated[:-1]))
        to_target_k, to_reserve_k = (self._beyond_k(self.states, of_charge) for of_charge in (False, True))
        is_short = to_target_k < 0.0 and to_reserve_k > to_target_k
        excess_k = to_reserve_k if is_short else to_target_k
        if not len(starts) or not abs(excess_k) <= MOVED_K:
            return
        moved_j, next_j = 0.0, -excess_k * self._joules_per_k
        for _ in range(MOST_TRIALS):
            if abs(excess_k) <= ARRIVAL_TOLERANCE_K:
                break
            self._drive_commands(self._with_start_moved(command_w, int(starts[-1]), next_j))
            found_k = self._beyond_k(self.states, is_short)
            slope = (found_k - excess_k) / (next_j - moved_j)
            moved_j, excess_k = next_j, found_k
            if not math.isfinite(slope) or slope == 0.0:
                break
            next_j = moved_j - excess_k / slope

    def _with_start_moved(self, command_w: FloatArray, start: int, more_j: float) -> FloatArray:
        """Return commands with more energy just before `start`, or less from it on [J]."""
        moved_w, left_j = command_w.copy(), abs(more_j)
        steps = range(start, -1, -1) if more_j > 0.0 else range(start, len(command_w))
        for k in steps:
            duration_s = float(self._trip.route.duration_s[k])
            room_w = float(self._trip.heater_limit_w[k]) - moved_w[k] if more_j > 0.0 else moved_w[k]
            taken_j = min(max(room_w, 0.0) * duration_s, left_j)
            moved_w[k] += math.copysign(taken_j / duration_s, more_j)
            left_j -= taken_j
            if left_j <= 0.0:
                break
        return moved_w
