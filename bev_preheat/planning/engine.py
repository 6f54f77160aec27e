# SPDX-License-Identifier: Apache-2.0
"""
The engine: the ten operations on which planning is built: runs, their limits and energies, and plans.

Each exists twice: in the native core, whose calls are here, and in readable Python, which defines the result. The
core answers if it is used and accepts the vehicle and the numbers; otherwise Python answers, or raises the
appropriate exception. No other module of planning knows that there are two.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.planning import dynamics, heat_run, limited_drive, one_interval, recursion
from bev_preheat.planning.dynamics import Accounts, energies_of, keeps_limits, stiff_w_per_k, with_shell_accounts
from bev_preheat.planning.heat_run import first_heated_s, initial_states, with_heat
from bev_preheat.planning.limited_drive import Course
from bev_preheat.planning.one_interval import is_driven_as_planned, SwitchPlan
from bev_preheat.planning.recursion import PlanByValues
from bev_preheat.planning.schedule import HeatingInterval, REASONS, Schedule, ScheduleOutcome
from bev_preheat.planning.two_switches import switched_off
from bev_preheat.vehicle import core_calls as calls
from bev_preheat.vehicle.core_calls import vehicle_in_core
from bev_preheat.vehicle.core_library import Declined, operation
from bev_preheat.vehicle.core_structs import NativeTrip, NativeVehicle
from bev_preheat.vehicle.model import make_euler, make_runge_kutta_4
from bev_preheat.vehicle.variants import without_heat_path

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.limited_drive import WantedHeat
    from bev_preheat.planning.methods import Requirements
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.core_structs import SwitchPlanStruct
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat.vehicle.model import Integrator, TripColumns


def trip_in_core(trip: Trip) -> NativeTrip:
    """Return the columns of a Trip as a native struct, which is made once."""
    # Beside the fields, as a cached property is.
    beside = vars(trip.columns)
    if 'in_core' not in beside:
        beside['in_core'] = NativeTrip(trip.columns)
    native: NativeTrip = beside['in_core']
    return native


def _both(trip: Trip) -> tuple[NativeVehicle, NativeTrip]:
    return vehicle_in_core(trip.vehicle), trip_in_core(trip)


def _model_inputs_in_core(vehicle: Vehicle, route: Route, heater_share: float,
                          heat_lag_s: float) -> tuple[Route, TripColumns]:
    leakage = vehicle.battery.leakage
    return route, calls.make_trip(
        (leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps, vehicle.drivetrain.heat_share,
         stiff_w_per_k(vehicle), vehicle.hvch.maximum_power_w, heater_share, heat_lag_s), route.block)


def _run_forward_in_core(trip: Trip, make_integrator: Integrator, soc: float, temperature_c: float,
                         heater_power_w: FloatArray | None = None,
                         brake_power_w: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    vehicle, native = _both(trip)
    states = np.empty((2, native.steps + 1))
    states[:, 0] = soc, temperature_c
    calls.run(vehicle, _number_of(make_integrator), native, states, heater_power_w, brake_power_w)
    return states[0], states[1]


def _number_of(make_integrator: Integrator) -> int:
    number = calls.INTEGRATORS.get(make_integrator)
    if number is None:
        raise Declined
    return number


def _run_heated_in_core(trip: Trip, start: States, command_w: FloatArray) -> Schedule:
    states, heat_w = _roll_heated(trip, start, command_w)
    return with_heat(trip, states, command_w, np.zeros(len(trip.route)), first_heated_s(trip, command_w), heat_w)


def _roll_heated(trip: Trip, start: States,
                 command_w: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    vehicle, native = _both(trip)
    states = np.empty((4, native.steps + 1))
    states[:, 0] = start
    return states, calls.run_heated(vehicle, native, states, command_w)


def _drive_within_limits_in_core(trip: Trip, state: BatteryState, wanted: WantedHeat,
                                 take_surplus: bool) -> Course:
    vehicle, native = _both(trip)
    rows = 2 if trip.vehicle.heat_path.is_direct else 4
    states, powers_w = np.empty((rows, native.steps + 1)), np.empty((rows, native.steps))
    states[:, 0] = initial_states(state)[:rows]
    return Course(states, powers_w, calls.drive_as_planned(
        vehicle, native, wanted.power_w, wanted.below_c, take_surplus, states, powers_w))


def _limits_of_steps_w_in_core(vehicle: Vehicle, soc: FloatArray, temperature_c: FloatArray,
                               variance_w2: FloatArray) -> tuple[FloatArray, FloatArray]:
    return calls.limits_of_steps(vehicle_in_core(vehicle), soc, temperature_c, variance_w2)


def _keep_accounts_in_core(trip: Trip, schedule: Schedule, deliverable: bool = False) -> Accounts:
    if schedule.driven_share is not None:
        trip = trip.driven(schedule.driven_share)
    vehicle, native = _both(trip)
    heat = schedule.heat
    energies_wh, powers_w = calls.keep_accounts(
        vehicle, _number_of(schedule.make_integrator), native, deliverable, (
            schedule.soc, schedule.temperature_c, schedule.drawn_power_w,
            None if heat is None else heat.arriving_heat_w, schedule.brake_power_w))
    return with_shell_accounts(trip, schedule, Accounts(
        energies_of(energies_wh, 0.0 if heat is None else heat.lost_electric_wh), *powers_w))


def _plan_switch_in_core(trip: Trip, state: BatteryState, target_c: float,
                         in_one_interval: bool = False) -> SwitchPlan:
    if not trip.vehicle.heat_path.is_direct:
        return _plan_two_switches(trip, state, target_c)
    return _switch_plan(trip, make_runge_kutta_4, calls.plan_switch(
        *_both(trip), state.soc, state.temperature_c, target_c, in_one_interval))


def _plan_by_paper_in_core(trip: Trip, state: BatteryState, target_c: float) -> SwitchPlan:
    if trip.vehicle.heat_path.is_direct:
        return _switch_plan(trip, make_euler, calls.plan_paper(
            *_both(trip), state.soc, state.temperature_c, target_c))
    planned = calls.plan_paper(
        vehicle_in_core(without_heat_path(trip.vehicle)), trip_in_core(trip), state.soc, state.temperature_c,
        target_c)
    start = initial_states(state)
    unheated = _run_heated_in_core(trip, start, np.zeros(len(trip.route)))
    heated = _run_heated_in_core(trip, start, planned.heater_power_w)
    schedule = replace(heated, heating_start_s=_instant_s(planned))
    return SwitchPlan(unheated, schedule, keeps_limits(trip, unheated, _limits_of_steps_w_in_core),
                      is_driven_as_planned(trip, schedule, _limits_of_steps_w_in_core), True,
                      float(schedule.soc.min()))


def _plan_two_switches(trip: Trip, state: BatteryState, target_c: float) -> SwitchPlan:
    vehicle, native = _both(trip)
    idle_w = np.zeros(len(trip.route))
    states, heat_w = _roll_heated(trip, initial_states(state), idle_w)
    schedule = unheated = with_heat(trip, states, idle_w, idle_w, None, heat_w)
    unheated_is_kept = is_kept = keeps_limits(trip, unheated, _limits_of_steps_w_in_core)
    if not unheated.temperature_c[-1] >= target_c:
        run = calls.find_two_switches(vehicle, native, target_c, states)
        schedule = switched_off(
            trip, with_heat(trip, run.states, run.command_w, idle_w, None, run.heat_w), run.on_s, run.off_s)
        is_kept = keeps_limits(trip, schedule, _limits_of_steps_w_in_core)
    return SwitchPlan(unheated, schedule, unheated_is_kept, is_kept, True, float(schedule.soc.min()))


def _switch_plan(trip: Trip, make_integrator: Integrator, run: calls.SwitchedRun) -> SwitchPlan:
    plan, idle_w = run.plan, np.zeros(len(run.heater_power_w))
    unheated = Schedule(None, idle_w, idle_w, run.idle_soc, run.idle_c, make_runge_kutta_4)
    schedule = Schedule(
        _instant_s(run), run.heater_power_w, idle_w, run.soc, run.temperature_c, make_integrator)
    is_kept, costs_least = bool(plan.keeps_limits), bool(plan.costs_least)
    return SwitchPlan(unheated, schedule, bool(plan.unheated_keeps_limits), is_kept, costs_least, plan.least_soc,
                      _outcome(trip, plan, schedule.heating_start_s) if is_kept and costs_least else None)


def _outcome(trip: Trip, plan: SwitchPlanStruct, instant_s: float | None) -> ScheduleOutcome | None:
    """Return the ScheduleOutcome of a plan that heats in at most one interval; None for more."""
    first = plan.first_heated
    intervals: tuple[HeatingInterval, ...] = ()
    if first != trip.columns.steps:
        if not plan.is_one_interval:
            return None
        start_s = max(trip.time_s.item(first), plan.switching_instant_s)
        intervals = (HeatingInterval(
            start_s, trip.time_s.item(plan.end_heated), plan.interval_wh, REASONS[plan.reason]),)
    return ScheduleOutcome(
        energies_of(plan.energy_wh.in_a_row()), intervals, instant_s if plan.is_heated else None)


def _instant_s(run: calls.SwitchedRun) -> float | None:
    """Return the switching instant [s]; None for NaN."""
    instant_s: float = run.plan.switching_instant_s
    return None if instant_s != instant_s else instant_s


def _find_values_in_core(trip: Trip, start: States, wanted: Requirements) -> PlanByValues:
    command_w, ends_in, values = calls.plan_by_values(*_both(trip), start, _requirements(wanted))
    return PlanByValues(None) if command_w is None else PlanByValues(command_w, ends_in, values)


def _follow_values_in_core(trip: Trip, start: States, wanted: Requirements, values: Any) -> PlanByValues | None:
    if not isinstance(values, calls.NativeValues):
        raise Declined
    found = calls.follow_values(*_both(trip), start, _requirements(wanted), values)
    return None if found is None else PlanByValues(*found, values)


def _requirements(wanted: Requirements) -> calls.ValueRequirements:
    uncertainty = wanted.uncertainty
    return calls.ValueRequirements(
        wanted.target_c, wanted.reserve, uncertainty.deviation_k, uncertainty.is_heating, wanted.price)


# The model's inputs along a route.
model_inputs = operation(_model_inputs_in_core, dynamics.model_inputs)
# Runs without regard to limits, and within them.
run_forward = operation(_run_forward_in_core, dynamics.run_forward)
run_heated = operation(_run_heated_in_core, heat_run.run_heated)
drive_within_limits = operation(_drive_within_limits_in_core, limited_drive.drive_within_limits)
# Limits of a run, and its energies.
limits_of_steps_w = operation(_limits_of_steps_w_in_core, dynamics.limits_of_steps_w)
keep_accounts = operation(_keep_accounts_in_core, dynamics.keep_accounts)
# Plans.
plan_switch = operation(_plan_switch_in_core, one_interval.plan_switch)
plan_by_paper = operation(_plan_by_paper_in_core, one_interval.plan_by_paper)
find_values = operation(_find_values_in_core, recursion.find_values)
follow_values = operation(_follow_values_in_core, recursion.follow_values)
