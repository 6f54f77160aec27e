# SPDX-License-Identifier: Apache-2.0
"""Method `paper` against Algorithms 1 and 2 written out a second time, and its refusals."""

from dataclasses import replace
import math

import drives
from formula_car import current_a, FORMULA_CAR, resistance_ohm, voltage_v
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from own_car import bilinear
import pytest
from refusals import problems_of

from bev_preheat.planning.methods import plan_paper
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route

START = BatteryState(temperature_c=-7.0, soc=0.88)
NAN = math.nan

SEGMENTS = drives.segments(
    propulsion_power_w=(-30e3, 45e3), ambient_temperature_c=(-25.0, 5.0), cabin_heating_power_w=(0.0, 4e3))


class Algorithms:
    """
    Algorithms 1 and 2 as printed, for the car above, with the paper's indices 1 ... N + 1.

    `segments` holds dictionaries as above; power does not vary within a segment.
    """

    def __init__(self, segments, cold_c, full_soc):
        self.segments = [None, *segments]
        self.last = len(segments)
        # Algorithm 1.
        self.soc_fw, self.t_fw = [None, full_soc], [None, cold_c]
        for k in range(1, self.last + 1):
            current_a, heating_k = self.change(k, self.soc_fw[k], self.t_fw[k], 0.0)
            self.soc_fw.append(
                self.soc_fw[k] - segments[k - 1]['duration_s'] * current_a / (200.0 * 3600.0))
            self.t_fw.append(self.t_fw[k] + heating_k)

    def change(self, k, soc, t, heater_w):
        """Current, and the change of temperature within segment k."""
        segment = self.segments[k]
        power_w = (segment['auxiliary_power_w'] + segment['cabin_heating_power_w'] + heater_w
                   + segment['propulsion_power_w'])
        current = current_a(soc, t, power_w)
        gamma = 33.0 + 0.5 * segment['speed_mps']
        # Eq. (5) with a loss that is positive in both directions.
        heat_w = (0.87 * heater_w + gamma * (segment['ambient_temperature_c'] - t)
                  + resistance_ohm(t) * current**2 + 0.8 * (1 - 0.9) * abs(segment['propulsion_power_w']))
        return current, segment['duration_s'] * heat_w / 378500.0

    def cross(self, target_c, end_soc):
        """Algorithm 2: step k in which the runs cross, and the instant at which their lines cross."""
        soc_bk, t_bk = {self.last + 1: end_soc}, {self.last + 1: target_c}
        for k in range(self.last, 0, -1):
            heater_w = max(7000.0 - self.segments[k]['cabin_heating_power_w'], 0.0)
            current_a, heating_k = self.change(k, soc_bk[k + 1], t_bk[k + 1], heater_w)
            duration_s = self.segments[k]['duration_s']
            soc_bk[k] = soc_bk[k + 1] + duration_s * current_a / (200.0 * 3600.0)
            t_bk[k] = t_bk[k + 1] - heating_k
            if t_bk[k] <= self.t_fw[k]:
                start_s = sum(segment['duration_s'] for segment in self.segments[1:k])
                forward = np.polyfit([0.0, 1.0], [self.t_fw[k], self.t_fw[k + 1]], 1)
                backward = np.polyfit([0.0, 1.0], [t_bk[k], t_bk[k + 1]], 1)
                return k, start_s + duration_s * np.roots(backward - forward)[0]
        return None


def route_of(segments):
    return make_route(drives.columns_of(segments), FORMULA_CAR.defaults)


def drive(step_s=30.0, ambient_c=-7.0):
    """Return the segments of a drive of 40 min."""
    return round(2400.0 / step_s) * [{
        'duration_s': step_s, 'speed_mps': 20.0, 'propulsion_power_w': 16e3, 'ambient_temperature_c': ambient_c,
        'cabin_heating_power_w': 1978.0, 'auxiliary_power_w': 500.0}]


def plan_of(segments, target_c=18.0, state=START, **options):
    return plan_preheating(FORMULA_CAR, route_of(segments), state, Goal(target_c), method='paper', no_regret=False,
                           **options)


@given(segments=SEGMENTS, cold_c=st.floats(-25.0, 10.0), rise_k=st.floats(0.0, 1.0),
       full_soc=st.floats(0.4, 0.95))
def test_switching_instant_is_that_of_the_printed_algorithms(segments, cold_c, rise_k, full_soc):
    algorithms = Algorithms(segments, cold_c, full_soc)
    # Up to 0.6 K/min above the unheated run, about the heater's contribution.
    longest_s = sum(segment['duration_s'] for segment in segments)
    target_c = algorithms.t_fw[-1] + max(1e-3, rise_k * 0.01 * longest_s)
    crossing = algorithms.cross(target_c, algorithms.soc_fw[-1])
    trip = make_trip(FORMULA_CAR, route_of(segments))
    schedule = plan_paper(trip, BatteryState(cold_c, full_soc), Goal(target_c))
    # The lines part at 0.5 mK/s or more, and temperatures are exact to 1e-12 K.
    assert schedule.heating_start_s == pytest.approx(crossing[1] if crossing else 0.0, abs=1e-6)
    # It is switched on in the step of the crossing: the paper's step k is the array's k - 1.
    assert np.flatnonzero(schedule.heater_power_w)[0] == (crossing[0] - 1 if crossing else 0)


def test_a_tenth_of_the_step_makes_a_tenth_of_the_arrival_error():
    errors_k = []
    for step_s in (60.0, 6.0):
        segments = drive(step_s=step_s)
        # A wrong soc at the end leaves an error that shorter steps do not reduce.
        arrival_soc = plan_of(segments).arrival_soc
        errors_k.append(
            plan_of(segments, terminal_soc=arrival_soc).arrival_temperature_c - 18.0)
    # First order; a second-order term shows a little at 60 s.
    assert errors_k[0] / errors_k[1] == pytest.approx(10.0, rel=0.15)


def test_power_limited_says_when_and_by_how_much():
    # A drive that asks a deeply cold battery for too much, twice.
    segments = drive(ambient_c=-30.0)
    segments[2] = dict(segments[2], propulsion_power_w=230e3)
    segments[9] = dict(segments[9], propulsion_power_w=480e3)
    plan = plan_of(segments, 59.0, BatteryState(-30.0, 0.88))
    soc, temperature_c = plan.soc[9], plan.battery_temperature_c[9]
    u, r = voltage_v(soc), resistance_ohm(temperature_c)
    # P_b = U I at the battery's limit, or the circuit's most, at U/2R.
    limit_w = bilinear(FORMULA_CAR.battery.discharge_power_limit, soc, temperature_c)
    most_a = min(limit_w / u, u / (2 * r))
    # The heater needs its share too.
    deficit_w = 480e3 + 1978.0 + 500.0 + 5022.0 - (u * most_a - r * most_a**2)
    # Segment 9 starts at 4:30.
    assert (plan.status, plan.undeliverable_at_s, plan.explanation) == (
        Status.POWER_LIMITED, 270.0, f'In 4:30 min the route needs {deficit_w / 1000:.1f} kW '
        'more than the battery can deliver; heating is on; arrival in 40:00 min at '
        f'{plan.arrival_temperature_c:.1f} degC, target 59.0 degC.')


@pytest.mark.parametrize('state, goal, ambient_c, problem', [
    (replace(START, temperature_c=-40.5), Goal(18.0), -7.0, 'battery temperature: -40.5 is not '
     "allowed; it must be -40 ... 60 degC, the range of the vehicle's battery"),
    (replace(START, temperature_c=266.15), Goal(18.0), -7.0, 'battery temperature: 266.15 is not '
     "allowed; it must be -40 ... 60 degC, the range of the vehicle's battery"),
    (replace(START, temperature_c=NAN), Goal(18.0), -7.0, 'battery temperature: nan is not '
     "allowed; it must be -40 ... 60 degC, the range of the vehicle's battery"),
    (replace(START, soc=88.0), Goal(18.0), -7.0,
     'state of charge: 88 is not allowed; it must be 0 ... 1; 0.88?'),
    (replace(START, soc=-0.1), Goal(18.0), -7.0,
     'state of charge: -0.1 is not allowed; it must be 0 ... 1'),
    (replace(START, soc=NAN), Goal(18.0), -7.0,
     'state of charge: nan is not allowed; it must be 0 ... 1'),
    (START, Goal(61.0), -7.0, 'target battery temperature: 61 is not allowed; it must be '
     "-40 ... 60 degC, the range of the vehicle's battery"),
    (START, Goal(NAN), -7.0, 'target battery temperature: nan is not allowed; it must be '
     "-40 ... 60 degC, the range of the vehicle's battery"),
    (START, Goal(18.0, minimum_arrival_soc=20.0), -7.0,
     'minimum arrival state of charge: 20 is not allowed; it must be 0 ... 1; 0.2?'),
    (START, Goal(18.0, minimum_arrival_soc=NAN), -7.0,
     'minimum arrival state of charge: nan is not allowed; it must be 0 ... 1'),
    (START, Goal(18.0), -44.0, 'ambient temperature: -44 is not allowed; it must be at least -40 '
     "degC: the vehicle's battery is not described below that")])
def test_state_goal_or_route_refused_in_words(state, goal, ambient_c, problem):
    route = route_of(drive(ambient_c=ambient_c))
    assert problems_of(plan_preheating, FORMULA_CAR, route, state, goal, method='paper') == [problem]
