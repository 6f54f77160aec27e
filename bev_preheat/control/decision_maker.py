# SPDX-License-Identifier: Apache-2.0
"""
The decision maker: learns about the car and decides which plan holds.

Only the current leg is planned from the battery's state, again on every input. A later leg is planned once, from
the departure that the route gives.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bev_preheat.control.charger_heat import ChargerHeat, ChargerHeater, ChargerSituation
from bev_preheat.control.decision import Decision
from bev_preheat.control.expected_drive import intervals_between, shown_command_w
from bev_preheat.control.forecast_plan import (
    believed_share,
    believed_state,
    ForecastPlanner,
    PlanningTask,
    seen_from_now,
)
from bev_preheat.control.inputs import Leg
from bev_preheat.control.margins import FORESEEN_S, MOST_COLDER_K, MOST_PARKED_S, MOST_STANDING_S
from bev_preheat.control.preparation_plan import (
    in_words_of_preparation,
    is_from_grid,
    plan_preparation,
    target_of_preparation,
)
from bev_preheat.control.regime import Regime
from bev_preheat.control.soak_watch import StandReport, StandWatch
from bev_preheat.control.target_choice import TargetChoice, TargetChooser, TargetSearchInput
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.estimator import Estimator
from bev_preheat.estimation.last_seen import LastSeen
from bev_preheat.estimation.soak import temperature_after
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.status import Status
from bev_preheat.vehicle.cell_spread import limited_by_coldest_cell

if TYPE_CHECKING:
    from bev_preheat.charging.stop import Charger
    from bev_preheat.control.admitted import AdmittedInputs
    from bev_preheat.control.command_history import CommandHistory
    from bev_preheat.control.inputs import Measurement, Mission
    from bev_preheat.control.knowledge import Known
    from bev_preheat.control.regime import RegimeReport
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.estimation.prior import Learned
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


class DecisionMaker:
    """Learns from battery states and makes Decisions for one vehicle."""

    def __init__(self, vehicle: Vehicle, learned: Learned | None = None,
                 last_seen: LastSeen | None = None) -> None:
        """Start from the vehicle file, or from the Learned of earlier drives, and the battery's LastSeen."""
        # The vehicle as described, and with the power limits of its coldest cell.
        self._vehicle = self._limited = vehicle
        self._colder_by_k = 0.0
        self._forecast_planner = ForecastPlanner(vehicle)
        self._targets = TargetChooser()
        self._charger_heater = ChargerHeater()
        self._estimator = Estimator(vehicle, learned)
        self._stand_watch = StandWatch(vehicle, last_seen)
        # Decisions by the number of legs that follow, and the settings that they were made with.
        self._later_decisions: dict[int, Decision] = {}
        self._later_settings: Settings | None = None

    @property
    def vehicle(self) -> Vehicle:
        """The Vehicle, as its file describes it."""
        return self._vehicle

    @property
    def estimate(self) -> Estimate | None:
        """The latest estimation.estimate.Estimate; None before the first battery state."""
        return self._estimator.estimate

    @property
    def stand_report(self) -> StandReport | None:
        """The StandReport on the trip's first battery state; None without one."""
        return self._stand_watch.report

    def follow_new_mission(self) -> None:
        """Drop the plans and the arrival's uncertainty of the route before."""
        self._later_decisions.clear()
        self._forecast_planner.forget_deviation()
        self._targets.follow_new_mission()

    def begin_trip(self) -> None:
        """Forget the consumption of the route before: another trip begins."""
        self._estimator.begin_route()

    def acquit_heater(self) -> None:
        """Take the heater for healthy, because the power with which it was compared is refuted."""
        self._estimator.acquit_heater()

    def lose_time(self) -> None:
        """Take the temperature from the next reading alone, because the clock was restarted."""
        self._estimator.lose_time()

    def learn(self, known: Known, timetable: Timetable | None, commands: CommandHistory,
              trip: Mission | None) -> None:
        """
        Take a Known measurement in, on a Timetable's mission and under a CommandHistory.

        `trip` is the Mission of the route plan, before which the vehicle may have stood.
        """
        measurement = known.measurement
        stamp_ns = measurement.stamp_ns
        standing = self._stand_watch.look(trip, measurement) if known.trusts_temperature else None
        if timetable is not None and is_from_grid(timetable.mission.legs[0]):
            # Then the battery's power does not show the heater's.
            measurement = replace(measurement, voltage_v=None, current_a=None)
        if standing is not None:
            self._estimator.rely_on(standing)
        if known.is_open:
            # The next state that is clear is compared with the latest one before this.
            return
        if known.is_described:
            self._estimator.observe(
                measurement, shown_command_w(timetable, stamp_ns, commands),
                intervals_between(
                    self._estimator.edges_ns(stamp_ns), self._vehicle, timetable, commands))
        else:
            self._estimator.hold(measurement, known.trusts_temperature, known.trusts_soc)
        estimate = self._estimator.estimate
        if estimate is not None:
            self._stand_watch.note(LastSeen(estimate.temperature_c, estimate.soc, estimate.stamp_ns))

    def decide(self, inputs: AdmittedInputs, regime: RegimeReport, now_ns: int, is_heating: bool,
               heated_s: float) -> Decision:
        """
        Return the Decision for valid inputs in a RegimeReport's regime at an instant [ns].

        `is_heating`: the heater is on; it has heated the battery for `heated_s` [s] on this trip.
        """
        timetable = inputs.active_timetable
        assert timetable is not None
        mission = timetable.mission
        number = mission.leg_number(now_ns) if timetable.end is None else len(mission.legs) - 1
        leg, later_legs = mission.legs[number], mission.legs[number + 1:]
        if timetable.end is None and leg.ended_for_s(now_ns) < 0.0:
            if leg.made_for is not None:
                return in_words_of_preparation(self._plan_current(inputs, leg, now_ns, is_heating, heated_s))
            decision = self._charged_on_the_way(inputs, leg, regime, now_ns, is_heating)
            if decision is None:
                decision = self._plan_current(inputs, leg, now_ns, is_heating, heated_s)
                stood_s = timetable.stood_ns / NS_PER_S
                limit_s = MOST_PARKED_S if regime.is_parked else MOST_STANDING_S
                # A vehicle that stands too long waits instead of heating, or of being about to.
                is_withheld = decision.status.meaning.is_of_plan and decision.status is not Status.NOT_NEEDED
                if stood_s > limit_s and is_withheld:
                    decision = Decision(Status.WAITING, _standing_sentence(stood_s, regime))
                starts_in_s = (leg.start_ns - now_ns) / NS_PER_S
                if starts_in_s > FORESEEN_S and decision.status.meaning.is_alarm:
                    decision = replace(decision, status=Status.WAITING, sentence=(
                        f'The route starts in {duration_text(starts_in_s)}; the heater waits until then. '
                        f'From the current state: {decision.explanation}'))
            return replace(decision, later_legs=later_legs) if later_legs else decision
        heat = self._charger_heat(inputs, leg, leg.charger, is_heating)
        why = f' {heat.reason}' if heat.reason else ''
        if later_legs:
            return Decision(Status.CHARGING, _charging_sentence(later_legs[0], now_ns) + why,
                            later_legs=later_legs, charger_heat_w=heat.power_w)
        arrived = _arrived_sentence(timetable, now_ns)
        if heat.power_w > 0.0:
            return Decision(Status.CHARGING, arrived + why, charger_heat_w=heat.power_w)
        return Decision(Status.ARRIVED, arrived)

    def _charged_on_the_way(self, inputs: AdmittedInputs, leg: Leg, regime: RegimeReport, now_ns: int,
                            is_heating: bool) -> Decision | None:
        """Return the Decision for a vehicle that is charged, or seems to be, on a leg; None if it is not."""
        if now_ns < leg.start_ns:
            return None
        if regime.regime is Regime.CHARGING:
            heat = self._charger_heat(inputs, leg, None, is_heating)
            why = f' {heat.reason}' if heat.reason else ''
            return Decision(Status.CHARGING, (
                f'The vehicle is charging {duration_text(-leg.ended_for_s(now_ns))} before its route ends: '
                f'{regime.evidence}; no heating for the route until it drives on.{why}'), leg=leg,
                charger_heat_w=heat.power_w)
        if regime.suspicion:
            return Decision(Status.WAITING, (
                f'The heater waits: {regime.suspicion}; the state of charge will decide.'), leg=leg)
        return None

    def _charger_heat(self, inputs: AdmittedInputs, leg: Leg, charger: Charger | None,
                      is_heating: bool) -> ChargerHeat:
        """Return the ChargerHeat at a charger after or on a leg; 0 W if the settings do not ask for it."""
        measurement, settings = inputs.measurement, inputs.settings
        assert measurement is not None
        if not settings.heat_while_charging or leg.made_for is not None:
            return ChargerHeat(0.0, '')
        estimate, vehicle, state = self.estimate if settings.estimation else None, self._limited, measurement.state
        if estimate is not None:
            vehicle = self._forecast_planner.vehicle(estimate)
            state = believed_state(vehicle, estimate)
        return self._charger_heater.heat(ChargerSituation(
            vehicle, leg, measurement, state, settings.prices, charger, is_heating))

    def _plan_current(self, inputs: AdmittedInputs, leg: Leg, now_ns: int, is_heating: bool,
                      heated_s: float) -> Decision:
        """Return the Decision for the current leg, from the battery's current state."""
        settings, goal, measurement = inputs.settings, inputs.goal_of(leg), inputs.measurement
        choice: TargetChoice | None = None
        assert measurement is not None
        state = measurement.state
        self._limit_to_coldest_cell(measurement, settings)
        estimate = self.estimate if settings.estimation else None
        stamp_ns = measurement.stamp_ns if estimate is None else estimate.stamp_ns
        # A stamp ahead of this clock must not delay heating that the plan wants now.
        start_ns = max(min(stamp_ns, now_ns), leg.start_ns)
        starts_in_s = (start_ns - now_ns) / NS_PER_S
        route = leg.route_ahead(start_ns)
        assert route is not None
        if starts_in_s > 0.0:
            # The vehicle stands until the start.
            ambient_c = float(route.ambient_temperature_c[0])
            state = replace(state, temperature_c=temperature_after(
                self._vehicle, state.temperature_c, ambient_c, starts_in_s))
            estimate = None if estimate is None else estimate.stood_until(temperature_after(
                self._vehicle, estimate.temperature_c, ambient_c, starts_in_s))
        if leg.made_for is not None:
            choice = target_of_preparation(leg.made_for, settings)
        elif leg.charging_planned:
            is_simple = leg.charger is None and leg.prospect.probability == 1.0
            choice = (self._targets.without_charger(leg, settings) if is_simple else
                      self._choose_target(inputs, leg, goal, route, estimate))
            goal = choice.goal(goal)
        if estimate is None:
            decision = self._plan(inputs, leg, route, goal, state, start_ns)
            if decision.plan is None:
                return decision
            plan, commanded = seen_from_now(
                decision.plan, self._limited, goal, starts_in_s, heated_s=heated_s), None
            status, sentence = _told(plan, choice, now_ns)
            if inputs.heater_refusal and plan.heating_start_s is not None:
                commanded, plan = plan, seen_from_now(plan_preheating(
                    self._limited, route, state, goal, settings.method, heater_share=0.0), self._limited, goal,
                    starts_in_s, heated_s=heated_s)
                status, sentence = plan.status, f'{inputs.heater_refusal} {plan.explanation}'
            return Decision(status, sentence, plan, start_ns, leg, commanded=commanded, target=choice)
        try:
            forecast_plan = self._forecast_planner.make(PlanningTask(
                route, goal, settings, is_heating, starts_in_s, heated_s, leg.made_for, inputs.heater_refusal),
                estimate)
        except (InvalidInput, PlanningFailure) as error:
            return Decision(Status.INVALID_INPUT, str(error))
        plan = forecast_plan.plan
        return Decision(
            *_told(plan, choice, now_ns), plan, start_ns, leg,
            forecast=forecast_plan.forecast,
            commanded=forecast_plan.commanded, command_share=forecast_plan.command_share,
            model_factors=forecast_plan.model_factors, target=choice)

    def _limit_to_coldest_cell(self, measurement: Measurement, settings: Settings) -> None:
        """Take the power limits of the coldest cell, if it is known and the settings say so."""
        coldest_c = measurement.coldest_cell_c if settings.coldest_cell_limits else None
        colder_by_k = 0.0 if coldest_c is None else min(
            max(measurement.state.temperature_c - coldest_c, 0.0), MOST_COLDER_K)
        # Vehicles are made for whole kelvins only, because each takes some milliseconds.
        if abs(colder_by_k - self._colder_by_k) >= 1.0:
            self._colder_by_k = float(round(colder_by_k))
            self._limited = limited_by_coldest_cell(self._vehicle, self._colder_by_k)
            self._forecast_planner.limit_to(self._limited)
            self._later_decisions.clear()

    def _choose_target(self, inputs: AdmittedInputs, leg: Leg, goal: Goal, route: Route,
                       estimate: Estimate | None) -> TargetChoice:
        """Return the TargetChoice for the current leg; `route` is its part ahead."""
        mission, measurement = inputs.mission, inputs.measurement
        assert mission is not None and measurement is not None
        search_input = TargetSearchInput(
            mission.route_id, len(mission.legs) - 1 - mission.legs.index(leg), leg, inputs.settings,
            goal, self._limited, route, measurement.state, measurement.stamp_ns)
        if estimate is not None:
            vehicle = self._forecast_planner.vehicle(estimate)
            search_input = replace(
                search_input, vehicle=vehicle, route=route.with_propulsion(estimate.propulsion_factor),
                state=believed_state(vehicle, estimate), log_factors=estimate.log_factors,
                heater_share=believed_share(estimate.heater))
        return self._targets.choose(search_input)

    def _plan(self, inputs: AdmittedInputs, leg: Leg, route: Route, goal: Goal, state: BatteryState,
              start_ns: int) -> Decision:
        """Return the Decision for a leg, from a state at an instant [ns]; `route` is the part ahead then."""
        try:
            plan = plan_preheating(
                self._limited, route, state, goal, inputs.settings.method
            ) if leg.made_for is None else plan_preparation(
                leg.made_for, self._limited, route, state, goal, inputs.settings.method)
        except (InvalidInput, PlanningFailure) as error:
            return Decision(Status.INVALID_INPUT, str(error))
        return Decision(plan.status, None, plan, start_ns, leg)

    def decide_later(self, inputs: AdmittedInputs, decision: Decision) -> tuple[Decision, ...]:
        """Return a Decision for each later leg of a Decision, from its departure on."""
        if not decision.later_legs:
            return ()
        if inputs.settings != self._later_settings:
            self._later_decisions, self._later_settings = {}, inputs.settings
        decisions = []
        for following, leg in reversed(list(enumerate(reversed(decision.later_legs)))):
            if following not in self._later_decisions:
                assert leg.departure is not None
                self._later_decisions[following] = self._plan(
                    inputs, leg, leg.route, inputs.goal_of(leg), leg.departure, leg.start_ns)
            planned = self._later_decisions[following]
            # A delayed leg keeps its plan; only its instants change.
            decisions.append(planned if planned.leg in (None, leg) else replace(
                planned, leg=leg, plan_start_ns=leg.start_ns))
        return tuple(decisions)


def _told(plan: Plan, choice: TargetChoice | None, now_ns: int) -> tuple[Status, str | None]:
    """
    Return a Plan's status and sentence at an instant [ns]; None: the plan's own sentence.

    They differ if heating is not worth it, or only because the vehicle may not charge.
    """
    if choice is None:
        return plan.status, None
    if choice.doubt is not None:
        return choice.doubt.told(plan, now_ns)
    if plan.status is Status.NOT_WORTH_IT:
        return plan.status, f'{choice.reason} {plan.explanation}'
    return plan.status, None


def _standing_sentence(stood_s: float, regime: RegimeReport) -> str:
    """Return the sentence on a vehicle that has stood for too long to be kept warm."""
    evidence = f' ({regime.evidence})' if regime.evidence else ''
    return (f'The vehicle has stood for {duration_text(stood_s)} although its route has no stop here{evidence}: '
            'no heating until it drives on.')


def _arrived_sentence(timetable: Timetable, now_ns: int) -> str:
    """Return the sentence on a trip that has ended."""
    ended_ns = None if timetable.end is None else timetable.end.at_ns
    if ended_ns is None or now_ns < ended_ns:
        return 'The route has ended; only a new route plan begins another trip.'
    return f'The route has ended: arrived {duration_text((now_ns - ended_ns) / NS_PER_S)} ago.'


def _charging_sentence(leg: Leg, now_ns: int) -> str:
    """Return the sentence on the stop before a leg and the drive after it."""
    end = 'to a fast charger' if leg.charging_planned else 'without fast charging at its end'
    return (f'Charging until departure in {duration_text((leg.start_ns - now_ns) / NS_PER_S)}; '
            f'then {duration_text(leg.route.total_duration_s)} of driving {end}.')
