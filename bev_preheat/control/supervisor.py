# SPDX-License-Identifier: Apache-2.0
"""
Keeps the last good inputs, re-plans, and says what the heater may do now.

In doubt the heater is off: `Supervisor.command` gives power only where battery state and route are
valid and fresh, nobody switched preheating off, and a plan says so. Instants are integers, in
nanoseconds of the node's clock.

Only the leg that is now is planned from the battery's state, again and again. A later leg starts
from the departure that the route gives: its plan is made once, when somebody asks for it.
"""

from dataclasses import dataclass, replace
import math
from typing import Optional

import numpy as np

from bev_preheat.control.command_history import CommandHistory
from bev_preheat.control.course import Course
from bev_preheat.control.heater_switch import HeaterSwitch
from bev_preheat.control.inputs import check_mission, Leg, Measurement, Mission, NS_PER_S
from bev_preheat.control.outlook import OutlookMaker, seen_from_now
from bev_preheat.control.refusals import RefusedRoute, Refusals
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import check_situation
from bev_preheat.planning.status import Status
from bev_preheat.vehicle.description import Vehicle

# A clock that falls back by more than this was set or restarted; stamps before it mean nothing.
CLOCK_RESTART_S = 1.0

# A state this near to what the plan at hand foresaw, within this time, is on track.
ON_TRACK_FOR_S = 60.0
ON_TRACK_K = 0.05
ON_TRACK_SOC = 5e-4


@dataclass(frozen=True)
class Command:
    """Electrical power for the battery [W], until when it may be used, and why."""

    battery_heating_power_w: float
    valid_until_ns: int
    reason: Status


@dataclass(frozen=True)
class Decision:
    """
    What holds until the next input: a status, its sentence, and the plan behind it, if any.

    `plan_start_ns` is the instant at which the plan's time 0 lies, `leg` what it is a plan for.
    `later_legs` lie ahead, beyond the next stop or the one that is now. `arrival_deviation_k` is the
    standard deviation of the temperature on arrival [K], NaN where it is not known. The command
    follows `commanded` where that is not None, else the plan; the heater gives `command_share` of
    it. `model_factors` are those that it was planned with (PreheatPlan.msg); (): none.
    """

    status: Status
    explanation: str
    plan: Optional[Plan] = None
    plan_start_ns: int = 0
    leg: Optional[Leg] = None
    later_legs: tuple = ()
    arrival_deviation_k: float = math.nan
    commanded: Optional[Plan] = None
    command_share: float = 1.0
    model_factors: tuple = ()


class Supervisor:
    """
    The planner's memory and judgement.

    `accept_battery` and `accept_mission` take input and raise InvalidInput where they refuse it,
    `cancel` drops the trip; `replan` makes `decision`; `command` says what holds at an instant,
    `later_decisions` what is planned beyond the next stop. `vehicle`, `settings`, `enabled` and
    `rivals` may be set at any time; `replan` then takes them into account.
    """

    def __init__(self, vehicle: Vehicle, settings: Settings):
        """Start with no input: NO_ROUTE."""
        self.settings = settings
        self._commands, self._switch = CommandHistory(), HeaterSwitch()
        self.vehicle = vehicle
        self.enabled = True
        self.rivals = ''  # The names of other nodes that command the same heater.
        self.mission: Optional[Mission] = None
        self.measurement: Optional[Measurement] = None
        # Whether the latest route plan called the trip off.
        self.is_cancelled = False
        self.decision = Decision(Status.NO_ROUTE, 'No route plan has arrived yet.')
        # Decisions by Leg, and the vehicle and settings that they were made with.
        self._later_decisions, self._later_made_with = {}, (None, None)
        self._refusals = Refusals()
        self._latest_ns = 0

    # The car

    @property
    def vehicle(self):
        """The Vehicle, as its file describes it."""
        return self._vehicle

    @vehicle.setter
    def vehicle(self, vehicle):
        self._vehicle = vehicle
        self._unlearned = []
        self._outlooks = OutlookMaker(vehicle)
        self._estimator = Estimator(vehicle)

    def recall(self, factors, factor_covariance):
        """Begin the estimation anew with what was learned before: see estimation.belief.Belief."""
        self._estimator = Estimator(self._vehicle, factors, factor_covariance)

    @property
    def estimate(self):
        """What is believed of the battery (estimation.estimator.Estimate); None if nothing is."""
        return self._estimator.estimate if self.settings.estimation else None

    # Input

    def accept_battery(self, measurement, now_ns):
        """Keep a measurement of the battery, or refuse it and keep the one before."""
        self._notice_clock(now_ns)
        try:
            self._check_battery(measurement, now_ns)
        except InvalidInput as error:
            self.refuse_battery(error)
            raise
        self.measurement = measurement
        self._unlearned.append(measurement)
        self._refusals.lift_by_battery()

    def accept_mission(self, mission):
        """Replace the route by a new one, or refuse it as `refuse_route` does."""
        try:
            check_mission(self.vehicle, mission, self.defaults.target_battery_temperature_c)
        except InvalidInput as error:
            self.refuse_route(error, RefusedRoute.of_mission(mission))
            raise
        self._follow(mission)
        self._refusals.lift_by_route()

    def revise_mission(self, mission):
        """
        Take the present route as other parameters make it.

        Where it does not fit them, it is dropped until it is revised again or a valid one comes.
        """
        try:
            check_mission(self.vehicle, mission, self.defaults.target_battery_temperature_c)
        except InvalidInput as error:
            self._follow(None)
            self._refusals.note_misfit(error)
            raise
        self._follow(mission)
        self._refusals.lift_misfit()

    def cancel(self):
        """Drop the route: there is nothing to heat for until a new one comes."""
        self._follow(None)
        self.is_cancelled = True
        self._refusals.lift_by_route()

    def _follow(self, mission):
        self.mission, self.is_cancelled = mission, False
        self._later_decisions.clear()
        self._outlooks.forget_deviation()
        self._switch.allow()

    def refuse_battery(self, error):
        """Note that a battery state was refused: 0 W until a valid one comes."""
        self._refusals.note_battery(error)

    def refuse_route(self, error, refused=RefusedRoute()):
        """Note that a route was refused: 0 W, for how long depends on its RefusedRoute."""
        if not self._refusals.note_route(error, refused, self.mission, self._latest_ns):
            self._follow(None)

    @property
    def refused_route(self):
        """What was refused of the latest route plan, as a sentence; None after a valid one."""
        return self._refusals.route

    def _notice_clock(self, now_ns):
        if now_ns < self._latest_ns - CLOCK_RESTART_S * NS_PER_S:
            self.measurement = None
            self._unlearned.clear()
            self._estimator.lose_time()
        self._latest_ns = now_ns

    def _check_battery(self, measurement, now_ns):
        if now_ns == 0:
            raise InvalidInput('use_sim_time is set and no /clock has arrived: time stands at 0')
        check_situation(self.vehicle, state=measurement.state)
        age_s = (now_ns - measurement.stamp_ns) / NS_PER_S
        timeout_s = self.settings.battery_state_timeout_s
        ahead_s = self.settings.clock_tolerance_s
        if not -ahead_s <= age_s <= timeout_s:
            raise InvalidInput(f'header.stamp: the state is {age_s:.3f} s old; it must be '
                               f'{-ahead_s:g} ... {timeout_s:g} s')
        if self.measurement is not None and measurement.stamp_ns < self.measurement.stamp_ns:
            late_s = (self.measurement.stamp_ns - measurement.stamp_ns) / NS_PER_S
            raise InvalidInput(f'header.stamp: the state is {late_s:.3f} s older than one that '
                               'came before it; stamps must not go back')

    # Judgement

    @property
    def defaults(self):
        """The vehicle's Defaults, with the target of the settings where they have one."""
        defaults, target_c = self.vehicle.defaults, self.settings.target_temperature_c
        return defaults if target_c is None else replace(
            defaults, target_battery_temperature_c=target_c)

    def goal_of(self, leg):
        """Return the Goal of a leg; what it leaves open comes from settings and vehicle."""
        goal = leg.goal(self.defaults.target_battery_temperature_c)
        if goal.minimum_arrival_soc > 0.0:
            reserve = min(goal.minimum_arrival_soc + self.settings.arrival_soc_margin, 1.0)
            goal = replace(goal, minimum_arrival_soc=reserve)
        return goal

    def replan(self, now_ns):
        """Learn from the inputs at hand, make the decision for them, and return it."""
        measurements, self._unlearned = self._unlearned, []
        if self.settings.estimation:
            course = Course(self._vehicle, self.mission)
            for measurement in measurements:
                self._estimator.observe(measurement, course, self._commands)
        self.decision = self._decide(now_ns)
        return self.decision

    def _decide(self, now_ns):
        obstacle = self._obstacle(now_ns)
        if obstacle is not None:
            return obstacle
        number = self.mission.leg_number(now_ns)
        leg, later_legs = self.mission.legs[number], self.mission.legs[number + 1:]
        ended_for_s = leg.ended_for_s(now_ns)
        if ended_for_s < 0.0:
            return replace(self._plan_now(leg, now_ns), later_legs=later_legs)
        if later_legs:
            return Decision(Status.CHARGING, _charging_sentence(later_legs[0], now_ns),
                            later_legs=later_legs)
        return Decision(Status.ARRIVED,
                        f'The route has ended: arrived {duration_text(ended_for_s)} ago.')

    def _plan_now(self, leg, now_ns):
        """Return the Decision for the leg that is now, from the battery as it is."""
        estimate = self.estimate
        stamp_ns = self.measurement.stamp_ns if estimate is None else estimate.stamp_ns
        # A stamp ahead of this clock must not put off what the plan wants now.
        start_ns = max(min(stamp_ns, now_ns), leg.start_ns)
        starts_in_s = (start_ns - now_ns) / NS_PER_S
        if estimate is None:
            decision = self._plan(leg, self.measurement.state, start_ns)
            if decision.plan is None:
                return decision
            plan = seen_from_now(decision.plan, self.vehicle, self.goal_of(leg), starts_in_s)
            return replace(decision, status=plan.status, explanation=plan.explanation, plan=plan)
        try:
            outlook = self._outlooks.make(estimate, leg.route_ahead(start_ns), self.goal_of(leg),
                                          self.settings, self._switch.is_on, starts_in_s)
        except (InvalidInput, PlanningFailure) as error:
            return Decision(Status.INVALID_INPUT, str(error))
        plan = outlook.plan
        return Decision(plan.status, plan.explanation, plan, start_ns, leg,
                        arrival_deviation_k=outlook.arrival_deviation_k,
                        commanded=outlook.commanded, command_share=outlook.command_share,
                        model_factors=outlook.model_factors)

    def _plan(self, leg, state, start_ns):
        """Return the Decision for a leg from a state at an instant [ns] before its end on."""
        try:
            plan = plan_preheating(self.vehicle, leg.route_ahead(start_ns), state,
                                   self.goal_of(leg), self.settings.method)
        except (InvalidInput, PlanningFailure) as error:
            return Decision(Status.INVALID_INPUT, str(error))
        return Decision(plan.status, plan.explanation, plan, start_ns, leg)

    def later_decisions(self):
        """Return a Decision for each leg beyond the next stop, from its departure on."""
        made_with = (self.vehicle, self.settings)
        if made_with != self._later_made_with:
            self._later_decisions, self._later_made_with = {}, made_with
        for leg in self.decision.later_legs:
            if leg not in self._later_decisions:
                self._later_decisions[leg] = self._plan(leg, leg.departure, leg.start_ns)
        return tuple(self._later_decisions[leg] for leg in self.decision.later_legs)

    def _obstacle(self, now_ns):
        """Return why the heater is off whatever a plan says; None where nothing stands against."""
        if not self.enabled:
            return Decision(Status.DISABLED, 'Preheating is switched off through ~/enable.')
        if self.rivals:
            return Decision(Status.COMMAND_CONFLICT, 'hvch_command is also published by '
                            f'{self.rivals}; the heater is off until only one is left.')
        if self._refusals.obstacle is not None:
            return Decision(Status.INVALID_INPUT, self._refusals.obstacle)
        if self.is_cancelled:
            return Decision(Status.NO_CHARGING_PLANNED,
                            'The trip was cancelled: no heating until a new route plan arrives.')
        if self.mission is None:
            return Decision(Status.NO_ROUTE, 'No valid route plan has arrived yet.')
        if self.measurement is None:
            return Decision(Status.NO_BATTERY_STATE, 'No valid battery state has arrived yet.')
        age_s = (now_ns - self.measurement.stamp_ns) / NS_PER_S
        if not (-self.settings.clock_tolerance_s <= age_s
                < self.settings.battery_state_timeout_s):
            return Decision(
                Status.STALE_INPUT,
                f'battery_state is {age_s:.1f} s old; at most '
                f'{self.settings.battery_state_timeout_s:g} s are allowed.')
        return None

    def on_track(self, now_ns):
        """
        Return whether the latest state is where the plan at hand saw it: its command then holds.

        The planner answers such a state at once, and plans again after that.
        """
        plan, measurement = self.decision.plan, self.measurement
        if plan is None or measurement is None or self._obstacle(now_ns) is not None:
            return False
        elapsed_s = (measurement.stamp_ns - self.decision.plan_start_ns) / NS_PER_S
        if not 0.0 <= elapsed_s <= min(ON_TRACK_FOR_S, plan.arrival_time_s):
            return False
        # One reading of a coarse signal does not move what is believed by more than this.
        coarse_k = self.estimate.temperature_resolution_k if self.estimate else 0.0
        seen_c = np.interp(elapsed_s, plan.time_s, plan.battery_temperature_c)
        seen_soc = np.interp(elapsed_s, plan.time_s, plan.soc)
        state = measurement.state
        return (abs(state.temperature_c - seen_c) <= ON_TRACK_K + coarse_k
                and abs(state.soc - seen_soc) <= ON_TRACK_SOC)

    def refresh(self, now_ns):
        """Let time pass: where the inputs no longer carry the decision, it gives way."""
        obstacle = self._obstacle(now_ns)
        if obstacle is not None:
            self.decision = obstacle

    def _heater_limit_w(self, leg, now_ns):
        """Return what the cabin leaves of the heater [W] at an instant on a leg."""
        segment = leg.route.segment_at((now_ns - leg.start_ns) / NS_PER_S)
        cabin_w = float(leg.route.cabin_heating_power_w[segment])
        return max(0.0, self.vehicle.hvch.maximum_power_w - cabin_w)

    def command_off(self, now_ns, reason):
        """Return the Command of 0 W at an instant, for a reason that lies outside."""
        self._switch.force_off()
        self._commands.note(now_ns, 0.0)
        return Command(0.0, now_ns + round(self.settings.lease_s * NS_PER_S), reason)

    def command(self, now_ns):
        """Return the Command at an instant; it counts as given."""
        decision = self._obstacle(now_ns) or self.decision
        plan = decision.commanded or decision.plan
        if plan is None:
            return self.command_off(now_ns, decision.status)
        elapsed_s = (now_ns - decision.plan_start_ns) / NS_PER_S
        if elapsed_s >= plan.arrival_time_s:
            return self.command_off(
                now_ns, Status.CHARGING if decision.later_legs else Status.ARRIVED)
        if elapsed_s < 0.0 or decision.status is Status.NO_CHARGING_PLANNED:
            # The trip has not begun, or there is nothing to heat for.
            return self.command_off(now_ns, decision.status)
        # A partial step's power is computed, and may round to a little more than there is.
        limit_w = self._heater_limit_w(decision.leg, now_ns)
        wanted_w = min(plan.power_at_w(elapsed_s) / decision.command_share, limit_w)
        if wanted_w == 0.0 and decision.status is Status.OUT_OF_CHARGE:
            # Not even for the heater's least time on: each watt is needed to get further.
            return self.command_off(now_ns, decision.status)
        power_w = self._switch.power_w(
            now_ns, wanted_w, limit_w,
            self.settings.minimum_on_time_s, self.settings.minimum_off_time_s)
        self._commands.note(now_ns, power_w)
        reason = decision.status
        if power_w > 0.0 and reason is Status.WAITING:
            reason = Status.HEATING
        elif power_w == 0.0 and reason is Status.HEATING:
            reason = Status.WAITING
        lease_end_ns = now_ns + round(self.settings.lease_s * NS_PER_S)
        stale_ns = self.measurement.stamp_ns + round(
            self.settings.battery_state_timeout_s * NS_PER_S)
        return Command(power_w, min(lease_end_ns, stale_ns), reason)


def _charging_sentence(leg, now_ns):
    """Return what is to be expected during the stop before a leg."""
    end = 'to a fast charger' if leg.charging_planned else 'without fast charging at its end'
    return (f'Charging until departure in {duration_text((leg.start_ns - now_ns) / NS_PER_S)}; '
            f'then {duration_text(leg.route.total_duration_s)} of driving {end}.')
