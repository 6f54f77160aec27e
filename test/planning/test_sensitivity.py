# SPDX-License-Identifier: Apache-2.0
"""
Sensitivity of a plan: against the closed form on a steady drive, and against plans beside on real ones.

A battery without resistance, on a steady drive, is C dT/dt = eta P - k (T - T_amb): full power over the last h
seconds adds eta P / k (1 - exp(-k h / C)), and a kelvin of the start arrives as exp(-k L / C).
"""

from dataclasses import replace
import math

from drives import route_of
import pytest

from bev_preheat.planning import sensitivity as module
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.schedule import Reason
from bev_preheat.planning.sensitivity import find_sensitivity
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.tunables import RESOLUTION_K, SHORTFALL_TOLERANCE_K
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import PolynomialVoltage, Table
from bev_preheat.vehicle.description import Battery, Defaults, Drivetrain, Hvch, Leakage, Vehicle

HEAT_CAPACITY_J_PER_K, EFFICIENCY, CABIN_W, HEATER_W = 300e3, 0.8, 1000.0, 6000.0
FREE_W, AMBIENT_C, TARGET_C, SPEED_MPS = HEATER_W - CABIN_W, -10.0, 20.0, 20.0
RANGE_C = (-40.0, 60.0)
REFERENCE = load_vehicle('reference')


def constant(value):
    return Table((0.0,), (0.0,), ((value,),))


def steady_car(leakage_w_per_k):
    """Return a car without resistance that leaks this much at the speed of the drive."""
    battery = Battery(
        200.0, HEAT_CAPACITY_J_PER_K, PolynomialVoltage((400.0,)), constant(1e-9), constant(1e6), constant(-1e6),
        Leakage(0.5 * leakage_w_per_k, 0.5 * leakage_w_per_k / SPEED_MPS), (0.0, 1.0), RANGE_C)
    return Vehicle('steady', battery, Drivetrain(0.9, 0.5, 100e3), Hvch(HEATER_W, EFFICIENCY),
                   Defaults(CABIN_W, 300.0, TARGET_C))


def kept(minutes, leakage_w_per_k):
    """Return the share of a difference at the start that is left on arrival."""
    return math.exp(-leakage_w_per_k * 60.0 * minutes / HEAT_CAPACITY_J_PER_K)


def heater_wh(start_c, minutes, leakage_w_per_k):
    """Return the heater's energy for the target, by the closed form."""
    missing_k = TARGET_C - AMBIENT_C - (start_c - AMBIENT_C) * kept(minutes, leakage_w_per_k)
    heated_s = -HEAT_CAPACITY_J_PER_K / leakage_w_per_k * math.log(
        1.0 - missing_k * leakage_w_per_k / (EFFICIENCY * FREE_W))
    return FREE_W * heated_s / 3600.0


def found(car, route, state, goal):
    return find_sensitivity(car, route, state, goal, plan_preheating(car, route, state, goal))


@pytest.mark.parametrize('minutes, leakage_w_per_k, start_c', [
    (60, 20.0, -10.0), (60, 20.0, 10.0), (90, 60.0, 0.0), (240, 5.0, -5.0), (480, 60.0, 10.0)])
def test_figures_of_a_steady_drive_are_those_of_the_closed_form(minutes, leakage_w_per_k, start_c):
    car = steady_car(leakage_w_per_k)
    # It rolls: the drivetrain gives no heat.
    route = route_of((minutes, 0.0), step_s=60.0, speed_mps=SPEED_MPS, ambient_c=AMBIENT_C, cabin_w=CABIN_W)
    it = found(car, route, BatteryState(start_c, 0.9), Goal(TARGET_C))
    now_wh = heater_wh(start_c, minutes, leakage_w_per_k)
    assert it.kelvin_saves_wh == pytest.approx(
        now_wh - heater_wh(start_c + 1.0, minutes, leakage_w_per_k), rel=1e-3, abs=0.02)
    assert it.kelvin_arrives_k == pytest.approx(0.0, abs=1e-4)
    share = kept(minutes, leakage_w_per_k)
    # Warm enough without heat: the target, with the leakage undone.
    warm_c = AMBIENT_C + (TARGET_C - AMBIENT_C) / share
    assert it.needed_below_c == (pytest.approx(warm_c, abs=RESOLUTION_K) if warm_c < RANGE_C[1] else math.inf)
    # With full power from the start on, to the tolerance of the status.
    heated_c = AMBIENT_C + EFFICIENCY * FREE_W / leakage_w_per_k
    cold_c = heated_c + (TARGET_C - SHORTFALL_TOLERANCE_K - heated_c) / share
    assert it.reached_from_c == (pytest.approx(cold_c, abs=RESOLUTION_K) if cold_c > RANGE_C[0] else -math.inf)
    assert it.unheated_colder_k == pytest.approx(
        TARGET_C - AMBIENT_C - (start_c - AMBIENT_C) * share, abs=1e-3)
    assert it.unheated_saves_wh == pytest.approx(now_wh, rel=1e-3)


@pytest.mark.parametrize('name, state, target_c', [
    ('reference', BatteryState(-10.0, 0.9), 25.0), ('winter_commute', BatteryState(20.0, 0.8), 25.0),
    ('alpine_pass', BatteryState(-10.0, 0.9), 50.0),
    pytest.param('motorway_3h', BatteryState(20.0, 0.95), 25.0, marks=pytest.mark.deep)])
def test_bounds_are_where_the_planner_changes_its_answer(name, state, target_c):
    route, goal = load_route(name, REFERENCE.defaults), Goal(target_c, 0.1)
    it = found(REFERENCE, route, state, goal)

    def plan_from(temperature_c):
        return plan_preheating(REFERENCE, route, replace(state, temperature_c=temperature_c), goal)

    below, above = (plan_from(it.needed_below_c + beside_k) for beside_k in (-2.0 * RESOLUTION_K, RESOLUTION_K))
    assert above.status is Status.NOT_NEEDED and below.status is not Status.NOT_NEEDED
    if math.isinf(it.reached_from_c):
        # Three hours are enough for the coldest battery, too.
        assert name == 'motorway_3h'
        assert plan_from(REFERENCE.battery.temperature_range_c[0]).shortfall_k <= SHORTFALL_TOLERANCE_K
        return
    below, above = (plan_from(it.reached_from_c + beside_k) for beside_k in (-2.0 * RESOLUTION_K, RESOLUTION_K))
    assert below.shortfall_k > SHORTFALL_TOLERANCE_K >= above.shortfall_k


def test_heat_from_surplus_is_not_needed_heat():
    # A cold battery accepts little of these 40 kW; the heater can have the rest.
    route = route_of((10, -40e3), (60, 15e3), ambient_c=-22.0, cabin_w=2500.0)
    state = BatteryState(-22.0, 0.5)
    free = plan_unheated(REFERENCE, route, state, Goal(0.0))
    goal = Goal(free.arrival_temperature_c - 0.5)
    plan = plan_preheating(REFERENCE, route, state, goal)
    assert {interval.reason for interval in plan.intervals} == {Reason.SURPLUS}
    it = find_sensitivity(REFERENCE, route, state, goal, plan)
    assert it.needed_below_c < -22.0 and not it.is_heated and 'Without heating' not in it.in_words()


def test_a_drive_that_the_charge_does_not_finish_has_no_sensitivity():
    route, state = load_route('reference', REFERENCE.defaults), BatteryState(-7.0, 0.2)
    assert found(REFERENCE, route, state, Goal(25.0)) is None


USUAL = module.Sensitivity(96.84, 0.0, 22.04, -34.1, (-40.0, 60.0), 19.84, 2646.4, True)


def test_unknown_energies_are_neither_told_nor_written():
    it = replace(USUAL, kelvin_saves_wh=math.nan, unheated_colder_k=math.nan)
    figures = it.as_dictionary()
    assert figures['kelvin_saves_wh'] is figures['unheated_colder_k'] is None
    assert 'nan' not in it.in_words() and 'kelvin' not in it.in_words()


@pytest.mark.parametrize('changes, expected', [
    ({}, 'One more kelvin in the battery now would save 96.8 Wh until arrival. Heating is needed if the battery '
         'is below 22.0 degC now; below -34.1 degC the target is out of reach. Without heating the battery would '
         'arrive 19.8 K colder and the drive would take 2646 Wh less.'),
    ({'kelvin_saves_wh': -1.2, 'kelvin_arrives_k': 0.6},
     'would cost 1.2 Wh until arrival, and the battery would arrive 0.60 K warmer.'),
    ({'kelvin_saves_wh': -0.01}, 'would save 0.0 Wh'),
    ({'needed_below_c': math.inf}, 'Heating is needed even from 60 degC in the battery now; below -34.1 degC'),
    ({'reached_from_c': -math.inf}, 'below 22.0 degC now; even from -40 degC the target is reached.'),
    ({'reached_from_c': math.inf}, 'The target is missed even from 60 degC in the battery now. Without'),
    ({'needed_below_c': -math.inf, 'reached_from_c': -math.inf},
     'Heating is not needed even from -40 degC in the battery now. '),
    ({'reached_from_c': 22.04},
     'The target is reached only from 22.0 degC in the battery now on, without heating.'),
    ({'unheated_saves_wh': -15.0}, 'and the drive would take 15 Wh more.')])
def test_it_is_put_into_words(changes, expected):
    assert expected in replace(USUAL, **changes).in_words()
