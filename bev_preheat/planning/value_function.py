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
either: T is the temperature that the battery comes to from the heat already in heater and coolant; the battery is
colder by the heat under way on the path before. Heat that arrives late has a price for that, and so has power that
the heater is still to draw.

With an Uncertainty the passes take an expectation: the drive will turn out warmer or colder than forecast, and the
values of an instant are averaged over that before the step that leads there. So the plan heats earlier where being
late costs more than being early, and the lead shrinks as the rest of the drive does. Heating is then whole steps,
and only its end is moved for an exact arrival: the plan is made again long before it has been driven.

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
from bev_preheat.planning.kept_values import KeptValues, Requirements
from bev_preheat.planning.limits import drive_as_planned, make_limited_drive, run_unheated
from bev_preheat.planning.no_regret import NO_WORSE_W
from bev_preheat.planning.schedule import ended_within, HeldBack
from bev_preheat.planning.situation import reserve_soc, Uncertainty
from bev_preheat.planning.steps_ahead import LACK_TOLERANCE_W, LEAST_HEATING_W, StepEnds, StepsAhead
from bev_preheat.planning.unlimited import switch_within_limits

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray, IntArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip

# Each time that the heater is switched on costs this much, so that no plan switches for less.
SWITCH_ON_WH = 0.5
# … and this much under an Uncertainty, in which each update may switch: chosen on `preheat robustness`.
SWITCH_ON_EXPECTED_WH = 30.0
# A joule that the heater takes costs this much by itself [J]: surplus that brings less goes to the brake.
HEATING_PRICE = 0.02
# A mixture of two ends has at least this share of the next one's power: no heater is kept on with little power.
LEAST_SHARE = 0.1
# A kelvin below the target costs this many times the battery energy that heats by a kelvin, and a joule that the
# battery cannot deliver this many times itself: a plan does not save there. Beyond the temperatures of a pass, a
# kelvin costs this share of its energy.
SHORT_PRICE = 30.0
# Under an Uncertainty the first part of a kelvin [K] costs less: no heater is switched on again for so little.
NEAR_K, NEAR_PRICE = 0.2, 2.0
LACK_PRICE = 2000.0
BEYOND_PRICE = 0.5
# A step that empties the battery [J].
EMPTY_J = 1e12
# The passes: temperatures this far apart, and this far around the path before. The first pass covers from below
# the coldest temperature of the unheated run to above target and start.
FIRST_STEP_K, BELOW_K, ABOVE_K = 0.5, 3.0, 25.0
WIDE_STEP_K, WIDE_K = 0.1, 1.5
NARROW_STEP_K, NARROW_K = 0.01, 0.15
LAST_STEP_K, LAST_K = 0.001, 0.015
PASSES = ((FIRST_STEP_K, 0.0), (WIDE_STEP_K, WIDE_K), (WIDE_STEP_K, WIDE_K), (NARROW_STEP_K, NARROW_K),
          (LAST_STEP_K, LAST_K))
# Under an Uncertainty so many passes are made, wider by this many of its standard deviations. A pass spreads
# values by at most this share of its temperatures' distance squared at once.
EXPECTED_PASSES = 3
WIDER_DEVIATIONS = 2.5
MOST_SPREAD = 0.9
# Temperatures of a ValueTable are this far apart.
TABLE_STEP_K = 0.03
# Most temperatures of an instant.
VALUE_POINTS = 128
# The core drives a step from three temperatures of a stretch of at most this width in which the same limits act,
# and lays a parabola through their ends; the end from a fourth one is as near to it as this, in cost and warmth.
STRETCH_K = 6.0
STRETCH_J = 10.0
# A pass is made again, at most so many times in all: the first one while the aim, lowered for the reserve of
# charge, moves by more than so many kelvin, the others while the path reaches this share of their width and that
# saves more than so much.
MOST_LOOKS = 7
NEAR_RESERVE_K = 0.1
EDGE_SHARE = 0.9
LOOK_WH = 0.25
# Charge is priced by moving it by this.
PRICED_SOC = 5e-4
PRICED_K = 0.3
# A limit may matter in a step if it does for a battery this much colder, or with this much more or less charge.
WATCHED_BELOW_K = 1.0
WATCHED_SOC = 0.02
# The start of the last interval is moved for an exact arrival if the arrival is as close as this; or its end,
# under an Uncertainty, also by the heat of a whole step.
MOVED_K = 1.0
# Tolerance on the reserve; plans aim at this much more.
RESERVE_TOLERANCE = 1e-5
SPARE_SOC = 1e-7


def plan_by_values(trip: Trip, state: BatteryState, goal: Goal,
                   unheated: Schedule | None = None, uncertainty: Uncertainty | None = None,
                   price: FloatArray | None = None, kept: KeptValues | None = None) -> Schedule:
    """
    Return the Schedule with the least battery energy that reaches the target within limits.

    Without an active limit it is the Schedule of `optimal_switch`. With an Uncertainty it has the least expected
    energy, of a plan that is made again on the way. `price` (N,) are factors of the battery energy of the steps,
    such as shares of the highest price. `unheated` is the Schedule without any heating, ignoring limits, if known.
    `kept` has the values of an earlier plan of the drive, and takes those of this one.
    If the charge does not carry the trip, only surplus heats.
    """
    if uncertainty is None:
        switched = switch_within_limits(trip, state, goal, unheated) if price is None else None
        if switched is not None:
            return switched
        uncertainty = Uncertainty(0.0, is_heating=state.heater_power_w > LEAST_HEATING_W)
    reserve = reserve_soc(trip.vehicle, goal)
    aimed_soc = reserve + SPARE_SOC if reserve > 0.0 else 0.0
    start = initial_states(state)
    if trip.vehicle.heat_path.is_direct:
        start = *start[:2], 0.0, 0.0
    wanted = Requirements(goal.target_temperature_c, aimed_soc, uncertainty, price)
    found, values = None, None if kept is None else kept.that_hold(trip, wanted)
    if isinstance(values, native_searches.NativeValues):
        found = _plan_in_core(trip, start, wanted, values)
    elif isinstance(values, _Recursion):
        found = _Recursion(trip, start, wanted, LACK_PRICE).followed(values)
    if found is None:
        found = _plan_in_core(trip, start, wanted) or _plan_in_python(trip, start, wanted)
        if kept is not None:
            kept.keep(trip, wanted, found.values)
    if found.command_w is None:
        return run_unheated(trip, state)
    schedule = drive_as_planned(trip, state, found.command_w)
    if found.ends_in is not None:
        schedule = ended_within(trip, schedule, found.ends_in)
    arrival_c, arrival_soc = float(schedule.temperature_c[-1]), float(schedule.soc[-1])
    is_held_back = arrival_c < goal.target_temperature_c and arrival_soc < reserve + RESERVE_TOLERANCE
    return replace(schedule, held_back=HeldBack.RESERVE) if is_held_back else schedule


def _plan_in_core(trip: Trip, start: States, wanted: Requirements,
                  values: native_searches.NativeValues | None = None) -> native_searches.PlanByValues | None:
    vehicle, uncertainty = native_vehicle(trip.vehicle), wanted.uncertainty
    return None if vehicle is None else native_searches.plan_by_values(
        vehicle, trip.native, start, wanted.target_c, wanted.reserve, uncertainty.deviation_k,
        uncertainty.is_heating, wanted.price, values)


def _plan_in_python(trip: Trip, start: States, wanted: Requirements) -> native_searches.PlanByValues:
    for lack_price in (LACK_PRICE, 0.0):
        recursion = _Recursion(trip, start, wanted, lack_price)
        command_w = recursion.plan()
        # The reserve comes before the power of climbs, and heat for a climb may cost the charge that it needs.
        if recursion.unheated_lack_w == 0.0 or (
                command_w is not None and recursion.states[0, -1] >= wanted.reserve - RESERVE_TOLERANCE
                and recursion.lack_w() <= recursion.unheated_lack_w + NO_WORSE_W):
            break
    return native_searches.PlanByValues(command_w, recursion.ends_in, recursion)


class ValueTable(NamedTuple):
    """
    Costs of the rest of a trip, for each instant and temperature: `values_j` [J] (N + 1, P).

    `temperature_c` (P,) [deg C] includes the heat under way; `joules_per_k` is the heater's energy for a kelvin.
    """

    temperature_c: FloatArray
    values_j: FloatArray
    joules_per_k: float


def value_table(trip: Trip, state: BatteryState, goal: Goal) -> ValueTable | None:
    """
    Return the ValueTable over the whole range, with the charge of the plan: for pictures and for study.

    The heater was off before each instant. None if the charge does not carry the trip.
    """
    certain = Uncertainty(0.0, state.heater_power_w > LEAST_HEATING_W)
    recursion = _Recursion(trip, initial_states(state), Requirements(
        goal.target_temperature_c, reserve_soc(trip.vehicle, goal), certain), LACK_PRICE)
    return None if recursion.plan() is None else recursion.table()


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

    def spread(self, variance_k2: float) -> _Layer:
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


class _Best(NamedTuple):
    """The best mixtures that do not heat, and that do: without the price of switching on."""

    unheated: _Mixtures
    heated: _Mixtures
    switch_on_j: float

    def value_j(self, was_on: bool) -> FloatArray:
        """Return the value, of heater off or on before."""
        value_j: FloatArray = np.minimum(
            self.unheated.value_j, self.heated.value_j + (0.0 if was_on else self.switch_on_j))
        return value_j

    def only(self, was_on: bool) -> tuple[int, float, bool]:
        """Return end, share of the next end, and whether they heat, for the one temperature."""
        is_heating = bool(
            self.unheated.value_j[0] > self.heated.value_j[0] + (0.0 if was_on else self.switch_on_j))
        mixture = self.heated if is_heating else self.unheated
        return int(mixture.end[0]), float(mixture.share[0]), is_heating


class _Recursion:
    """The passes for one trip."""

    def __init__(self, trip: Trip, start: States, wanted: Requirements, lack_price: float) -> None:
        """Take the States at the start; `lack_price` is the cost of a joule that the battery cannot deliver."""
        vehicle, steps = trip.vehicle, len(trip.route)
        self._trip, self._lack_price = trip, lack_price
        self._target_c, self._reserve, uncertainty = wanted.target_c, wanted.reserve, wanted.uncertainty
        self._price = np.ones(steps) if wanted.price is None else wanted.price
        self._deviation_k, self._is_heating = uncertainty.deviation_k, uncertainty.is_heating
        self._is_certain = not uncertainty.deviation_k > 0.0
        self._switch_on_j = JOULES_PER_WH * (SWITCH_ON_WH if self._is_certain else SWITCH_ON_EXPECTED_WH)
        # The largest power deficit of the unheated run [W].
        self.unheated_lack_w = 0.0
        self._joules_per_k = (vehicle.battery.heat_capacity_j_per_k
                              + vehicle.heat_path.coolant_heat_capacity_j_per_k) / vehicle.hvch.efficiency
        self._voltage_v = vehicle.battery.open_circuit_voltage.function(ARRAYS)
        self._ahead = StepsAhead(trip, self._price)
        self._drives = [make_limited_drive(trip, takes_surplus) for takes_surplus in (False, True)]
        self.states = np.zeros((4, steps + 1))
        self.states[:, 0] = start
        self._powers_w = np.zeros((4, steps))
        self._path_c, self._soc = np.zeros(steps + 1), np.zeros(steps + 1)
        self._due_price = np.ones(steps + 1)
        self._price_j, self._late_price_j = np.zeros(steps + 1), np.zeros(steps + 1)
        self._watched_steps = [(True, True)] * steps
        self._layers: list[_Layer] = []
        # The step to which an edge was moved at last; that in which heating ends, if that was moved there.
        self._moved_in = 0
        self.ends_in: int | None = None
        self._k_per_watt, self._share_of_excess = heat_to_come_k(vehicle)

    def plan(self) -> FloatArray | None:
        """Return the heater commands [W] (N,); None if the charge does not carry the trip."""
        if not self._drive_commands(None):
            return None
        self._keep_path()
        self.unheated_lack_w = self.lack_w()
        range_c = self._range_c()
        aim_c, looks, number, is_priced = self._target_c, 0, 0, True
        kept = self.states.copy(), self._powers_w.copy()
        while number < (len(PASSES) if self._is_certain else EXPECTED_PASSES):
            self._layers = self._find_values(number, range_c, aim_c, is_priced and number > 0)
            saved_j = 0.0
            if not self._find_path():
                saved_j = -math.inf
            elif number > 0 and self._is_certain:
                saved_j = self._cost_j(*kept, aim_c) - self._cost_j(self.states, self._powers_w, aim_c)
            if saved_j < 0.0:
                # No pass makes the plan worse: charge may be priced wrongly, as limits bend.
                self.states, self._powers_w = (values.copy() for values in kept)
                if number == 0 and looks < MOST_LOOKS:
                    # The charge does not carry so much heat.
                    aim_c, looks = 0.5 * (aim_c + float(self.states[1, -1])), looks + 1
                    continue
                number, looks, is_priced = (number, looks, False) if is_priced else (number + 1, 0, True)
                continue
            kept = self.states.copy(), self._powers_w.copy()
            moved_k = self._keep_path()
            # The reserve of charge allows this temperature.
            spare_k = -self._beyond_k(self.states, is_short_of_charge=True)
            is_short = spare_k < 0.0 or aim_c < self._target_c
            aimed_c = aim_c
            if is_short:
                aim_c = min(self._target_c, float(self.states[1, -1]) + spare_k)
            looks += 1
            is_found = (abs(aim_c - aimed_c) < NEAR_RESERVE_K if number == 0 else
                        moved_k < EDGE_SHARE * PASSES[number][1] or saved_j < LOOK_WH * JOULES_PER_WH)
            if is_found or looks >= MOST_LOOKS:
                number, looks, is_priced = number + 1, 0, True
        return self._finished(aim_c)

    def _finished(self, aim_c: float) -> FloatArray:
        """Return the commands of the run [W] (N,), which arrives exactly unless that costs more."""
        kept = self.states.copy(), self._powers_w.copy()
        self._arrive_exactly()
        if self._cost_j(self.states, self._powers_w, aim_c) > self._cost_j(*kept, aim_c):
            # The heat beyond the target was for limits on the way.
            self.states, self._powers_w, self.ends_in = *kept, None
        command_w: FloatArray = self._powers_w[0]
        return command_w

    def followed(self, kept: _Recursion) -> native_searches.PlanByValues | None:
        """
        Return the plan from the values of an earlier one, whose last steps are those of this trip: forward only.

        None if they do not lead to a plan: something is short, or it leaves the temperatures that have values.
        """
        steps = len(self._trip.route)
        if not kept.is_to_be_followed():
            return None
        self._layers, self._watched_steps = kept._layers[-steps - 1:], kept._watched_steps[-steps:]
        self._soc, self._due_price = kept._soc[-steps - 1:], kept._due_price[-steps - 1:]
        self._price_j, self._late_price_j = kept._price_j[-steps - 1:], kept._late_price_j[-steps - 1:]
        if not self._find_path():
            return None
        middle_c = np.array([0.5 * (layer.grid_c[0] + layer.grid_c[-1]) for layer in self._layers])
        settled_c = self.states[1] + np.array([self._to_come_k(k) for k in range(steps + 1)])
        if np.abs(settled_c - middle_c).max() > WIDE_K:
            return None
        command_w = self._finished(self._target_c)
        return native_searches.PlanByValues(command_w, self.ends_in) if self.is_to_be_followed() else None

    def is_to_be_followed(self) -> bool:
        """Return whether the values lead from other states, too: they are wide, and nothing is short."""
        return (not self._is_certain and self.unheated_lack_w == 0.0
                and self._beyond_k(self.states, is_short_of_charge=True) <= 0.0)

    def lack_w(self) -> float:
        """Return the largest power deficit of the run [W]."""
        return float(self._lacking_along_w(self.states, self._powers_w).max())

    # Backward.

    def table(self) -> ValueTable:
        """Return the values over the whole range, with the charge of the last pass."""
        range_c = self._range_c()
        grids_c = [np.arange(*range_c, TABLE_STEP_K)] * len(self._path_c)
        layers = self._find_values(1, range_c, self._target_c, True, grids_c)
        return ValueTable(layers[0].grid_c, np.array([layer.values_j[0] for layer in layers]), self._joules_per_k)

    def _find_values(self, number: int, range_c: tuple[float, float], aim_c: float,
                     is_priced: bool, grids_c: Sequence[FloatArray] = ()) -> list[_Layer]:
        """Return the layers of a pass, from the arrival at `aim_c` back; `is_priced`: charge and lateness are."""
        grids_c = grids_c or [self._grid_c(k, number, range_c) for k in range(len(self._path_c))]
        short_k = np.maximum(aim_c - grids_c[-1], 0.0)
        near_k = 0.0 if self._is_certain else np.minimum(short_k, NEAR_K)
        short_j = (SHORT_PRICE * short_k - (SHORT_PRICE - NEAR_PRICE) * near_k) * self._joules_per_k
        layers = [_Layer(grids_c[-1], np.array((short_j, short_j)))]
        self._price_j[:], self._late_price_j[:] = 0.0, 0.0
        for k in reversed(range(len(self._trip.route))):
            following = layers[-1] = layers[-1].spread(self._variance_k2(k)) if number > 0 else layers[-1]
            self._watched_steps[k] = self._watched(k, grids_c[k], following.grid_c)
            ends = self._ends_ahead(
                k, np.full(len(grids_c[k]), self._soc[k]), grids_c[k], self._under_way_k[k], self._lack_price)
            best = self._best(ends, following)
            values_j = np.array([best.value_j(was_on) for was_on in (False, True)])
            layers.append(_Layer(grids_c[k], np.where(ends.is_empty, EMPTY_J, values_j)))
            if is_priced:
                self._price_j[k] = self._price_of_charge(k, following)
                if self._trip.vehicle.heat_path.heat_lag_s > 0.0:
                    self._late_price_j[k] = self._price_of_lateness(k, following)
        return layers[::-1]

    def _variance_k2(self, k: int) -> float:
        """Return how much less is uncertain about the arrival at the end of step k than at its start [K^2]."""
        left_s = self._trip.time_s[-1] - self._trip.time_s[[0, k, k + 1]]
        return float(self._deviation_k ** 2 * (left_s[1] ** 2 - left_s[2] ** 2) / left_s[0] ** 2)

    def _grid_c(self, k: int, number: int, range_c: tuple[float, float]) -> FloatArray:
        """Return the temperatures of a layer [deg C]."""
        step_k, half_k = PASSES[number]
        half_k += WIDER_DEVIATIONS * self._deviation_k
        path_c = float(self._path_c[k])
        low_c, high_c = range_c if number == 0 else (path_c - half_k, path_c + half_k)
        points = (high_c - low_c) / step_k + 2.0
        if points > VALUE_POINTS:
            points, step_k = VALUE_POINTS, (high_c - low_c) / (VALUE_POINTS - 1)
        grid_c: FloatArray = low_c + step_k * np.arange(int(points), dtype=float)
        return grid_c

    def _ends_ahead(self, k: int, soc: FloatArray, settled_c: FloatArray, under_way_k: float,
                    lack_price: float) -> StepEnds:
        """Return the ends of step k from charges and temperatures (P,), at their prices."""
        ahead, vehicle = self._ahead, self._trip.vehicle
        ends = ahead.ends(k, soc, settled_c, under_way_k, self._watched_steps[k], lack_price)
        cost_j = ends.cost_j + self._price_j[k + 1] * (ends.soc - self._soc[k + 1])
        # Power that the heater draws later is paid for later; and late heat costs where limits miss it.
        heater_j = ends.command_w * float(self._trip.route.duration_s[k])
        cost_j = cost_j + ahead.due_share[k] * (heater_j * self._due_price[k + 1] - (cost_j - cost_j[0]))
        late_k = ahead.late_share[k] * heater_j * vehicle.hvch.efficiency / vehicle.battery.heat_capacity_j_per_k
        return ends._replace(cost_j=cost_j + self._late_price_j[k + 1] * late_k
                             + HEATING_PRICE * self._price[k] * heater_j)

    def _best(self, ends: StepEnds, following: _Layer) -> _Best:
        """
        Return the best mixtures of an end and the next one.

        Between the ends, the best lies at a temperature of the next layer, as values are straight in between.
        """
        points = ends.cost_j.shape[1]
        none = _Mixtures(np.full(points, np.inf), np.zeros(points, dtype=int), np.zeros(points))
        unheated, heated = none, none
        rows = list(zip(*ends[:3]))
        for end, (cost_j, settled_c, command_w) in enumerate(rows):
            is_heating = command_w > LEAST_HEATING_W
            value_j = cost_j + following.worth_j(settled_c, is_heating, self._joules_per_k)
            heated = heated.with_better(np.where(is_heating, value_j, np.inf), end, 0.0)
            unheated = unheated.with_better(np.where(is_heating, np.inf, value_j), end, 0.0)
        for end, (low, high) in enumerate(zip(rows, rows[1:]) if self._is_certain else ()):
            cost_j, settled_c, command_w = (row[:, None] for row in low)
            more_j, wide_k, more_w = (next_row[:, None] - row[:, None] for row, next_row in zip(low, high))
            share = (following.grid_c - settled_c) / np.where(wide_k > 0.0, wide_k, np.nan)
            least_w = np.maximum(LEAST_HEATING_W, LEAST_SHARE * (command_w + more_w))
            is_between = (share > 0.0) & (share <= 1.0) & (command_w + share * more_w > least_w)
            value_j = np.where(is_between, cost_j + share * more_j + following.values_j[1], np.inf)
            found = value_j.argmin(axis=1)[:, None]
            heated = heated.with_better(np.take_along_axis(value_j, found, 1)[:, 0], end,
                                        np.take_along_axis(share, found, 1)[:, 0])
        return _Best(unheated, heated, self._switch_on_j)

    def _ends_beside(self, k: int, following: _Layer, soc: FloatArray, moved_k: FloatArray | float,
                     lack_price: float) -> StepEnds | None:
        """
        Return the end of step k, heated as is best on the path, from two starts (2,) beside it.

        Their charges, and how much more heat has arrived in their battery [K]; None if the battery is empty then.
        """
        path_c = self._path_c[k:k + 1]
        ends = self._ends_ahead(k, self._soc[k:k + 1], path_c, self._under_way_k[k], lack_price)
        if ends.is_empty[0]:
            return None
        end, share, _ = self._best(ends, following).only(True)
        wanted_w, takes_surplus = float(ends.wanted_w[end]), end > 0
        if share > 0.0:
            low_w, high_w = ends.command_w[end, 0], ends.command_w[end + 1, 0]
            wanted_w, takes_surplus = float(low_w + share * (high_w - low_w)), True
        beside = self._ahead.end(k, soc, np.repeat(path_c, 2), self._under_way_k[k] - moved_k,
                                 self._watched_steps[k], lack_price, wanted_w, takes_surplus)
        return None if beside.is_empty.any() else beside._replace(
            cost_j=beside.cost_j + self._price_j[k + 1] * beside.soc)

    def _price_of_charge(self, k: int, following: _Layer) -> float:
        """
        Return what charge at instant k is worth beyond its energy [J]: how the cost on the path changes with it.

        Heated as is best there. That less charge delivers less is left out: heat repairs it, at the price of heat.
        """
        soc = np.array((max(self._soc[k] - PRICED_SOC, PRICED_SOC), min(self._soc[k] + PRICED_SOC, 1.0)))
        beside = self._ends_beside(k, following, soc, 0.0, 0.0) if soc[1] > soc[0] else None
        if beside is None:
            return 0.0
        return self._change_beside_j(following, beside) / float(soc[1] - soc[0])

    def _change_beside_j(self, following: _Layer, beside: StepEnds) -> float:
        """Return how much more the second end costs [J]; heat repairs a difference in warmth, at its price."""
        ahead_c = beside.settled_c[0]
        most_j = self._joules_per_k * abs(ahead_c[1] - ahead_c[0])
        warmth_j = np.diff(following.worth_j(ahead_c, True, self._joules_per_k))[0]
        return float(np.diff(beside.cost_j[0])[0] + np.clip(warmth_j, -most_j, most_j))

    def _price_of_lateness(self, k: int, following: _Layer) -> float:
        """
        Return the cost of a kelvin that is still under way at instant k [J].

        The battery is colder, and limits tighter. Another kelvin of heat repairs it.
        """
        beside = self._ends_beside(k, following, self._soc[[k, k]], np.array((-PRICED_K, PRICED_K)),
                                   self._lack_price)
        if beside is None:
            return 0.0
        change_j = -self._change_beside_j(following, beside)
        lag_s = self._trip.vehicle.heat_path.heat_lag_s
        left = math.exp(-float(self._trip.route.duration_s[k]) / lag_s)
        return float(np.clip(0.5 * change_j / PRICED_K + left * self._late_price_j[k + 1],
                             -self._joules_per_k, self._joules_per_k))

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

    def _find_path(self) -> bool:
        """Take the best end of each step; return whether the charge carries the trip."""
        is_on = self._is_heating
        for k in range(len(self._trip.route)):
            to_come_k = self._to_come_k(k)
            settled_c = self.states[1, k:k + 1] + to_come_k
            ends = self._ends_ahead(k, self.states[0, k:k + 1], settled_c, to_come_k, self._lack_price)
            if ends.is_empty[0]:
                return False
            end, share, is_on = self._best(ends, self._layers[k + 1]).only(is_on)
            wanted_w, takes_surplus = float(ends.wanted_w[end]), end > 0
            if share > 0.0:
                low_w, high_w = ends.command_w[end, 0], ends.command_w[end + 1, 0]
                wanted_w, takes_surplus = float(low_w + share * (high_w - low_w)), False
            if not self._drive(k, wanted_w, takes_surplus):
                return False
        return True

    def _drive(self, k: int, wanted_w: float, takes_surplus: bool) -> bool:
        """Drive step k; return whether the charge carries it."""
        states, powers_w = self._drives[takes_surplus](k, tuple(self.states[:, k].tolist()), wanted_w)
        self._powers_w[:, k] = powers_w
        self.states[:, k + 1] = states
        return states[0] > 0.0

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
        if self._trip.vehicle.heat_path.heater_lag_s > 0.0:
            self._price_what_is_due()
        return float(np.abs(self._path_c - before_c).max())

    def _price_what_is_due(self) -> None:
        """Price a joule that the heater is still to draw: the battery pays what surplus does not cover."""
        trip, lag_s = self._trip, self._trip.vehicle.heat_path.heater_lag_s
        for k in reversed(range(len(trip.route))):
            full_w, paid = float(trip.heater_limit_w[k]), 1.0
            left = math.exp(-float(trip.route.duration_s[k]) / lag_s)
            if trip.route.propulsion_power_w[k] < 0.0 and full_w > 0.0:
                least_w, _ = self._ahead.limits_w(k, self._soc[[k]], self.states[1, [k]])
                paid = 1.0 - min(max((float(least_w[0]) - float(trip.idle_power_w[k])) / full_w, 0.0), 1.0)
            self._due_price[k] = (1.0 - left) * paid + left * self._due_price[k + 1]

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

    def _lacking_along_w(self, states: FloatArray, powers_w: FloatArray) -> FloatArray:
        """Return the power of each step of a run beyond the discharge limit [W]."""
        trip = self._trip
        _, most_w = limits_of_steps_w(trip.vehicle, states[0], states[1], trip.power_variance_w2)
        lacking_w: FloatArray = trip.idle_power_w + powers_w[2] + powers_w[1] - most_w
        return np.where(lacking_w > LACK_TOLERANCE_W, lacking_w, 0.0)

    def _cost_j(self, states: FloatArray, powers_w: FloatArray, aim_c: float) -> float:
        """Return the cost of a run [J]: battery, heater, power deficit, switching, missed target and reserve."""
        trip, (soc, temperature_c) = self._trip, states[:2]
        voltage_v = self._voltage_v(soc, temperature_c)
        charge_as = trip.vehicle.battery.capacity_as * (soc[:-1] - soc[1:])
        energy_j = self._price @ (0.5 * (voltage_v[1:] + voltage_v[:-1]) * charge_as)
        lacking_w = self._lacking_along_w(states, powers_w)
        is_on = np.append(self._is_heating, powers_w[0] > LEAST_HEATING_W)
        switched_j = self._switch_on_j * float((is_on[1:] & ~is_on[:-1]).sum())
        short_k = max(aim_c - float(temperature_c[-1]), 0.0) + max(self._beyond_k(states, True), 0.0)
        heater_j = float((self._price * trip.route.duration_s) @ powers_w[0])
        lacking_j = float(trip.route.duration_s @ lacking_w)
        return (float(energy_j) + HEATING_PRICE * heater_j + self._lack_price * lacking_j + switched_j
                + SHORT_PRICE * self._joules_per_k * short_k)

    def _arrive_exactly(self) -> None:
        """Move the start of the last interval, or its end under an Uncertainty, so that the arrival is exact."""
        command_w = self._powers_w[0].copy()
        heated, braked = command_w > LEAST_HEATING_W, self._powers_w[1] > 1.0
        beside = np.append(False, heated[:-1]) if self._is_certain else np.append(heated[1:], False)
        edges = np.flatnonzero(heated & ~braked & ~beside)
        to_target_k, to_reserve_k = (self._beyond_k(self.states, of_charge) for of_charge in (False, True))
        is_short = to_target_k < 0.0 and to_reserve_k > to_target_k
        excess_k = to_reserve_k if is_short else to_target_k
        if not len(edges) or not abs(excess_k) <= self._most_moved_k(int(edges[-1])):
            return
        moved_j, next_j = 0.0, -excess_k * self._joules_per_k
        for _ in range(MOST_TRIALS):
            if abs(excess_k) <= ARRIVAL_TOLERANCE_K:
                break
            self._drive_commands(self._with_edge_moved(command_w, int(edges[-1]), next_j))
            found_k = self._beyond_k(self.states, is_short)
            slope = (found_k - excess_k) / (next_j - moved_j)
            moved_j, excess_k = next_j, found_k
            if not math.isfinite(slope) or slope == 0.0:
                break
            next_j = moved_j - excess_k / slope
        if moved_j != 0.0 and not self._is_certain and not self._powers_w[0, self._moved_in + 1:].any():
            self.ends_in = self._moved_in

    def _most_moved_k(self, edge: int) -> float:
        """Return the largest error on arrival that moving an edge corrects [K]."""
        step_j = float(self._trip.heater_limit_w[edge] * self._trip.route.duration_s[edge])
        if self._is_certain:
            return MOVED_K
        return max(MOVED_K, step_j / self._joules_per_k)

    def _with_edge_moved(self, command_w: FloatArray, edge: int, more_j: float) -> FloatArray:
        """Return commands with more energy outside an interval that begins or ends at `edge`, or less [J]."""
        moved_w, left_j = command_w.copy(), abs(more_j)
        is_later = (more_j > 0.0) != self._is_certain
        steps = range(edge, len(command_w)) if is_later else range(edge, -1, -1)
        for k in steps:
            duration_s = float(self._trip.route.duration_s[k])
            room_w = float(self._trip.heater_limit_w[k]) - moved_w[k] if more_j > 0.0 else moved_w[k]
            taken_j = min(max(room_w, 0.0) * duration_s, left_j)
            self._moved_in = k if taken_j > 0.0 else self._moved_in
            moved_w[k] += math.copysign(taken_j / duration_s, more_j)
            left_j -= taken_j
            if left_j <= 0.0:
                break
        return moved_w
