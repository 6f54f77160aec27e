# SPDX-License-Identifier: Apache-2.0
"""The battery's power limits (9i): whether a run keeps them, and the forward run that does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning import dynamics, engine
from bev_preheat.planning.heated_limits import along_heated_limits
from bev_preheat.planning.schedule import Schedule, switched_on_s
from bev_preheat.planning.wanted_heat import WantedHeat
from bev_preheat.tunables import COLDER_BY_K
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.description import Vehicle


def colder(vehicle: Vehicle, temperature_c: FloatArray) -> FloatArray:
    """Return temperatures COLDER_BY_K below these [deg C], but not below the vehicle's range."""
    return np.maximum(temperature_c - COLDER_BY_K, vehicle.battery.temperature_range_c[0])


def limit_is_near(trip: Trip, soc: FloatArray, temperature_c: FloatArray) -> bool:
    """Return whether a limit may act in a run that is at most COLDER_BY_K colder than this one (N + 1 values)."""
    least_w, most_w = engine.limits_of_steps_w(
        trip.vehicle, soc, colder(trip.vehicle, temperature_c), trip.power_variance_w2)
    may_overcharge = (trip.route.propulsion_power_w < 0.0) & (trip.idle_power_w < least_w)
    return bool(may_overcharge.any() or (trip.idle_power_w + trip.heater_limit_w > most_w).any())


def limits_along(trip: Trip, schedule: Schedule) -> tuple[FloatArray, FloatArray]:
    """
    Return least and most terminal power [W] (N,) of each step of a Schedule.

    They keep the limits at both ends of the step.
    """
    return dynamics.limits_along(trip, schedule, engine.limits_of_steps_w)


def limits_hold(trip: Trip, schedule: Schedule) -> bool:
    """Return whether a schedule made without regard to limits keeps them all."""
    return dynamics.keeps_limits(trip, schedule, engine.limits_of_steps_w)


def run_within_limits(trip: Trip, state: BatteryState, wanted: WantedHeat, take_surplus: bool) -> Schedule:
    """
    Return the Schedule of a forward run that keeps the limits.

    `wanted` is the WantedHeat, cut if the battery cannot deliver it or would exceed its highest temperature. With
    `take_surplus`, regeneration that the battery cannot accept goes to the heater first, up to BELOW_HIGHEST_K
    below that temperature; the friction brake takes the rest.

    The state of charge stays within 0 ... 1: the friction brake takes power that would overfill the battery, and
    when the charge runs out the vehicle stands for the rest of the trip.
    """
    states, powers_w, stranded = engine.drive_within_limits(trip, state, wanted, take_surplus)
    empty_at_s, driven_share = _where_stranded(trip, stranded)
    start_s = switched_on_s(trip, powers_w[0])
    if start_s is not None:
        # A step that is heated in part because of a limit is heated evenly, from its beginning.
        start_s = float(trip.time_s[int(np.searchsorted(trip.time_s, start_s, side='right')) - 1])
    if not trip.vehicle.heat_path.is_direct:
        return along_heated_limits(trip, states, powers_w, start_s, empty_at_s, driven_share)
    (soc, temperature_c), (heater_power_w, brake_power_w) = states, powers_w
    return Schedule(start_s, heater_power_w, brake_power_w, soc, temperature_c, make_runge_kutta_4,
                    empty_at_s=empty_at_s, driven_share=driven_share)


def _where_stranded(trip: Trip,
                    stranded: tuple[int, float] | None) -> tuple[float | None, FloatArray | None]:
    """Return `empty_at_s` and `driven_share` of a Schedule; `stranded` as in a Course."""
    if stranded is None:
        return None, None
    empty, share = stranded
    driven_share = np.where(np.arange(len(trip.route)) < empty, 1.0, 0.0)
    driven_share[empty] = share
    return float(trip.time_s[empty] + share * trip.route.duration_s[empty]), driven_share


def run_unheated(trip: Trip, state: BatteryState) -> Schedule:
    """Return the Schedule of a forward run that keeps the limits, heated with free surplus only."""
    return run_within_limits(trip, state, WantedHeat(np.zeros(len(trip.route))), take_surplus=True)


def drive_as_planned(trip: Trip, state: BatteryState, heater_power_w: FloatArray,
                     take_surplus: bool = False) -> Schedule:
    """Return the Schedule of a forward run that keeps the limits under heater powers [W] (N,)."""
    return run_within_limits(trip, state, WantedHeat(heater_power_w), take_surplus)
