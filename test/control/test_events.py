# SPDX-License-Identifier: Apache-2.0
"""The effect of each event on the inbox, and of a refusal."""

from dataclasses import fields, replace
from typing import get_args

import pytest

from bev_preheat.control.decision import Command, Decision
from bev_preheat.control.events import (
    BatteryStateArrived,
    BatteryStateUnreadable,
    Event,
    PreheatingSwitched,
    Reconfigured,
    RivalsChanged,
    RouteArrived,
    RouteUnreadable,
    TripCancelled,
)
from bev_preheat.control.forecast_plan import ForecastPlan
from bev_preheat.control.inbox import Inbox, NO_CHANGES
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
NOW_NS = 1_700_000_000 * NS_PER_S
GOOD = Measurement(BatteryState(-7.0, 0.8), NOW_NS)
BAD = Measurement(BatteryState(-7.0, 2.0), NOW_NS)
PROBLEM = 'state of charge: 2 is not allowed; it must be 0 ... 1'
HINT = 'percentage must be 0 ... 1, not 0 ... 100'
ERROR = InvalidInput('speed[0]: -1 is not allowed')


def make_mission(route_id='home', target_c=25.0):
    return Mission(route_id, (Leg(make_route({
        'duration_s': [60.0] * 20, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
        'ambient_temperature_c': [-7.0], 'cabin_heating_power_w': [1500.0],
        'auxiliary_power_w': [400.0]}, VEHICLE.defaults), NOW_NS, True, target_c),))


@pytest.fixture
def inbox():
    inbox, _ = Inbox(VEHICLE, Settings()).taken(RouteArrived(make_mission()), NOW_NS)
    inbox, _ = inbox.taken(BatteryStateArrived(GOOD), NOW_NS)
    return inbox._replace(changes=NO_CHANGES)


def taken(inbox, event, now_ns=NOW_NS):
    """Return the inbox with an event that must not be refused."""
    inbox, refusal = inbox.taken(event, now_ns)
    assert refusal is None
    return inbox


def refused(inbox, event):
    """Return the inbox after an event that must be refused, and the problems."""
    inbox, refusal = inbox.taken(event, NOW_NS)
    return inbox, list(refusal.problems)


@pytest.mark.parametrize('kind', [*get_args(Event), Command, Decision,
                         ForecastPlan], ids=lambda kind: kind.__name__)
def test_what_was_handed_over_cannot_be_changed(kind):
    # Without __init__, which differs between classes.
    if issubclass(kind, tuple):
        names = [*kind.__annotations__]
        value = kind(*names)
    else:
        names, value = [field.name for field in fields(kind)], object.__new__(kind)
    with pytest.raises(AttributeError):
        setattr(value, next(iter(names), 'anything'), None)


@pytest.mark.parametrize('hint, problems', [('', [PROBLEM]), (HINT, [PROBLEM, HINT])])
def test_a_refused_battery_state_is_told_with_its_hint(inbox, hint, problems):
    inbox, problems_told = refused(inbox, BatteryStateArrived(BAD, hint))
    assert problems_told == problems
    assert inbox.refusals.obstacle == f'battery_state refused: {"; ".join(problems)}'
    assert inbox.measurement == GOOD


def test_a_valid_battery_state_needs_no_hint(inbox):
    later = replace(GOOD, stamp_ns=NOW_NS + 1)
    inbox = taken(inbox, BatteryStateArrived(later, HINT), NOW_NS + 1)
    assert (inbox.measurement, inbox.refusals.obstacle) == (later, None)


def test_an_unreadable_battery_state_holds_the_heater_off(inbox):
    inbox, problems_told = refused(inbox, BatteryStateUnreadable(ERROR))
    assert problems_told == list(ERROR.problems)
    assert inbox.refusals.obstacle == 'battery_state refused: speed[0]: -1 is not allowed'


def test_an_unreadable_route_of_which_nothing_is_known_drops_the_one_before(inbox):
    inbox, problems_told = refused(inbox, RouteUnreadable(ERROR))
    assert problems_told == list(ERROR.problems)
    assert inbox.mission is None
    assert inbox.refused_route.startswith('route_plan refused: speed[0]: -1 is not allowed')


def test_route_and_cancellation(inbox):
    other = make_mission('work')
    inbox = taken(inbox, RouteArrived(other))
    assert (inbox.mission, inbox.is_cancelled) == (other, False)
    inbox = taken(inbox, TripCancelled())
    assert (inbox.mission, inbox.is_cancelled) == (None, True)


@pytest.mark.parametrize('is_enabled', [False, True])
def test_the_drivers_switch_is_noted(inbox, is_enabled):
    inbox = taken(inbox, PreheatingSwitched(is_enabled))
    assert inbox.is_enabled is is_enabled


def test_rivals_are_noted(inbox):
    inbox = taken(inbox, RivalsChanged('other_planner'))
    assert inbox.rivals == 'other_planner'


def test_parameters_without_a_route_leave_it(inbox):
    mission, vehicle, settings = inbox.mission, load_vehicle('small_car'), Settings(lease_s=1.0)
    inbox = taken(inbox, Reconfigured(vehicle, settings))
    assert (inbox.vehicle, inbox.settings, inbox.mission) == (vehicle, settings, mission)
    assert not inbox.changes.has_new_mission


def test_parameters_with_a_route_replace_it_and_go_on_with_the_trip(inbox):
    revised = make_mission()
    inbox = taken(inbox, Reconfigured(VEHICLE, Settings(), revised))
    changes = inbox.changes
    assert (inbox.mission, changes.has_new_mission, changes.has_new_trip) == (revised, True, False)


@pytest.mark.parametrize('misfit, problem', [
    (ERROR, 'speed[0]: -1 is not allowed'),
    (make_mission(target_c=99.0), 'target battery temperature: 99 is not allowed')],
    ids=['unreadable', 'beyond the model'])
def test_a_route_that_does_not_fit_new_parameters_is_dropped_but_not_forgotten(inbox, misfit, problem):
    before = inbox.mission
    settings = Settings(lease_s=1.0)
    inbox, problems = refused(inbox, Reconfigured(VEHICLE, settings, misfit))
    assert problems[0].startswith(problem)
    assert (inbox.mission, inbox.settings) == (None, settings)
    # It may fit the next parameters.
    assert inbox.latest_mission is (before if misfit is ERROR else misfit)
    assert problem in inbox.refusals.obstacle
