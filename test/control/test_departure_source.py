# SPDX-License-Identifier: Apache-2.0
"""A week's departures as goals of a planner: priorities, evidence, clocks, restarts and skips."""

from datetime import datetime, time
from math import log
from zoneinfo import ZoneInfo

import pytest
from steady_drives import steady_leg, VEHICLE

from bev_preheat.control.departure_source import DepartureSource, DepartureState
from bev_preheat.control.departures import DailyPrice, Departure, Departures, GridPrices
from bev_preheat.control.events import (
    BatteryStateArrived,
    PreheatingSwitched,
    PreparationEnded,
    PreparationWanted,
    RouteArrived,
    TripCancelled,
)
from bev_preheat.control.inputs import Measurement, Mission
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState

ZONE = ZoneInfo('Europe/Berlin')
AMBIENT_C, START_C, TARGET_C = -6.0, -2.0, 17.0
FULL_W = VEHICLE.hvch.maximum_power_w - VEHICLE.defaults.cabin_heating_power_w
MINUTE, HOUR = 60.0, 3600.0
VOLTAGE_V = 400.0


def ns(year, month, day, hour, minute=0):
    return round(datetime(year, month, day, hour, minute, tzinfo=ZONE).timestamp()) * NS_PER_S


# A Wednesday.
NIGHT = 2026, 11, 25
READY_NS = ns(*NIGHT, 7, 30)


def work(target_c=TARGET_C, most_c=None):
    return Departure('work', frozenset(range(5)), time(7, 30), target_c, True, most_c)


def week(*departures, ambient_c=AMBIENT_C):
    return Departures(ZONE, departures or (work(),), ambient_c)


class Car:
    """A planner with a week of departures, and a battery whose measured state is set by the test."""

    def __init__(self, departures=None, prices=None, now_ns=READY_NS - round(3 * HOUR * NS_PER_S),
                 last_seen_ns=None, **settings):
        self.supervisor = Supervisor(VEHICLE, Settings(**{'estimation': False, **settings}))
        self.source = DepartureSource(departures or week(), prices, last_seen_ns)
        self.now_ns, self.temperature_c, self.soc, self.power_w = now_ns, START_C, 0.7, None
        self.outcomes, self.events = [], []

    def step(self, *events):
        output = self.supervisor.step(self.now_ns, *events)
        assert not output.failure, output.failure
        for outcome in output.outcomes:
            self.outcomes.append(outcome)
            self.source = self.source.noted(outcome, self.supervisor.state, self.now_ns)
        return output

    def tick(self, **changes):
        """Send a battery state, then let the departures act, as the node does; return the command's power [W]."""
        for name, value in changes.items():
            setattr(self, name, value)
        current = () if self.power_w is None else (VOLTAGE_V, self.power_w / VOLTAGE_V)
        self.step(BatteryStateArrived(Measurement(
            BatteryState(self.temperature_c, self.soc), self.now_ns, *current)))
        return self.act()

    def act(self):
        self.source, events = self.source.events(self.supervisor.state, self.now_ns)
        self.events += events
        return self.step(*events).command.battery_heating_power_w

    def go(self, seconds, each_s=30.0, **changes):
        """Let time pass; return the powers [W] of all ticks."""
        powers_w = []
        end_ns = self.now_ns + round(seconds * NS_PER_S)
        while self.now_ns < end_ns:
            self.now_ns = min(self.now_ns + round(each_s * NS_PER_S), end_ns)
            powers_w.append(self.tick(**changes))
        return powers_w

    @property
    def state(self):
        return self.source.state

    @property
    def goal(self):
        return self.supervisor.state.preparation_goal


def test_a_departure_is_prepared_and_heated_at_the_latest_that_is_early_enough():
    car = Car()
    car.tick()
    assert (car.goal.ready_at_ns, car.goal.target_c, car.goal.is_plugged_in) == (READY_NS, TARGET_C, True)
    assert car.state is DepartureState.PREPARING and car.goal.prices is None
    battery, leakage = VEHICLE.battery, VEHICLE.battery.leakage.gamma_0_w_per_k
    heated_c = AMBIENT_C + VEHICLE.hvch.efficiency * FULL_W / leakage
    tau_s = battery.heat_capacity_j_per_k / leakage
    # Measured at START_C all the time, so full power from then on reaches the target at the departure.
    needs_s = tau_s * log((heated_c - START_C) / (heated_c - TARGET_C))
    powers_w = car.go(3 * HOUR - needs_s - MINUTE, 600.0)
    assert not any(powers_w)
    assert car.go(2 * MINUTE)[-1] == pytest.approx(FULL_W)
    car.go((READY_NS - car.now_ns) / NS_PER_S, temperature_c=TARGET_C)
    [outcome] = car.outcomes
    assert outcome.ending is PreparationEnding.REACHED
    # The next one is tomorrow's.
    car.go(MINUTE)
    assert car.goal is None and car.state is DepartureState.LATER
    assert car.source.following.instant_ns == ns(2026, 11, 26, 7, 30)
    assert 'work, Wed 2026-11-25 07:30 CET: REACHED' in car.source.latest


def test_nothing_happens_until_its_window():
    car = Car(now_ns=READY_NS - round((6 * HOUR + MINUTE) * NS_PER_S))
    car.tick()
    assert car.goal is None and car.state is DepartureState.LATER
    assert car.source.reason == 'its preparation may begin in 1:00 min'
    car.go(2 * MINUTE)
    assert car.goal is not None


def test_a_goal_sent_by_hand_has_priority_and_the_departure_follows_it():
    car = Car()
    car.tick()
    by_hand = PreparationGoal(car.now_ns + round(HOUR * NS_PER_S), 11.0, False, AMBIENT_C)
    car.step(PreparationWanted(by_hand))
    assert car.outcomes[-1].ending is PreparationEnding.REPLACED
    car.go(MINUTE)
    assert car.goal is by_hand and car.state is DepartureState.HELD_OFF
    assert car.source.reason == 'another goal of prepare_battery is active'
    car.go(HOUR, 600.0)
    car.go(MINUTE)
    assert car.goal is not by_hand and car.goal.ready_at_ns == READY_NS


def mission(start_ns):
    return Mission('to the charger', (steady_leg(1800.0, start_ns=start_ns, ambient_temperature_c=[-3.0],
                                                 target_temperature_c=24.0),))


@pytest.mark.parametrize('event, power_w, words, opposite, lasts_s', [
    (RouteArrived(mission(READY_NS - round(3 * HOUR * NS_PER_S))), None,
     "'to the charger' drives before the departure", TripCancelled(), MINUTE),
    # 12 kW for the five minutes that the memory covers.
    (None, 12e3, 'the vehicle drives: the battery gives', None, 6 * MINUTE),
    (PreheatingSwitched(False), None, 'switched off', PreheatingSwitched(True), MINUTE)],
    ids=['route', 'drive', 'driver'])
def test_what_outranks_a_departure_holds_its_preparation_off_until_it_is_over(
        event, power_w, words, opposite, lasts_s):
    car = Car()
    car.tick()
    car.step(*filter(None, [event]))
    car.go(5 * MINUTE, power_w=power_w)
    assert car.goal is None and car.state is DepartureState.HELD_OFF
    assert words in car.source.reason
    car.step(*filter(None, [opposite]))
    car.go(lasts_s, power_w=0.0)
    # The grid is still believed in.
    assert car.goal is not None and car.goal.is_plugged_in


def test_the_route_of_the_departure_itself_does_not_stop_its_preparation():
    car = Car()
    car.step(RouteArrived(mission(READY_NS)))
    car.tick()
    assert car.goal.ready_at_ns == READY_NS
    car.go(3 * HOUR, 600.0)
    assert car.goal is None and car.supervisor.state.active_mission.route_id == 'to the charger'


def test_a_charge_that_falls_outranks_the_file_until_the_vehicle_is_charged_again():
    car = Car()
    car.tick()
    car.go(MINUTE, soc=0.67)
    assert car.outcomes[-1].ending is PreparationEnding.UNPLUGGED
    assert car.goal is not None and not car.goal.is_plugged_in
    assert not car.source.is_plugged_in and 'the charge has fallen' in car.source.reason
    car.go(MINUTE, soc=0.70)
    assert car.goal.is_plugged_in and car.source.is_plugged_in


def test_without_any_ambient_temperature_it_is_off_and_says_why():
    car = Car(week(ambient_c=None))
    car.tick()
    assert car.outcomes[-1].ending is PreparationEnding.REFUSED and car.goal is None
    assert 'ambient_temperature: is not given' in car.source.reason
    # It is not asked for with each tick.
    car.go(4 * MINUTE)
    assert len(car.outcomes) == 1
    car.go(2 * MINUTE)
    assert len(car.outcomes) == 2


# Calendar and clock


def test_a_departure_that_passed_while_the_planner_was_down_is_reported_and_never_heated():
    car = Car(now_ns=READY_NS + round(MINUTE * NS_PER_S), last_seen_ns=READY_NS - round(HOUR * NS_PER_S))
    assert car.tick() == 0.0 and car.goal is None
    assert car.source.latest == (
        'work, Wed 2026-11-25 07:30 CET: not prepared: the planner was not running.')


def test_a_clock_that_is_set_back_or_forward_leads_to_the_departure_of_the_new_time():
    car = Car()
    car.tick()
    car.now_ns -= round(24 * HOUR * NS_PER_S)
    car.tick()
    car.go(6 * MINUTE)
    assert car.goal.ready_at_ns == ns(2026, 11, 24, 7, 30)
    assert any(outcome.ending is PreparationEnding.INPUT_LOST and 'set back' in outcome.explanation
               for outcome in car.outcomes)
    # Forward beyond the departure: it has passed.
    car.now_ns = READY_NS + round(HOUR * NS_PER_S)
    car.tick()
    car.tick()
    assert car.goal is None and car.source.following.instant_ns == ns(2026, 11, 26, 7, 30)


def test_a_clock_that_was_never_set_prepares_nothing():
    car = Car(now_ns=3600 * NS_PER_S)
    assert car.tick() == 0.0 and car.goal is None
    assert 'before 2020' in car.source.reason and car.source.following is None


def test_a_skip_by_a_wrong_clock_does_not_last_for_years():
    car = Car(now_ns=ns(2040, 1, 4, 6))
    car.tick()
    event, _ = car.source.skip_next(car.supervisor.state, car.now_ns)
    car.step(event)
    car.now_ns = READY_NS - round(HOUR * NS_PER_S)
    car.tick()
    car.go(6 * MINUTE)
    assert car.goal.ready_at_ns == READY_NS


def test_without_departures_there_is_nothing_to_skip():
    car = Car(Departures(ZONE, ()))
    car.tick()
    assert car.source.skip_next(car.supervisor.state, car.now_ns)[0] is None
    assert car.state is DepartureState.NONE


def test_another_file_replaces_the_goal_without_a_pause():
    car = Car(now_ns=READY_NS - round(10 * MINUTE * NS_PER_S))
    assert car.tick() == pytest.approx(FULL_W)
    for target_c, most_c in (23.0, None), (23.0, 36.0):
        car.source = car.source.using(week(work(target_c=target_c, most_c=most_c)), None)
        assert car.act() == pytest.approx(FULL_W)
        assert (car.goal.target_c, car.goal.maximum_arrival_temperature_c) == (target_c, most_c)
    assert not any(isinstance(event, PreparationEnded) for event in car.events)


def test_with_prices_it_heats_in_the_cheap_hours():
    # 5 ct until 06:30, then 50 ct: heating early leaks, but costs less.
    car = Car(prices=GridPrices(ZONE, (DailyPrice(time(0), 0.05), DailyPrice(time(6, 30), 0.5))))
    assert car.tick() == 0.0
    assert car.go(3 * HOUR - 65 * MINUTE, 1800.0)[-1] == pytest.approx(FULL_W)
    # What leaks until the departure is heated before, too.
    assert car.go(10 * MINUTE, temperature_c=TARGET_C + 2.5)[-1] == 0.0
    assert car.go(55 * MINUTE, 1800.0, temperature_c=TARGET_C)[-1] == 0.0
    assert car.outcomes[-1].ending is PreparationEnding.REACHED
