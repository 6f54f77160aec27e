# SPDX-License-Identifier: Apache-2.0
"""How a battery state is judged: whether it is on track and may be answered at once, and what is told of it."""

from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.supervision.command_history import CommandHistory
from bev_preheat.supervision.decision import Decision
from bev_preheat.supervision.events import BatteryStateArrived, RouteArrived
from bev_preheat.supervision.inbox import Inbox
from bev_preheat.supervision.inputs import Leg, Measurement, Mission, NS_PER_S
from bev_preheat.supervision.judgement import Judgement
from bev_preheat.supervision.settings import Settings
from bev_preheat.supervision.supervisor import Supervisor
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S
STATE = BatteryState(-7.0, 0.8)
MEASURED = Settings(estimation=False)


def make_a_route(duration_s=1200.0):
    return make_route({
        'duration_s': [duration_s / 40.0] * 40, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
        'ambient_temperature_c': [-7.0], 'cabin_heating_power_w': [1500.0],
        'auxiliary_power_w': [400.0]}, VEHICLE.defaults)


def decision_on(route):
    plan = plan_preheating(VEHICLE, route, STATE, Goal(25.0))
    return Decision(plan.status, plan.explanation, plan, START_NS)


DECISION = decision_on(make_a_route())


def is_on_track(after_ns, warmer_k=0.0, fuller=0.0, decision=DECISION, judgement=None,
                settings=MEASURED):
    """Return the answer to a state that is off the forecast of `decision` by so much."""
    start_ns, plan, after_s = decision.plan_start_ns, decision.plan, after_ns / NS_PER_S
    state = BatteryState(
        float(np.interp(after_s, plan.time_s, plan.battery_temperature_c)) + warmer_k,
        float(np.interp(after_s, plan.time_s, plan.soc)) + fuller)
    inbox = Inbox(VEHICLE, settings)
    inbox.accept_battery(Measurement(state, start_ns + after_ns), start_ns + after_ns)
    return (judgement or Judgement(VEHICLE)).is_on_track(inbox, decision)


def ns(seconds):
    return round(seconds * NS_PER_S)


# It is heated from the start, by 0.7 K a minute.
assert DECISION.plan.battery_temperature_c[2] > STATE.temperature_c + 0.6


@pytest.mark.parametrize('after_ns, expected', [
    (-NS_PER_S, False), (-1, False), (0, True), (1, True), (ns(31.5), True), (ns(60.0), True),
    (ns(60.0) + 1, False), (ns(600.0), False)])
def test_a_forecast_holds_for_a_minute(after_ns, expected):
    assert is_on_track(after_ns) is expected


def test_a_simulated_clock_may_have_begun_a_moment_ago():
    decision = replace(DECISION, plan_start_ns=ns(5.0))
    assert [is_on_track(ns(after_s), decision=decision) for after_s in (0.0, 31.5, 60.0, 62.0)] == [
        True, True, True, False]


@pytest.mark.parametrize('after_ns, expected', [
    (0, True), (ns(20.0), True), (ns(20.0) + 1, False), (ns(40.0), False)])
def test_a_forecast_ends_on_arrival(after_ns, expected):
    assert is_on_track(after_ns, decision=decision_on(make_a_route(20.0))) is expected


@pytest.mark.parametrize('after_s', [0.0, 31.5])
@pytest.mark.parametrize('warmer_k, fuller, expected', [
    (0.049, 0.0, True), (-0.049, 0.0, True), (0.051, 0.0, False), (-0.051, 0.0, False),
    (1.2, 0.0, False), (0.0, 4.9e-4, True), (0.0, -4.9e-4, True), (0.0, 5.1e-4, False),
    (0.0, -5.1e-4, False), (0.0, 0.15, False), (0.04, -4e-4, True), (0.06, -6e-4, False)])
def test_a_state_near_the_forecast_of_its_instant_is_on_track(after_s, warmer_k, fuller, expected):
    assert is_on_track(ns(after_s), warmer_k, fuller) is expected


def coarse_judgement():
    """Return a Judgement that has seen a temperature in whole degrees."""
    judgement = Judgement(VEHICLE)
    judgement.learn(
        (Measurement(BatteryState(temperature_c, 0.8), START_NS + ns(after_s))
         for after_s, temperature_c in enumerate((-8.0, -7.0, -8.0, -7.0), start=-4)),
        None, CommandHistory(), None)
    assert judgement.estimate.temperature_resolution_k == 1.0
    return judgement


@pytest.mark.parametrize('estimation, warmer_k, expected', [
    (True, 1.049, True), (True, -1.049, True), (True, 1.051, False), (True, -1.051, False),
    (False, 0.049, True), (False, 0.051, False)])
def test_one_step_of_a_coarse_signal_is_no_deviation_of_the_estimate(estimation, warmer_k, expected):
    assert is_on_track(ns(5.0), warmer_k, judgement=coarse_judgement(),
                       settings=Settings(estimation=estimation)) is expected


def test_before_the_first_estimate_a_signal_is_taken_as_it_is():
    settings = Settings(estimation=True)
    assert is_on_track(0, 0.049, settings=settings)
    assert not is_on_track(0, 0.051, settings=settings)


def test_without_a_plan_or_a_state_nothing_is_on_track():
    inbox, judgement = Inbox(VEHICLE, MEASURED), Judgement(VEHICLE)
    assert not judgement.is_on_track(inbox, DECISION)
    inbox.accept_battery(Measurement(STATE, START_NS), START_NS)
    assert judgement.is_on_track(inbox, DECISION)
    assert not judgement.is_on_track(inbox, replace(DECISION, plan=None))


@pytest.mark.parametrize('estimation', [False, True])
@pytest.mark.parametrize('error', [InvalidInput('beyond the model'), PlanningFailure('beyond the model')],
                         ids=lambda error: type(error).__name__)
def test_what_cannot_be_planned_is_told_and_not_heated(monkeypatch, estimation, error):
    def fail(*_, **__):
        raise error

    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    list(supervisor.step(START_NS, RouteArrived(Mission('home', (
        Leg(make_a_route(), START_NS, True, 25.0),)))))
    for module in ('judgement', 'outlook'):
        monkeypatch.setattr(f'bev_preheat.supervision.{module}.plan_preheating', fail)
    outputs = list(supervisor.step(START_NS, BatteryStateArrived(Measurement(STATE, START_NS))))
    assert (supervisor.decision.status, supervisor.decision.explanation) == (
        Status.INVALID_INPUT, 'beyond the model')
    assert supervisor.latest_command.battery_heating_power_w == 0.0
    # It was foreseen.
    assert not any(output.failure for output in outputs)


@pytest.mark.parametrize('estimation', [False, True])
def test_a_state_that_comes_late_does_not_shift_what_is_said(estimation):
    """100 s into the route, of which 1100 s are left: times count from now, not from the state."""
    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    state_ns = START_NS + ns(100.0)
    list(supervisor.step(START_NS, RouteArrived(Mission('home', (
        Leg(make_a_route(), START_NS, True, 25.0),)))))
    for age_s, left in ((0.0, '18:20'), (0.4, '18:20'), (0.6, '18:19'), (1.4, '18:19')):
        list(supervisor.step(state_ns + ns(age_s), BatteryStateArrived(
            Measurement(STATE, state_ns))))
        assert f'arrival in {left} min' in supervisor.decision.explanation
        assert supervisor.decision.plan_start_ns == state_ns
