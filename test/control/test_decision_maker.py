# SPDX-License-Identifier: Apache-2.0
"""The decision on a battery state, its report, and the coldest cell that limits it."""

from dataclasses import replace

import pytest
from steady_drives import measured, NOW_NS, ns, steady_leg, VEHICLE

from bev_preheat.control.events import BatteryStateArrived, Reconfigured, RouteArrived
from bev_preheat.control.inputs import Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status


@pytest.mark.parametrize('estimation', [False, True])
@pytest.mark.parametrize('error', [InvalidInput('beyond the model'), PlanningFailure('beyond the model')],
                         ids=lambda error: type(error).__name__)
def test_what_cannot_be_planned_is_told_and_not_heated(monkeypatch, estimation, error):
    def fail(*_, **__):
        raise error

    supervisor = Supervisor(VEHICLE, Settings(estimation=estimation))
    supervisor.step(NOW_NS, RouteArrived(Mission('home', (steady_leg(),))))
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
    state_ns = NOW_NS + ns(100.0)
    supervisor.step(NOW_NS, RouteArrived(Mission('home', (steady_leg(),))))
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
    return supervisor, supervisor.state.decision.status


@pytest.mark.parametrize('estimation', [True, False])
def test_the_coldest_cell_limits_the_power(estimation):
    settings = Settings(estimation=estimation)
    assert status(settings, None)[1] is not Status.POWER_LIMITED
    assert status(settings, -6.0)[1] is not Status.POWER_LIMITED
    assert status(settings, -25.0)[1] is Status.POWER_LIMITED
    assert status(replace(settings, coldest_cell_limits=False), -25.0)[1] is not Status.POWER_LIMITED


def test_it_may_be_switched_off_at_run_time():
    supervisor, before = status(Settings(), -25.0)
    assert before is Status.POWER_LIMITED
    supervisor.step(NOW_NS, Reconfigured(
        VEHICLE, replace(supervisor.state.settings, coldest_cell_limits=False), supervisor.state.mission))
    assert supervisor.state.decision.status is not Status.POWER_LIMITED
