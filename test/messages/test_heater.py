# SPDX-License-Identifier: Apache-2.0
"""HeatSourceStatus at the door: each source answers for itself, within its power."""

import math

import pytest
import yaml

from bev_preheat.control.events import SourceStatusArrived, SourceStatusUnreadable
from bev_preheat.control.heater import FAULTS, IN_WORDS
from bev_preheat.estimation.hypotheses import Heater, HEATERS
from bev_preheat.messages.diagnostics import HEATER_LEVELS, HEATER_SENTENCES
from bev_preheat.messages.heater import source_status_event
from bev_preheat.simulation.scenario import SCHEMA
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


def test_each_verdict_on_the_heater_has_its_words():
    assert set(HEATERS) == HEATER_LEVELS.keys() == HEATER_SENTENCES.keys() == set(Heater)
    assert FAULTS.keys() == IN_WORDS.keys() == set(Heater) - {Heater.ANSWERS}
    expected = yaml.safe_load(SCHEMA.read_text())['definitions']['expect']['properties']
    assert expected['heater']['enum'] == [each.value for each in Heater]
