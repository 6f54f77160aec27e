# SPDX-License-Identifier: Apache-2.0
"""
Drive and charging session in one nonlinear program: the lowest possible cost of energy and time.

    price · bought energy + value of time · charging time

The heater's power in each step of the drive is free, without a target; so is that at the charger, below the limit
of the car. Solutions are local, so IPOPT starts from several plans. Its results are driven and charged by the
project's own simulation, with the actual limits: this makes the costs of programs and plans comparable, and the
program's smoothing affects neither. There the program's heat at the charger competes with the choice from the same
arrival (`charging.heating_choice`).

The steps of the session are of equal length in a free total time. The heater's power in each is free up to the
car's own switch: on below the limit, off above. The switch is smoothed, because a program needs smooth functions:
half the power at the limit, and a tanh within SWITCH_K on both sides, so that the battery is held close to the
limit. Its input is the mean over both ends of a step of the temperature with the heat under way, which is
second-order accurate and always stable. Tables are linear between their points. Along a session a program meets
dozens of these corners, and the position of each within a step decides a derivative: IPOPT converges only if they
are rounded.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
import math
from time import perf_counter

import casadi
import numpy as np

from bev_preheat.charging.equations import (
    heated_c,
    heater_power_of,
    make_charging_rates,
    make_charging_step,
    make_cooling,
    supply_of,
)
from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.heating_policy import HeatingLimit
from bev_preheat.charging.session import charge, Session
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.nonlinear_program.drive_steps import (
    add_drive_steps,
    Blocks,
    drive_parameters,
    drive_states,
    POWER_SCALE_W,
    RESERVES,
    SOC_SCALE,
    Values,
)
from bev_preheat.nonlinear_program.program import ByName, IPOPT_OPTIONS, state_bounds
from bev_preheat.nonlinear_program.symbols import smooth_tables, SYMBOLS
from bev_preheat.numerics import AnyNumber, Arithmetic, FloatArray, JOULES_PER_WH, S_PER_H, WH_PER_KWH
from bev_preheat.planning.engine import limits_of_steps_w, run_without_heating
from bev_preheat.planning.limits import colder, drive_as_planned
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import finish_plan, plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, reserve_soc
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.route.segments import Route
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.charging import charging_of, vehicle_at_charger
from bev_preheat.vehicle.heat_path import make_heat_step
from bev_preheat.vehicle.model import hottest_c, idle_heat_w, make_rates
from bev_preheat.vehicle.variants import Corrections

# Half the width of the switch [K], and of a rounded corner: state of charge, temperature [K], power [W].
SWITCH_K = 0.5
SOC_WIDTH, TEMPERATURE_WIDTH_K, POWER_WIDTH_W = 0.005, 0.5, 200.0
TIME_SCALE_S = 1000.0
# Name of each state on the drive and at the charger, and its scale.
STATES = (('soc', 'charging_soc', SOC_SCALE), ('temperature', 'charging_temperature', 1.0),
          ('heater_power', 'charging_heater_power', POWER_SCALE_W),
          ('coolant_excess', 'charging_coolant_excess', 1.0))


def smooth_minimum(one: AnyNumber, other: AnyNumber) -> AnyNumber:
    """Return the lesser of two powers [W], at most POWER_WIDTH_W / 2 below it."""
    return 0.5 * (one + other - casadi.sqrt((one - other)**2 + POWER_WIDTH_W**2))


# For powers [W] only.
SMOOTH: Arithmetic[AnyNumber] = replace(
    SYMBOLS, minimum=smooth_minimum, maximum=lambda one, other: -smooth_minimum(-one, -other))


def smoothed(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle with rounded corners in the maps of its charging sessions."""
    widths, charging = (SOC_WIDTH, TEMPERATURE_WIDTH_K), vehicle.charging
    return replace(
        vehicle, battery=smooth_tables(vehicle.battery, ('open_circuit_voltage', 'resistance'), *widths),
        charging=None if charging is None else smooth_tables(charging, ('power_limit',), *widths))


def add_charging_steps(vehicle: Vehicle, stop: ChargingStop, steps: int, variables: Blocks,
                       constraints: Blocks) -> tuple[casadi.MX, casadi.MX]:
    """
    Add the steps of the session after a drive to a program; return its duration [s] and the energy bought [J].

    Variables: `charging_time` [s], each state of the drive at the ends of the steps, and for a car that can
    heat at the charger `charging_heater`, the highest power of its heater in each step [W].
    """
    duration = variables.variable('charging_time', 1, TIME_SCALE_S)
    duration_s = duration * TIME_SCALE_S
    starts: list[casadi.MX] = []
    ends: list[casadi.MX | None] = []
    of_drive = {state.name for state in drive_states(vehicle)}
    for name, charging_name, scale in STATES:
        if name not in of_drive:
            starts.append(casadi.MX.zeros(1, steps))
            ends.append(None)
        else:
            later = variables.variable(charging_name, steps, scale)
            starts.append(scale * casadi.horzcat(variables.row(name)[-1], later[:-1]))
            ends.append(later)
    later_ends = [casadi.MX.zeros(1, steps) if end is None else scale * end
                  for end, (_, _, scale) in zip(ends, STATES)]
    most_w = casadi.MX.zeros(1, steps)
    if can_heat(vehicle):
        most_w = POWER_SCALE_W * variables.variable('charging_heater', steps, POWER_SCALE_W)
    *reached, terminal_w, drawn_w = symbolic_charging_step(vehicle, stop).map(steps)(
        *starts, casadi.repmat(duration_s / steps, 1, steps), heated_c(vehicle, *later_ends[1:]), most_w)
    for (_, charging_name, scale), at_end, end in zip(STATES, reached, ends):
        if end is not None:
            constraints.add(f'{charging_name}_defect', at_end / scale - end, scale)
    return duration_s, duration_s * (casadi.sum2(terminal_w + drawn_w) / steps
                                     + stop.cabin_heating_power_w + stop.auxiliary_power_w)


def can_heat(vehicle: Vehicle) -> bool:
    """Return whether a vehicle can heat its battery while it charges."""
    return math.isfinite(charging_of(vehicle).heated_below_c)


def symbolic_charging_step(vehicle: Vehicle, stop: ChargingStop) -> casadi.Function:
    """
    Return a step of `charging.session`, its switch smoothed, as a CasADi Function.

    Inputs: soc, temperature [deg C], heater power [W], coolant excess [K], duration [s], the temperature with the
    heat under way at its end (`heated_c`) [deg C], and the heater's power below the limit [W]. Outputs: the four
    states at the end, and the means of the power into the terminals and of the power of heater and cooling [W].
    """
    inputs = [casadi.SX.sym(name) for name in (
        'soc', 'temperature_c', 'heater_w', 'excess_k', 'duration_s', 'heated_end_c', 'most_w')]
    soc, temperature_c, heater_w, excess_k, duration_s, heated_end_c, most_w = inputs
    vehicle = vehicle_at_charger(smoothed(vehicle))
    battery, supply_w = vehicle.battery, supply_of(vehicle, stop)
    charging = charging_of(vehicle)
    limit_c = charging.heated_below_c
    rates = make_charging_rates(
        charging.power_limit.function(SYMBOLS), make_cooling(charging.cooling, stop.ambient_c, SMOOTH),
        make_rates(vehicle, SYMBOLS), SMOOTH)
    command_w = casadi.SX(0.0)
    if math.isfinite(limit_c):
        above_k = 0.5 * (heated_c(vehicle, temperature_c, heater_w, excess_k) + heated_end_c) - limit_c
        command_w = 0.5 * most_w * (1.0 - casadi.tanh(above_k / SWITCH_K))
    leakage_w_per_k = battery.leakage.coefficient_w_per_k(0.0)
    idle_w = idle_heat_w(leakage_w_per_k, stop.ambient_c, 0.0)
    other_heat_w = casadi.SX(0.0)
    if vehicle.heat_path.has_coolant:
        other_heat_w = battery.heat_capacity_j_per_k * rates(
            soc, temperature_c, command_w - supply_w, 0.0, idle_w, leakage_w_per_k)[1]
    drawn_w, arriving_w, heater_end_w, coolant_c = make_heat_step(vehicle, SYMBOLS)(
        heater_w, temperature_c + excess_k, temperature_c, duration_s, command_w, other_heat_w,
        idle_w, leakage_w_per_k)
    soc_end, temperature_end_c, _, powers = make_charging_step(rates)(
        soc, temperature_c, duration_s, drawn_w - supply_w, 0.0, idle_w + arriving_w, leakage_w_per_k)
    excess_end_k = (coolant_c - temperature_end_c if vehicle.heat_path.has_coolant else excess_k)
    return casadi.Function('charging_step', inputs, [
        soc_end, temperature_end_c, heater_end_w, excess_end_k, powers.terminal_w, drawn_w + powers.cooling_w])


METHOD = 'nlp with charging'
CHARGING_STEPS = 80
# IPOPT starts from plans for these targets [deg C], and from the unheated drive.
START_TARGETS_C = (5.0, 15.0, 25.0, 35.0)
SAME_START_K = 1e-4
# Steps at the charger with less than this share of the heater's power count as unheated.
HEATED_SHARE = 0.01
# More digits would exceed the accuracy of the session's steps.
SOLVER_OPTIONS: ByName = {
    **IPOPT_OPTIONS,
    'ipopt.max_iter': 300,
    'ipopt.tol': 1e-7,
    'ipopt.constr_viol_tol': 1e-8,
    # The maps have corners, at which the last digits may not converge.
    'ipopt.acceptable_tol': 1e-5,
    'ipopt.acceptable_constr_viol_tol': 1e-7,
    'ipopt.acceptable_iter': 15,
}
SOLVED = ('Solve_Succeeded', 'Solved_To_Acceptable_Level')


@dataclass(frozen=True)
class ChargedDrive:
    """A Plan and the Session that follows it, both simulated, and their cost."""

    plan: Plan
    session: Session
    cost: float


@dataclass(frozen=True)
class SessionAttempt:
    """One call of IPOPT: cost of its start, status, cost in the program, and the simulated result, or None."""

    start: float
    status: str
    program_cost: float
    driven: ChargedDrive | None


@dataclass(frozen=True)
class ChargingOptimum:
    """The cheapest of IPOPT's results, as simulated (None if it never succeeded), and all attempts."""

    best: ChargedDrive | None
    attempts: tuple[SessionAttempt, ...]


def limit_is_near(trip: Trip, soc: FloatArray, temperature_c: FloatArray) -> bool:
    """Return whether a limit may act in a run that is at most COLDER_BY_K colder than this one (N + 1 values)."""
    least_w, most_w = limits_of_steps_w(
        trip.vehicle, soc, colder(trip.vehicle, temperature_c), trip.power_variance_w2)
    may_overcharge = (trip.route.propulsion_power_w < 0.0) & (trip.idle_power_w < least_w)
    return bool(may_overcharge.any() or (trip.idle_power_w + trip.drawing_limit_w > most_w).any())


class ChargingProgram:
    """The program of one drive and stop; each `attempt` starts from a plan."""

    def __init__(self, vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, stop: ChargingStop,
                 prices: Prices, charging_steps: int = CHARGING_STEPS) -> None:
        """Build the program; raises InvalidInput if vehicle, route, state or goal are not allowed."""
        check_situation(vehicle, route, state, goal)
        self._trip: Trip = make_trip(vehicle, route)
        self._state, self._goal, self._stop, self._prices = state, goal, stop, prices
        self._steps = charging_steps
        self._heating = ChargerHeating(vehicle, stop, prices)
        unheated = run_without_heating(self._trip, state)
        self._limited = limit_is_near(self._trip, unheated.soc, unheated.temperature_c)
        variables, constraints = self._variables, self._constraints = Blocks(), Blocks()
        drive = add_drive_steps(vehicle, len(self._trip.route), self._limited, variables, constraints)
        duration_s, bought_j = add_charging_steps(vehicle, stop, charging_steps, variables, constraints)
        cost = (prices.energy_per_kwh * bought_j / (JOULES_PER_WH * WH_PER_KWH)
                + prices.time_per_h * duration_s / S_PER_H)
        # Scales the cost to about 1 in any currency.
        self._cost_scale = max(prices.energy_per_kwh * 30.0 + prices.time_per_h * 0.5, 1e-6)
        self._solver = casadi.nlpsol('charging_optimum', 'ipopt', {
            'x': variables.vector(), 'p': drive.parameters, 'f': cost / self._cost_scale,
            'g': constraints.vector()}, SOLVER_OPTIONS)

    def attempt(self, start: Plan) -> SessionAttempt:
        """Return the SessionAttempt that starts from a Plan of the same drive."""
        drive = self._charged(start)
        low, high = self._bounds()
        result = self._solver(
            x0=self._variables.pack(self._guess(drive)), lbx=low, ubx=high, lbg=0.0,
            ubg=self._constraints.pack(dict.fromkeys(RESERVES, np.inf), otherwise=0.0),
            p=drive_parameters(self._trip, Corrections()))
        status = self._solver.stats()['return_status']
        driven = None
        if status in SOLVED:
            found = self._variables.unpack(np.asarray(result['x']).ravel())
            driven = self._driven(found['heater'], self._limit_of(found))
        return SessionAttempt(drive.cost, status, float(result['f']) * self._cost_scale, driven)

    def _charged(self, plan: Plan, limit: HeatingLimit | None = None) -> ChargedDrive:
        """Return the ChargedDrive of a Plan with the chosen heat at the charger, or a limit if that costs less."""
        arrival = plan.arrival_state
        choice = self._heating.choose(arrival)
        chosen = ChargedDrive(plan, choice.session, choice.cost)
        if limit is None:
            return chosen
        session = charge(self._trip.vehicle, self._stop, arrival, heating=limit)
        cost = self._prices.cost(session.bought_energy_wh, session.charging_time_s)
        return chosen if chosen.cost <= cost else ChargedDrive(plan, session, cost)

    def _limit_of(self, found: Values) -> HeatingLimit | None:
        """Return the HeatingLimit with which a session follows the temperatures that the program heats to."""
        vehicle = self._trip.vehicle
        if not can_heat(vehicle):
            return None
        names = ('charging_temperature', 'charging_heater_power', 'charging_coolant_excess')
        temperature_c, heater_w, excess_k = (
            np.asarray(found[name]).ravel() if name in found else np.zeros(self._steps) for name in names)
        heated = np.asarray(found['charging_heater']).ravel() > HEATED_SHARE * heater_power_of(vehicle, self._stop)
        limit_c = np.where(heated, heated_c(vehicle, temperature_c, heater_w, excess_k),
                           vehicle.battery.temperature_range_c[0])
        return HeatingLimit(tuple(np.asarray(found['charging_soc']).ravel().tolist()), tuple(limit_c.tolist()))

    def _driven(self, heater_w: FloatArray, limit: HeatingLimit | None) -> ChargedDrive:
        """Return the ChargedDrive of heater powers [W] (N,) and the program's limit at the charger, simulated."""
        started = perf_counter()
        schedule = drive_as_planned(self._trip, self._state, heater_w)
        return self._charged(finish_plan(
            self._trip, replace(self._goal, charging_planned=False), schedule, METHOD, started), limit)

    def _guess(self, drive: ChargedDrive) -> Values:
        plan, session, path = drive.plan, drive.session, self._trip.vehicle.heat_path
        # A session that never ends is no worse as a start than another.
        times_s = np.linspace(0.0, float(session.time_s[-1]), self._steps + 1)[1:]

        def along(values: FloatArray) -> FloatArray:
            return np.interp(times_s, session.time_s, values)

        heat, heating_w = plan.heat, np.append(session.hvch_battery_power_w, 0.0)
        excess_k = (self._trip.vehicle.hvch.efficiency * along(heating_w) / (
            path.coolant_conductance_w_per_k) if path.has_coolant else 0.0)
        return {'soc': plan.soc, 'temperature': plan.battery_temperature_c,
                'heater': plan.hvch_battery_power_w, 'brake': plan.friction_brake_power_w,
                'heater_power': 0.0 if heat is None else heat.heater_power_w,
                'coolant_excess': 0.0 if heat is None else heat.coolant_excess_k,
                'charging_time': float(session.time_s[-1]), 'charging_soc': along(session.soc),
                'charging_temperature': along(session.battery_temperature_c),
                'charging_heater_power': along(heating_w), 'charging_heater': along(heating_w),
                'charging_coolant_excess': excess_k}

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper bounds of the variables (scaled)."""
        trip, state, battery = self._trip, self._state, self._trip.vehicle.battery
        lowest_soc, highest_soc = battery.soc_range
        low, high = state_bounds(trip, state, (min(lowest_soc, state.soc), max(highest_soc, state.soc)),
                                 battery.temperature_range_c)
        low['soc'][-1] = reserve_soc(trip.vehicle, self._goal)
        departure = np.append(np.full(self._steps - 1, -np.inf), self._stop.departure_soc)
        return (self._variables.pack({
            **low, 'charging_soc': departure, 'charging_temperature': battery.temperature_range_c[0],
            'charging_heater_power': -np.inf, 'charging_coolant_excess': -np.inf}, otherwise=0.0),
            self._variables.pack({
                **high, 'charging_soc': np.abs(departure), 'charging_temperature': hottest_c(trip.vehicle),
                'charging_heater': heater_power_of(trip.vehicle, self._stop)}, otherwise=np.inf))


def solve_charging(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, stop: ChargingStop,
                   prices: Prices, more_targets_c: Iterable[float] = (),
                   charging_steps: int = CHARGING_STEPS) -> ChargingOptimum:
    """
    Return the ChargingOptimum of a drive to a ChargingStop.

    IPOPT starts from the unheated drive, and from plans for START_TARGETS_C and for `more_targets_c`
    [deg C]. Raises InvalidInput if an input is not allowed (`charging.stop.check_stop`).
    """
    program = ChargingProgram(vehicle, route, state, goal, stop, prices, charging_steps)
    unheated = plan_unheated(vehicle, route, state, goal)
    highest_c = vehicle.battery.temperature_range_c[1]
    starts = [unheated]
    for target_c in sorted((*START_TARGETS_C, *more_targets_c)):
        if unheated.arrival_temperature_c < target_c <= highest_c:
            plan = plan_preheating(
                vehicle, route, state, replace(goal, target_temperature_c=target_c, heats_until_arrival=True))
            # Beyond the reachable temperature all plans are the same.
            if plan.arrival_temperature_c > max(
                    start.arrival_temperature_c for start in starts) + SAME_START_K:
                starts.append(plan)
    attempts = tuple(map(program.attempt, starts))
    found = [attempt.driven for attempt in attempts
             if attempt.driven is not None and math.isfinite(attempt.driven.cost)]
    return ChargingOptimum(min(found, key=lambda driven: driven.cost, default=None), attempts)
