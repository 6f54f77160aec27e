# SPDX-License-Identifier: Apache-2.0
"""The model's inputs along a route, its runs over a trip, their limits and energies: the Python engine's."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import AnyNumber, ARRAYS, FloatArray, FLOATS, JOULES_PER_WH, SATURATING_FLOATS
from bev_preheat.tunables import LONGEST_STEP_S, TIME_CONSTANT_SHARE
from bev_preheat.vehicle.model import (
    deliverable_w,
    heat_with_brake_w,
    hottest_c,
    idle_heat_w,
    idle_power_w,
    Integrator,
    leaked_w,
    make_rates,
    make_terminal_limits,
    Step,
    TripColumns,
)
from bev_preheat.vehicle.variants import KEPT_VEHICLES

if TYPE_CHECKING:
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


def model_inputs(vehicle: Vehicle, route: Route, heater_share: float,
                 heat_lag_s: float) -> tuple[Route, TripColumns]:
    """Return a route, with long segments divided, and its TripColumns; see `trip.make_trip`."""
    whole, leakage = route, vehicle.battery.leakage
    leakage_w_per_k = leakage.coefficient_w_per_k(whole.speed_mps)
    route = whole.divided(_longest_steps_s(vehicle, leakage_w_per_k))
    if route is not whole:
        leakage_w_per_k = leakage.coefficient_w_per_k(route.speed_mps)
    drivetrain_heat_w = vehicle.drivetrain.heat_to_battery_w(route.propulsion_power_magnitude_w)
    heater_limit_w = heater_share * np.maximum(
        vehicle.hvch.maximum_power_w - route.cabin_heating_power_w, 0.0)
    if heat_lag_s > 0.0:
        # The heat of other steps mostly arrives after the end.
        left_s = route.total_duration_s - route.time_s[1:] + 0.5 * route.duration_s
        heater_limit_w = (left_s > heat_lag_s) * heater_limit_w
    return route, TripColumns.of_columns(
        route.time_s, route.duration_s,
        idle_power_w(route.propulsion_power_w, route.cabin_heating_power_w, route.auxiliary_power_w),
        route.propulsion_power_variance_w2,
        idle_heat_w(leakage_w_per_k, route.ambient_temperature_c, drivetrain_heat_w),
        leakage_w_per_k, heater_limit_w, route.propulsion_power_w, drivetrain_heat_w,
        route.ambient_temperature_c)


def _longest_steps_s(vehicle: Vehicle, leakage_w_per_k: FloatArray) -> FloatArray | float:
    """Return the longest step for integrating the model [s], for each leakage (N,) or for all."""
    stiff = stiff_w_per_k(vehicle)
    if leakage_w_per_k.max() <= stiff:
        return LONGEST_STEP_S
    return LONGEST_STEP_S * np.minimum(1.0, stiff / np.maximum(leakage_w_per_k, stiff))


def stiff_w_per_k(vehicle: Vehicle) -> float:
    """Return the leakage above which steps must be shorter [W/K]."""
    return (TIME_CONSTANT_SHARE / LONGEST_STEP_S) * vehicle.battery.heat_capacity_j_per_k


@lru_cache(maxsize=KEPT_VEHICLES)
def step_of_floats(vehicle: Vehicle, make_integrator: Integrator,
                   saturating: bool = False) -> Step[float]:
    """Return one step of the vehicle's model for floats; cached, because building it costs more than a step."""
    return make_integrator(make_rates(vehicle, SATURATING_FLOATS if saturating else FLOATS))


def run_forward(trip: Trip, make_integrator: Integrator, soc: float, temperature_c: float,
                heater_power_w: FloatArray | None = None,
                brake_power_w: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return (soc, temperature_c) (N + 1,) of a trip under powers (N,), as of `Trip.inputs`, ignoring limits."""
    start = np.array([soc]), np.array([temperature_c])
    return run_on(trip, make_integrator, *start, 0, heater_power_w, brake_power_w)


def run_on(trip: Trip, make_integrator: Integrator, soc: FloatArray, temperature_c: FloatArray,
           first: int, heater_power_w: FloatArray | None = None,
           brake_power_w: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Do as `run_forward` from step `first` on, after a run that is known until then, soc and temperature_c."""
    columns = [column[first:].tolist() for column in trip.inputs(heater_power_w, brake_power_w)]
    states = rolled(partial(step_of_floats, trip.vehicle, make_integrator),
                    (soc.item(first), temperature_c.item(first)), columns)
    return np.concatenate((soc[:first], states[0])), np.concatenate((temperature_c[:first], states[1]))


def rolled(step_of: Callable[[bool], Callable[..., tuple[float, ...]]], start: tuple[float, ...],
           columns: Sequence[Sequence[float]]) -> FloatArray:
    """
    Return the states at each instant as rows, the start first, under a step's inputs in columns.

    `step_of` returns the step, given whether it is driven with the battery's highest power if that is not enough.
    """
    for is_saturating in (False, True):
        step, states, rows = step_of(is_saturating), start, [start]
        try:
            for inputs in zip(*columns):
                states = step(*states, *inputs)[:len(start)]
                rows.append(states)
            break
        except (ValueError, ArithmeticError):
            # No root or, far beyond an empty battery, no number at all.
            if is_saturating:
                raise
    return np.array(rows).T.copy()


def limits_of_steps_w(vehicle: Vehicle, soc: FloatArray, temperature_c: FloatArray,
                      variance_w2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return least and most terminal power [W] (K,) that keep the limits at both ends of each step.

    `soc` and `temperature_c` [deg C] (K + 1,) are the states at the ends of the steps, `variance_w2`
    (K,) their power variances [W^2].
    """
    limits = make_terminal_limits(vehicle, ARRAYS)
    (least_w, most_w), (least_end_w, most_end_w) = (
        limits(soc[ends], temperature_c[ends], variance_w2) for ends in (slice(-1), slice(1, None)))
    return np.maximum(least_w, least_end_w), np.minimum(most_w, most_end_w)


def is_described(trip: Trip, schedule: Schedule) -> bool:
    """Return whether a run stays within the charge and heat that the model describes."""
    return bool(schedule.soc.min() > 0.0 and schedule.soc.max() <= 1.0
                and schedule.temperature_c.max() <= hottest_c(trip.vehicle))


def keeps_limits(trip: Trip, schedule: Schedule,
                 find_w: Callable[..., tuple[FloatArray, FloatArray]] = limits_of_steps_w) -> bool:
    """Return whether a schedule made without regard to limits keeps those of an engine's `limits_of_steps_w`."""
    battery = trip.vehicle.battery
    lowest_c, highest_c = battery.temperature_range_c
    temperature_c, soc = schedule.temperature_c, schedule.soc
    if (temperature_c.max() > highest_c or temperature_c.min() < lowest_c
            or soc.min() <= 0.0 or soc.max() > 1.0):
        return False
    terminal_w = trip.idle_power_w + schedule.drawn_power_w
    least_w, most_w = find_w(trip.vehicle, soc, temperature_c, trip.power_variance_w2)
    return bool(((terminal_w >= least_w) & (terminal_w <= most_w)).all())


@dataclass(frozen=True)
class Energies:
    """
    Energies of a forward run [Wh]; the first four rows are those of the paper's Table II.

    `leakage` is negative if heat is lost. `battery_total` is the energy from the cells, including
    losses: the integral of U_oc I_b. With a heat path, `hvch_heat` is the heat that reaches the battery before
    arrival; `hvch_electric` and `battery_total` include the energy that a heater with lag draws after arrival.
    """

    joule: float
    drivetrain_heat: float
    hvch_heat: float
    leakage: float
    hvch_electric: float
    battery_total: float


def energies_of(until_arrival_wh: Sequence[float], lost_wh: float = 0.0) -> Energies:
    """Return Energies [Wh] from those until arrival, in field order, and the heater's energy after arrival."""
    joule, drivetrain_heat, hvch_heat, leakage, hvch_electric, battery_total = until_arrival_wh
    return Energies(joule, drivetrain_heat, hvch_heat, leakage, hvch_electric + lost_wh,
                    battery_total + lost_wh)


class Accounts(NamedTuple):
    """
    The cost of a forward run: its energies, and their powers in each of the N steps [W].

    `leakage_w` is negative if heat is lost, `battery_power_w` is P_b, `undeliverable_power_w` the terminal
    power that the battery could not give.
    """

    energy_wh: Energies
    joule_heat_w: FloatArray
    leakage_w: FloatArray
    battery_power_w: FloatArray
    undeliverable_power_w: FloatArray


def keep_accounts(trip: Trip, schedule: Schedule, deliverable: bool = False) -> Accounts:
    """
    Return the Accounts of a Schedule's forward run.

    Each term is integrated with the weights of the run's own integrator, so that the heat balance
    and the energy balance close to rounding. `deliverable`: the circuit is known to deliver every requested
    power. Heat that a run removes beyond the model's leakage, to hold the battery at the hottest planned
    temperature, counts as leakage.
    """
    vehicle = trip.vehicle
    if schedule.driven_share is not None:
        trip = trip.driven(schedule.driven_share)
    heater_power_w, soc, temperature_c = (
        schedule.drawn_power_w, schedule.soc, schedule.temperature_c)
    lost_wh = 0.0 if schedule.heat is None else schedule.heat.lost_electric_wh
    inputs = schedule.inputs(trip)
    duration_s, terminal_power_w = inputs[:2]
    hours = duration_s / JOULES_PER_WH
    _, end_c, mean_temperature_c, joule_heat_w = _step_of_arrays(
        vehicle, schedule.make_integrator)(soc[:-1], temperature_c[:-1], *inputs)
    undeliverable_w = np.zeros(len(duration_s)) if deliverable else np.maximum(
        terminal_power_w - deliverable_power_w(vehicle, soc[:-1], temperature_c[:-1]), 0.0)
    drivetrain_heat_w = heat_with_brake_w(vehicle, trip.drivetrain_heat_w, schedule.brake_power_w)
    leakage_w = leaked_w(trip.leakage_w_per_k, trip.route.ambient_temperature_c, mean_temperature_c)
    hottest = temperature_c[1:] >= hottest_c(vehicle)
    if hottest.any():
        leakage_w = leakage_w - np.where(
            hottest, end_c - temperature_c[1:],
            0.0) * vehicle.battery.heat_capacity_j_per_k / duration_s
    battery_power_w = terminal_power_w - undeliverable_w + joule_heat_w
    hvch_electric_wh = float(hours @ heater_power_w)
    hvch_heat_wh = vehicle.hvch.efficiency * hvch_electric_wh
    if schedule.heat is not None:
        hvch_heat_wh = float(hours @ schedule.heat.arriving_heat_w)
    return with_shell_accounts(trip, schedule, Accounts(
        energy_wh=energies_of((
            float(hours @ joule_heat_w), float(hours @ drivetrain_heat_w), hvch_heat_wh,
            float(hours @ leakage_w), hvch_electric_wh, float(hours @ battery_power_w)), lost_wh),
        joule_heat_w=joule_heat_w,
        leakage_w=leakage_w,
        battery_power_w=battery_power_w,
        undeliverable_power_w=undeliverable_w))


def with_shell_accounts(trip: Trip, schedule: Schedule, accounts: Accounts) -> Accounts:
    """Return the Accounts of a Schedule; of a battery with a shell, where heat arrives and from which it leaks."""
    if schedule.heat is None or not trip.vehicle.heat_path.is_shell:
        return accounts
    excess_k, energies = schedule.heat.coolant_excess_k, accounts.energy_wh
    leakage_w = accounts.leakage_w - trip.leakage_w_per_k * 0.5 * (excess_k[:-1] + excess_k[1:])
    # Other sources, which are not allowed beside a lag, draw another power than their heat as HVCH power.
    heater_w = schedule.drawn_power_w if trip.mix.is_alone else schedule.heater_power_w
    return accounts._replace(leakage_w=leakage_w, energy_wh=replace(
        energies, hvch_heat=trip.vehicle.hvch.efficiency * float(trip.route.duration_s @ heater_w) / JOULES_PER_WH,
        leakage=float(trip.route.duration_s @ leakage_w) / JOULES_PER_WH))


@lru_cache(maxsize=KEPT_VEHICLES)
def _step_of_arrays(vehicle: Vehicle, make_integrator: Integrator) -> Step[FloatArray]:
    return make_integrator(make_rates(vehicle, ARRAYS))


def deliverable_power_w(vehicle: Vehicle, soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
    """Return the highest terminal power [W] of the circuit, U_oc^2/(4 R); shape of the inputs."""
    circuit = vehicle.battery.open_circuit_voltage, vehicle.battery.resistance
    return deliverable_w(*(curve.function(ARRAYS)(soc, temperature_c) for curve in circuit))
