# SPDX-License-Identifier: Apache-2.0
"""Switching of the heater by a supervisor with intermittently invalid inputs."""

from dataclasses import replace
from itertools import pairwise
import random
from random import Random

import pytest
from steady_drives import NOW_NS, ns, steady_mission, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.events import (
    BatteryStateArrived,
    BatteryStateUnreadable,
    PreheatingSwitched,
    RivalsChanged,
    RouteArrived,
    RouteUnreadable,
    TripCancelled,
)
from bev_preheat.control.inputs import Measurement
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.signal_checks import FEED
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.tunables import MOST_SWITCH_ONS

SETTINGS = Settings(estimation=False)
UNREADABLE = InvalidInput('temperature: nan is not allowed')


def mission(minutes=90, target_c=60.0, ambient_c=-20.0, route_id='home', start_ns=NOW_NS):
    """A trip that heats from start to end, because 60 degC is never reached."""
    return steady_mission(
        route_id, duration_s=60.0 * minutes, speed_mps=[30.0], propulsion_power_w=[10e3],
        ambient_temperature_c=[ambient_c], start_ns=start_ns, target_temperature_c=target_c)


class Car:
    """Passes inputs to a Stepwise, and counts switch-ons; instants in seconds from the start."""

    def __init__(self, settings=SETTINGS, temperature_c=-10.0, **trip):
        self.planner, self.temperature_c = Stepwise(VEHICLE, settings), temperature_c
        self.commands, self.powers_w, self.switch_ons_s = [], [], []
        self.give(0.0, RouteArrived(mission(**trip)))

    def state(self, at_s, stamp_s=None):
        stamp_s = at_s if stamp_s is None else stamp_s
        # A charge that stayed would be that of a parked car.
        return BatteryStateArrived(Measurement(
            BatteryState(self.temperature_c, 0.8 - 6e-5 * at_s), NOW_NS + ns(stamp_s)))

    def give(self, at_s, *events):
        self.planner.step_through(NOW_NS + ns(at_s), *events)
        output = self.planner.output
        assert not output.failure
        if output.command is not None:
            power_w = output.command.battery_heating_power_w
            if power_w > 0.0 and not (self.powers_w and self.powers_w[-1] > 0.0):
                self.switch_ons_s.append(at_s)
            self.powers_w.append(power_w)
            self.commands.append((at_s, output.command))

    @property
    def reason(self):
        return self.planner.state.latest_command.reason


@pytest.mark.parametrize('doubt, reason, words', [
    (RivalsChanged('/other'), Status.COMMAND_CONFLICT, 'Another node commanded the heater'),
    (BatteryStateUnreadable(UNREADABLE), Status.INVALID_INPUT, 'battery_state was refused'),
    (RouteUnreadable(UNREADABLE), Status.INVALID_INPUT, 'route_plan was refused')])
def test_other_doubts_make_it_wait_too(doubt, reason, words):
    car = Car()
    car.give(1.0, car.state(1.0))
    assert car.powers_w[-1] > 0.0
    car.give(2.0, doubt)
    for second in range(3, 16):
        car.give(second, RivalsChanged(''), RouteArrived(mission()), car.state(second))
        if second == 5:
            assert car.reason is reason and car.planner.state.decision.explanation.startswith(words)
    assert car.switch_ons_s == [1.0, pytest.approx(12.0, abs=1.1)]


def test_what_does_not_want_heat_does_not_wait_for_the_end_of_a_pause():
    car = Car(target_c=25.0, minutes=10)
    for second, temperature_c, reason in (
            (1, -10.0, Status.TARGET_UNREACHABLE), (3, -10.0, Status.INVALID_INPUT), (4, 26.0, Status.WAITING)):
        car.temperature_c = temperature_c
        if second == 3:
            car.give(2.0, BatteryStateUnreadable(UNREADABLE))
        car.give(second, car.state(second))
        assert car.reason is reason


@pytest.mark.parametrize('every_s, timeout_s, doubted', [
    (10.0, 5.0, True), (4.0, 5.0, False), (10.0, 15.0, False)])
def test_a_feed_slower_than_the_timeout_does_not_relay(every_s, timeout_s, doubted):
    car = Car(replace(SETTINGS, battery_state_timeout_s=timeout_s))
    for second in range(1200):
        car.give(second, *([car.state(second)] if second % every_s == 0 else []))
    verdicts = [verdict for verdict in car.planner.state.signal_verdicts if verdict.signal == FEED]
    assert len(car.switch_ons_s) == 1
    assert (car.powers_w[-1] == 0.0, len(verdicts)) == (doubted, doubted)
    if doubted:
        words = 'battery_state arrives every 10.0 s; battery_state_timeout is 5 s: raise it'
        assert words in verdicts[0].sentence
        assert words in car.planner.state.decision.explanation
        # Once it is steady, heating continues.
        for second in range(1200, 1230):
            car.give(second, car.state(second))
        assert (car.planner.state.signal_verdicts, car.powers_w[-1] > 0.0) == ((), True)


# The least time on

def held_car(temperature_c, target_c):
    """Return a car that starts heating at once and is this warm [deg C] 3 s later; ambient is warm, too."""
    car = Car(temperature_c=target_c - 10.0, target_c=target_c, minutes=10, ambient_c=25.0)
    for second in range(3):
        car.give(second, car.state(second))
    assert car.powers_w[-1] > 0.0
    car.temperature_c = temperature_c
    car.give(3.0, car.state(3.0))
    return car


@pytest.mark.parametrize('above_k', [0.1, 0.9])
def test_within_its_least_time_on_the_heater_says_that_it_is_held(above_k):
    car = held_car(25.0 + above_k, 25.0)
    assert (car.powers_w[-1] > 0.0, car.reason, car.planner.state.decision.status) == (
        True, Status.HEATING, Status.HEATING)
    assert car.planner.state.decision.explanation.startswith(
        'The heater stays on for its minimum time, 17 s more: arrival at ')
    for second in range(4, 22):
        car.give(second, car.state(second))
    assert (car.powers_w[-1], car.reason) == (0.0, Status.NOT_NEEDED)
    assert car.planner.state.decision.status is Status.NOT_NEEDED


@pytest.mark.parametrize('temperature_c, target_c', [
    # Above the target by more than 1 K; nearer than 3 K to the 60 degC of the range.
    (26.1, 25.0), (33.0, 25.0), (60.0, 50.0), (57.1, 56.5)])
def test_the_least_time_on_does_not_outrank_limit_and_target(temperature_c, target_c):
    car = held_car(temperature_c, target_c)
    assert car.powers_w[-1] == 0.0
    assert car.reason is car.planner.state.decision.status
    assert car.reason in (Status.NOT_NEEDED, Status.WAITING)
    # The least time off holds.
    car.temperature_c = target_c - 10.0
    for second in range(4, 122):
        car.give(second, car.state(second))
    assert car.powers_w[-1] == 0.0
    car.give(124.0, car.state(124.0))
    assert car.powers_w[-1] > 0.0


def random_event(seeded, car, at_s):
    what = seeded.choice(('state',) * 12 + (
        'nan', 'late', 'overtaken', 'cancel', 'route', 'route', 'bad route', 'no', 'yes', 'rival', 'alone',
        'nothing'))
    state = Measurement(BatteryState(car.temperature_c, 0.8), NOW_NS + ns(at_s))
    return {
        'state': BatteryStateArrived(state), 'nan': BatteryStateUnreadable(UNREADABLE),
        'late': BatteryStateArrived(replace(state, stamp_ns=state.stamp_ns - ns(30.0))),
        'overtaken': BatteryStateArrived(replace(state, stamp_ns=state.stamp_ns - ns(0.7))),
        'cancel': TripCancelled(), 'route': RouteArrived(mission(route_id=f'{seeded.random()}')),
        'bad route': RouteUnreadable(UNREADABLE), 'no': PreheatingSwitched(False), 'yes': PreheatingSwitched(True),
        'rival': RivalsChanged('/other'), 'alone': RivalsChanged(''),
        'nothing': None}[what]


@pytest.mark.costly
@pytest.mark.parametrize('share, seed', [
    (1.0, 2), *(pytest.param(share, seed, marks=pytest.mark.deep)
                for share in (0.02, 0.2, 1.0) for seed in (0, *range(3, 9)))])
def test_attacks_never_switch_on_more_often_than_stated(share, seed):
    seeded, car, at_s = random.Random(seed), Car(), 0.0
    for _ in range(3000):
        at_s += seeded.choice((0.1, 1.0, 1.0, 3.0))
        events = [car.state(at_s)] if seeded.random() >= share else filter(
            None, [random_event(seeded, car, at_s), PreheatingSwitched(True), RivalsChanged('')])
        car.give(at_s, *events)
    for first_s, beyond_s in zip(car.switch_ons_s, car.switch_ons_s[MOST_SWITCH_ONS:]):
        assert beyond_s - first_s >= 3600.0
    # Without ~/enable and new routes even fewer.
    assert len(car.switch_ons_s) <= 1 + MOST_SWITCH_ONS * (1 + int(at_s // 3600.0))


TIMEOUT_S, PHASE_S = 5.0, 0.37


def commands(stamp_s, seconds, period_s=1.0, silent_after_s=1e9):
    """
    Return [(instant [s], Command)] of a drive of some seconds.

    A state arrives every `period_s` [s] with the stamp `stamp_s(instant)`, until the feed ends; the command is
    repeated just before each state, where stamps are oldest.
    """
    car, at_s = Car(Settings(battery_state_timeout_s=TIMEOUT_S)), PHASE_S
    while at_s < seconds:
        car.give(at_s - 0.001)
        if at_s < silent_after_s:
            car.temperature_c += 0.01 * period_s
            car.give(at_s, car.state(at_s, stamp_s(at_s)))
        at_s += period_s
    return car.commands


def until_s(command):
    """Return the end of a command's lease [s]."""
    return (command.valid_until_ns - NOW_NS) / NS_PER_S


def of_step(step_s):
    return lambda at_s: at_s // step_s * step_s


def late_by(late_s):
    return lambda at_s: at_s - late_s


def jittering(most_s):
    seeded = Random(7)
    return lambda at_s: at_s - seeded.uniform(0.0, most_s)


@pytest.mark.parametrize('stamp_s, period_s', [
    (of_step(1.0), 1.0), (of_step(2.0), 1.0), (of_step(5.0), 1.0), (of_step(5.0), 0.25), (late_by(4.0), 1.0),
    (late_by(4.9), 1.0), (jittering(4.0), 1.0), (jittering(4.0), 0.25)],
    ids=['steps of 1 s', '2 s', '5 s', '5 s at 4 Hz', '4 s late', '4.9 s late', 'jitter', 'jitter at 4 Hz'])
def test_coarse_late_or_jittering_stamps_within_the_limit_do_not_interrupt_heating(stamp_s, period_s):
    # From the first state on.
    given = commands(stamp_s, 40.0, period_s)[3:]
    assert all(command.total_w > 0.0 for _, command in given)
    # The lease never ends before the next command.
    assert all(until_s(command) > next_s for (_, command), (next_s, _) in pairwise(given))


@pytest.mark.parametrize('stamp_s, most_s', [
    (late_by(0.0), TIMEOUT_S), (late_by(2.0), 3.0), (of_step(5.0), TIMEOUT_S), (late_by(4.9), 2.0)],
    ids=['fresh', '2 s late', 'steps of 5 s', '4.9 s late'])
def test_heat_ends_with_the_feed(stamp_s, most_s):
    """After the last state the lease ends with its age limit, and 2 s after a state that came near the limit."""
    silent_after_s = 30.0
    given = commands(stamp_s, 60.0, silent_after_s=silent_after_s)
    last_s = max(at_s for at_s, _ in given if at_s < silent_after_s)
    assert max(until_s(command) for _, command in given if command.total_w > 0.0) <= last_s + most_s + 1e-6
    assert {command.total_w for at_s, command in given if at_s >= last_s + most_s} == {0.0}
    assert given[-1][1].reason is Status.STALE_INPUT


def test_jitter_does_not_hide_a_second_battery():
    seeded, supervisor = Random(3), Supervisor(VEHICLE, Settings(battery_state_timeout_s=TIMEOUT_S))
    refused = 0
    for second in range(60):
        now_ns = NOW_NS + second * NS_PER_S
        # The second battery's clock is 3 s behind, so that its states look overtaken.
        for late_s, temperature_c in ((0.0, -7.0), (3.0, 18.0)):
            output = supervisor.step(now_ns, BatteryStateArrived(Measurement(
                BatteryState(temperature_c + seeded.uniform(-0.2, 0.2), 0.8), now_ns - round(late_s * NS_PER_S))))
            refused += bool(output.refusals)
    assert refused >= 59
