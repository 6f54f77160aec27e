# SPDX-License-Identifier: Apache-2.0
"""Decisions: a route with stops, the commanded leg at each time, plans beyond the next stop, refusals."""

from dataclasses import replace
import gc
import weakref

import pytest
from refusals import problems_of
from steady_drives import at, measured, NOW_NS, ns, outcome, steady_leg, steady_mission, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.events import BatteryStateArrived, PreheatingSwitched, Reconfigured, RouteArrived
from bev_preheat.control.inputs import Measurement, Mission, with_stops
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import plan_case
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.vehicle import load_vehicle


@pytest.mark.parametrize('estimation', [False, True])
@pytest.mark.parametrize('error', [InvalidInput('beyond the model'), PlanningFailure('beyond the model')],
                         ids=lambda error: type(error).__name__)
def test_what_cannot_be_planned_is_told_and_not_heated(monkeypatch, estimation, error):
    def fail(*_, **__):
        raise error

    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    supervisor.step(NOW_NS, RouteArrived(steady_mission()))
    monkeypatch.setattr('bev_preheat.planning.planner.plan_case', fail)
    output = supervisor.step(NOW_NS, BatteryStateArrived(measured()))
    assert (supervisor.state.decision.status, supervisor.state.decision.explanation) == (
        Status.INVALID_INPUT, 'beyond the model')
    assert supervisor.state.latest_command.battery_heating_power_w == 0.0
    # It was foreseen.
    assert not output.failure


@pytest.mark.parametrize('estimation', [False, True])
def test_a_state_that_comes_late_does_not_shift_what_is_said(estimation):
    """100 s into the route, 1100 s before its end: times count from now, not from the state."""
    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    state_ns = at(100.0)
    supervisor.step(NOW_NS, RouteArrived(steady_mission()))
    for age_s, left in ((0.0, '18:20'), (0.4, '18:20'), (0.6, '18:19'), (1.4, '18:19')):
        supervisor.step(state_ns + ns(age_s), BatteryStateArrived(measured(state_ns)))
        assert f'arrival in {left} min' in supervisor.state.decision.explanation
        assert supervisor.state.decision.plan_start_ns == state_ns


# At 40 % the reference battery delivers some 150 kW at -5 degC and 70 kW at -25 degC.
STEEP = steady_leg(600.0, 60.0, speed_mps=[30.0], propulsion_power_w=[95e3], target_temperature_c=None)


def status(settings, coldest_cell_c):
    supervisor = Supervisor(VEHICLE, settings)
    supervisor.step(NOW_NS, RouteArrived(Mission('steep', (STEEP,))))
    supervisor.step(NOW_NS, BatteryStateArrived(Measurement(
        BatteryState(-5.0, 0.4), NOW_NS, coldest_cell_c=coldest_cell_c)))
    return supervisor.state.decision.status


@pytest.mark.parametrize('estimation', [True, False])
def test_the_coldest_cell_limits_the_power(estimation):
    settings = Settings(estimation=estimation)
    assert status(settings, None) is not Status.POWER_LIMITED
    assert status(settings, -6.0) is not Status.POWER_LIMITED
    assert status(settings, -25.0) is Status.POWER_LIMITED
    assert status(replace(settings, coldest_cell_limits=False), -25.0) is not Status.POWER_LIMITED


COLD = BatteryState(-7.0, 0.8)
# Plans start exactly from the measured values.
MEASURED = Settings(estimation=False, minimum_on_time_s=0.0, minimum_off_time_s=0.0)
AFTER_FIRST, AFTER_SECOND = BatteryState(16.0, 0.7), BatteryState(31.0, 0.6)
# Legs of 10, 10 and 5 min; the cabin leaves another power of the 7 kW in each.
FIRST_W, SECOND_W = 5500.0, 6100.0
STOPS_S = (300.0, 200.0)
SECOND_S, THIRD_S = 900.0, 1700.0
HEATS = Status.TARGET_UNREACHABLE


def make_leg(duration_s, heater_left_w, **fields):
    return steady_leg(duration_s, propulsion_power_w=[18e3], ambient_temperature_c=[-5.0],
                      cabin_heating_power_w=[7000.0 - heater_left_w], **{'target_temperature_c': None, **fields})


def make_mission(start_ns=NOW_NS, **second):
    """Return a trip with two stops and a final leg without charging."""
    legs = (make_leg(600.0, FIRST_W, start_ns=start_ns, target_temperature_c=25.0),
            make_leg(600.0, SECOND_W, **{'departure': AFTER_FIRST, 'target_temperature_c': 20.0,
                                         'minimum_arrival_soc': 0.15, **second}),
            make_leg(300.0, 6300.0, charging_planned=False, departure=AFTER_SECOND))
    return Mission('over two stops', with_stops(legs, STOPS_S))


def supervisor_at(elapsed_s, settings=MEASURED, **mission):
    """Return a supervisor that has planned at NOW_NS, some time after the start of the trip."""
    supervisor = Stepwise(VEHICLE, settings)
    supervisor.accept_mission(make_mission(NOW_NS - ns(elapsed_s), **mission))
    supervisor.accept_battery(Measurement(COLD, NOW_NS), NOW_NS)
    return supervisor


@pytest.fixture
def planned_states(monkeypatch):
    """Return the list of the states that plans were made from, in order."""
    states = []

    def plan(case):
        states.append(case.state)
        return plan_case(case)

    monkeypatch.setattr('bev_preheat.planning.planner.plan_case', plan)
    return states


# The current leg

@pytest.mark.parametrize('elapsed_s, power_w, reason', [
    (-0.001, 0.0, HEATS),
    (0.0, FIRST_W, HEATS), (599.999, FIRST_W, HEATS),
    (600.0, 0.0, Status.CHARGING), (899.999, 0.0, Status.CHARGING),
    (900.0, SECOND_W, HEATS), (1499.999, SECOND_W, HEATS),
    (1500.0, 0.0, Status.CHARGING), (1699.999, 0.0, Status.CHARGING),
    (1700.0, 0.0, Status.NO_CHARGING_PLANNED), (1999.999, 0.0, Status.NO_CHARGING_PLANNED),
    (2000.0, 0.0, Status.ARRIVED), (9000.0, 0.0, Status.ARRIVED)])
def test_the_leg_that_is_now_is_commanded(elapsed_s, power_w, reason):
    assert outcome(supervisor_at(elapsed_s)) == (pytest.approx(power_w), reason)


PATIENT = replace(MEASURED, battery_state_timeout_s=5000.0)


@pytest.mark.parametrize('planned_s, elapsed_s, expected', [
    (0.0, 599.999, (pytest.approx(FIRST_W), HEATS)), (0.0, 600.0, (0.0, Status.CHARGING)),
    # No heating for the next leg before it has a plan.
    (0.0, SECOND_S + 50.0, (0.0, Status.CHARGING)),
    (1900.0, 1999.999, (0.0, Status.NO_CHARGING_PLANNED)), (1900.0, 2000.0, (0.0, Status.ARRIVED))])
def test_time_alone_ends_a_leg(planned_s, elapsed_s, expected):
    supervisor = supervisor_at(planned_s, PATIENT)
    assert outcome(supervisor, at(elapsed_s - planned_s)) == expected


# Beyond the next stop

@pytest.mark.parametrize('elapsed_s, starts_s', [
    (-10.0, [SECOND_S, THIRD_S]), (300.0, [SECOND_S, THIRD_S]), (700.0, [SECOND_S, THIRD_S]),
    (1000.0, [THIRD_S]), (1600.0, [THIRD_S]), (1800.0, []), (2100.0, [])])
def test_what_lies_beyond_the_next_stop_is_planned(elapsed_s, starts_s):
    decisions = supervisor_at(elapsed_s).later_decisions()
    assert [(decision.plan_start_ns - NOW_NS) / NS_PER_S + elapsed_s
            for decision in decisions] == pytest.approx(starts_s)


def test_the_command_does_not_wait_for_later_legs(planned_states):
    supervisor = Stepwise(VEHICLE, MEASURED)
    supervisor.accept_mission(make_mission())
    output = supervisor.step(NOW_NS, BatteryStateArrived(Measurement(COLD, NOW_NS)))
    assert output.command.battery_heating_power_w == pytest.approx(FIRST_W)
    assert planned_states == [COLD]
    assert len(supervisor.later_decisions()) == 2
    assert planned_states == [COLD, AFTER_FIRST, AFTER_SECOND]


# The second leg has a target of its own, which another target in the settings leaves.
@pytest.mark.parametrize('events, planned_again', [
    ([Reconfigured(load_vehicle('reference'), MEASURED)], [AFTER_FIRST, AFTER_SECOND]),
    ([Reconfigured(VEHICLE, replace(MEASURED, target_battery_temperature_c=12.0))], [AFTER_SECOND]),
    ([RouteArrived(make_mission())], [AFTER_FIRST, AFTER_SECOND]),
    ([PreheatingSwitched(False), PreheatingSwitched(True)], []), ([Reconfigured(VEHICLE, replace(MEASURED))], [])],
    ids=['vehicle', 'settings', 'route', 'off and on', 'equal settings'])
def test_later_legs_are_planned_again_where_they_must(planned_states, events, planned_again):
    supervisor = supervisor_at(0.0)
    planned_states.clear()
    supervisor.run(NOW_NS, *events)
    assert planned_states == [COLD, *planned_again]


def test_legs_of_a_route_that_was_replaced_are_forgotten():
    supervisor = supervisor_at(0.0)
    gone = weakref.ref(supervisor.state.mission.legs[1])
    supervisor.accept_mission(make_mission())
    supervisor.replan(NOW_NS)
    gc.collect()
    assert gone() is None


def test_a_later_leg_that_cannot_be_planned_is_told_and_leaves_this_one(monkeypatch):
    def plan(case):
        if case.state is AFTER_FIRST:
            raise PlanningFailure('no finite temperatures')
        return plan_case(case)

    monkeypatch.setattr('bev_preheat.planning.planner.plan_case', plan)
    supervisor = supervisor_at(0.0)
    second, third = supervisor.later_decisions()
    assert (outcome(supervisor)[0], second.status, second.explanation, third.status) == (
        pytest.approx(FIRST_W), Status.INVALID_INPUT, 'no finite temperatures',
        Status.NO_CHARGING_PLANNED)


@pytest.mark.parametrize('second, message', [
    ({'departure': BatteryState(61.5, 0.5)}, 'leg 2: battery temperature: 61.5 is not allowed; '),
    ({'minimum_arrival_soc': 1.25}, 'leg 2: minimum arrival state of charge: 1.25 is not allowed; ')])
def test_a_leg_outside_the_model_is_refused_by_its_number(second, message):
    told, = problems_of(supervisor_at, 0.0, **second)
    assert told.startswith(message)
