# SPDX-License-Identifier: Apache-2.0
"""
Decides which plan holds, and whether the coldest cell sets the limits.

Only the current leg is planned from the battery's state, again on every input. A later leg is planned once, from
the departure that the route gives.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from bev_preheat.charging.stop import Charger
from bev_preheat.control.charger_heat import ChargerHeat, ChargerHeater, ChargerSituation
from bev_preheat.control.decision import Decision, Moment
from bev_preheat.control.forecast_plan import (
    believed_share,
    believed_state,
    ForecastPlanner,
    planned_as_measured,
    PlanningTask,
)
from bev_preheat.control.inputs import Leg, Measurement
from bev_preheat.control.regime import Regime, RegimeReport
from bev_preheat.control.settings import Settings
from bev_preheat.control.target import TargetChoice
from bev_preheat.control.target_choice import TargetChooser, TargetSearchInput
from bev_preheat.control.timetable import Timetable
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.estimation.estimate import Estimate
from bev_preheat.estimation.prior import temperature_after
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import Route
from bev_preheat.tunables import COLDER_CELL_K, FORESEEN_S, MOST_PARKED_S, MOST_STANDING_S
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import limited_by_coldest_cell


class DecisionMaker(NamedTuple):
    """
    Makes Decisions for one vehicle; a value: each decision makes another one.

    It has the planner of forecasts, the chooser of targets and the heating at a charger. The power limits are
    those of a coldest cell that is `colder_by_k` [K] colder than the battery.
    """

    forecasts: ForecastPlanner = ForecastPlanner()
    targets: TargetChooser = TargetChooser()
    charger_heater: ChargerHeater = ChargerHeater()
    colder_by_k: float = 0.0

    def for_new_mission(self) -> DecisionMaker:
        """Return the maker without the arrival's uncertainty of the route before."""
        return self._replace(forecasts=self.forecasts.for_new_mission(), targets=self.targets.for_new_mission())

    def decide(self, moment: Moment) -> tuple[DecisionMaker, Decision]:
        """Return the Decision for a Moment, and the maker after it."""
        now_ns, timetable = moment.now_ns, moment.active_timetable
        assert timetable is not None
        mission = timetable.mission
        number = mission.leg_number(now_ns) if timetable.end is None else len(mission.legs) - 1
        leg, later_legs = mission.legs[number], mission.legs[number + 1:]
        if timetable.end is None and leg.ended_for_s(now_ns) < 0.0:
            maker, decision = (self._decide_on_the_way(moment, leg, timetable) if leg.terms.is_trip
                               else self._plan_current(moment, leg))
            decision = leg.terms.in_words(decision)
            return maker, replace(decision, later_legs=later_legs) if later_legs else decision
        maker, heat = self._charger_heat(moment, leg, leg.charger)
        sentence = (_charging_sentence(later_legs[0], now_ns) if later_legs else
                    _arrived_sentence(timetable, now_ns))
        if not later_legs and heat.power_w == 0.0:
            return maker, Decision(Status.ARRIVED, sentence)
        return maker, Decision(Status.CHARGING, f'{sentence} {heat.reason}'.rstrip(), later_legs=later_legs,
                               charger_heat_w=heat.power_w)

    def _decide_on_the_way(self, moment: Moment, leg: Leg, timetable: Timetable) -> tuple[DecisionMaker, Decision]:
        """Return the Decision for a Moment before or on a leg of a route."""
        now_ns, regime = moment.now_ns, moment.regime
        if now_ns >= leg.start_ns and regime.regime is Regime.CHARGING:
            maker, heat = self._charger_heat(moment, leg, None)
            left = duration_text(-leg.ended_for_s(now_ns))
            sentence = (f'The vehicle is charging {left} before its route ends: {regime.evidence}; no heating for '
                        f'the route until it drives on. {heat.reason}').rstrip()
            return maker, Decision(Status.CHARGING, sentence, leg=leg, charger_heat_w=heat.power_w)
        if now_ns >= leg.start_ns and regime.suspicion:
            return self, Decision(Status.WAITING, (
                f'The heater waits: {regime.suspicion}; the state of charge will decide.'), leg=leg)
        maker, decision = self._plan_current(moment, leg)
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
        return maker, decision

    def _charger_heat(self, moment: Moment, leg: Leg,
                      charger: Charger | None) -> tuple[DecisionMaker, ChargerHeat]:
        """Return the ChargerHeat at a charger after or on a leg; 0 W if the settings do not ask for it."""
        measurement, settings = moment.measurement, moment.settings
        assert measurement is not None
        if not settings.heat_while_charging or not leg.terms.is_trip:
            return self, ChargerHeat(0.0, '')
        maker, vehicle, state = self._as_known(moment.vehicle, measurement, moment.estimate)
        heater, heat = self.charger_heater.heat(ChargerSituation(
            vehicle, leg, measurement, state, settings.prices, charger, moment.direction > 0))
        return maker._replace(charger_heater=heater), heat

    def _plan_current(self, moment: Moment, leg: Leg) -> tuple[DecisionMaker, Decision]:
        """Return the Decision for the current leg, from the battery's current state."""
        now_ns, estimate, measurement = moment.now_ns, moment.estimate, moment.measurement
        settings, goal = moment.settings, moment.goal_of(leg)
        choice: TargetChoice | None = None
        assert measurement is not None
        state = measurement.state
        maker = self._limited_to_coldest_cell(measurement, settings)
        limited = _limited(moment.heating_vehicle, maker.colder_by_k)
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
                moment.vehicle, state.temperature_c, ambient_c, starts_in_s))
            estimate = None if estimate is None else estimate.stood_until(temperature_after(
                moment.vehicle, estimate.temperature_c, ambient_c, starts_in_s))
        if leg.terms.target is not None:
            choice = leg.terms.target
        elif leg.charging_planned:
            if leg.charger is None and leg.prospect.probability == 1.0:
                targets, choice = maker.targets.without_charger(leg, settings)
                maker = maker._replace(targets=targets)
            else:
                maker, choice = maker._choose_target(moment, leg, goal, route, estimate)
            goal = choice.goal(goal)
        task = PlanningTask(route, goal, moment, starts_in_s, leg.terms)
        try:
            if estimate is None:
                decision = planned_as_measured(limited, state, task)
            else:
                forecasts, decision = maker.forecasts.make(limited, task, estimate)
                maker = maker._replace(forecasts=forecasts)
        except (InvalidInput, PlanningFailure) as error:
            return maker, Decision(Status.INVALID_INPUT, f'{error} {task.unserved}'.rstrip())
        if choice is not None:
            decision = _with_reason(decision, choice, now_ns)
        return maker, replace(decision, plan_start_ns=start_ns, leg=leg, target=choice)

    def _limited_to_coldest_cell(self, measurement: Measurement, settings: Settings) -> DecisionMaker:
        """Take the power limits of the coldest cell, if it is known and the settings say so."""
        coldest_c = measurement.coldest_cell_c if settings.coldest_cell_limits else None
        colder_by_k = 0.0 if coldest_c is None else min(
            max(measurement.state.temperature_c - coldest_c, 0.0), COLDER_CELL_K)
        # Vehicles are made for whole kelvins only, because each takes some milliseconds.
        if abs(colder_by_k - self.colder_by_k) < 1.0:
            return self
        return self._replace(colder_by_k=float(round(colder_by_k)), forecasts=self.forecasts.for_other_limits())

    def _choose_target(self, moment: Moment, leg: Leg, goal: Goal, route: Route,
                       estimate: Estimate | None) -> tuple[DecisionMaker, TargetChoice]:
        """Return the TargetChoice for the current leg; `route` is its part ahead."""
        mission, measurement = moment.mission, moment.measurement
        assert mission is not None and measurement is not None
        maker, vehicle, state = self._as_known(moment.heating_vehicle, measurement, estimate)
        heater_share = 1.0
        if estimate is not None:
            route = route.with_propulsion(estimate.propulsion_factor)
            heater_share = believed_share(estimate.heater) * moment.heater_share
        targets, choice = self.targets.choose(TargetSearchInput(
            mission.route_id, len(mission.legs) - 1 - mission.legs.index(leg), leg, moment.settings, goal, vehicle,
            route, state, measurement.stamp_ns, heater_share))
        return maker._replace(targets=targets), choice

    def _as_known(self, vehicle: Vehicle, measurement: Measurement,
                  estimate: Estimate | None) -> tuple[DecisionMaker, Vehicle, BatteryState]:
        """Return the limited Vehicle and the BatteryState as estimated, or as measured without an Estimate."""
        vehicle = _limited(vehicle, self.colder_by_k)
        if estimate is None:
            return self, vehicle, measurement.state
        maker = self._replace(forecasts=self.forecasts.following(estimate))
        vehicle = maker.forecasts.vehicle(vehicle)
        return maker, vehicle, believed_state(vehicle, estimate)

    def decide_later(self, moment: Moment, decision: Decision) -> tuple[Decision, ...]:
        """Return a Decision for each later leg of a Decision, from its departure on."""
        vehicle = _limited(moment.vehicle, self.colder_by_k)
        decisions = []
        for leg in decision.later_legs:
            assert leg.departure is not None
            plan = _planned_later(vehicle, leg.route, leg.departure, moment.goal_of(leg), moment.settings.method)
            decisions.append(Decision(Status.INVALID_INPUT, plan) if isinstance(plan, str) else Decision(
                plan.status, None, plan, leg.start_ns, leg))
        return tuple(decisions)


@lru_cache(maxsize=4)
def _limited(vehicle: Vehicle, colder_by_k: float) -> Vehicle:
    """Return a Vehicle with the power limits of its coldest cell, which is colder by [K]."""
    return limited_by_coldest_cell(vehicle, colder_by_k)


@lru_cache(maxsize=16)
def _planned_later(vehicle: Vehicle, route: Route, departure: BatteryState, goal: Goal, method: str) -> Plan | str:
    """Return the Plan from a departure, which no delay changes, or the sentence on the failure."""
    try:
        return plan_preheating(vehicle, route, departure, goal, method)
    except (InvalidInput, PlanningFailure) as error:
        return str(error)


def _with_reason(decision: Decision, choice: TargetChoice, now_ns: int) -> Decision:
    """Return the Decision of a plan with the reason of its target, if that matters."""
    plan = decision.plan
    assert plan is not None
    if choice.doubt is not None:
        status, sentence = choice.doubt.told(plan, now_ns)
        return replace(decision, status=status, sentence=sentence)
    if plan.status is Status.NOT_WORTH_IT:
        return replace(decision, sentence=f'{choice.reason} {plan.explanation}')
    return decision


def _standing_sentence(stood_s: float, regime: RegimeReport) -> str:
    """Return the sentence on a vehicle that has stood for too long to be kept warm."""
    evidence = f' ({regime.evidence})' if regime.evidence else ''
    return (f'The vehicle has stood for {duration_text(stood_s)} although its route has no stop here{evidence}: '
            'no heating until it drives on.')


def _arrived_sentence(timetable: Timetable, now_ns: int) -> str:
    """Return the sentence on a trip that has ended."""
    end = timetable.end
    if end is None or end.at_ns is None or now_ns < end.at_ns:
        return 'The route has ended; only a new route plan begins another trip.'
    ago = f'{duration_text((now_ns - end.at_ns) / NS_PER_S)} ago'
    return f'The route has ended: arrived {ago}.' if end.is_observed else (
        f'The route has ended: by its times the vehicle arrived {ago}; an update of the route continues it.')


def _charging_sentence(leg: Leg, now_ns: int) -> str:
    """Return the sentence on the stop before a leg and the drive after it."""
    end = 'to a fast charger' if leg.charging_planned else 'without fast charging at its end'
    return (f'Charging until departure in {duration_text((leg.start_ns - now_ns) / NS_PER_S)}; '
            f'then {duration_text(leg.route.total_duration_s)} of driving {end}.')
