# SPDX-License-Identifier: Apache-2.0
"""
What a joule of heat in each step does along a run within limits, to the charge on arrival and to what is required.

Prices as in `prices`, with what limits make of them. In a step whose surplus goes to the heater, or to the
friction brake, a warmer battery takes more of it, so the heater gets less without being told. Beside the
target a climb may be required, whose power the battery must be able to give, and before a descent the charge
must not fall below the battery's range.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.planning.bracketing import ARRIVAL_TOLERANCE_K
from bev_preheat.planning.dynamics import limits_along, terminal_limits_w
from bev_preheat.planning.heating_intervals import SURPLUS_TOLERANCE_W
from bev_preheat.planning.prices import (
    CHARGE,
    ChargeWarmth,
    model_slopes,
    rates_along,
    Slopes,
    SOC_DIFFERENCE,
    TEMPERATURE_DIFFERENCE_K,
    WARMTH,
)
from bev_preheat.planning.threshold_search import find_climbs, POWER_SURPLUS

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip

# The slope over the friction brake's power is taken over this difference.
BRAKE_DIFFERENCE_W = 1000.0
# Where the heater can take no more, or no less, than this there is nothing to change: what a climb is just
# delivered with is not heated with.
LEAST_ROOM_W = 10.0
# Steps that end this close to the highest temperature are not heated more.
NEAR_HIGHEST_K = 1e-3
# A power that is lacking by less than this share is rounding.
POWER_ROUNDING = 1e-6
# The charge on the way stays this far above the lowest of the battery's range, or as low as it was: a plan that
# leaves hardly more than that charge the safeguard takes for the warmest that it may allow.
LOWEST_SOC_MARGIN = 2e-5
# What is aimed at above that: by so much a run may differ from its prices.
LOWEST_SOC_AIM = 1e-6
# Further above no exchange leads below it.
NEAR_LOWEST_SOC = 0.05


class Needs(NamedTuple):
    """
    What a run must not fall short of: what the run does that it is compared with.

    The temperature on arrival [deg C], and the terminal power that the battery can give in each step (N,) [W]:
    what the drive asks, or what that run gives where it lacks power. The state of charge never falls below
    `lowest_soc`. `climbs` are the steps (first, last + 1) that a battery a little colder could not deliver.
    """

    arrival_c: float
    power_w: FloatArray
    lowest_soc: float
    climbs: tuple[tuple[int, int], ...]

    def spare_w(self, trip: Trip, run: Schedule) -> FloatArray:
        """Return the power that the battery can give in each step of a run beyond what it must [W], (N,)."""
        return limits_along(trip, run)[1] - self.power_w

    def are_met(self, trip: Trip, run: Schedule) -> bool:
        """Return whether a run falls short of nothing but rounding."""
        short_w = -POWER_ROUNDING * np.abs(trip.idle_power_w)
        return (run.empty_at_s is None
                and float(run.temperature_c[-1]) >= self.arrival_c - ARRIVAL_TOLERANCE_K
                and float(run.soc.min()) >= self.lowest_soc
                and bool((self.spare_w(trip, run) >= short_w).all()))


def find_needs(trip: Trip, schedule: Schedule, target_c: float) -> Needs:
    """Return the Needs of a run (a Schedule) that is to be improved, and its target [deg C]."""
    return Needs(min(target_c, float(schedule.temperature_c[-1])),
                 np.minimum(trip.idle_power_w, limits_along(trip, schedule)[1]),
                 min(trip.vehicle.battery.soc_range[0] + LOWEST_SOC_MARGIN, float(schedule.soc.min())),
                 tuple(find_climbs(trip, schedule)))


def free_heat_w(trip: Trip, run: Schedule) -> FloatArray:
    """Return the surplus that goes to the heater in each step of a run anyway [W], (N,)."""
    surplus_w = limits_along(trip, run)[0] - trip.idle_power_w
    free_w = np.where(trip.route.propulsion_power_w < 0.0,
                      np.minimum(np.maximum(surplus_w, 0.0), trip.heater_limit_w), 0.0)
    # If the brake takes a part, the heater takes no more: the battery is warm enough.
    return np.where(run.brake_power_w > 0.0, np.minimum(free_w, run.heater_power_w), free_w)


class LimitChanges(NamedTuple):
    """
    What heating a step more, or less, does along a run, C changes that can be made.

    In each `step` (C,) by at most `most_j` [J], more where `sign` is 1.0, less where it is -1.0. A joule of
    it changes the charge on arrival by `charge_per_j`, and what is required by `needs_per_j` (R, C): the
    temperature on arrival [K], the power that can be given in `worst` steps, one for each climb [W], and the
    charge at the instant `lowest`, if that is not None.
    """

    step: IntArray
    sign: FloatArray
    most_j: FloatArray
    charge_per_j: FloatArray
    needs_per_j: FloatArray
    worst: tuple[int, ...]
    lowest: int | None

    def spare(self, trip: Trip, run: Schedule, needs: Needs) -> list[float]:
        """Return what a run has beyond each need [K, W, ..., 1], less what is aimed at."""
        spare_w = needs.spare_w(trip, run)
        spare_soc = ([] if self.lowest is None else
                     [float(run.soc[self.lowest]) - needs.lowest_soc - LOWEST_SOC_AIM])
        return [float(run.temperature_c[-1]) - needs.arrival_c - 0.5 * ARRIVAL_TOLERANCE_K,
                *(float(spare_w[k]) - 0.5 * POWER_SURPLUS * float(trip.idle_power_w[k])
                  for k in self.worst), *spare_soc]


def find_changes(trip: Trip, run: Schedule, needs: Needs) -> LimitChanges:
    """Return the Changes that can be made to a run within limits, of a vehicle without a heat path."""
    free_w, heater_w = free_heat_w(trip, run), run.heater_power_w
    slopes = _slopes_within_limits(trip, run, free_w)
    is_full = ((run.temperature_c[1:] >= trip.vehicle.battery.temperature_range_c[1] - NEAR_HIGHEST_K)
               | (run.brake_power_w > 0.0))
    most_w = np.minimum(trip.heater_limit_w, limits_along(trip, run)[1] - trip.idle_power_w)
    room_w = np.where(is_full, 0.0, most_w - heater_w), heater_w - free_w
    more, less = (np.flatnonzero(each_w > LEAST_ROOM_W) for each_w in room_w)
    spare_w = needs.spare_w(trip, run)
    worst = tuple(first + int(spare_w[first:last].argmin()) for first, last in needs.climbs)
    lowest, end = _lowest_instant(run, needs), len(trip.route)
    effects = [slopes.effect_until(*what) for what in (
        (end, CHARGE), (end, WARMTH), *(_worth_of_climb(trip, run, k) for k in worst),
        *(() if lowest is None else ((lowest, CHARGE),)))]
    step = np.concatenate((more, less))
    duration_s = trip.route.duration_s[step]
    sign = np.where(np.arange(len(step)) < len(more), 1.0, -1.0)
    per_j = np.array([sign * effect[step] / duration_s for effect in effects])
    return LimitChanges(step, sign, np.concatenate((room_w[0][more], room_w[1][less])) * duration_s,
                   per_j[0], per_j[1:], worst, lowest)


def _lowest_instant(run: Schedule, needs: Needs) -> int | None:
    """Return the instant from which a run charges again from its lowest; None where that is far above the need."""
    rises = np.flatnonzero(run.soc[1:-1] < run.soc[2:]) + 1
    if not len(rises):
        return None
    lowest = int(rises[run.soc[rises].argmin()])
    return lowest if run.soc[lowest] < needs.lowest_soc + NEAR_LOWEST_SOC else None


@dataclass(frozen=True)
class LimitedSlopes(Slopes):
    """
    Slopes along a run within limits, N pairs each.

    `by_surplus` is for a watt of surplus: to the heater, or to the brake. Of it there is so much more [W] for
    more charge at the start of the step, and for a kelvin more, as `surplus_w` says. 0 where there is none.
    """

    by_surplus: list[ChargeWarmth]
    surplus_w: list[ChargeWarmth]

    def with_limits(self, k: int, earlier: ChargeWarmth, middle: ChargeWarmth) -> ChargeWarmth:
        """Return what charge and warmth before step k are worth, from what they are without limits."""
        worth = middle[0] * self.by_surplus[k][0] + middle[1] * self.by_surplus[k][1]
        return (earlier[0] + worth * self.surplus_w[k][0], earlier[1] + worth * self.surplus_w[k][1])


def _slopes_within_limits(trip: Trip, run: Schedule, free_w: FloatArray) -> LimitedSlopes:
    """Return the Slopes along a run; `free_w` (N,) is the surplus that its heater takes anyway [W]."""
    vehicle, variance_w2 = trip.vehicle, trip.power_variance_w2
    heater_w, brake_w = run.heater_power_w, run.brake_power_w
    rates_at = rates_along(trip, run)
    by_charge, by_warmth, by_power = model_slopes(trip, rates_at, heater_w, brake_w)
    by_brake = ((rates_at(heater_w, brake_w + BRAKE_DIFFERENCE_W) - rates_at(heater_w, brake_w))
                / BRAKE_DIFFERENCE_W * trip.route.duration_s)
    takes_surplus = ((free_w > 0.0) & (free_w < trip.heater_limit_w)
                     & (heater_w <= free_w + SURPLUS_TOLERANCE_W))
    by_surplus = np.where(brake_w > 0.0, by_brake, np.where(takes_surplus, by_power, 0.0))
    # The battery leaves it at that end of the step at which it takes less.
    starts_w, ends_w = (terminal_limits_w(vehicle, run.soc[ends], run.temperature_c[ends], variance_w2)[0]
                        for ends in (slice(-1), slice(1, None)))
    starts = starts_w >= ends_w
    least_w = np.where(starts, starts_w, ends_w)
    soc, temperature_c = (np.where(starts, values[:-1], values[1:])
                          for values in (run.soc, run.temperature_c))
    fuller_w, _ = terminal_limits_w(vehicle, soc + SOC_DIFFERENCE, temperature_c, variance_w2)
    warmer_w, _ = terminal_limits_w(
        vehicle, soc, temperature_c + TEMPERATURE_DIFFERENCE_K, variance_w2)
    surplus_w = np.array(((fuller_w - least_w) / SOC_DIFFERENCE,
                          (warmer_w - least_w) / TEMPERATURE_DIFFERENCE_K))
    return LimitedSlopes(*(slope.T.tolist() for slope in (
        by_charge, by_warmth, by_power, by_surplus, surplus_w)))


def _worth_of_climb(trip: Trip, run: Schedule, k: int) -> tuple[int, ChargeWarmth]:
    """Return at which end of step k the battery can give less, and what charge and warmth give there [W]."""
    def most_w(instant: int, fuller: float = 0.0, warmer_k: float = 0.0) -> float:
        at = slice(instant, instant + 1)
        return float(terminal_limits_w(
            trip.vehicle, run.soc[at] + fuller, run.temperature_c[at] + warmer_k,
            trip.power_variance_w2[k:k + 1])[1][0])

    start_w, end_w = most_w(k), most_w(k + 1)
    instant, here_w = (k, start_w) if start_w <= end_w else (k + 1, end_w)
    # Downwards: what is full already is not fuller.
    return instant, ((here_w - most_w(instant, fuller=-SOC_DIFFERENCE)) / SOC_DIFFERENCE,
                     (most_w(instant, warmer_k=TEMPERATURE_DIFFERENCE_K) - here_w)
                     / TEMPERATURE_DIFFERENCE_K)
