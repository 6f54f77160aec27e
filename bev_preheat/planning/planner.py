# SPDX-License-Identifier: Apache-2.0
"""Makes a plan: checks the input, runs a method, chooses the plan's status, and describes the result."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
import math
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.numerics import FloatArray, JOULES_PER_WH
from bev_preheat.planning import engine
from bev_preheat.planning.dynamics import Energies, is_described
from bev_preheat.planning.explanation import explain, NO_POWER, NOT_POSSIBLE, TOO_LATE
from bev_preheat.planning.full_power import heat_until_arrival
from bev_preheat.planning.heat_mix import HeatMix
from bev_preheat.planning.installed_methods import find_methods, installed_method
from bev_preheat.planning.limits import drive_as_planned, notes_on_route, schedule_within_gates
from bev_preheat.planning.methods import is_best, KeptValues, plan_by_values, plan_optimal_switch, plan_paper
from bev_preheat.planning.one_interval import SwitchPlan
from bev_preheat.planning.outcome import find_outcome, NoRegretCheck, power_deficit, unheated_within_limits
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.schedule import HeldBack, Method, Schedule, ScheduleOutcome, StepPrices
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, reserve_soc, Uncertainty
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import heated_throughout, make_trip, Trip
from bev_preheat.route.segments import Route
from bev_preheat.tunables import (
    BELOW_HIGHEST_K,
    HEATED_W,
    LEAST_PRICE_SHARE,
    NOW_S,
    SAME_POWER_W,
    SAME_SOC,
    SHORTFALL_TOLERANCE_K,
    SOC_TOLERANCE,
)
from bev_preheat.vehicle.description import HVCH, Vehicle
from bev_preheat.vehicle.variants import hvch_alone


class PlanningCase(NamedTuple):
    """
    A vehicle with a battery state at the start of a route, its goal, and how to plan.

    `method` is a name in `planner.method_names()`; `options` are its own. With an `uncertainty` `value_function`
    plans for the least expected energy; other methods do not know it. Only `value_function` knows `step_prices`; a
    negative price counts as 0. `kept` has the values of earlier plans of the drive, which save time while they
    hold.

    `heater_share` (0 ... 1) is the share of its power that the heater gives. With `heats_throughout` the heater
    heats regardless of the plan; the energies include that. The heat arrives `heat_lag_s` [s] late; heat that
    would come after the end is not planned. (This is for a vehicle without a heat path; a heat path is planned as
    such, and `state` gives the heat under way.) Without `no_regret` the method's plan is returned even if it is
    worse than not heating: for comparing methods, never for driving.
    """

    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal
    method: str
    uncertainty: Uncertainty | None
    step_prices: StepPrices | None
    heater_share: float
    heats_throughout: bool
    heat_lag_s: float
    no_regret: bool
    kept: KeptValues | None
    options: Mapping[str, Any]

    @property
    def aim_c(self) -> float:
        """The target of the plan [deg C]: the goal's, or the lowest if no warm arrival is asked for."""
        if self.goal.charging_planned and self.goal.heating_pays:
            return self.goal.target_temperature_c
        return self.vehicle.battery.temperature_range_c[0]

    def aimed_at(self, target_c: float) -> Goal:
        """Return the goal with another target [deg C]; beyond the highest temperature: with that instead."""
        if target_c > self.goal.maximum_arrival_temperature_c:
            return replace(self.goal, maximum_arrival_temperature_c=target_c)
        return replace(self.goal, target_temperature_c=target_c)

    def trip_that_obeys(self) -> Trip:
        """Return the Trip with all the heat that the heater can give, as commanded."""
        # Only `value_function` mixes heat sources, and a heater that heats throughout is the HVCH.
        is_alone = self.heats_throughout or self.method in ('optimal_switch', 'paper')
        vehicle = hvch_alone(self.vehicle) if is_alone else self.vehicle
        if self.step_prices is not None:
            # Cheap heat is stored to BELOW_HIGHEST_K below the highest temperature, or as needed.
            low_c, high_c = vehicle.battery.temperature_range_c
            stored_c = max(high_c - BELOW_HIGHEST_K, self.state.temperature_c, self.goal.target_temperature_c)
            vehicle = replace(vehicle, battery=replace(vehicle.battery, temperature_range_c=(low_c, stored_c)))
        return make_trip(vehicle, self.route, self.heater_share, self.heat_lag_s)

    def trip(self, obeyed: Trip) -> Trip:
        """Return the Trip to plan for; `obeyed` is `trip_that_obeys`."""
        return heated_throughout(obeyed, self.uncommanded_w(obeyed)) if self.heats_throughout else obeyed

    def uncommanded_w(self, obeyed: Trip) -> FloatArray:
        """Return the power that a heater which heats throughout takes in each step [W] (N,)."""
        return make_trip(obeyed.vehicle, self.route, self.heater_share).heater_limit_w

    def method_options(self, trip: Trip, knows_uncertainty: bool) -> dict[str, Any]:
        """Return the method's options for a Trip, those from the case included."""
        options = dict(self.options)
        if self.uncertainty is not None and knows_uncertainty:
            options |= {'uncertainty': self.uncertainty, 'kept': self.kept}
        if self.step_prices is not None:
            options['price'] = _as_shares(self.step_prices(trip.time_s))
        return options


def _as_shares(price_per_kwh: FloatArray) -> FloatArray:
    """Return prices (N,) as shares of the highest one; no price at all: 1 everywhere. Raises InvalidInput."""
    if not np.isfinite(price_per_kwh).all():
        raise InvalidInput('price of energy: is not a number in every step; a finite price per kWh is needed')
    highest = float(price_per_kwh.max())
    return np.maximum(price_per_kwh / highest, LEAST_PRICE_SHARE) if highest > 0.0 else np.ones(len(price_per_kwh))


class Way(NamedTuple):
    """
    A method, and its plan with one interval of heating, usually the best one without an active limit; None: none.

    `keeps_reserve`: the method itself keeps the reserve; `is_installed`: it comes from another package.
    """

    method: Method
    in_one_interval: Callable[[Trip, BatteryState, float], SwitchPlan] | None = None
    keeps_reserve: bool = False
    is_installed: bool = False

    def is_done(self, trip: Trip, goal: Goal, switched: SwitchPlan) -> bool:
        """Return whether a plan with one interval needs no further look, because no limit is active."""
        # A trip without charging is run by Runge-Kutta, whatever the method.
        return (switched.unheated_keeps_limits and is_best(trip, goal, switched)
                and (trip.vehicle.heat_path.is_direct or not goal.heats_until_arrival)
                and (goal.charging_planned or self.method is not plan_paper))


METHODS = {
    'value_function': Way(plan_by_values, engine.plan_switch, keeps_reserve=True),
    'optimal_switch': Way(plan_optimal_switch, partial(engine.plan_switch, in_one_interval=True)),
    'paper': Way(plan_paper, engine.plan_by_paper),
}
DEFAULT_METHOD = 'value_function'
# Methods of earlier versions: {name: the method that took its place}.
REPLACED = {'merit_order': 'value_function'}


def method_names() -> tuple[str, ...]:
    """Return the names of all planning methods: the built-in ones, then those of installed packages."""
    return (*METHODS, *installed_names())


def installed_names() -> tuple[str, ...]:
    """Return the names of the planning methods of installed packages."""
    return tuple(find_methods(METHODS).usable)


def refused_methods() -> tuple[str, ...]:
    """Return a sentence for each method of an installed package whose name cannot be used."""
    return tuple(find_methods(METHODS).refused.values())


def check_method(name: str) -> None:
    """Raise InvalidInput if a name is not that of a planning method, or if an installed one cannot be loaded."""
    if name not in METHODS and name not in REPLACED:
        installed_method(name, METHODS)


def replaced_in_words(name: str) -> str:
    """Return a sentence on what took the place of a method of an earlier version; '' for any other name."""
    return f'method {name} no longer exists; {REPLACED[name]} took its place' if name in REPLACED else ''


def is_method(name: str) -> bool:
    """Return whether a name is that of a built-in method, or of an installed one that can be loaded."""
    try:
        check_method(name)
    except InvalidInput:
        return False
    return True


def plan_preheating(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                    method: str = DEFAULT_METHOD, uncertainty: Uncertainty | None = None,
                    step_prices: StepPrices | None = None, heater_share: float = 1.0,
                    heats_throughout: bool = False, heat_lag_s: float = 0.0, no_regret: bool = True,
                    kept: KeptValues | None = None, **options: Any) -> Plan:
    """
    Return the Plan for a vehicle with a battery state at the start of a route; see PlanningCase for the others.

    `method` may also be a name in REPLACED; with `step_prices` it is DEFAULT_METHOD in any case. Raises what
    `plan_case` raises.
    """
    method = DEFAULT_METHOD if step_prices is not None else REPLACED.get(method, method)
    return plan_case(PlanningCase(
        vehicle, route, state, goal, method, uncertainty, step_prices, heater_share, heats_throughout, heat_lag_s,
        no_regret, kept, options))


def plan_case(case: PlanningCase) -> Plan:
    """
    Return the Plan for a PlanningCase.

    Raises InvalidInput if state, goal or route are outside the range of the vehicle's model, or the method is
    unknown; PlanningFailure if the model yields no numbers, or an installed method no valid powers.
    """
    notes: dict[str, None] = {}
    method = case.method
    way = METHODS.get(method) or Way(
        partial(installed_method(method, METHODS).plan, notes=notes), is_installed=True)
    started = perf_counter()
    check_situation(case.vehicle, case.route, case.state, case.goal, case.uncertainty)
    obeyed = case.trip_that_obeys()
    trip = case.trip(obeyed)
    try:
        schedule, outcome = _schedule_case(case, trip, way, notes)
    except PlanningFailure:
        raise
    except ArithmeticError as error:
        raise PlanningFailure(f'the battery model fails on this route: {error}') from error
    plan = finish_plan(trip, case.goal, schedule, method, started, outcome, ' '.join(notes))
    return plan if not case.heats_throughout else replace(plan, energy_wh=_told_as_heater(
        plan.energy_wh, obeyed, case.uncommanded_w(obeyed), schedule.driven_share))


def _schedule_case(case: PlanningCase, trip: Trip, way: Way,
                   notes: dict[str, None]) -> tuple[Schedule, ScheduleOutcome | None]:
    """Return the Schedule for a case within its vehicle's gates, and the ScheduleOutcome if it is known."""
    options, outcome = case.method_options(trip, case.method == DEFAULT_METHOD), None
    is_quick = case.no_regret and not options and trip.mix.is_alone
    switched = way.in_one_interval(trip, case.state, case.aim_c) if way.in_one_interval and is_quick else None
    if switched is not None and way.is_done(trip, case.goal, switched):
        first, outcome = switched.schedule, switched.outcome
    else:
        first = _schedule_trip(case, trip, way, options, switched)
    if not (case.vehicle.heating_gates.is_any and case.no_regret):
        return first, outcome

    def plan_on(gated: Trip) -> Schedule:
        return first if gated is trip else _schedule_trip(case, gated, way, options)

    schedule = schedule_within_gates(trip, case.state, plan_on, notes, case.heater_share)
    below_c = case.vehicle.heating_gates.maximum_temperature_c - SHORTFALL_TOLERANCE_K
    if schedule.temperature_c[-1] < below_c < case.aim_c:
        # Steps too hot for the gate moved the heat ahead, and it leaks away: aimed at the gate, heating is late.
        lower = case._replace(goal=case.aimed_at(below_c), kept=None)
        how = lower.method_options(trip, case.method == DEFAULT_METHOD)
        late = schedule_within_gates(
            trip, case.state, lambda gated: _schedule_trip(lower, gated, way, how), dict(notes), case.heater_share)
        schedule = max(schedule, late, key=lambda each: float(each.temperature_c[-1]))
    if schedule.heating_start_s is not None or schedule.temperature_c[-1] < case.goal.target_temperature_c:
        notes.update(dict.fromkeys(notes_on_route(trip)))
    return schedule, outcome if schedule is first else None


def _told_as_heater(energy_wh: Energies, obeyed: Trip, taken_w: FloatArray,
                    driven_share: FloatArray | None) -> Energies:
    """Move the heater's part of a `heated_throughout` trip, which takes `taken_w` [W], from drive to heater."""
    hours = obeyed.route.duration_s / JOULES_PER_WH * (1.0 if driven_share is None else driven_share)
    heat_wh = obeyed.vehicle.hvch.efficiency * float(hours @ obeyed.heater_limit_w)
    return replace(
        energy_wh, drivetrain_heat=energy_wh.drivetrain_heat - heat_wh, hvch_heat=energy_wh.hvch_heat + heat_wh,
        hvch_electric=energy_wh.hvch_electric + float(hours @ taken_w))


def _schedule_trip(case: PlanningCase, trip: Trip, way: Way, options: dict[str, Any],
                   switched: SwitchPlan | None = None) -> Schedule:
    """Return the Schedule for a case on a Trip; `switched` is the plan with one interval of heating, if known."""
    state, goal = case.state, case.goal
    unheated = engine.run_without_heating(trip, state) if switched is None else switched.unheated
    if not goal.charging_planned:
        return as_described(trip, state, unheated)
    if not goal.heating_pays:
        if way.is_installed:
            # It may ignore the target, so it is not asked.
            return unheated_within_limits(trip, state, unheated)
        goal = case.aimed_at(case.aim_c)
    is_late = goal.heats_until_arrival and not trip.vehicle.heat_path.is_direct and trip.mix.is_alone
    # Other built-in methods do not know the battery's limits.
    knows_limits = way.keeps_reserve or way.is_installed or not case.no_regret

    def propose(target_c: float, **how: Any) -> Schedule:
        if switched is not None and target_c == case.aim_c:
            how = {**how, 'switched': switched}
        schedule = way.method(trip, state, case.aimed_at(target_c), **how)
        if not knows_limits and (power_deficit(trip, schedule).worst_w > 0.0 or not is_described(trip, schedule)):
            schedule = drive_as_planned(trip, state, schedule.heater_power_w)
        if is_late:
            schedule = heat_until_arrival(trip, state, schedule, target_c)
        return as_described(trip, state, schedule)

    if not case.no_regret:
        return propose(goal.target_temperature_c, **options)
    proposals = [partial(propose, **options)]
    if 'uncertainty' in options:
        # Heat for the uncertainty is left out before the target is lowered for the reserve.
        proposals.append(partial(propose, **{**options, 'uncertainty': None, 'kept': None}))
    return NoRegretCheck(trip, state, goal, unheated).serve(proposals)


def as_described(trip: Trip, state: BatteryState, schedule: Schedule) -> Schedule:
    """Return the Schedule if the model describes its run, else as executed within the limits."""
    return schedule if is_described(trip, schedule) else drive_as_planned(trip, state, schedule.heater_power_w)


def as_driven(plan: Plan, vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal) -> Plan:
    """Return a plan as executed: unchanged if it keeps (9i), else within the limits."""
    # Methods that do not mix heat sources have no powers of any.
    trip = make_trip(vehicle if plan.source_power_w else hvch_alone(vehicle), route)
    driven = drive_as_planned(trip, state, plan.command_w)
    moved_w = max(np.abs(driven.heater_power_w - plan.command_w).max(),
                  np.abs(driven.brake_power_w - plan.friction_brake_power_w).max())
    # Once the charge has run out the vehicle stands; the powers of that step are shares.
    is_same = moved_w < SAME_POWER_W or plan.stranding is not None
    if is_same and np.abs(driven.soc - plan.soc).max() < SAME_SOC:
        return plan
    return finish_plan(trip, goal, replace(driven, held_back=plan.held_back), f'{plan.method}, driven',
                       perf_counter() - plan.planning_time_s, note=plan.note)


def plan_unheated(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal) -> Plan:
    """Return the Plan that never heats, as executed within the limits: the reference for savings."""
    goal = replace(goal, charging_planned=False)
    return as_driven(plan_preheating(vehicle, route, state, goal), vehicle, route, state, goal)


def finish_plan(trip: Trip, goal: Goal, schedule: Schedule, method: str, started: float,
                outcome: ScheduleOutcome | None = None, note: str = '') -> Plan:
    """Return the Plan of a schedule, with a note, its ScheduleOutcome if known, begun at perf_counter()."""
    arrival_c, arrival_soc = schedule.temperature_c.item(-1), schedule.soc.item(-1)
    target_c = goal.target_temperature_c if goal.heating_pays else arrival_c
    # NaN propagates, so checking the final state is enough.
    if not (math.isfinite(arrival_c) and math.isfinite(arrival_soc)):
        raise PlanningFailure('the battery model yields no finite temperatures on this route')
    outcome = outcome or find_outcome(
        trip, schedule, goal.target_temperature_c if goal.heating_pays else -math.inf)
    reserve = reserve_soc(trip.vehicle, goal)
    sources_w = trip.mix.split_w(schedule.heater_power_w, schedule.temperature_c[:-1])
    most_c = goal.maximum_arrival_temperature_c if goal.charging_planned else math.inf
    highest_c = goal.highest_arrival_c if goal.charging_planned else math.inf
    shortfall_k = max(0.0, target_c - arrival_c, arrival_c - highest_c)
    soc_shortfall = max(0.0, reserve - arrival_soc)
    most_w = trip.vehicle.hvch.maximum_power_w
    left_w = trip.mix.most_heat_w if isinstance(trip.mix, HeatMix) else most_w - trip.route.cabin_heating_power_w
    unheated_because = (
        NOT_POSSIBLE if note else TOO_LATE if (left_w > 0.0).any() else
        NOT_POSSIBLE if sources_w or most_w == 0.0 else NO_POWER)
    cooled = np.flatnonzero(schedule.heater_power_w < -HEATED_W)
    cooling_start_s = float(trip.time_s[cooled[0]]) if len(cooled) else None
    return Plan(
        status=_status(goal, schedule, outcome, shortfall_k, soc_shortfall, cooling_start_s),
        sentence=partial(explain, reserve=reserve),
        method=method,
        target_temperature_c=target_c,
        time_s=trip.time_s,
        battery_temperature_c=schedule.temperature_c,
        soc=schedule.soc,
        hvch_battery_power_w=sources_w.get(HVCH, schedule.heater_power_w),
        friction_brake_power_w=schedule.brake_power_w,
        shortfall_k=shortfall_k,
        soc_shortfall=soc_shortfall,
        planning_time_s=perf_counter() - started,
        heating_end_s=schedule.heating_end_s,
        held_back=schedule.held_back,
        heat=schedule.heat,
        note=note,
        unheated_because=unheated_because,
        source_power_w=sources_w,
        maximum_arrival_temperature_c=most_c,
        cooling_start_s=cooling_start_s,
        **outcome._asdict())


def _status(goal: Goal, schedule: Schedule, outcome: ScheduleOutcome, shortfall_k: float,
            soc_shortfall: float, cooling_start_s: float | None) -> Status:
    if not goal.charging_planned:
        return Status.NO_CHARGING_PLANNED
    if outcome.stranding is not None:
        return Status.OUT_OF_CHARGE
    if outcome.undeliverable_power_w > 0.0:
        return Status.POWER_LIMITED
    missed = shortfall_k > SHORTFALL_TOLERANCE_K and schedule.held_back is not HeldBack.START
    if soc_shortfall > SOC_TOLERANCE or (missed and schedule.held_back is not None):
        return Status.SOC_LIMITED
    if missed:
        return Status.TARGET_UNREACHABLE
    if cooling_start_s is not None and (
            outcome.heating_start_s is None or cooling_start_s < outcome.heating_start_s):
        return Status.WAITING_TO_COOL if cooling_start_s > NOW_S else Status.COOLING
    if outcome.heating_start_s is None:
        return Status.NOT_NEEDED if goal.heating_pays else Status.NOT_WORTH_IT
    return Status.WAITING if outcome.heating_start_s > NOW_S else Status.HEATING
