# SPDX-License-Identifier: Apache-2.0
"""HeatSourceStatus at the door: each source answers for itself, within its power."""

import math

import pytest

from bev_preheat.control.events import SourceStatusArrived, SourceStatusUnreadable
from bev_preheat.messages.heater import source_status_event
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HeatSourceStatus

CAR = load_vehicle('heat_pump_car')


def event_of(**fields):
    message = HeatSourceStatus(**fields)
    message.header.stamp.sec = 1_700_000_000
    return source_status_event(message, CAR)


@pytest.mark.parametrize('fields, problem', [
    ({'name': ''}, "heat source '' is not in vehicle heat_pump_car"),
    ({'name': 'fridge'}, "heat source 'fridge' is not in vehicle heat_pump_car"),
    ({'name': 'hvch'}, 'name: hvch is not allowed; its controller answers with hvch_status'),
    ({'name': 'heat_pump', 'requested_power': math.nan}, 'requested_power: nan W is not allowed'),
    ({'name': 'heat_pump', 'requested_power': 9e3}, 'it must be 0 ... 2500 W')])
def test_an_answer_of_no_source_or_beyond_its_power_is_refused(fields, problem):
    event = event_of(**fields)
    assert isinstance(event, SourceStatusUnreadable) and problem in str(event.error)


def test_the_answer_of_a_source_has_its_name():
    event = event_of(name='heat_pump', requested_power=2000.0, active_power=1500.0)
    assert isinstance(event, SourceStatusArrived)
    assert (event.name, event.status.active_w) == ('heat_pump', 1500.0)
