# SPDX-License-Identifier: Apache-2.0
"""
The engine: the ten operations on which planning is built: runs, their limits and energies, and plans.

Each exists twice: in the native core, whose calls are here, and in readable Python, which defines the result. The
core answers if it is used and accepts the vehicle and the numbers; otherwise Python answers, or raises the
appropriate exception. No other module of planning knows that there are two.
"""

from __future__ import annotations

from ctypes import addressof, byref, c_double, c_int32
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.planning import dynamics, limited_drive, one_interval, recursion
from bev_preheat.planning.dynamics import Accounts, energies_of, keeps_limits, stiff_w_per_k, with_shell_accounts
from bev_preheat.planning.heat_run import initial_states, States, with_heat
from bev_preheat.planning.limited_drive import Course
from bev_preheat.planning.one_interval import SwitchPlan
from bev_preheat.planning.recursion import PlanByValues
from bev_preheat.planning.schedule import HeatingInterval, Reason, Schedule, ScheduleOutcome
from bev_preheat.planning.two_switches import switched_off
from bev_preheat.vehicle.core_calls import doubles_at, INTEGRATORS, place, rows_of, vehicle_in_core
from bev_preheat.vehicle.core_library import call, Declined, EMPTY, LEFT, operation
from bev_preheat.vehicle.core_structs import (
    address_of,
    ENERGIES,
    NativeTrip,
    NativeVehicle,
    room,
    RunOfPowersStruct,
    StrandingStruct,
    SwitchPlanStruct,
    TripTermsStruct,
    ValueGoalStruct,
)
from bev_preheat.vehicle.model import Integrator, make_runge_kutta_4, TRIP_COLUMNS, TripColumns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.methods import Requirements
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


def trip_in_core(trip: Trip) -> NativeTrip:
    """Return the columns of a Trip as a native struct, which is made once."""
    # Beside the fields, as a cached property is.
    beside = vars(trip.columns)
    if 'in_core' not in beside:
        beside['in_core'] = NativeTrip(trip.columns, trip.mix.for_core(), trip.mix.heating)
    native: NativeTrip = beside['in_core']
    return native


def _both(trip: Trip) -> tuple[NativeVehicle, NativeTrip]:
    return vehicle_in_core(trip.vehicle), trip_in_core(trip)


def _model_inputs_in_core(vehicle: Vehicle, route: Route, heater_share: float,
                          heat_lag_s: float) -> tuple[Route, TripColumns]:
    """Do as in Python; declined also if a step is too long for the integrators."""
    leakage, steps = vehicle.battery.leakage, len(route)
    columns = np.empty(len(TRIP_COLUMNS) * steps + 1)
    call('bev_make_trip', byref(TripTermsStruct(
        leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps, vehicle.drivetrain.heat_share,
        stiff_w_per_k(vehicle), vehicle.hvch.maximum_power_w, heater_share, heat_lag_s)),
         steps, place(route.block), place(columns))
    return route, TripColumns(steps, columns)


def _run_forward_in_core(trip: Trip, make_integrator: Integrator, soc: float, temperature_c: float,
                         heater_power_w: FloatArray | None = None,
                         brake_power_w: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    vehicle, native = _both(trip)
    states = np.empty((2, native.steps + 1))
    states[:, 0] = soc, temperature_c
    call('bev_run', vehicle.address, _number_of(make_integrator), native.address, 0,
         doubles_at(heater_power_w, native.steps), doubles_at(brake_power_w, native.steps), *rows_of(states))
    return states[0], states[1]


def _number_of(make_integrator: Integrator) -> int:
    number = INTEGRATORS.get(make_integrator)
    if number is None:
        raise Declined
    return number


def _run_without_heating_in_core(trip: Trip, state: BatteryState) -> Schedule:
    idle_w = np.zeros(len(trip.route))
    if trip.vehicle.heat_path.is_direct:
        run = _run_forward_in_core(trip, make_runge_kutta_4, state.soc, state.temperature_c)
        return Schedule(None, idle_w, idle_w, *run, make_runge_kutta_4)
    states, heat_w = _roll_heated(trip, initial_states(state), idle_w)
    return with_heat(trip, states, idle_w, idle_w, None, heat_w)


def _roll_heated(trip: Trip, start: States,
                 command_w: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """Return the States, and the means of heater power and arriving heat [W] (N,)."""
    vehicle, native = _both(trip)
    states, heat_w = np.empty((4, native.steps + 1)), np.empty((2, native.steps))
    states[:, 0] = start
    call('bev_run_heated', vehicle.address, native.address, doubles_at(command_w, native.steps), place(states),
         place(heat_w))
    return states, (heat_w[0], heat_w[1])


def _drive_within_limits_in_core(trip: Trip, state: BatteryState, wanted_w: FloatArray, take_surplus: bool,
                                 below_c: float) -> Course:
    vehicle, native = _both(trip)
    rows = 2 if trip.vehicle.heat_path.is_direct and trip.mix.is_alone else 4
    states, powers_w = np.empty((rows, native.steps + 1)), np.empty((rows, native.steps))
    states[:, 0] = initial_states(state)[:rows]
    stranding, flags = StrandingStruct(), np.empty(2 * native.steps, np.uint8)
    call('bev_drive_as_planned', vehicle.address, native.address, doubles_at(wanted_w, native.steps),
         below_c, take_surplus, place(states), place(powers_w), flags.ctypes.data, addressof(stranding))
    return Course(states, powers_w, None if stranding.step < 0 else (stranding.step, stranding.driven_share))


def _limits_of_steps_w_in_core(vehicle: Vehicle, soc: FloatArray, temperature_c: FloatArray,
                               variance_w2: FloatArray) -> tuple[FloatArray, FloatArray]:
    native, count = vehicle_in_core(vehicle), len(variance_w2)
    limits_w = np.empty((2, count))
    call('bev_limits_of_steps', native.address, count, doubles_at(soc, count + 1),
         doubles_at(temperature_c, count + 1), doubles_at(variance_w2, count), *rows_of(limits_w))
    return limits_w[0], limits_w[1]


def _keep_accounts_in_core(trip: Trip, schedule: Schedule, deliverable: bool = False) -> Accounts:
    if schedule.driven_share is not None:
        trip = trip.driven(schedule.driven_share)
    (vehicle, native), heat = _both(trip), schedule.heat
    powers_w, energies_wh = np.empty((4, native.steps)), (c_double * len(ENERGIES))()
    kept = [array if array is None else np.ascontiguousarray(array, dtype=float) for array in (
        schedule.soc, schedule.temperature_c, schedule.drawn_power_w,
        None if heat is None else heat.arriving_heat_w, schedule.brake_power_w)]
    run = RunOfPowersStruct(deliverable, *map(address_of, kept))
    call('bev_keep_accounts', vehicle.address, _number_of(schedule.make_integrator), native.address,
         addressof(run), place(powers_w), addressof(energies_wh))
    return with_shell_accounts(trip, schedule, Accounts(
        energies_of(energies_wh[:], 0.0 if heat is None else heat.lost_electric_wh), *powers_w))


def _plan_switch_in_core(trip: Trip, state: BatteryState, target_c: float,
                         in_one_interval: bool = False) -> SwitchPlan:
    if not trip.vehicle.heat_path.is_direct:
        return _plan_two_switches(trip, state, target_c)
    return _plan_one_switch(trip, state, target_c, in_one_interval)


def _plan_two_switches(trip: Trip, state: BatteryState, target_c: float) -> SwitchPlan:
    vehicle, native = _both(trip)
    idle_w, steps = np.zeros(len(trip.route)), native.steps
    idle_states, heat_w = _roll_heated(trip, initial_states(state), idle_w)
    schedule = unheated = with_heat(trip, idle_states, idle_w, idle_w, None, heat_w)
    unheated_is_kept = is_kept = keeps_limits(trip, unheated, _limits_of_steps_w_in_core)
    if not unheated.temperature_c[-1] >= target_c:
        states, command_w, (drawn_w, arriving_w) = np.empty((4, steps + 1)), np.empty(steps), np.empty((2, steps))
        on_s, off_s = c_double(), c_double()
        call('bev_find_two_switches', vehicle.address, native.address, target_c, place(idle_states),
             place(np.empty(room('BEV_TWO_SWITCHES_MEMORY', steps))), place(states), place(command_w),
             place(drawn_w), byref(on_s), byref(off_s))
        schedule = switched_off(trip, with_heat(
            trip, states, command_w, idle_w, None, (drawn_w, arriving_w)), on_s.value, off_s.value)
        is_kept = keeps_limits(trip, schedule, _limits_of_steps_w_in_core)
    return SwitchPlan(unheated, schedule, unheated_is_kept, is_kept, True, float(schedule.soc.min()))


def _plan_one_switch(trip: Trip, state: BatteryState, target_c: float, in_one_interval: bool) -> SwitchPlan:
    (vehicle, native), steps = _both(trip), len(trip.route)
    memory, plan = np.empty(room('BEV_SWITCH_MEMORY', steps)), SwitchPlanStruct()
    (soc, temperature_c), heater_w, idle_w = np.empty((2, steps + 1)), np.empty(steps), np.zeros(steps)
    call('bev_plan_switch', vehicle.address, native.address, state.soc, state.temperature_c, target_c,
         in_one_interval,
         place(memory), place(soc), place(temperature_c), place(heater_w), addressof(plan))
    # The memory begins with the unheated run.
    unheated = Schedule(None, idle_w, idle_w, memory[:steps + 1], memory[steps + 1:2 * steps + 2],
                        make_runge_kutta_4)
    instant_s: float = plan.switching_instant_s
    schedule = Schedule(None if instant_s != instant_s else instant_s, heater_w, idle_w, soc, temperature_c,
                        make_runge_kutta_4)
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
            start_s, trip.time_s.item(plan.end_heated), plan.interval_wh, Reason(plan.reason)),)
    return ScheduleOutcome(
        energies_of(plan.energy_wh.in_a_row()), intervals, instant_s if plan.is_heated else None)


class NativeValues(NamedTuple):
    """What `bev_plan_by_values` leaves for `bev_follow_values`, of a trip of so many steps."""

    steps: int
    flags: NDArray[np.uint8]
    memory: FloatArray


def _find_values_in_core(trip: Trip, start: States, wanted: Requirements) -> PlanByValues:
    steps = len(trip.route)
    values = NativeValues(steps, np.zeros(room('BEV_VALUE_BYTES', steps), dtype=np.uint8),
                          np.empty(room('BEV_VALUE_MEMORY', steps)))
    # It keeps the values of every instant: memory is cheaper here than computing them twice.
    _, found = _by_values('bev_plan_by_values', trip, start, wanted, values, (), (1,))
    return found if found.command_w is not None else PlanByValues(None)


def _follow_values_in_core(trip: Trip, start: States, wanted: Requirements, values: Any) -> PlanByValues | None:
    if not isinstance(values, NativeValues):
        raise Declined
    status, found = _by_values('bev_follow_values', trip, start, wanted, values, (values.steps,), ())
    return None if status == LEFT else found


def _by_values(function: str, trip: Trip, start: States, wanted: Requirements, values: NativeValues,
               before: tuple[int, ...], after: tuple[int, ...]) -> tuple[int, PlanByValues]:
    """Return status and plan of a function of the core; its own arguments come `before` the states, or `after`."""
    (vehicle, native), steps, uncertainty = _both(trip), len(trip.route), wanted.uncertainty
    states, powers_w, ends_in = np.zeros((4, steps + 1)), np.zeros((4, steps)), c_int32()
    states[:, 0] = start
    goal = ValueGoalStruct(uncertainty.direction, wanted.target_c, wanted.most_c, wanted.reserve,
                           uncertainty.deviation_k, address_of(wanted.price))
    status = call(
        function, vehicle.address, native.address, byref(goal), *before, address_of(states), address_of(powers_w),
        address_of(values.flags), address_of(values.memory), byref(ends_in), *after)
    return status, PlanByValues(None if status == EMPTY else powers_w[0],
                                None if ends_in.value < 0 else ends_in.value, values)


# The model's inputs along a route.
model_inputs = operation(_model_inputs_in_core, dynamics.model_inputs)
# Runs without regard to limits, and within them.
run_forward = operation(_run_forward_in_core, dynamics.run_forward)
run_without_heating = operation(_run_without_heating_in_core, one_interval.run_without_heating)
drive_within_limits = operation(_drive_within_limits_in_core, limited_drive.drive_within_limits)
# Limits of a run, and its energies.
limits_of_steps_w = operation(_limits_of_steps_w_in_core, dynamics.limits_of_steps_w)
keep_accounts = operation(_keep_accounts_in_core, dynamics.keep_accounts)
# Plans.
plan_switch = operation(_plan_switch_in_core, one_interval.plan_switch)
plan_by_paper = one_interval.plan_by_paper
find_values = operation(_find_values_in_core, recursion.find_values)
follow_values = operation(_follow_values_in_core, recursion.follow_values)
