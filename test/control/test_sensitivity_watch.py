# SPDX-License-Identifier: Apache-2.0
"""The sensitivity of the planner's current plan: as found at once, in parts, once a minute."""

import re

import pytest
from stepwise import Stepwise

from bev_preheat.control.events import PreheatingSwitched
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.sensitivity_watch import SensitivityWatch
from bev_preheat.control.settings import Settings
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning import sensitivity as module
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.sensitivity import find_sensitivity
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
ROUTE = load_route('reference', VEHICLE.defaults)
START_NS, STATE = 1_700_000_000 * NS_PER_S, BatteryState(-7.0, 0.8)
ENOUGH_LOOKS = 40


def planning(estimation=False, charging_planned=True, state=STATE):
    """Return a planner after a route and a battery state."""
    supervisor = Stepwise(VEHICLE, Settings(estimation=estimation))
    supervisor.run(START_NS)
    supervisor.accept_mission(Mission('home', (Leg(ROUTE, START_NS, charging_planned, 25.0),)))
    supervisor.accept_battery(Measurement(state, START_NS), START_NS)
    return supervisor


def looked(watch, supervisor, from_s=0.0, looks=ENOUGH_LOOKS):
    """Return the sentences at each look, two a second."""
    return [watch.look(supervisor.state, START_NS + round((from_s + 0.5 * number) * NS_PER_S))
            for number in range(looks)]


def at_once(state=STATE, heat_lag_s=0.0):
    inputs = VEHICLE, ROUTE, state, Goal(25.0)
    return find_sensitivity(
        *inputs, plan_preheating(*inputs, heat_lag_s=heat_lag_s), heat_lag_s).in_words()


@pytest.fixture
def plans(monkeypatch):
    """Give the list of all further plans."""
    made = []

    def counted(*arguments, **options):
        made.append(1)
        return plan_preheating(*arguments, **options)

    monkeypatch.setattr(module, 'plan_preheating', counted)
    return made


def test_it_is_that_of_the_plan():
    texts = looked(SensitivityWatch(), planning())
    assert (texts[0], texts[-1]) == ('', at_once())


def test_with_estimation_it_is_that_of_the_estimated_state():
    supervisor = planning(estimation=True)
    text = looked(SensitivityWatch(), supervisor)[-1]
    # The factors of the car are those of its file until they are learned.
    lag_s = supervisor.state.estimate.heat_lag_s
    figures, expected = (list(map(float, re.findall(r'-?\d+\.\d+', each)))
                         for each in (text, at_once(heat_lag_s=lag_s)))
    assert lag_s > 0.0 and figures == pytest.approx(expected, abs=0.15, rel=2e-3)


def test_each_look_makes_one_plan_at_most_and_a_search_begins_once_a_minute(plans):
    warmer = BatteryState(-2.0, 0.8)
    expected, later = at_once(), at_once(warmer)
    watch, supervisor, before = SensitivityWatch(), planning(), len(plans)
    first = before
    for number in range(ENOUGH_LOOKS):
        looked(watch, supervisor, 0.5 * number, looks=1)
        assert len(plans) - before <= 1
        before = len(plans)
    # Nothing more is planned until the minute is over; the sentences stay.
    assert set(looked(watch, supervisor, 0.5 * ENOUGH_LOOKS, 119 - ENOUGH_LOOKS)) == {expected}
    assert len(plans) == before > first + 10
    supervisor.accept_battery(Measurement(warmer, START_NS), START_NS)
    assert looked(watch, supervisor, 60.0)[-1] == later
    assert len(plans) > before


def test_another_trip_begins_at_once():
    watch, supervisor = SensitivityWatch(), planning()
    assert looked(watch, supervisor)[-1]
    supervisor.accept_mission(Mission('another', (Leg(ROUTE, START_NS, True, 10.0),)))
    supervisor.accept_battery(Measurement(STATE, START_NS), START_NS)
    texts = looked(watch, supervisor, 20.0)
    assert texts[0] == '' and texts[-1] not in ('', at_once())


def test_without_a_plan_or_a_target_nothing_is_said(plans):
    assert set(looked(SensitivityWatch(), planning(charging_planned=False))) == {''}
    watch, supervisor = SensitivityWatch(), planning()
    assert looked(watch, supervisor)[-1]
    before = len(plans)
    supervisor.run(START_NS, PreheatingSwitched(False))
    assert set(looked(watch, supervisor, 120.0)) == {''} and len(plans) == before
