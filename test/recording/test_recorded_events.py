# SPDX-License-Identifier: Apache-2.0
"""Every event of the planner's step can be recorded."""

from dataclasses import asdict
from datetime import time
import json

import pytest

from bev_preheat.control import events
from bev_preheat.control.departures import DailyPrice, GridPrices, PricePeriod, zone_of
from bev_preheat.control.events import PreparationEnded, PreparationWanted, Reconfigured, RouteUnreadable
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.inputs import INPUTS
from bev_preheat.recording.records import event_of, event_values, GoalNumbers, PLAIN_EVENTS


def test_no_event_is_left_out():
    every = {each for each in vars(events).values()
             if isinstance(each, type) and issubclass(each, events.Event)} - {events.Event}
    of_messages = {event for event in every if event.source in INPUTS} - {Reconfigured}
    others = {*PLAIN_EVENTS.values(), PreparationWanted, PreparationEnded, Reconfigured}
    assert every == of_messages | others
    # Each topic has an event for a message that can be read, and one for a message that cannot.
    assert {event.source for event in of_messages} == set(INPUTS)
    assert all(sum(event.source == topic for event in of_messages) >= 2 for topic in INPUTS)


def test_goals_are_told_apart_by_number():
    """Two goals with the same wishes are two goals, and an end names one of them."""
    written, read = GoalNumbers(), GoalNumbers()
    goals = [PreparationGoal(10**18, 20.0, is_plugged_in=True) for _ in range(2)]
    back = [event_of(event_values(PreparationWanted(goal), written, False), read).preparation_goal
            for goal in goals]
    assert [asdict(goal) for goal in back] == [asdict(goal) for goal in goals]
    end = event_of(event_values(PreparationEnded(goals[1], PreparationEnding.CANCELED, 'x'), written, False), read)
    assert end.preparation_goal is back[1]
    with pytest.raises(InvalidInput, match='its beginning is missing'):
        event_of({'kind': 'PreparationEnded', 'goal': 7, 'ending': 3, 'explanation': ''}, read)


@pytest.mark.parametrize('zone', ['UTC', 'Europe/Berlin'])
def test_the_prices_of_a_departure_come_back(zone):
    prices = GridPrices(zone_of(zone), (DailyPrice(time(22, 5), 0.18), DailyPrice(time(6), -0.34)),
                        (PricePeriod(10**18, 2 * 10**18, None),), 'EUR')
    goal = PreparationGoal(10**18, is_plugged_in=True, prices=prices)
    values = json.loads(json.dumps(event_values(PreparationWanted(goal), GoalNumbers(), False)))
    assert event_of(values, GoalNumbers()).preparation_goal.prices == prices


def test_a_refused_route_without_a_message_keeps_its_reason():
    event = RouteUnreadable(InvalidInput('too long'))
    back = event_of(event_values(event, GoalNumbers(), has_message=False), GoalNumbers())
    assert str(back.error) == 'too long'


@pytest.mark.parametrize('values', [{}, {'kind': 'Other'}, {'kind': 'RivalsChanged'},
                                    {'kind': 'PreparationEnded', 'goal': 1}])
def test_an_event_that_is_damaged_or_of_another_version_is_named(values):
    with pytest.raises(InvalidInput, match='of the recording|damaged'):
        event_of(values, GoalNumbers())
