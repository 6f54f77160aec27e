# SPDX-License-Identifier: Apache-2.0
"""The decision on a battery state, and its report."""

import pytest

from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S
STATE = BatteryState(-7.0, 0.8)


def make_a_route():
    return make_route({
        'duration_s': [30.0] * 40, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
        'ambient_temperature_c': [-7.0], 'cabin_heating_power_w': [1500.0],
        'auxiliary_power_w': [400.0]}, VEHICLE.defaults)


def ns(seconds):
    return round(seconds * NS_PER_S)


@pytest.mark.parametrize('estimation', [False, True])
@pytest.mark.parametrize('error', [InvalidInput('beyond the model'), PlanningFailure('beyond the model')],
                         ids=lambda error: type(error).__name__)
def test_what_cannot_be_planned_is_told_and_not_heated(monkeypatch, estimation, error):
    def fail(*_, **__):
        raise error

    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    supervisor.step(START_NS, RouteArrived(Mission('home', (
        Leg(make_a_route(), START_NS, True, 25.0),))))
    monkeypatch.setattr('bev_preheat.planning.planner.plan_case', fail)
    output = supervisor.step(START_NS, BatteryStateArrived(Measurement(STATE, START_NS)))
    assert (supervisor.state.decision.status, supervisor.state.decision.explanation) == (
        Status.INVALID_INPUT, 'beyond the model')
    assert supervisor.state.latest_command.battery_heating_power_w == 0.0
    # It was foreseen.
    assert not output.failure


@pytest.mark.parametrize('estimation', [False, True])
def test_a_state_that_comes_late_does_not_shift_what_is_said(estimation):
    """100 s into the route, 1100 s before its end: times count from now, not from the state."""
    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    state_ns = START_NS + ns(100.0)
    supervisor.step(START_NS, RouteArrived(Mission('home', (
        Leg(make_a_route(), START_NS, True, 25.0),))))
    for age_s, left in ((0.0, '18:20'), (0.4, '18:20'), (0.6, '18:19'), (1.4, '18:19')):
        supervisor.step(state_ns + ns(age_s), BatteryStateArrived(
            Measurement(STATE, state_ns)))
        assert f'arrival in {left} min' in supervisor.state.decision.explanation
        assert supervisor.state.decision.plan_start_ns == state_ns


@pytest.mark.parametrize('estimation', [False, True])
def test_a_state_is_answered_once_by_the_plan_made_from_it(estimation):
    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    supervisor.step(START_NS, RouteArrived(Mission('home', (
        Leg(make_a_route(), START_NS, True, 25.0),))))
    for second in range(3):
        now_ns = START_NS + ns(second)
        # As the previous plan had predicted.
        output = supervisor.step(now_ns, BatteryStateArrived(Measurement(STATE, now_ns)))
        assert output.command is not None
        assert supervisor.state.decision.plan_start_ns == now_ns
