# SPDX-License-Identifier: Apache-2.0
"""
The effect of a joule of heat in each step of a run within limits, on the charge on arrival and on the needs.

Prices as in `prices`, extended by the limits. If a step's surplus goes to the heater or to the friction brake,
a warmer battery takes more of the surplus, so the heater gets less without a changed command. Beside the target,
the battery may have to deliver the power of a climb, and before a descent the charge must not fall below the
battery's range.
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

# Difference for the slope over the friction brake's power.
BRAKE_DIFFERENCE_W = 1000.0
# A step in which the heater can take no more (or no less) than this is left alone: heat that makes a climb only
# just deliverable is not used.
LEAST_ROOM_W = 10.0
# Steps that end this close to the highest temperature are not heated more.
NEAR_HIGHEST_K = 1e-3
# A power deficit below this share is rounding.
POWER_ROUNDING = 1e-6
# The charge on the way stays this far above the lowest of the battery's range, or as low as it was. The
# no-regret check regards a plan that leaves hardly more charge as the warmest allowed one.
LOWEST_SOC_MARGIN = 2e-5
# Aim this far above it: a run may differ from its prices by this amount.
LOWEST_SOC_AIM = 1e-6
# From further above, no exchange leads below it.
NEAR_LOWEST_SOC = 0.05


class Needs(NamedTuple):
    """
    Needs of a run: the outcome of the reference run that it must not fall short of.

    The temperature on arrival [deg C], and the terminal power that the battery can give in each step (N,) [W]:
    the drive's demand, or the reference run's power if that has a deficit. The state of charge never falls below
    `lowest_soc`. `climbs` are the steps (first, last + 1) that a slightly colder battery could not deliver.
    """

    arrival_c: float
    power_w: FloatArray
    lowest_soc: float
    climbs: tuple[tuple[int, int], ...]

    def spare_w(self, trip: Trip, run: Schedule) -> FloatArray:
        """Return the spare power of the battery beyond the need in each step of a run [W], (N,)."""
        return limits_along(trip, run)[1] - self.power_w

    def are_met(self, trip: Trip, run: Schedule) -> bool:
        """Return whether a run meets all needs, up to rounding."""
        short_w = -POWER_ROUNDING * np.abs(trip.idle_power_w)
        return (run.empty_at_s is None
                and float(run.temperature_c[-1]) >= self.arrival_c - ARRIVAL_TOLERANCE_K
                and float(run.soc.min()) >= self.lowest_soc
                and bool((self.spare_w(trip, run) >= short_w).all()))


def find_needs(trip: Trip, schedule: Schedule, target_c: float) -> Needs:
    """Return the Needs for improving a run (a Schedule), and its target [deg C]."""
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
    Effects of heating a step more, or less, along a run: C possible changes.

    Each changes one `step` (C,) by at most `most_j` [J]: more if `sign` is 1.0, less if it is -1.0. A joule
    changes the charge on arrival by `charge_per_j` and the needs by `needs_per_j` (R, C): the temperature on
    arrival [K], the power available in the `worst` steps, one for each climb [W], and the charge at the instant
    `lowest`, unless that is None.
    """

    step: IntArray
    sign: FloatArray
    most_j: FloatArray
    charge_per_j: FloatArray
    needs_per_j: FloatArray
    worst: tuple[int, ...]
    lowest: int | None

    def spare(self, trip: Trip, run: Schedule, needs: Needs) -> list[float]:
        """Return a run's margin beyond each need [K, W, ..., 1], less the margin aimed at."""
        spare_w = needs.spare_w(trip, run)
        spare_soc = ([] if self.lowest is None else
                     [float(run.soc[self.lowest]) - needs.lowest_soc - LOWEST_SOC_AIM])
        return [float(run.temperature_c[-1]) - needs.arrival_c - 0.5 * ARRIVAL_TOLERANCE_K,
                *(float(spare_w[k]) - 0.5 * POWER_SURPLUS * float(trip.idle_power_w[k])
                  for k in self.worst), *spare_soc]


def find_changes(trip: Trip, run: Schedule, needs: Needs) -> LimitChanges:
    """Return the LimitChanges possible in a run within limits, for a vehicle without a heat path."""
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
    """Return the instant of a run's lowest charge; None if that is far above the need."""
    rises = np.flatnonzero(run.soc[1:-1] < run.soc[2:]) + 1
    if not len(rises):
        return None
    lowest = int(rises[run.soc[rises].argmin()])
    return lowest if run.soc[lowest] < needs.lowest_soc + NEAR_LOWEST_SOC else None


@dataclass(frozen=True)
class LimitedSlopes(Slopes):
    """
    Slopes along a run within limits, N pairs each.

    `by_surplus` is the effect of a watt of surplus, to the heater or to the brake. `surplus_w` is how much the
    surplus grows [W] with the charge at the start of the step, and with each kelvin. 0 without surplus.
    """

    by_surplus: list[ChargeWarmth]
    surplus_w: list[ChargeWarmth]

    def with_limits(self, k: int, earlier: ChargeWarmth, middle: ChargeWarmth) -> ChargeWarmth:
        """Return the worth of charge and warmth before step k, from their worth without limits."""
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
    # The surplus is set at the end of the step at which the battery takes less.
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
    """Return the end of step k at which the battery can give less, and the slopes of its power there [W]."""
    def most_w(instant: int, fuller: float = 0.0, warmer_k: float = 0.0) -> float:
        at = slice(instant, instant + 1)
        return float(terminal_limits_w(
            trip.vehicle, run.soc[at] + fuller, run.temperature_c[at] + warmer_k,
            trip.power_variance_w2[k:k + 1])[1][0])

    start_w, end_w = most_w(k), most_w(k + 1)
    instant, here_w = (k, start_w) if start_w <= end_w else (k + 1, end_w)
    # Downwards: a full battery cannot be fuller.
    return instant, ((here_w - most_w(instant, fuller=-SOC_DIFFERENCE)) / SOC_DIFFERENCE,
                     (most_w(instant, warmer_k=TEMPERATURE_DIFFERENCE_K) - here_w)
                     / TEMPERATURE_DIFFERENCE_K)
