# SPDX-License-Identifier: Apache-2.0
"""The effect of a refused route, and of a cancellation, on the previous trip (docs/explanation/safety.md)."""

from dataclasses import replace

import pytest
from steady_drives import at, measured, NOW_NS, ns, outcome, steady_leg, steady_mission, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.events import RefusedRoute
from bev_preheat.control.inputs import Measurement, Mission, with_stops
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status

# Neither a refusal nor a cancellation is held up by the least time on.
SETTINGS = Settings(estimation=False, minimum_on_time_s=600.0, minimum_off_time_s=0.0,
                    battery_state_timeout_s=4.0)
# 20 min at -7 degC: too short to reach 25 degC, so it heats at once.
DURATION_S = 1200.0
ERROR = InvalidInput('speed[0]: -1 is not allowed')


def make_trip_with_stop(start_ns=NOW_NS):
    return Mission('home', with_stops(
        (steady_leg(start_ns=start_ns), steady_leg(900.0, departure=BatteryState(30.0, 0.8))), (600.0,)))


def feed(supervisor, now_ns):
    """Give a valid state; return the supervisor's answer (power [W], status)."""
    supervisor.accept_battery(measured(now_ns), now_ns)
    return outcome(supervisor, now_ns)


def feed_on(supervisor):
    """Give valid states from the next second on, past the pause after doubt; return the last answer."""
    # Input must be valid for 10 s.
    first, *_, last = (feed(supervisor, at(1.0 + second)) for second in range(12))
    assert first == OFF
    return last


def heating_supervisor(mission):
    supervisor = Stepwise(VEHICLE, SETTINGS)
    supervisor.accept_mission(mission)
    power_w, _ = feed(supervisor, NOW_NS)
    assert power_w > 0.0
    return supervisor


OFF = (0.0, Status.INVALID_INPUT)
HOME_END_NS = at(DURATION_S)
SAME = RefusedRoute('home', True, (HOME_END_NS,))


# An update of the same trip

@pytest.mark.parametrize('refused', [
    SAME, replace(SAME, arrivals_ns=(HOME_END_NS + ns(300.0),)),
    # The difference between sums in different steps.
    replace(SAME, arrivals_ns=(HOME_END_NS - 1000,))], ids=['same', 'later', 'rounding'])
def test_after_an_update_that_arrives_no_earlier_the_old_route_goes_on(refused):
    supervisor = heating_supervisor(steady_mission())
    supervisor.refuse_route(ERROR, refused)
    assert outcome(supervisor, NOW_NS) == OFF
    power_w, status = feed_on(supervisor)
    assert (power_w > 0.0, status) == (True, Status.TARGET_UNREACHABLE)


def test_the_old_route_goes_on_only_with_a_valid_state():
    supervisor = heating_supervisor(steady_mission())
    supervisor.refuse_route(ERROR, SAME)
    with pytest.raises(InvalidInput):
        supervisor.accept_battery(Measurement(BatteryState(-7.0, 2.0), NOW_NS), NOW_NS)
    supervisor.refresh(at(1.0))
    assert outcome(supervisor, at(1.0)) == OFF


def test_a_refused_update_remains_known_until_a_valid_route_comes():
    supervisor = heating_supervisor(steady_mission())
    supervisor.refuse_route(ERROR, SAME)
    known = []
    for second in range(1, 4):
        feed(supervisor, at(second))
        known.append(supervisor.state.inbox.refused_route)
    supervisor.accept_mission(steady_mission())
    assert (set(known), supervisor.state.inbox.refused_route) == ({
        'route_plan refused: speed[0]: -1 is not allowed. The previous route holds again from '
        'the next valid battery state on.'}, None)


@pytest.mark.parametrize('route_id', ['home', 'yesterday'])
def test_a_route_that_was_over_when_it_arrived_ends_no_trip(route_id):
    supervisor = heating_supervisor(steady_mission())
    with pytest.raises(InvalidInput, match='ended 300 s before it arrived'):
        supervisor.accept_mission(steady_mission(route_id, start_ns=NOW_NS - ns(DURATION_S + 300.0)))
    assert feed(supervisor, at(1.0))[0] > 0.0
    assert supervisor.state.inbox.refused_route.endswith('The current route goes on.')


def test_an_update_that_has_just_ended_is_the_arrival():
    supervisor = heating_supervisor(steady_mission())
    supervisor.accept_mission(steady_mission(start_ns=NOW_NS - ns(DURATION_S + 5.0)))
    assert feed(supervisor, at(1.0))[0] == 0.0
    assert supervisor.state.decision.status is Status.ARRIVED


def test_an_old_route_lifts_no_refusal():
    supervisor = heating_supervisor(steady_mission())
    supervisor.refuse_route(ERROR, SAME)
    with pytest.raises(InvalidInput):
        supervisor.accept_mission(steady_mission(start_ns=NOW_NS - ns(DURATION_S + 300.0)))
    assert supervisor.state.decision.explanation.startswith('route_plan refused: header.stamp')


def test_a_route_plan_that_was_replaced_does_not_come_back():
    supervisor = heating_supervisor(steady_mission(start_ns=NOW_NS - ns(300.0)))
    supervisor.accept_mission(steady_mission(start_ns=NOW_NS))
    with pytest.raises(InvalidInput, match='a later route plan has replaced this one'):
        supervisor.accept_mission(steady_mission(start_ns=NOW_NS - ns(300.0)))
    assert feed(supervisor, at(1.0))[0] > 0.0
    assert supervisor.state.mission.arrival_ns == HOME_END_NS
    # Another trip may have any stamp; a vehicle that is earlier has a new one.
    for route_id, early_s in (('home', 200.0), ('work', 300.0)):
        mission = steady_mission(route_id, start_ns=NOW_NS - ns(early_s))
        supervisor.accept_mission(mission)
        assert supervisor.state.mission.arrival_ns == mission.arrival_ns


# Other refusals

DROPPED = {
    'other_id': (replace(SAME, route_id='work'),
                 "has another route_id, 'work' instead of 'home'"),
    'no_id': (replace(SAME, route_id=''), 'has no route_id'),
    'no_charging': (replace(SAME, charging_planned=False), 'plans no charging'),
    'earlier': (replace(SAME, arrivals_ns=(HOME_END_NS - ns(2.0),)), 'arrives earlier'),
    'unreadable': (replace(SAME, arrivals_ns=None), 'the arrival of the refused route cannot be'),
    'with_a_stop': (replace(SAME, arrivals_ns=(at(600.0), HOME_END_NS + ns(60.0))),
                    'has other stops'),
    'nothing': (RefusedRoute(), 'has no route_id'),
}


@pytest.mark.parametrize('refused, reason', DROPPED.values(), ids=DROPPED)
def test_any_other_refused_route_ends_the_one_before(refused, reason):
    supervisor = heating_supervisor(steady_mission())
    supervisor.refuse_route(ERROR, refused)
    outcomes = {outcome(supervisor, NOW_NS)} | {
        feed(supervisor, at(second)) for second in range(1, 5)}
    assert (outcomes, supervisor.state.mission) == ({OFF}, None)
    sentence = supervisor.state.decision.explanation
    assert sentence.startswith('route_plan refused: speed[0]: -1 is not allowed. The previous route '
                               'was dropped because ')
    assert reason in sentence
    assert sentence.endswith('The heater is off until a valid route plan arrives.')


def test_a_route_without_an_id_is_no_update_of_one_without():
    supervisor = heating_supervisor(steady_mission(route_id=''))
    supervisor.refuse_route(ERROR, replace(SAME, route_id=''))
    assert feed(supervisor, at(1.0)) == OFF


def test_a_refused_route_without_one_before_it_is_told_until_a_valid_one_comes():
    supervisor = Stepwise(VEHICLE, SETTINGS)
    supervisor.refuse_route(ERROR, SAME)
    assert feed(supervisor, NOW_NS) == OFF
    assert supervisor.state.decision.explanation == (
        'route_plan refused: speed[0]: -1 is not allowed. The heater is off until a valid route '
        'plan arrives.')


@pytest.mark.parametrize('arrivals_s, goes_on', [
    ((1200, 2700), True), ((1300, 2800), True),
    # The stop is missing, one is added, the stop is earlier, the end is earlier.
    ((2700,), False), ((1200, 1500, 2700), False), ((1100, 2800), False), ((1200, 2600), False)])
def test_stops_ahead_must_not_be_called_off_either(arrivals_s, goes_on):
    supervisor = heating_supervisor(make_trip_with_stop())
    supervisor.refuse_route(ERROR, replace(
        SAME, arrivals_ns=tuple(at(second) for second in arrivals_s)))
    assert (feed_on(supervisor) != OFF) is goes_on


def test_stops_behind_may_be_left_out():
    # Under way on the second leg.
    supervisor = Stepwise(VEHICLE, SETTINGS)
    supervisor.accept_mission(make_trip_with_stop(start_ns=NOW_NS - ns(1900.0)))
    assert feed(supervisor, NOW_NS)[0] > 0.0
    supervisor.refuse_route(ERROR, replace(SAME, arrivals_ns=(at(2700.0 - 1900.0),)))
    assert feed_on(supervisor)[0] > 0.0


def test_a_cancelled_trip_is_off_and_stays_off():
    supervisor = heating_supervisor(steady_mission())
    supervisor.cancel()
    outcomes = {outcome(supervisor, NOW_NS)} | {
        feed(supervisor, at(second)) for second in range(1, 5)}
    # Regardless of the battery state, because no route asks for heat.
    supervisor.refresh(at(100.0))
    outcomes.add(outcome(supervisor, at(100.0)))
    assert (outcomes, supervisor.state.decision.explanation) == (
        {(0.0, Status.NO_CHARGING_PLANNED)},
        'The trip was cancelled: no heating until a new route plan arrives.')
