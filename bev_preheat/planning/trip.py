# SPDX-License-Identifier: Apache-2.0
"""A route as driven by one vehicle: the model's inputs in each step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np

from bev_preheat.numerics import FloatArray
from bev_preheat.planning import engine
from bev_preheat.planning.heat_mix import ALONE, Alone, HeatMix
from bev_preheat.route.segments import Route
from bev_preheat.vehicle.description import STANDING_MPS, steps_below_w, Vehicle
from bev_preheat.vehicle.model import heat_with_brake_w, heat_with_heater_w, TripColumns

# This many trips with at most this many segments are cached, for planning again from another state or for another
# target.
KEPT_TRIPS = 8
MOST_KEPT_SEGMENTS = 2000
# Columns of a step's arguments in `model`, after the states.
Inputs: TypeAlias = 'tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]'


class _Column(cached_property[FloatArray]):
    """One of a Trip's TripColumns, by the name of the attribute."""

    def __init__(self) -> None:
        super().__init__(lambda trip: trip.columns.column(self.attrname))


@dataclass(frozen=True)
class Trip:
    """The model's inputs in N steps, without battery heating: columns of shape (N,), `time_s` [s] (N + 1,)."""

    vehicle: Vehicle
    route: Route
    columns: TripColumns
    mix: HeatMix | Alone = ALONE

    time_s = _Column()
    # P_t without battery heating [W], and mean square minus squared mean of the propulsion power [W^2].
    idle_power_w = _Column()
    power_variance_w2 = _Column()
    # gamma T_amb + Q_ed, and Q_ed alone [W]; gamma [W/K].
    idle_heat_w = _Column()
    drivetrain_heat_w = _Column()
    leakage_w_per_k = _Column()
    # The HVCH power beyond the cabin's share (9g) [W]; with further heat sources the most heat, as HVCH power.
    heater_limit_w = _Column()

    @property
    def drawing_limit_w(self) -> FloatArray:
        """The most electrical power of all heat sources [W] (N,)."""
        return self.heater_limit_w if isinstance(self.mix, Alone) else self.mix.most_power_w

    @property
    def most_cold_w(self) -> FloatArray:
        """The least heat of all sources, as HVCH power [W] (N,): at most 0."""
        mix = self.mix
        return np.zeros(len(self.route)) if isinstance(mix, Alone) else mix.most_cold_w

    @property
    def hvch_limit_w(self) -> FloatArray:
        """The power of the HVCH that the cabin leaves [W] (N,)."""
        return self.heater_limit_w if isinstance(self.mix, Alone) else self.mix.hvch_limit_w

    def changed(self, **columns: FloatArray) -> Trip:
        """Return the Trip with other columns, by name."""
        return replace(self, columns=self.columns.changed(**columns))

    def inputs(
            self, heater_power_w: FloatArray | float | None = None,
            brake_power_w: FloatArray | float | None = None) -> Inputs:
        """
        Return the inputs of `model` steps under a heater and a friction brake power [W], a tuple of arrays.

        In the order of a step's arguments: duration, terminal power, power variance, heat, leakage.
        None means no power. The friction brake's power is not regenerated, so it reduces the drivetrain's heat.
        """
        power_w, heat_w = self.idle_power_w, self.idle_heat_w
        if heater_power_w is not None:
            power_w = power_w + heater_power_w
            heat_w = heat_with_heater_w(self.vehicle, heat_w, heater_power_w)
        if brake_power_w is not None:
            power_w = power_w + brake_power_w
            heat_w = heat_with_brake_w(self.vehicle, heat_w, brake_power_w)
        return (self.route.duration_s, power_w, self.power_variance_w2, heat_w,
                self.leakage_w_per_k)

    def step_at(self, instant_s: float) -> int:
        """Return the index of the step in which an instant [s] lies."""
        return min(int(np.searchsorted(self.time_s, instant_s, side='right')), len(self.route)) - 1

    def driven(self, share: FloatArray) -> Trip:
        """Return the Trip with a share (N,) of each step driven; standing, it leaks heat and draws no power."""
        return self.changed(
            idle_power_w=share * self.idle_power_w,
            power_variance_w2=share * self.power_variance_w2,
            idle_heat_w=self.idle_heat_w - (1.0 - share) * self.drivetrain_heat_w,
            drivetrain_heat_w=share * self.drivetrain_heat_w)


def make_trip(vehicle: Vehicle, route: Route, heater_share: float = 1.0,
              heat_lag_s: float = 0.0) -> Trip:
    """
    Return the Trip of a vehicle on a route, with long segments divided.

    `heater_share` (0 ... 1) is the share of the power left by the cabin that is available to the battery. Heat
    arrives `heat_lag_s` [s] late; it is not produced in the last steps, from which it would arrive too late.
    """
    make = uncached_trip if len(route) > MOST_KEPT_SEGMENTS else _cached_trip
    return make(vehicle, route, heater_share, heat_lag_s)


def uncached_trip(vehicle: Vehicle, route: Route, heater_share: float, heat_lag_s: float) -> Trip:
    """Return the same Trip as `make_trip`, without the cache."""
    trip = Trip(vehicle, *engine.model_inputs(vehicle, route, heater_share, heat_lag_s))
    gates = vehicle.heating_gates
    if gates.only_while_standing or gates.power_steps_w:
        # The heater's steps are those of its command, whatever share arrives.
        limit_w = steps_below_w(gates.power_steps_w, np.maximum(
            vehicle.hvch.maximum_power_w - trip.route.cabin_heating_power_w, 0.0))
        is_open = trip.heater_limit_w > 0.0
        if gates.only_while_standing:
            is_open &= trip.route.speed_mps < STANDING_MPS
        trip = trip.changed(heater_limit_w=np.where(is_open, heater_share * limit_w, 0.0))
    if not vehicle.heat_sources:
        return trip
    is_open = trip.time_s[-1] - trip.time_s[1:] + 0.5 * trip.route.duration_s > heat_lag_s
    mix = HeatMix(vehicle, trip.route, trip.heater_limit_w)
    return replace(trip.changed(heater_limit_w=is_open * mix.most_heat_w), mix=mix)


_cached_trip = lru_cache(maxsize=KEPT_TRIPS)(uncached_trip)


def heated_throughout(trip: Trip, taken_w: FloatArray) -> Trip:
    """
    Return the Trip of a heater that draws `taken_w` (N,) [W], whatever is commanded.

    As much heat arrives as the heater could give; like the drivetrain's heat, to which it is added, it ends when
    the vehicle stands without charge.
    """
    heat_w = trip.vehicle.hvch.efficiency * trip.heater_limit_w
    return trip.changed(
        idle_power_w=trip.idle_power_w + taken_w, idle_heat_w=trip.idle_heat_w + heat_w,
        drivetrain_heat_w=trip.drivetrain_heat_w + heat_w, heater_limit_w=np.zeros(len(heat_w)))
