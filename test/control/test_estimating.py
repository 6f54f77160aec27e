# SPDX-License-Identifier: Apache-2.0
"""The step with estimation, on simulated cars: uncertainty, and heaters that do not obey."""

from functools import cache
import re

import pytest
from simulated_drives import drive

from bev_preheat.control.events import RouteArrived
from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.simulation.heater import HeaterFault, HeaterLease
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle

pytestmark = pytest.mark.costly

VEHICLE = load_vehicle('reference')
ROUTE = load_route('reference', VEHICLE.defaults).before(1500.0)
COARSE = Sensors(temperature_noise_k=0.2, temperature_resolution_k=1.0, period_s=4.0)
# The cabin takes 1978 W.
FULL_W = 7000.0 - 1978.0


@cache
def ride(until_s, *faults, temperature_c=10.0):
    """Return the Seen of each command of a ride to 25 degC until an instant [s]."""
    return tuple(drive(VEHICLE, DrivePhase(ROUTE, Goal(25.0)), BatteryState(temperature_c, 0.8), until_s,
                       sensors=COARSE, faults=faults, seed=3))


def derated():
    return ride(1410.0, HeaterFault(300.0, share=0.4))


def test_the_plan_aims_at_the_target_and_no_further():
    # While it heats, and can still stop in time.
    aimed_k = [seen.decision.plan.arrival_temperature_c - 25.0 for seen in ride(1490.0)
               if 600.0 < seen.at_s < 1300.0 and seen.decision.status is Status.HEATING]
    assert len(aimed_k) > 400
    assert min(aimed_k) > -0.01
    assert max(aimed_k) < 0.1


def test_a_dead_heater_is_asked_all_the_same_and_not_counted_on():
    seen = ride(1200.0, HeaterFault(600.0, share=0.0))
    assert next(each.decision.status for each in seen if each.at_s >= 590.0) is Status.HEATING
    _, command, decision, _, car = seen[-1]
    assert re.fullmatch(
        r'The heater does not respond to its command\. Driving alone does not warm the battery '
        r'enough: arrival in \d+:\d\d min at [\d.]+ degC, [\d.]+ K below the target 25\.0 degC\.',
        decision.explanation)
    assert decision.status is Status.TARGET_UNREACHABLE
    # The heater may recover, so it is still commanded at full power.
    assert command.battery_heating_power_w == pytest.approx(FULL_W)
    cools_c = decision.plan.arrival_temperature_c
    assert cools_c < 24.0
    # No command changes the rest of the drive.
    car.advance_under(HeaterLease(FULL_W, 1490.0), 1490.0)
    assert car.plant.temperature_c == pytest.approx(cools_c, abs=1.0)


def test_a_derated_heater_is_planned_with_its_real_power():
    _, command, decision, *_ = derated()[-1]
    assert decision.explanation.startswith('The heater delivers only ')
    assert decision.command_share == pytest.approx(0.4, abs=0.1)
    # The command is the full power; the plan contains the power that the heater really delivers.
    assert command.battery_heating_power_w == pytest.approx(FULL_W)
    assert decision.plan.hvch_battery_power_w.max() == pytest.approx(decision.command_share * FULL_W, rel=0.1)


def test_a_suspected_heater_is_said_to_be_so_before_it_is_reported():
    suspected_s, reported_s = (
        next(seen.at_s for seen in derated() if seen.decision.explanation.startswith(words))
        for words in ('The heater may', 'The heater delivers only '))
    assert 340.0 < suspected_s < reported_s
    assert not any(seen.decision.explanation.startswith('The heater') for seen in ride(1490.0)
                   if 290.0 < seen.at_s < 1400.0)


def test_a_heater_that_is_stuck_on_is_commanded_off():
    _, command, decision, *_ = ride(800.0, HeaterFault(100.0, stuck_on=True), temperature_c=24.0)[-1]
    assert decision.explanation.startswith('The heater heats without a command. ')
    assert command.total_w == 0.0
    # The uncommanded heat is predicted.
    assert decision.plan.arrival_temperature_c > 30.0


def test_a_new_route_forgets_how_sure_the_old_one_was():
    *_, decision, planner, _ = ride(200.0)[-1]
    leg = planner.state.mission.legs[0]
    planner.step(planner.state.now_ns, RouteArrived(Mission('short', (
        Leg(leg.route.before(300.0), leg.start_ns, True, 25.0),))))
    assert planner.state.decision.forecast.as_planned_k < 0.5 * decision.forecast.as_planned_k
