# SPDX-License-Identifier: Apache-2.0
"""Stamps of battery states that are coarse, late or jitter, and states that are stale."""

from random import Random

import pytest

from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S
# 20 min in the cold towards a target that needs heat all the way.
COLUMNS = {'duration_s': [60.0] * 20, 'speed_mps': [25.0], 'propulsion_power_w': [15e3],
           'ambient_temperature_c': [-7.0], 'cabin_heating_power_w': [0.0], 'auxiliary_power_w': [400.0]}
TIMEOUT_S, PHASE_S = 5.0, 0.37


def commands(stamp_s, seconds, period_s=1.0, silent_after_s=1e9):
    """
    Return [(instant [s], power [W], end of the lease [s], reason)] of a drive of some seconds.

    A state arrives every `period_s` [s] with the stamp `stamp_s(instant)`, until the feed ends; the command is
    repeated just before each state, where stamps are oldest.
    """
    supervisor, given = Supervisor(VEHICLE, Settings(battery_state_timeout_s=TIMEOUT_S)), []

    def step(at_s, *events):
        command = supervisor.step(START_NS + round(at_s * NS_PER_S), *events).command
        given.append((at_s, command.battery_heating_power_w, (command.valid_until_ns - START_NS) / NS_PER_S,
                      command.reason))

    leg = Leg(make_route(COLUMNS, VEHICLE.defaults), START_NS, True, 25.0)
    supervisor.step(START_NS, RouteArrived(Mission('home', (leg,))))
    at_s, temperature_c = PHASE_S, -7.0
    while at_s < seconds:
        step(at_s - 0.001)
        if at_s < silent_after_s:
            temperature_c += 0.01 * period_s
            step(at_s, BatteryStateArrived(Measurement(
                BatteryState(temperature_c, 0.8), START_NS + round(stamp_s(at_s) * NS_PER_S))))
        at_s += period_s
    return given


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
    given = commands(stamp_s, 40.0, period_s)[2:]
    assert {power_w > 0.0 for _, power_w, _, _ in given} == {True}
    # The lease never ends before the next command.
    for (_, _, until_s, _), (next_s, *_) in zip(given, given[1:]):
        assert until_s > next_s


@pytest.mark.parametrize('stamp_s', [late_by(5.1), of_step(1e6)], ids=['5.1 s late', 'never renewed'])
def test_states_older_than_the_limit_never_heat(stamp_s):
    given = [entry for entry in commands(stamp_s, 60.0) if entry[0] > TIMEOUT_S + 1.0]
    assert {power_w for _, power_w, _, _ in given} == {0.0}
    assert Status.INVALID_INPUT in {reason for *_, reason in given}


def test_refusal_of_a_stamp_that_stays_names_the_parameter():
    supervisor, state = Supervisor(VEHICLE, Settings()), Measurement(BatteryState(-7.0, 0.8), START_NS)
    supervisor.step(START_NS, BatteryStateArrived(state))
    output = supervisor.step(START_NS + 6 * NS_PER_S, BatteryStateArrived(state))
    assert str(output.refusals[0].error) == (
        'header.stamp: the state is 6 s old; at most 5 s are allowed; the state before had the same stamp: if '
        'stamps are coarse, battery_state_timeout must be at least their step')


@pytest.mark.parametrize('stamp_s, most_s', [
    (late_by(0.0), TIMEOUT_S), (late_by(2.0), 3.0), (of_step(5.0), TIMEOUT_S), (late_by(4.9), 2.0)],
    ids=['fresh', '2 s late', 'steps of 5 s', '4.9 s late'])
def test_heat_ends_with_the_feed(stamp_s, most_s):
    """After the last state the lease ends with its age limit, and 2 s after a state that came near the limit."""
    silent_after_s = 30.0
    given = commands(stamp_s, 60.0, silent_after_s=silent_after_s)
    last_s = max(at_s for at_s, *_ in given if at_s < silent_after_s)
    assert max(until_s for _, power_w, until_s, _ in given if power_w > 0.0) <= last_s + most_s + 1e-6
    assert {power_w for at_s, power_w, _, _ in given if at_s >= last_s + most_s} == {0.0}
    assert given[-1][-1] is Status.STALE_INPUT


def test_jitter_does_not_hide_a_second_battery():
    seeded, supervisor = Random(3), Supervisor(VEHICLE, Settings(battery_state_timeout_s=TIMEOUT_S))
    refused = 0
    for second in range(60):
        now_ns = START_NS + second * NS_PER_S
        # The second battery's clock is 3 s behind, so that its states look overtaken.
        for late_s, temperature_c in ((0.0, -7.0), (3.0, 18.0)):
            output = supervisor.step(now_ns, BatteryStateArrived(Measurement(
                BatteryState(temperature_c + seeded.uniform(-0.2, 0.2), 0.8), now_ns - round(late_s * NS_PER_S))))
            refused += bool(output.refusals)
    assert refused >= 59
