# SPDX-License-Identifier: Apache-2.0
"""Heating that begins early and ends once the target is certain, against runs in continuous time."""

from dataclasses import replace

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.uncertainty_margin import ARRIVAL_TOLERANCE_K, UncertaintyMargin
from bev_preheat.route.csv_file import load_route
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.model import make_rates
from bev_preheat.vehicle.terminal_limits import make_terminal_limits

CAR = load_vehicle('reference')
START = BatteryState(temperature_c=-4.0, soc=0.82)
CABIN_W = 1500.0
GOAL = Goal(20.0)
# The plan has a mean power in the step in which heating ends, whereas continuous time switches within it; the end
# is searched to ARRIVAL_TOLERANCE_K.
SAME_C = 5e-3


def steady_route(minutes=60, step_s=60.0, **changed):
    count = round(60 * minutes / step_s)
    return make_route({
        'duration_s': [step_s] * count, 'speed_mps': [24.0], 'propulsion_power_w': [17e3],
        'ambient_temperature_c': [-9.0], 'cabin_heating_power_w': [CABIN_W],
        'auxiliary_power_w': [400.0], **changed}, CAR.defaults)


def planned(route=None, state=START, goal=GOAL, **uncertainty_margin):
    return plan_preheating(
        CAR,
        steady_route() if route is None else route,
        state,
        goal,
        uncertainty_margin=UncertaintyMargin(
            **uncertainty_margin) if uncertainty_margin else None)


def arrival_in_continuous_time_c(route, state, from_s, to_s):
    """Arrival temperature of a heater at full power between two instants; one steady segment."""
    from scipy.integrate import solve_ivp
    rates = make_rates(CAR, FLOATS)
    end_s, gamma = route.total_duration_s, CAR.battery.leakage.coefficient_w_per_k(24.0)
    drivetrain_w = (CAR.drivetrain.heat_recovery_efficiency
                    * (1.0 - CAR.drivetrain.efficiency) * 17e3)
    y = [state.soc, state.temperature_c]
    edges = [(0.0, from_s, 0.0), (from_s, to_s, 1.0), (to_s, end_s, 0.0)]
    for start_s, stop_s, on in edges:
        if stop_s <= start_s:
            continue
        heater_w = on * (CAR.hvch.maximum_power_w - CABIN_W)
        heat_w = CAR.hvch.efficiency * heater_w + drivetrain_w - 9.0 * gamma
        terminal_w = 17e3 + CABIN_W + 400.0 + heater_w
        y = solve_ivp(lambda t, y: rates(y[0], y[1], terminal_w, 0.0, heat_w, gamma)[:2],
                      (start_s, stop_s), y, rtol=1e-9, atol=1e-9).y[:, -1]
    return y[1]


@pytest.fixture(scope='module')
def plain():
    plan = planned()
    assert plan.status is Status.WAITING
    return plan


def test_no_caution_changes_nothing(plain):
    careful = planned(margin_k=0.0, lead_k=0.0)
    assert careful.heating_start_s == plain.heating_start_s
    assert careful.heating_end_s is None


@pytest.mark.parametrize('lead_k', [0.3, 1.0, 2.5])
def test_lead_is_so_many_kelvin_of_heating(plain, lead_k):
    careful = planned(lead_k=lead_k)
    heat_w = CAR.hvch.efficiency * (CAR.hvch.maximum_power_w - CABIN_W)
    earlier_s = plain.heating_start_s - careful.heating_start_s
    assert earlier_s * heat_w / CAR.battery.heat_capacity_j_per_k == pytest.approx(lead_k)


def test_lead_reaches_back_over_where_the_cabin_takes_the_whole_heater(plain):
    taken = (1740.0, 2340.0)
    start_s = plain.heating_start_s
    assert taken[1] < start_s < taken[1] + 300.0
    cabin_w = [CAR.hvch.maximum_power_w if taken[0] <= 60.0 * step < taken[1] else CABIN_W
               for step in range(60)]
    route = steady_route(cabin_heating_power_w=cabin_w)
    late, careful = planned(route), planned(route, lead_k=7.0)
    kelvin_per_s = (CAR.hvch.efficiency * (CAR.hvch.maximum_power_w - CABIN_W)
                    / CAR.battery.heat_capacity_j_per_k)
    assert late.heating_start_s > taken[1]
    assert careful.heating_start_s == pytest.approx(
        late.heating_start_s - (taken[1] - taken[0]) - 7.0 / kelvin_per_s)
    assert careful.arrival_temperature_c == pytest.approx(20.0, abs=ARRIVAL_TOLERANCE_K)


def test_lead_never_begins_where_the_cabin_takes_the_whole_heater():
    cabin_w = [CAR.hvch.maximum_power_w] * 40 + [CABIN_W] * 20
    careful = planned(steady_route(cabin_heating_power_w=cabin_w), lead_k=7.0)
    assert careful.heating_start_s == 2400.0
    assert careful.status is Status.WAITING


def test_lead_of_a_stretch_that_fills_all_that_can_be_heated_is_planned():
    """This used to be a division by 0, a failed plan, and a heater that stayed off."""
    route = steady_route(cabin_heating_power_w=[CAR.hvch.maximum_power_w] * 40 + [CABIN_W] * 20)
    plain, careful = (planned(route, goal=Goal(40.0), **uncertainty_margin)
                      for uncertainty_margin in ({}, {'lead_k': 7.0}))
    assert careful.status is plain.status is Status.TARGET_UNREACHABLE
    assert careful.hvch_battery_power_w.tolist() == plain.hvch_battery_power_w.tolist()
    assert careful.hvch_battery_power_w[40:] == pytest.approx(CAR.hvch.maximum_power_w - CABIN_W)


@pytest.mark.parametrize('lead_k', [0.3, 1.0, 2.5])
def test_heating_ends_where_continuous_time_arrives_at_the_target(plain, lead_k):
    from scipy.optimize import brentq
    careful = planned(lead_k=lead_k)
    route = steady_route()
    end_s = brentq(lambda end_s: arrival_in_continuous_time_c(
        route, START, careful.heating_start_s, end_s) - 20.0, plain.heating_start_s, 3600.0,
        xtol=1e-3)
    late_c = arrival_in_continuous_time_c(
        route, START, careful.heating_start_s, careful.heating_end_s)
    assert careful.heating_end_s < 3600.0
    assert late_c == pytest.approx(20.0, abs=SAME_C)
    # A second of heating is about 0.012 K.
    assert careful.heating_end_s == pytest.approx(end_s, abs=SAME_C / 0.012)


def test_margin_makes_the_battery_arrive_so_much_warmer():
    careful = planned(margin_k=0.4)
    assert careful.arrival_temperature_c == pytest.approx(20.4, abs=ARRIVAL_TOLERANCE_K)
    assert careful.shortfall_k == 0.0
    # The reported shortfall is that of the target, without the margin.
    cold = planned(state=replace(START, temperature_c=-25.0), goal=Goal(40.0), margin_k=0.4)
    assert cold.shortfall_k == pytest.approx(40.0 - cold.arrival_temperature_c)


def test_early_heating_costs_only_what_leaks(plain):
    careful = planned(lead_k=2.5)
    more, less = vars(careful.energy_wh), vars(plain.energy_wh)
    change_wh = {name: more[name] - less[name] for name in more}
    # The leaking share of the heat that is brought forward must be replaced.
    capacity = CAR.battery.heat_capacity_j_per_k
    leaked = 1.0 - np.exp(-CAR.battery.leakage.coefficient_w_per_k(24.0) / capacity
                          * (careful.heating_end_s - careful.heating_start_s))
    expected_wh = 2.5 * capacity / 3600.0 * leaked / CAR.hvch.efficiency
    assert change_wh['hvch_electric'] == pytest.approx(expected_wh, rel=0.15)
    # The battery arrives as warm: the additional heat has leaked.
    assert (change_wh['hvch_heat'] + change_wh['joule'] + change_wh['leakage']
            == pytest.approx(0.0, abs=0.2))


def test_power_is_full_between_the_switching_instants_and_none_outside():
    careful = planned(lead_k=2.0)
    full_w = CAR.hvch.maximum_power_w - CABIN_W
    start_s, end_s = careful.heating_start_s, careful.heating_end_s
    for elapsed_s, expected_w in (
            (start_s - 0.5, 0.0), (start_s + 0.5, full_w), (0.5 * (start_s + end_s), full_w),
            (end_s - 0.5, full_w), (end_s + 0.5, 0.0), (3599.0, 0.0)):
        assert careful.power_at_w(elapsed_s) == pytest.approx(expected_w), elapsed_s
    # The means of the steps are the same energy.
    instants_s = np.arange(0.05, 3600.0, 0.1)
    sampled_wh = sum(careful.power_at_w(at_s) for at_s in instants_s) * 0.1 / 3600.0
    assert sampled_wh == pytest.approx(careful.energy_wh.hvch_electric, rel=1e-4)


def test_a_heater_that_is_on_pauses_only_for_longer_than_is_worth_a_switching(plain):
    start_s = plain.heating_start_s
    for pause_s, expected_s in ((start_s + 1.0, 0.0), (start_s - 1.0, start_s)):
        careful = planned(is_heating=True, least_pause_s=pause_s)
        assert careful.heating_start_s == pytest.approx(expected_s, abs=1e-6)
    off = planned(is_heating=False, least_pause_s=start_s + 1.0)
    assert off.heating_start_s == start_s


def test_heating_through_a_pause_ends_as_soon_as_it_is_enough(plain):
    careful = planned(is_heating=True, least_pause_s=3600.0)
    assert careful.heating_end_s < 3600.0
    assert careful.arrival_temperature_c == pytest.approx(20.0, abs=ARRIVAL_TOLERANCE_K)
    assert careful.status is Status.HEATING


@pytest.mark.parametrize('least_s, heats', [(30.0, True), (3000.0, False)])
def test_heating_for_less_than_is_worth_a_switching_is_left(least_s, heats):
    careful = planned(least_heating_s=least_s)
    assert bool(careful.hvch_battery_power_w.any()) is heats


def test_where_all_heating_is_not_enough_caution_cannot_help():
    cold = replace(START, temperature_c=-25.0)
    plain, careful = planned(state=cold, goal=Goal(45.0)), planned(
        state=cold, goal=Goal(45.0), lead_k=2.0, margin_k=0.3)
    assert careful.arrival_temperature_c == pytest.approx(plain.arrival_temperature_c, abs=1e-9)
    assert careful.status is plain.status is Status.TARGET_UNREACHABLE


@pytest.mark.parametrize('method', ['value_function', 'optimal_switch', 'paper'])
def test_every_method_can_be_careful(method):
    careful = plan_preheating(CAR, steady_route(), START, GOAL, method, UncertaintyMargin(lead_k=1.5))
    assert careful.arrival_temperature_c == pytest.approx(20.0, abs=2 * ARRIVAL_TOLERANCE_K)


def test_the_batterys_limits_are_kept():
    route = load_route('alpine_pass', CAR.defaults)
    state, goal = BatteryState(-10.0, 0.9), Goal(25.0)
    careful = plan_preheating(CAR, route, state, goal, uncertainty_margin=UncertaintyMargin(lead_k=2.5))
    least_w, most_w = (np.array(column) for column in zip(*(
        make_terminal_limits(CAR, FLOATS)(soc, temperature_c, variance_w2)
        for soc, temperature_c, variance_w2 in zip(
            careful.soc, careful.battery_temperature_c,
            route.divided(300.0).propulsion_power_variance_w2))))
    drawn = route.divided(300.0)
    terminal_w = (drawn.propulsion_power_w + drawn.cabin_heating_power_w + drawn.auxiliary_power_w
                  + careful.hvch_battery_power_w + careful.friction_brake_power_w)
    assert (terminal_w <= most_w * (1 + 1e-9)).all()
    assert (terminal_w >= least_w * (1 + 1e-9) - 1e-6).all()


@pytest.mark.costly
@given(target_c=st.floats(-3.0, 35.0), lead_k=st.floats(0.0, 3.0), margin_k=st.floats(0.0, 0.5),
       is_heating=st.booleans(), pause_s=st.floats(0.0, 4000.0),
       powers_w=st.lists(st.floats(-5e3, 40e3), min_size=30, max_size=30))
def test_a_careful_plan_is_never_colder_and_starts_never_later(
        target_c, lead_k, margin_k, is_heating, pause_s, powers_w):
    route = steady_route(minutes=40, step_s=80.0, propulsion_power_w=powers_w)
    goal = Goal(target_c)
    plain = planned(route, goal=goal)
    assume(plain.heating_start_s is not None)
    careful = planned(route, goal=goal, lead_k=lead_k, margin_k=margin_k, is_heating=is_heating,
                      least_pause_s=pause_s)
    assert careful.heating_start_s <= plain.heating_start_s + 1e-6
    assert careful.arrival_temperature_c >= (
        min(plain.arrival_temperature_c, target_c) - 2 * ARRIVAL_TOLERANCE_K)
    if plain.status is Status.WAITING and plain.arrival_temperature_c <= target_c + 1e-3:
        assert careful.arrival_temperature_c <= target_c + margin_k + 2 * ARRIVAL_TOLERANCE_K
    # It heats as steadily as the plan without a margin.
    assert (careful.hvch_battery_power_w <= CAR.hvch.maximum_power_w - CABIN_W + 1e-6).all()
