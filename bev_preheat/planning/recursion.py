# SPDX-License-Identifier: Apache-2.0
"""
Method `value_function`: heat where a kelvin is worth more than it costs, earlier if the arrival is uncertain.

The two passes of the paper, for every temperature instead of one. Backward from arrival, each step takes the best
of its ends: heater off, heated with the surplus of regeneration, at full power, cooled, or a mixture of two:

    V_N(T)     = cost of arriving at T: nothing from the target to the highest temperature, SHORT_PRICE beyond
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

import math
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import JOULES_PER_WH
from bev_preheat.planning.steps_ahead import best_of, Layer
from bev_preheat.planning.value_path import ValuePath
from bev_preheat.planning.value_run import ValueRun
from bev_preheat.tunables import (
    ABOVE_K,
    ARRIVAL_TOLERANCE_K,
    BELOW_K,
    EDGE_SHARE,
    EMPTY_J,
    EXPECTED_PASSES,
    FIRST_STEP_K,
    LACK_PRICE,
    LAST_K,
    LAST_STEP_K,
    LOOK_WH,
    MOST_LOOKS,
    NARROW_K,
    NARROW_STEP_K,
    NEAR_K,
    NEAR_PRICE,
    NEAR_RESERVE_K,
    NO_WORSE_W,
    SHORT_PRICE,
    SOC_TOLERANCE,
    TABLE_STEP_K,
    WIDE_K,
    WIDE_STEP_K,
    WIDER_DEVIATIONS,
)
from bev_preheat.vehicle.core_structs import VALUE_POINTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.methods import Requirements
    from bev_preheat.planning.trip import Trip

PASSES = ((FIRST_STEP_K, 0.0), (WIDE_STEP_K, WIDE_K), (WIDE_STEP_K, WIDE_K), (NARROW_STEP_K, NARROW_K),
          (LAST_STEP_K, LAST_K))


class PlanByValues(NamedTuple):
    """
    Heater commands [W] (N,) of a plan by values; None if the charge does not carry the trip.

    `ends_in` is the step within which heating ends, or None. `values` lead to the plans after it; only the engine
    that found them can read them.
    """

    command_w: FloatArray | None
    ends_in: int | None = None
    values: Any = None


def find_values(trip: Trip, start: States, wanted: Requirements) -> PlanByValues:
    """Return the PlanByValues from the four States at the start on."""
    for lack_price in (LACK_PRICE, 0.0):
        recursion = Recursion(trip, start, wanted, lack_price)
        command_w = recursion.plan()
        # The reserve comes before the power of climbs, and heat for a climb may cost the charge that it needs.
        if recursion.unheated_lack_w == 0.0 or (
                command_w is not None and recursion.run.states[0, -1] >= wanted.reserve - SOC_TOLERANCE
                and recursion.run.lack_w() <= recursion.unheated_lack_w + NO_WORSE_W):
            break
    return PlanByValues(None) if command_w is None else PlanByValues(command_w, recursion.run.ends_in, recursion)


def follow_values(trip: Trip, start: States, wanted: Requirements, values: Any) -> PlanByValues | None:
    """
    Return the PlanByValues from values of an earlier plan, forward only: its last steps are those of this trip.

    None if they do not lead to a plan: heating leaves something short, or the run leaves their temperatures.
    """
    return (Recursion(trip, start, wanted, values.lack_price).followed(values)
            if isinstance(values, Recursion) else None)


class ValueTable(NamedTuple):
    """
    Costs of the rest of a trip, for each instant and temperature: `values_j` [J] (N + 1, P).

    `temperature_c` (P,) [deg C] includes the heat under way; `joules_per_k` is the heater's energy for a kelvin.
    """

    temperature_c: FloatArray
    values_j: FloatArray
    joules_per_k: float


class Recursion:
    """The passes for one trip: `run` is that of the latest, `path` that of the one before."""

    def __init__(self, trip: Trip, start: States, wanted: Requirements, lack_price: float) -> None:
        """Take the States at the start; `lack_price` is the cost of a joule that the battery cannot deliver."""
        self._trip, self._wanted, self.lack_price = trip, wanted, lack_price
        self._deviation_k = wanted.uncertainty.deviation_k
        self.run = ValueRun(trip, start, wanted, lack_price)
        self.path = ValuePath(trip, self.run, lack_price)
        self._layers: list[Layer] = []
        # The largest power deficit of the unheated run [W].
        self.unheated_lack_w = 0.0
        # The target of the latest pass, or the temperature that the reserve allows [deg C].
        self._aim_c = wanted.target_c

    def plan(self) -> FloatArray | None:
        """Return the heater commands [W] (N,); None if the charge does not carry the trip."""
        run, target_c = self.run, self._wanted.target_c
        if not run.drive_commands(None):
            return None
        self.path.keep()
        self.unheated_lack_w = run.lack_w()
        range_c = self._range_c()
        aim_c, looks, number, is_priced = target_c, 0, 0, True
        kept = run.keep()
        while number < (len(PASSES) if run.is_certain else EXPECTED_PASSES):
            self._layers = self._find_values(
                self._grids_c(number, range_c), aim_c, number > 0, is_priced and number > 0)
            saved_j = 0.0
            if not self._find_path():
                saved_j = -math.inf
            elif number > 0 and run.is_certain:
                saved_j = run.cost_j(aim_c, kept) - run.cost_j(aim_c)
            if saved_j < 0.0:
                # No pass makes the plan worse: charge may be priced wrongly, as limits bend.
                run.take(kept)
                if number == 0 and looks < MOST_LOOKS:
                    # The charge does not carry so much heat.
                    aim_c, looks = 0.5 * (aim_c + run.arrival_c), looks + 1
                    continue
                number, looks, is_priced = (number, looks, False) if is_priced else (number + 1, 0, True)
                continue
            kept = run.keep()
            moved_k = self.path.keep()
            # The reserve of charge allows this temperature.
            spare_k = -run.beyond_k(is_short_of_charge=True)
            is_short = spare_k < 0.0 or aim_c < target_c
            aimed_c = aim_c
            if is_short:
                aim_c = min(target_c, run.arrival_c + spare_k)
            looks += 1
            is_found = (abs(aim_c - aimed_c) < NEAR_RESERVE_K if number == 0 else
                        moved_k < EDGE_SHARE * PASSES[number][1]
                        or (run.is_certain and saved_j < LOOK_WH * JOULES_PER_WH))
            if is_found or looks >= MOST_LOOKS:
                number, looks, is_priced = number + 1, 0, True
        self._aim_c = aim_c
        return run.arrive_exactly(aim_c)

    def followed(self, kept: Recursion) -> PlanByValues | None:
        """Return the plan from the values of an earlier one; see `follow_values`."""
        if not kept.leads_on(kept._aim_c):
            return None
        self._layers = kept._layers[-len(self._trip.route) - 1:]
        self.path.take_last(kept.path)
        if not self._find_path():
            return None
        middle_c = np.array([0.5 * (layer.grid_c[0] + layer.grid_c[-1]) for layer in self._layers])
        if np.abs(self.run.states[1] + self.path.all_to_come_k() - middle_c).max() > WIDE_K:
            return None
        command_w = self.run.arrive_exactly(self._wanted.target_c)
        return PlanByValues(command_w, self.run.ends_in) if self.leads_on(kept._aim_c) else None

    def leads_on(self, aim_c: float) -> bool:
        """
        Return whether the values of a pass with an aim [deg C] lead to the plan of this run.

        They are wide; the run arrives at that aim, or is as short of charge and power as without heating.
        """
        run = self.run
        if run.is_certain:
            return False
        short_k, lack_w, driven = run.beyond_k(is_short_of_charge=True), run.lack_w(), run.keep()
        is_short = short_k > ARRIVAL_TOLERANCE_K
        if is_short or lack_w > 0.0:
            run.drive_commands(None)
            least_k, least_w = run.beyond_k(is_short_of_charge=True), run.lack_w()
            run.take(driven)
            if lack_w > least_w + NO_WORSE_W or (is_short and short_k > least_k + ARRIVAL_TOLERANCE_K):
                return False
        return is_short or abs(min(self._wanted.target_c, run.arrival_c - short_k) - aim_c) <= NEAR_RESERVE_K

    def table(self) -> ValueTable:
        """Return the values over the whole range, with the charge of the last pass."""
        grid_c = np.arange(*self._range_c(), TABLE_STEP_K)
        layers = self._find_values([grid_c] * len(self.path.soc), self._wanted.target_c, True, True)
        return ValueTable(grid_c, np.array([layer.values_j[0] for layer in layers]), self.run.joules_per_k)

    # Backward.

    def _find_values(self, grids_c: Sequence[FloatArray], aim_c: float, is_expected: bool,
                     is_priced: bool) -> list[Layer]:
        """
        Return the layers of a pass at given temperatures [deg C], from the arrival at `aim_c` back.

        `is_expected`: they are averaged over the Uncertainty; `is_priced`: charge and heat under way are priced.
        """
        run = self.run
        short_k = np.maximum(np.maximum(aim_c - grids_c[-1], grids_c[-1] - self._wanted.most_c), 0.0)
        near_k = 0.0 if run.is_certain else np.minimum(short_k, NEAR_K)
        short_j = (SHORT_PRICE * short_k - (SHORT_PRICE - NEAR_PRICE) * near_k) * run.joules_per_k
        layers = [Layer(grids_c[-1], np.array((short_j, short_j)))]
        self.path.forget_prices()
        for k in reversed(range(len(self._trip.route))):
            grid_c = grids_c[k]
            following = layers[-1] = layers[-1].spread(self._variance_k2(k)) if is_expected else layers[-1]
            self.path.watch(k, grid_c, following.grid_c)
            ends = self.path.ends(
                k, np.full(len(grid_c), self.path.soc[k]), grid_c, self.path.under_way_k[k])
            best = best_of(ends, following, run.joules_per_k, is_mixed=run.is_certain)
            values_j = np.array([best.value_j(switch_on_j) for switch_on_j in (run.switch_on_j, 0.0)])
            layers.append(Layer(grid_c, np.where(ends.is_empty, EMPTY_J, values_j)))
            if is_priced:
                self.path.price(k, following)
        return layers[::-1]

    def _variance_k2(self, k: int) -> float:
        """Return how much less is uncertain about the arrival at the end of step k than at its start [K^2]."""
        left_s = self._trip.time_s[-1] - self._trip.time_s[[0, k, k + 1]]
        return float(self._deviation_k ** 2 * (left_s[1] ** 2 - left_s[2] ** 2) / left_s[0] ** 2)

    def _range_c(self) -> tuple[float, float]:
        """Return the lowest and the highest temperature of the first pass [deg C]."""
        path_c, target_c = self.path.settled_c, self._wanted.target_c
        highest_c = self._trip.vehicle.battery.temperature_range_c[1]
        warmest_c = float(path_c.max() if self._trip.mix.cools else path_c[0])
        return (min(float(path_c.min()), target_c, self._wanted.most_c) - BELOW_K,
                min(max(warmest_c, target_c) + ABOVE_K, highest_c + BELOW_K))

    def _grids_c(self, number: int, range_c: tuple[float, float]) -> list[FloatArray]:
        """Return the temperatures of all layers of a pass [deg C]."""
        step_k, half_k = PASSES[number]
        half_k += WIDER_DEVIATIONS * self._deviation_k
        wide_k = range_c[1] - range_c[0] if number == 0 else 2.0 * half_k
        return [_grid_c(range_c[0] if number == 0 else path_c - half_k, wide_k, step_k)
                for path_c in self.path.settled_c.tolist()]

    # Forward.

    def _find_path(self) -> bool:
        """Take the best end of each step; return whether the charge carries the trip."""
        run, direction = self.run, self._wanted.uncertainty.direction
        for k in range(len(self._trip.route)):
            to_come_k = self.path.to_come_k(k)
            ends = self.path.ends(k, run.states[0, k:k + 1], run.states[1, k:k + 1] + to_come_k, to_come_k)
            if ends.is_empty[0]:
                return False
            choice = best_of(ends, self._layers[k + 1], run.joules_per_k, is_mixed=run.is_certain).only(
                direction, run.switch_on_j)
            direction = choice.direction
            if not run.drive(k, choice.wanted_w(ends), choice.takes_surplus(ends)):
                return False
        return True


def _grid_c(low_c: float, wide_k: float, step_k: float) -> FloatArray:
    """Return temperatures from `low_c` on, `wide_k` and more, `step_k` apart, or more if they were too many."""
    points = wide_k / step_k + 2.0
    if points > VALUE_POINTS:
        points, step_k = VALUE_POINTS, wide_k / (VALUE_POINTS - 1)
    grid_c: FloatArray = low_c + step_k * np.arange(int(points), dtype=float)
    return grid_c
