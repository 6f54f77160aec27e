# SPDX-License-Identifier: Apache-2.0
"""A battery whose cells differ is limited by its coldest cell."""

from dataclasses import replace

import pytest

from bev_preheat.control.events import BatteryStateArrived, Reconfigured, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
NOW_NS = 1_700_000_000 * NS_PER_S
# At 40 % the reference battery delivers some 150 kW at -5 degC and 70 kW at -25 degC.
ROUTE = make_route({
    'duration_s': [60.0] * 10, 'speed_mps': [30.0], 'propulsion_power_w': [95e3],
    'ambient_temperature_c': [-7.0]}, VEHICLE.defaults)


def status(settings, coldest_cell_c):
    supervisor = Supervisor(VEHICLE, settings)
    supervisor.step(NOW_NS, RouteArrived(Mission('steep', (Leg(ROUTE, NOW_NS),))))
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
