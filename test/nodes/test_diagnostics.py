# SPDX-License-Identifier: Apache-2.0
"""The entry `planner: estimation` on an offset temperature sensor."""

from dataclasses import replace
import math
import re

from diagnostic_msgs.msg import DiagnosticStatus
from planner_car import values_of
import pytest
from stepwise import Stepwise

from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.state import State
from bev_preheat.estimation.hypotheses import Heater, HeaterReport, SuspectedFault
from bev_preheat.messages.diagnostics import heater_entry, planner_diagnostics
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.csv_file import load_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S


def test_a_sensor_that_contradicts_the_standing_time_is_a_warning():
    supervisor = Stepwise(VEHICLE, Settings())
    supervisor.run(START_NS)
    supervisor.accept_mission(Mission('morning', (
        Leg(load_route('reference', VEHICLE.defaults), START_NS, True, 20.0),), standing_time_s=36_000.0))
    supervisor.accept_battery(Measurement(BatteryState(-2.0, 0.8), START_NS), START_NS)
    entry, = (status for status in planner_diagnostics(supervisor.state, START_NS)
              if status.name == 'estimation')
    values = values_of(entry)
    assert entry.level == DiagnosticStatus.WARN
    assert entry.message.startswith('battery_state.temperature was -2.0 degC after 10:00:00 h of ')
    assert 'check the sensor, and standing_time of route_plan' in entry.message
    assert re.fullmatch(r'-6\.\d\d \+- 1\.\d\d',
                        values['temperature expected after standing [degC]'])
    assert float(values['offset of the temperature sensor [K]']) > 1.0


@pytest.mark.parametrize('power_nats, as_likely', [(math.log(4.0), '4'), (None, 'power is not known')])
def test_a_suspected_heater_is_named_with_its_evidence(power_nats, as_likely):
    report = HeaterReport(Heater.ANSWERS, 0.2, 1.0, SuspectedFault(Heater.DEAD, 0.8, 0.0, 70.0, 1.5, power_nats))
    entry = heater_entry(report)
    values = values_of(entry)
    assert entry.level == DiagnosticStatus.OK
    assert entry.message.startswith('answers') and entry.message.endswith('; suspected: dead')
    assert values['suspected for [s]'] == '70' and values['times as likely by the power [1]'] == as_likely


@pytest.mark.parametrize('source, kind, message', [
    ('heat_pump', Heater.DEAD, 'dead: the battery does not get the commanded heat; it gets no command any more'),
    ('chiller', Heater.DEAD, 'dead: the battery is not cooled as commanded; it gets no command any more'),
    ('motor', Heater.STUCK_ON, 'stuck on: the battery is heated without a command'),
    ('chiller', Heater.STUCK_ON, 'stuck on: the battery is cooled without a command')])
def test_the_fault_of_a_heat_source_says_what_the_battery_gets(monkeypatch, source, kind, message):
    supervisor = Stepwise(load_vehicle('heat_pump_car'), Settings())
    supervisor.accept_battery(Measurement(BatteryState(-7.0, 0.8), START_NS), START_NS)
    reports = {**supervisor.state.source_reports, source: HeaterReport(kind, 0.999, 0.0)}
    monkeypatch.setattr(State, 'source_reports', reports)
    entries = {entry.name: entry.message for entry in planner_diagnostics(supervisor.state, START_NS)}
    assert entries.pop(f'heat source {source}') == message
    assert {told for name, told in entries.items() if name.startswith('heat')} == {'answers: responds normally'}


@pytest.mark.parametrize('cabin_w, warning', [
    (2000.0, ''), (50e3, ' route_plan: cabin_heating_power: 50000 W at min 0.0; the heater has 7000 W; '
                   'check the unit.')])
def test_a_wrong_unit_in_the_route_is_a_warning_and_no_refusal(cabin_w, warning):
    supervisor = Stepwise(VEHICLE, Settings())
    route = load_route('reference', VEHICLE.defaults)
    powers_w = route.cabin_heating_power_w.copy()
    # So briefly that the charge is still enough for the trip.
    powers_w[0] = cabin_w
    supervisor.accept_mission(Mission('home', (
        Leg(replace(route, cabin_heating_power_w=powers_w), START_NS, True, -10.0),)))
    supervisor.accept_battery(Measurement(BatteryState(-7.0, 0.8), START_NS), START_NS)
    entry = planner_diagnostics(supervisor.state, START_NS)[0]
    assert entry.level == (DiagnosticStatus.WARN if warning else DiagnosticStatus.OK)
    assert entry.message.startswith('NOT_NEEDED: ') and entry.message.endswith(warning)
    assert ('check the unit' in entry.message) is bool(warning)
