# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of the arrival temperature: the uncertainty of an estimate, propagated along a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.belief import terms_of, WANDERED_IN_AN_HOUR
from bev_preheat.estimation.estimate import (
    HEAT_LAG,
    JOULE_RISE,
    PROPULSION,
    rates_and_slopes,
    SIZE,
    SOC,
    state_rates,
    TEMPERATURE,
    UNDER_WAY,
)
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.numerics import array_exp, ARRAYS
from bev_preheat.tunables import (
    LOCAL_LAG_S,
    NOISY_FROM_W,
    POWER_NOISE,
    POWER_NOISE_LASTS_S,
    SETTLED_K,
    UNDESCRIBED_SHARE,
    UNMODELLED_K,
    UNSEEN_LAG_S,
    UNSEEN_SHARE,
)
from bev_preheat.vehicle.core_calls import arrival_variance as native_variance
from bev_preheat.vehicle.core_calls import vehicle_in_core
from bev_preheat.vehicle.core_library import operation
from bev_preheat.vehicle.description import HVCH
from bev_preheat.vehicle.variants import DriveInputs, with_coolant_in_battery

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.estimation.hypotheses import SuspectedFault
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.plan import Plan
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import HeatSource, Vehicle


class DrivenRoute(NamedTuple):
    """A vehicle, and a route whose segments are the steps of its plan."""

    vehicle: Vehicle
    route: Route


@dataclass(frozen=True, eq=False)
class Forecast:
    """
    Uncertainty of a plan's predicted arrival; computed on first use, so that no command waits for it.

    `deviation_k` is the standard deviation of the arrival with re-planning on the way; `as_planned_k` is that
    of the fixed plan, the error that heating has to correct. The fields are arguments of `arrival_deviation_k`,
    and the faults `suspected` of heat sources, by name: the plan is that of healthy ones.
    """

    trip: DrivenRoute
    plan: Plan
    estimate: Estimate
    suspected: tuple[tuple[str, SuspectedFault], ...] = ()

    @cached_property
    def as_planned_k(self) -> float:
        """Standard deviation of the temperature on arrival if the plan is executed unchanged [K]."""
        return arrival_deviation_k(self.trip, self.plan, self.estimate)

    @cached_property
    def deviation_k(self) -> float:
        """Standard deviation of the temperature on arrival [K]."""
        replanned_k = replanned_deviation_k(self.as_planned_k, self.trip, self.plan, self.estimate)
        return math.hypot(replanned_k, _suspected_k(
            self.trip, self.plan, self.suspected, self.estimate.under_way_k))

    @cached_property
    def local_rise_k(self) -> float:
        """Rise of the temperature reading above its place by the Joule heat before arrival [K]."""
        car, states, drive = _steps(self.trip, self.plan)
        _, _, joule_w = state_rates(car, states[:, np.newaxis], drive)
        left = array_exp((self.trip.route.time_s - self.trip.route.total_duration_s) / LOCAL_LAG_S)
        return 1e-3 * self.estimate.mean.item(JOULE_RISE) * float(np.average(joule_w[:, 0], weights=np.diff(left)))


def arrival_sensitivities(trip: DrivenRoute, plan: Plan) -> tuple[FloatArray, FloatArray]:
    """
    Change of the arrival temperature [K] with each element of the state at the plan's start, (SIZE,).

    The adjoint of the model's temperature along the plan: the effect on arrival of a kelvin in step k,
    times the effect of each element on the temperature in that step. Second, the change with
    the propulsion factor in each step alone, shape (N,).
    """
    _, slopes = rates_and_slopes(*_steps(trip, plan))
    slopes = slopes[:, TEMPERATURE] * trip.route.duration_s[:, np.newaxis]
    # Effect on arrival of a kelvin at the end of each step.
    kept = array_exp(slopes[:, TEMPERATURE])
    worth = np.concatenate((np.cumprod(kept[:0:-1])[::-1], [1.0]))
    by_step = worth[:, np.newaxis] * slopes
    total = by_step.sum(axis=0)
    # Heat under way at the start arrives.
    total[TEMPERATURE] = total[UNDER_WAY] = float(np.prod(kept))
    return total, by_step[:, PROPULSION]


def _steps(trip: DrivenRoute, plan: Plan) -> tuple[Vehicle, FloatArray, DriveInputs]:
    """Return the vehicle, the states (N, SIZE) at the beginning of a plan's steps, and DriveInputs (N, 1)."""
    route = _fed_route(trip, plan)
    states = np.zeros((len(route), SIZE))
    states[:, TEMPERATURE] = plan.battery_temperature_c[:-1]
    states[:, SOC] = plan.soc[:-1]
    return _of_one_mass(trip.vehicle), states, DriveInputs(*(column[:, np.newaxis] for column in (
        route.speed_mps, route.ambient_temperature_c, route.propulsion_power_w,
        route.propulsion_power_variance_w2, route.propulsion_power_magnitude_w,
        route.cabin_heating_power_w, route.auxiliary_power_w, plan.hvch_battery_power_w,
        plan.command_w - plan.hvch_battery_power_w)))


def arrival_deviation_k(trip: DrivenRoute, plan: Plan, estimate: Estimate) -> float:
    """
    Return the standard deviation [K] of the temperature on arrival if the plan is executed unchanged.

    `trip` must be that of the corrected vehicle and route of the plan.
    """
    return math.sqrt(_arrival_variance_k2(trip, plan, estimate) + wandered_k2(trip.route.total_duration_s)
                     + _lag_variance_k2(trip, plan, estimate))


def _k_per_j(car: Vehicle) -> float:
    return car.hvch.efficiency / car.pack_heat_capacity_j_per_k


def _unseen_k(trip: DrivenRoute, plan: Plan, estimate: Estimate) -> float:
    """
    Return the standard deviation [K] of the heat in the battery on arrival that no reading tells.

    The sensor may show it before the core has it. Behind a slow shell the readings tell how fast the core warms,
    and the heat under way is that rate times an uncertain lag.
    """
    lag_deviation = math.sqrt(max(estimate.covariance.item(HEAT_LAG, HEAT_LAG), 0.0))
    arriving_k = estimate.under_way_k * math.exp(-trip.route.total_duration_s / estimate.heat_lag_s)
    return max(UNSEEN_SHARE * _under_way_k(trip, plan, UNSEEN_LAG_S), estimate.share_in_battery * lag_deviation * (
        arriving_k + _under_way_k(trip, plan, estimate.heat_lag_s)))


def _under_way_k(trip: DrivenRoute, plan: Plan, lag_s: float) -> float:
    """Return the heat of a Plan under way on arrival with a lag [s], as a rise of the temperature [K]."""
    left = array_exp((trip.route.time_s - trip.route.total_duration_s) / lag_s)
    return lag_s * _k_per_j(trip.vehicle) * float(plan.command_w @ np.diff(left))


def _lag_variance_k2(trip: DrivenRoute, plan: Plan, estimate: Estimate) -> float:
    """Return the variance [K^2] of the temperature on arrival by the lag of the heat that a Plan sends."""
    car, lag_s = trip.vehicle, estimate.outside_lag_s
    ages = (trip.route.total_duration_s - trip.route.time_s) / lag_s
    # Of heat of age x, in lags, (1 + x) e^-x changes with the logarithm of the lag.
    changing = (1.0 + ages) * array_exp(-ages)
    slope_k = lag_s * _k_per_j(car) * float(plan.command_w @ np.diff(changing))
    return slope_k**2 * max(estimate.covariance.item(HEAT_LAG, HEAT_LAG), 0.0)


def _variance_in_core_k2(trip: DrivenRoute, plan: Plan, estimate: Estimate) -> float:
    car = _of_one_mass(trip.vehicle)
    return native_variance(
        vehicle_in_core(car), terms_of(car.heat_path), car.battery.leakage, _fed_route(trip, plan).block,
        plan.hvch_battery_power_w, plan.command_w - plan.hvch_battery_power_w, plan.battery_temperature_c,
        plan.soc, _arriving_covariance(trip, estimate))


def _variance_k2(trip: DrivenRoute, plan: Plan, estimate: Estimate) -> float:
    """Return the variance [K^2] of the temperature on arrival by the elements of the state, and by traffic."""
    route = trip.route
    sensitivities, by_step = arrival_sensitivities(trip, plan)
    # No factor covers traffic that differs from step to step. If a step drives and regenerates equally, its mean
    # power is small but its heat is not.
    spread = POWER_NOISE * np.maximum(
        1.0, NOISY_FROM_W / np.maximum(route.propulsion_power_magnitude_w, 1.0))
    lasting = np.maximum(1.0, POWER_NOISE_LASTS_S / route.duration_s)
    traffic = float(((by_step * spread)**2 * lasting).sum())
    return max(0.0, float(sensitivities @ _arriving_covariance(trip, estimate) @ sensitivities)) + traffic


_arrival_variance_k2 = operation(_variance_in_core_k2, _variance_k2)


def _fed_route(trip: DrivenRoute, plan: Plan) -> Route:
    """Return the route whose consumers include the heat sources beside the HVCH."""
    sources_w = [power_w for name, power_w in plan.source_power_w.items() if name != HVCH]
    return trip.route if not sources_w else replace(
        trip.route, auxiliary_power_w=trip.route.auxiliary_power_w + np.sum(sources_w, axis=0))


def _of_one_mass(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle whose shell counts as battery; any other vehicle as it is."""
    return with_coolant_in_battery(vehicle) if vehicle.heat_path.is_shell else vehicle


def _arriving_covariance(trip: DrivenRoute, estimate: Estimate) -> FloatArray:
    """Return the covariance of an Estimate, with the heat under way as far as it arrives in time."""
    share = np.ones(SIZE)
    share[UNDER_WAY] = 1.0 - (1.0 - estimate.share_in_battery) * math.exp(
        -trip.route.total_duration_s / estimate.outside_lag_s)
    covariance: FloatArray = estimate.covariance * np.outer(share, share)
    return covariance


def wandered_k2(duration_s: float) -> float:
    """Return the variance of the temperature from unmodelled heat in a drive of `duration_s` [K^2]."""
    return float(WANDERED_IN_AN_HOUR[TEMPERATURE]) * duration_s / 3600.0


def replanned_deviation_k(as_planned_k: float, trip: DrivenRoute, plan: Plan, estimate: Estimate) -> float:
    """
    Return the standard deviation of the temperature on arrival [K] with re-planning on the way.

    `as_planned_k` [K] is that of the fixed plan. While heating lies ahead, it ends later if the battery
    turns out colder, and earlier if it turns out warmer. The rest is the uncertainty of the temperature, that of
    the drive after heating ends, errors beyond the heat that can be added or saved, and the model error. That is
    UNMODELLED_K, and without `thermal` a share of the sensor's excess, and the heat that arrives late.
    """
    colder_k, warmer_k, end_s = _heat_ahead(trip, plan)
    unmodelled_k = UNMODELLED_K if estimate.path.is_shell else math.hypot(
        UNMODELLED_K, UNDESCRIBED_SHARE * estimate.sensor_excess_k,
        math.sqrt(_lag_variance_k2(trip, plan, estimate)), _unseen_k(trip, plan, estimate))
    if warmer_k <= 0.0:
        return math.hypot(as_planned_k, unmodelled_k)
    arrival_s = trip.route.total_duration_s
    after = (arrival_s - end_s) / arrival_s
    kept_k2 = min(estimate.settled_deviation_k, SETTLED_K)**2 + wandered_k2(arrival_s - end_s) + after * max(
        0.0, as_planned_k**2 - estimate.settled_deviation_k**2 - wandered_k2(arrival_s))
    beyond_k2 = as_planned_k**2 * (_beyond(colder_k / as_planned_k) + _beyond(warmer_k / as_planned_k))
    return math.hypot(min(as_planned_k, math.sqrt(kept_k2 + beyond_k2)), unmodelled_k)


def _heat_ahead(trip: DrivenRoute, plan: Plan) -> tuple[float, float, float]:
    """
    Return by how much a Plan can correct a battery that turns out colder and warmer [K], and until when [s].

    That is the heat that the HVCH can add and save, or, if the plan cools at last, the cold that can be saved and
    added; until the end of the latest heating or cooling.
    """
    car, route = trip.vehicle, trip.route
    switched = np.flatnonzero(plan.command_w)
    if len(switched) == 0:
        return 0.0, 0.0, 0.0
    cools, k_per_j = bool(plan.command_w[switched[-1]] < 0.0), _k_per_j(car)
    if cools:
        weather = route.ambient_temperature_c, plan.battery_temperature_c[:-1]
        power_w = taken_w = np.maximum(-plan.command_w, 0.0)
        limit_w = -np.sum([_most_heat_w(each, *weather) for each in car.heat_sources if each.cools], axis=0)
    else:
        power_w, taken_w = np.maximum(plan.command_w, 0.0), plan.hvch_battery_power_w
        limit_w = np.maximum(0.0, car.hvch.maximum_power_w - route.cabin_heating_power_w)
    saved_k = k_per_j * float((power_w * route.duration_s).sum())
    added_k = k_per_j * float(np.maximum(0.0, limit_w - taken_w) @ route.duration_s)
    end_s = float(plan.time_s[switched[-1] + 1]) if plan.heating_end_s is None else plan.heating_end_s
    return (saved_k, added_k, end_s) if cools else (added_k, saved_k, end_s)


def _most_heat_w(source: HeatSource, ambient_c: FloatArray, temperature_c: FloatArray) -> FloatArray:
    """Return the most heat of a HeatSource as HVCH power [W], below 0 if it cools."""
    return source.maximum_power_w.function(ARRAYS)(ambient_c, temperature_c) * source.hvch_watts.function(ARRAYS)(
        ambient_c, temperature_c)


def _suspected_k(trip: DrivenRoute, plan: Plan, suspected: Sequence[tuple[str, SuspectedFault]],
                 under_way_k: float) -> float:
    """
    Return the root mean square [K] by which suspected faults change the arrival, beyond what heat can make up.

    The heat under way [K] is that of healthy heat sources, too.
    """
    if not suspected:
        return 0.0
    car, route = trip.vehicle, trip.route
    colder_k, warmer_k, _ = _heat_ahead(trip, plan)
    others = {source.name: source for source in car.heat_sources}
    square_k2 = 0.0
    for name, fault in suspected:
        source = others.get(name)
        power_w = plan.source_power_w.get(
            name, plan.hvch_battery_power_w if name == HVCH else np.zeros(len(route)))
        if source is None:
            if name != HVCH:
                # The plan is made without it.
                continue
            most_w = np.maximum(0.0, car.hvch.maximum_power_w - route.cabin_heating_power_w)
            k_per_j = _k_per_j(car)
        else:
            weather = route.ambient_temperature_c, plan.battery_temperature_c[:-1]
            most_w = source.maximum_power_w.function(ARRAYS)(*weather)
            k_per_j = _k_per_j(car) * float(np.abs(source.hvch_watts.function(ARRAYS)(*weather)).mean())
        is_stuck = fault.heater is Heater.STUCK_ON
        off_w = np.maximum(0.0, most_w - power_w) if is_stuck else (1.0 - fault.share) * power_w
        made_up_k = warmer_k if is_stuck else colder_k if others else fault.share * colder_k
        off_k = k_per_j * float(off_w @ route.duration_s) + (1.0 - fault.share) * abs(under_way_k)
        square_k2 += fault.probability * max(0.0, off_k - (
            0.0 if source is not None and source.cools else made_up_k))**2
    return math.sqrt(square_k2)


def _beyond(deviations: float) -> float:
    """Return the mean square excess of a standard normal variable over `deviations` on one side."""
    density = math.exp(-0.5 * deviations**2) / math.sqrt(2.0 * math.pi)
    return (1.0 + deviations**2) * 0.5 * math.erfc(deviations / math.sqrt(2.0)) - deviations * density
