# SPDX-License-Identifier: Apache-2.0
"""When a battery state is compared with the standing time, and the report on an offset sensor."""

from math import exp

import pytest
from steady_drives import at, measured, NOW_NS, steady_leg, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.inputs import Mission
from bev_preheat.control.learning import StandWatch
from bev_preheat.control.settings import Settings
from bev_preheat.estimation.before_restart import LastSeen
from bev_preheat.estimation.prior import after_soak
from bev_preheat.numerics import NS_PER_S
from bev_preheat.tunables import LONGEST_GAP_S

NIGHT_S = 36_000.0
FIRST = measured(NOW_NS, -5.0)
LEG = steady_leg(ambient_temperature_c=[-7.0] * 20 + [4.0] * 20, target_temperature_c=20.0)


def trip(standing_time_s=NIGHT_S):
    return Mission('morning', (LEG,), standing_time_s)


def compared(*measurements, watch=StandWatch()):
    """Return the StandWatch after Measurements on a trip, and the Soak before each."""
    standing = []
    for measurement in measurements:
        watch, soak = watch.compared(trip(), measurement, VEHICLE)
        standing.append(soak)
    return watch, standing


def test_the_first_state_of_a_trip_is_of_a_battery_that_stood_where_the_route_begins():
    assert compared(FIRST)[1] == [after_soak(VEHICLE, -7.0, NIGHT_S)]


@pytest.mark.parametrize('after_s, is_first', [
    (LONGEST_GAP_S, True), (LONGEST_GAP_S + 0.1, False)])
def test_a_state_that_comes_late_is_none_of_a_battery_that_stood(after_s, is_first):
    _, (first, second) = compared(*[measured(at(after_s), -5.0)] * 2)
    assert bool(first) is is_first
    assert second is None


@pytest.mark.parametrize('temperature_c, words', [
    (-7.0, ''), (-5.2, ''), (-8.8, ''),
    (-3.0, '-3.0 degC after 10:00:00 h of standing at -7.0 degC: 3.6 K warmer than the -6.6 degC'),
    (-11.0, '4.4 K colder than the -6.6 degC expected')])
def test_a_sensor_that_contradicts_by_more_than_2_k_is_named(temperature_c, words):
    sentence = compared(measured(NOW_NS, temperature_c))[0].report.contradiction
    assert words in sentence
    assert bool(sentence) is bool(words)


def test_the_planner_plans_with_what_the_sensor_is_off_by():
    temperatures_c = []
    for standing_time_s in (0.0, NIGHT_S, 1.7e308):
        supervisor = Stepwise(VEHICLE, Settings())
        supervisor.run(NOW_NS)
        supervisor.accept_mission(trip(standing_time_s=standing_time_s))
        supervisor.accept_battery(FIRST, NOW_NS)
        temperatures_c.append(supervisor.state.decision.plan.battery_temperature_c[0])
    believed_c, corrected_c, forever_c = temperatures_c
    assert forever_c == pytest.approx(corrected_c, abs=0.3)
    assert believed_c == pytest.approx(-5.0)
    assert -6.1 < corrected_c < -5.5


def test_a_state_that_came_before_the_route_is_made_good():
    supervisor = Stepwise(VEHICLE, Settings())
    supervisor.accept_battery(FIRST, NOW_NS)
    assert supervisor.state.estimate.sensor_offset_k == 0.0
    supervisor.accept_mission(trip())
    supervisor.accept_battery(measured(at(1.0), -5.0), at(1.0))
    assert supervisor.state.estimate.sensor_offset_k > 0.5
    assert supervisor.state.stand_report.reading_c == -5.0


def seen(temperature_c, before_s):
    return LastSeen(temperature_c, 0.8, NOW_NS - round(before_s * NS_PER_S))


def test_the_stand_starts_from_the_last_temperature_before_a_silence():
    # The battery wakes before the route arrives.
    watch = StandWatch()
    driven = (seen(36.0, NIGHT_S + 60.0 - before_s) for before_s in range(60))
    for each in (*driven, seen(-5.1, 2.0), seen(-5.0, 1.0)):
        watch = watch.noted(each)
    _, (standing,) = compared(FIRST, watch=watch)
    # Newton's law of cooling from 36 degC on, with the leakage at rest.
    battery = VEHICLE.battery
    cooled_c = -7.0 + 43.0 * exp(-battery.leakage.gamma_0_w_per_k * NIGHT_S / battery.heat_capacity_j_per_k)
    assert standing.temperature_c == pytest.approx(cooled_c, abs=0.01)
