# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of an arrival, compared with drives of cars that differ from the estimate."""

from dataclasses import replace
import math

import numpy as np
import pytest

from bev_preheat.estimation.belief import Belief
from bev_preheat.estimation.estimate import (
    Estimate,
    FACTORS,
    HEAT_LAG,
    JOULE_RISE,
    SIZE,
    SOC,
    TEMPERATURE,
    UNDER_WAY,
)
from bev_preheat.estimation.forecast import (
    arrival_deviation_k,
    arrival_sensitivities,
    Forecast,
    replanned_deviation_k,
)
from bev_preheat.estimation.hypotheses import Heater, HeaterReport, SuspectedFault
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.csv_file import load_route
from bev_preheat.route.segments import make_route
from bev_preheat.tunables import POWER_NOISE, POWER_NOISE_LASTS_S
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections, hvch_alone

TRIPS = {
    'reference': (load_vehicle('reference'), 'reference', BatteryState(-8.0, 0.85)),
    'small_car': (load_vehicle('small_car'), 'winter_commute', BatteryState(-3.0, 0.7)),
    'heat_pump_car': (load_vehicle('heat_pump_car'), 'winter_commute', BatteryState(-3.0, 0.7)),
}
TARGET_C = 12.0


def planned(name):
    vehicle, route_name, state = TRIPS[name]
    route = load_route(route_name, vehicle.defaults)
    plan = plan_preheating(vehicle, route, state, Goal(TARGET_C))
    assert plan.command_w.any()
    return vehicle, route, state, plan


def planned_to(target_c):
    vehicle, _, state = TRIPS['reference']
    route = load_route('reference', vehicle.defaults)
    return vehicle, route, state, plan_preheating(vehicle, route, state, Goal(target_c))


def arrival_c(vehicle, route, state, plan, moved, powers=None):
    """
    Arrival of a drive with the plan's heater powers by another car, whose state differs by `moved`.

    `powers` are factors on the propulsion power of each segment.
    """
    capacity, leakage, resistance, heater, propulsion, source = np.exp(moved[FACTORS]).tolist()
    car = corrected_vehicle(hvch_alone(vehicle), Corrections(capacity, leakage, resistance, heater))
    # The HVCH gives the heat of the other sources; their electrical power stays.
    heat_w = plan.hvch_battery_power_w + source * (plan.command_w - plan.hvch_battery_power_w)
    route = replace(route, auxiliary_power_w=route.auxiliary_power_w + plan.drawn_power_w - heat_w)
    route = route.with_propulsion(propulsion if powers is None else propulsion * powers)
    _, temperature_c = run_forward(
        make_trip(car, route), make_runge_kutta_4, state.soc + moved[SOC],
        state.temperature_c + moved[TEMPERATURE] + moved[UNDER_WAY],
        heat_w, plan.friction_brake_power_w)
    return temperature_c[-1]


@pytest.mark.parametrize('name', TRIPS)
@pytest.mark.parametrize('index', range(SIZE))
def test_sensitivities_are_central_differences_of_drives(name, index):
    vehicle, route, state, plan = planned(name)
    sensitivities, _ = arrival_sensitivities(make_trip(vehicle, route), plan)
    step = np.zeros(SIZE)
    step[index] = 0.02
    expected = (arrival_c(vehicle, route, state, plan, step)
                - arrival_c(vehicle, route, state, plan, -step)) / 0.04
    # Steps of a minute with the rates at their beginning (Euler).
    assert sensitivities[index] == pytest.approx(expected, rel=0.05, abs=0.05)


def estimate_with(covariance):
    return Estimate(0, np.zeros(SIZE), covariance, HeaterReport(Heater.ANSWERS, 1.0, 1.0), 0.0)


@pytest.mark.costly
@pytest.mark.parametrize('name', TRIPS)
def test_deviation_is_that_of_many_drives(name):
    vehicle, route, state, plan = planned(name)
    belief = Belief.of(vehicle).placed(state.temperature_c, 0.3**2, state.soc, 0.005**2)
    covariance = belief.expected()[1].copy()
    # In these drives no heat is late.
    covariance[HEAT_LAG] = covariance[:, HEAT_LAG] = 0.0
    drawn = np.random.default_rng(3)
    lasting = np.sqrt(np.maximum(1.0, POWER_NOISE_LASTS_S / route.duration_s))
    arrivals_c = [
        arrival_c(vehicle, route, state, plan, drawn.multivariate_normal(np.zeros(SIZE), covariance),
                  1.0 + POWER_NOISE * lasting * drawn.standard_normal(len(route)))
        for _ in range(400)]
    deviation_k = arrival_deviation_k(make_trip(vehicle, route), plan, estimate_with(covariance))
    # The standard deviation of 400 draws has an uncertainty of 3.5 %; three times that, and the same
    # again for nonlinearity.
    assert deviation_k == pytest.approx(np.std(arrivals_c), rel=0.2)


def added_k(trip, plan, covariance, lag_s):
    """Return the part of an arrival's deviation by a covariance, with a lag of the heat [s]."""
    mean = np.zeros(SIZE)
    mean[HEAT_LAG] = math.log(lag_s / 40.0)
    known, unknown = (arrival_deviation_k(trip, plan, replace(estimate_with(own), mean=mean)) for own in (
        np.zeros((SIZE, SIZE)), covariance))
    return math.sqrt(unknown**2 - known**2)


@pytest.mark.parametrize('lag_s, left', [(40.0, 1.0), (160.0, 0.5)])
def test_heat_that_is_in_the_battery_counts_whether_or_not_the_core_has_it(lag_s, left):
    """Of 1 K that is either in the core or under way, the heat that is still outside is missing on arrival."""
    vehicle, route, state, _ = planned('reference')
    covariance = np.zeros((SIZE, SIZE))
    covariance[TEMPERATURE, TEMPERATURE] = covariance[UNDER_WAY, UNDER_WAY] = 1.0
    covariance[TEMPERATURE, UNDER_WAY] = covariance[UNDER_WAY, TEMPERATURE] = -1.0
    short = route.before(60.0)
    trip, plan = make_trip(vehicle, short), plan_preheating(vehicle, short, state, Goal(TARGET_C))
    missing_k = left * math.exp(-60.0 / (left * lag_s))
    assert added_k(trip, plan, covariance, lag_s) == pytest.approx(missing_k, rel=0.02)


@pytest.mark.parametrize('lag_s, outside_s', [(40.0, 40.0), (160.0, 80.0)])
def test_heat_of_the_plan_may_be_earlier_or_later_with_the_lag_outside_the_battery(lag_s, outside_s):
    vehicle, route, state, _ = planned('reference')
    route = route.before(300.0)
    trip, plan = make_trip(vehicle, route), plan_preheating(vehicle, route, state, Goal(60.0))
    assert (plan.command_w > 0.0).all()
    uncertain = np.zeros((SIZE, SIZE))
    uncertain[HEAT_LAG, HEAT_LAG] = 0.2**2
    # Of the heat of each second, the part that has arrived in the time left.
    ages_s = np.arange(0.5, 300.0)
    power_w = plan.command_w[np.searchsorted(route.time_s, 300.0 - ages_s, side='right') - 1]
    late_k, soon_k = (0.87 / 377376.0 * float(power_w @ (1.0 - np.exp(-ages_s / (outside_s * factor))))
                      for factor in (math.exp(0.1), math.exp(-0.1)))
    assert added_k(trip, plan, uncertain, lag_s) == pytest.approx(soon_k - late_k, rel=0.01)


def test_without_thermal_the_core_may_lack_heat_that_the_sensor_shows():
    vehicle, route, state, _ = planned('reference')
    plan = plan_preheating(vehicle, route, state, Goal(60.0))
    assert plan.status is Status.TARGET_UNREACHABLE and (plan.command_w > 0.0).all()
    estimate = estimate_with(np.zeros((SIZE, SIZE)))
    described = replace(estimate, path=HeatPath(0.0, 50e3, 500.0, shell_share=0.2))
    deviation_k, described_k = (
        replanned_deviation_k(0.5, make_trip(vehicle, route), plan, known) for known in (estimate, described))
    # A quarter of the heat of the last 150 s, of steady heat.
    late_k = 0.25 * 150.0 * 0.87 * plan.command_w[-1] / vehicle.pack_heat_capacity_j_per_k
    assert math.sqrt(deviation_k**2 - described_k**2) == pytest.approx(late_k, rel=0.05)


def suspected_k(case, fault, unlike, source='hvch'):
    """
    Return the part of an arrival's deviation by a suspected fault, and the same from two drives [K].

    `unlike` makes the powers of the drive with the fault from those of the plan.
    """
    vehicle, route, state, plan = case
    trip, estimate = make_trip(vehicle, route), estimate_with(np.zeros((SIZE, SIZE)))
    healthy_k, doubted_k = (Forecast(trip, plan, estimate, suspects).deviation_k for suspects in (
        (), ((source, fault),)))
    arrivals_c = [run_forward(trip, make_runge_kutta_4, state.soc, state.temperature_c, power_w,
                              plan.friction_brake_power_w)[1][-1]
                  for power_w in (plan.command_w, unlike(plan.command_w, trip))]
    driven_k = math.sqrt(fault.probability) * abs(arrivals_c[0] - arrivals_c[1])
    return math.sqrt(doubted_k**2 - healthy_k**2), driven_k


def summer(most_c=33.0):
    vehicle = load_vehicle('heat_pump_car')
    route = load_route('winter_commute', vehicle.defaults)
    route = replace(route, ambient_temperature_c=np.full(len(route), 32.0))
    state = BatteryState(41.0, 0.8)
    return vehicle, route, state, plan_preheating(
        vehicle, route, state, Goal(20.0, maximum_arrival_temperature_c=most_c))


@pytest.mark.parametrize('steps', [1, 4, 120])
def test_the_local_rise_on_arrival_is_that_of_the_joule_heat_before_it(steps):
    vehicle = load_vehicle('reference')
    route = make_route({'duration_s': [30.0] * steps, 'speed_mps': [30.0] * steps,
                        'propulsion_power_w': [40e3] * steps, 'ambient_temperature_c': [20.0] * steps},
                       vehicle.defaults)
    plan = plan_preheating(vehicle, route, BatteryState(25.0, 0.8), Goal(20.0))
    known = estimate_with(np.zeros((SIZE, SIZE)))
    known.mean[JOULE_RISE] = 0.4
    joule_kw = plan.energy_wh.joule * 3.6 / (30.0 * steps)
    assert Forecast(make_trip(vehicle, route), plan, known).local_rise_k == pytest.approx(
        0.4 * joule_kw, rel=0.05)


@pytest.mark.parametrize('case, fault, source', [
    (lambda: planned('small_car'), SuspectedFault(Heater.DEAD, 0.9, 0.0, 100.0, 2.0, None), 'hvch'),
    (summer, SuspectedFault(Heater.DEAD, 0.7, 0.0, 100.0, 2.0, None), 'chiller')])
def test_heat_that_a_suspected_source_may_not_give_is_not_promised(case, fault, source):
    added_k, driven_k = suspected_k(case(), fault, lambda power_w, _: 0.0 * power_w, source)
    assert driven_k > 2.0
    # Of the heat, some leaks on the way.
    assert added_k == pytest.approx(driven_k, rel=0.1)


def test_heat_of_a_heater_that_may_be_stuck_on_is_expected():
    vehicle, route_name, state = TRIPS['reference']
    route = load_route(route_name, vehicle.defaults)
    plan = plan_preheating(vehicle, route, state, Goal(-7.9))
    assert not plan.command_w.any()
    added_k, driven_k = suspected_k(
        (vehicle, route, state, plan), SuspectedFault(Heater.STUCK_ON, 0.6, 1.0, 100.0, 2.0, None),
        lambda _, trip: trip.heater_limit_w)
    # It leaks for an hour.
    assert 1.0 < added_k / driven_k < 1.25


def test_what_an_earlier_start_makes_up_for_is_not_missing():
    # Heating begins late enough that half of the heater reaches the target, too.
    case = planned('reference')
    assert case[3].heating_start_s > 0.5 * case[3].arrival_time_s
    half, dead = (SuspectedFault(kind, 0.9, share, 100.0, 2.0, None) for kind, share in (
        (Heater.DERATED, 0.5), (Heater.DEAD, 0.0)))
    assert suspected_k(case, half, lambda power_w, _: 0.5 * power_w)[0] == 0.0
    assert suspected_k(case, dead, lambda power_w, _: power_w)[0] > 5.0


def test_a_source_without_which_a_plan_is_made_takes_nothing_from_it():
    dead = SuspectedFault(Heater.DEAD, 0.9, 0.0, 100.0, 2.0, None)
    assert suspected_k(planned('small_car'), dead, lambda power_w, _: power_w)[0] > 2.0
    assert suspected_k(planned('small_car'), dead, lambda power_w, _: power_w, 'heat_pump')[0] == 0.0


@pytest.mark.parametrize('case, corrected', [
    (lambda: planned('reference'), 'both'), (summer, 'both'),
    (lambda: planned_to(60.0), 'warmer'), (lambda: summer(20.0), 'colder')])
def test_errors_that_later_heating_or_cooling_corrects_are_not_left_on_arrival(case, corrected):
    """Out of reach, full power has nothing to add to a battery that turns out further away."""
    vehicle, route, _, plan = case()
    assert (plan.status is Status.TARGET_UNREACHABLE) == (corrected != 'both')
    known = replace(estimate_with(np.zeros((SIZE, SIZE))), path=HeatPath(0.0, 50e3, 500.0, shell_share=0.2))
    left_k = replanned_deviation_k(3.0, make_trip(vehicle, route), plan, known)
    if corrected == 'both':
        assert left_k < 1.0
    else:
        assert left_k == pytest.approx(3.0 * math.sqrt(0.5), rel=0.1)
