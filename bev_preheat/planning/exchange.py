# SPDX-License-Identifier: Apache-2.0
"""
With active limits: move heat from steps in which it costs much to steps in which it costs little.

The thresholds of `merit_order` come from a coarser model than its runs, and their heat before a climb or a
descent is within a tenth of a kelvin of the optimum, but not quite in the best steps. Along the plan's own run
`limited_prices` gives the effect of a joule more, or less, in each step. A linear program moves heat so that the
target and the climbs are still met and the charge stays in its range, and only as much heat as the prices are
trusted for. Then the run is repeated within the limits; it becomes the plan if it costs less.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native import plans as native_plans
from bev_preheat.native.structs import SettlingStruct
from bev_preheat.numerics.linear_program import maximise
from bev_preheat.planning.cheapest_steps import LEAST_SAVING_WH, sum_in_turn, whole_charge_wh
from bev_preheat.planning.dynamics import native_vehicle
from bev_preheat.planning.heating_intervals import SURPLUS_TOLERANCE_W
from bev_preheat.planning.limited_prices import (
    find_changes,
    find_needs,
    free_heat_w,
    LimitChanges,
)
from bev_preheat.planning.limits import along_limits, drive_as_planned, watch_everywhere

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip

# At most this many exchanges are tried, each with a run.
MOST_TRIALS = 8
# Share of the paid heat that is moved at first.
FIRST_SHARE = 0.25
# An exchange that saves more than the first share of the saving that its prices promise may be followed by a
# larger one; if it saves less than the second share, by a smaller one.
GOOD_SHARE, POOR_SHARE = 0.75, 0.25
# An exchange that falls short of a need is repaired at most this often, if it saves at least this share.
MOST_MENDS = 3
MENDED_SHARE = 0.5
# After an exchange that saves nothing, this share of the heat to move remains.
LEAST_LEFT, MOST_LEFT = 0.1, 0.5


def exchange_heat(trip: Trip, state: BatteryState, schedule: Schedule, target_c: float) -> Schedule:
    """
    Return the Schedule after all exchanges of heat that save charge; the same Schedule if none does.

    `schedule` is a run within limits from a BatteryState, of a vehicle without a heat path, that arrives at the
    target [deg C] as far as it can. The result is no further below the target or the power of the drive, and does
    not lead below the charge to be left on the way (`limited_prices.Needs`).
    """
    vehicle = native_vehicle(trip.vehicle)
    found = None if vehicle is None or schedule.empty_at_s is not None else native_plans.exchange_heat(
        vehicle, trip.native, SettlingStruct(True, target_c, trip.vehicle.battery.soc_range[0]),
        schedule.soc, schedule.temperature_c, schedule.heater_power_w, schedule.brake_power_w)
    if found is not None:
        return (along_limits(trip, watch_everywhere(trip), *found[0], stranded=None) if found[0]
                else schedule)
    return schedule if schedule.empty_at_s is not None else _exchanged(trip, state, schedule, target_c)


def _exchanged(trip: Trip, state: BatteryState, schedule: Schedule, target_c: float) -> Schedule:
    needs = find_needs(trip, schedule, target_c)
    least_saving = LEAST_SAVING_WH / whole_charge_wh(trip, schedule)
    run, trusted_j = schedule, FIRST_SHARE * _paid_j(trip, schedule)
    changes: LimitChanges | None = None
    for _ in range(MOST_TRIALS):
        if changes is None:
            changes = find_changes(trip, run, needs)
            spare = changes.spare(trip, run, needs)
            # Margin of each need in the last trial, beyond the promise of the prices.
            beyond, mends = [0.0] * len(spare), 0
            if not len(changes.step):
                break
        moved_j = _best_exchange(changes, [
            has + more for has, more in zip(spare, beyond)], trusted_j)
        saving, all_moved_j = sum_in_turn(changes.charge_per_j * moved_j), sum_in_turn(moved_j)
        if not saving >= least_saving:
            if not any(beyond):
                break
            beyond, mends = [0.0] * len(spare), 0
            trusted_j = MOST_LEFT * all_moved_j
            continue
        # Nothing changes before the first step whose heating changes.
        there = drive_as_planned(trip, state, _commands_w(trip, run, changes, moved_j), take_surplus=True,
                                 first=int(changes.step[moved_j > 0.0].min()), before=run)
        saved = float(there.soc[-1]) - float(run.soc[-1])
        is_met = needs.are_met(trip, there)
        if is_met and saved >= least_saving:
            if saved > GOOD_SHARE * saving:
                trusted_j = 2.0 * trusted_j
            elif saved < POOR_SHARE * saving:
                trusted_j = MOST_LEFT * all_moved_j
            run, changes = there, None
        else:
            beyond = [now - (has + sum_in_turn(per_j * moved_j)) for now, has, per_j in zip(
                changes.spare(trip, there, needs), spare, changes.needs_per_j)]
            if not is_met and saved > MENDED_SHARE * saving and mends < MOST_MENDS:
                mends += 1
            else:
                # The deviation from the promise grows with the square of the heat that is moved.
                left = saving / (2.0 * (saving - saved)) if saved < saving else MOST_LEFT
                left = min(max(left, LEAST_LEFT), MOST_LEFT)
                trusted_j, mends = left * all_moved_j, 0
                beyond = [left * left * more for more in beyond]
    return run


def _paid_j(trip: Trip, run: Schedule) -> float:
    """Return the heat of a run beyond surplus [J, electrical]."""
    return sum_in_turn(np.maximum(run.heater_power_w - free_heat_w(trip, run), 0.0)
                       * trip.route.duration_s)


def _best_exchange(changes: LimitChanges, spare: list[float], trusted_j: float) -> FloatArray:
    """Return how much of each of the LimitChanges saves the most [J], out of `trusted_j` in total."""
    greatest = [_greatest(per_j) for per_j in changes.needs_per_j]
    uses = np.array([*(-per_j / most for per_j, most in zip(changes.needs_per_j, greatest)),
                     np.ones(len(changes.step))])
    left = [has / most for has, most in zip(spare, greatest)]
    return maximise(changes.charge_per_j / _greatest(changes.charge_per_j), uses, [*left, trusted_j],
                    changes.most_j)


def _greatest(values: FloatArray) -> float:
    """Return the greatest magnitude of values, or 1 if all are 0."""
    return float(np.abs(values).max()) or 1.0


def _commands_w(trip: Trip, run: Schedule, changes: LimitChanges, moved_j: FloatArray) -> FloatArray:
    """Return the commanded heater powers (N,) [W] after an exchange, without surplus."""
    wanted_w = run.heater_power_w.copy()
    np.add.at(wanted_w, changes.step, changes.sign * moved_j / trip.route.duration_s[changes.step])
    free_w = free_heat_w(trip, run)
    is_paid = wanted_w > np.where(free_w > 0.0, free_w + SURPLUS_TOLERANCE_W, 0.0)
    return np.where(is_paid, np.minimum(wanted_w, trip.heater_limit_w), 0.0)
