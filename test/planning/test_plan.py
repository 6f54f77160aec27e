# SPDX-License-Identifier: Apache-2.0
"""The plan object: the keys that other programs read, shapes, and JSON."""

from dataclasses import asdict, replace
import json
import pickle

import numpy as np
import pytest

from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
# Power that the cabin leaves the heater [W].
LEFT_W = VEHICLE.hvch.maximum_power_w - VEHICLE.defaults.cabin_heating_power_w


def made_plan(target_c=25.0, charging_planned=True, method='paper', **how):
    route = make_route({
        'duration_s': [40.0, 10.0, 25.0, 60.0, 30.0, 5.0, 90.0], 'speed_mps': [22.0],
        'propulsion_power_w': [19e3], 'ambient_temperature_c': [-6.0]}, VEHICLE.defaults)
    return plan_preheating(VEHICLE, route, BatteryState(temperature_c=-3.0, soc=0.83),
                           Goal(target_c, charging_planned=charging_planned), method=method, **how)


@pytest.fixture(scope='module')
def plan():
    # Partial heating reaches the target.
    return made_plan(target_c=-0.5)


def test_a_plan_that_is_told_in_other_words_is_the_same_plan(plan):
    sentence, before = plan.explanation, vars(plan).copy()
    told = plan.told(Status.INTERNAL_ERROR, in_other_words)
    assert told.explanation == 'A plan by paper: INTERNAL_ERROR.'
    assert {**vars(told), 'status': plan.status, 'sentence': plan.sentence,
            'explanation': sentence} == before
    assert vars(plan) == before
    assert replace(told, status=Status.WAITING).explanation == 'A plan by paper: WAITING.'


def in_other_words(plan):
    return f'A plan by {plan.method}: {plan.status.name}.'


def test_a_plan_that_another_process_has_sent_tells_itself(plan):
    assert pickle.loads(pickle.dumps(plan)).explanation == plan.explanation


@pytest.mark.parametrize('target_c', [-0.5, 40.0, -5.0],
                         ids=['waiting', 'unreachable', 'not_needed'])
def test_json_and_back_is_the_same(target_c):
    dictionary = made_plan(target_c).as_dictionary()
    # Strict JSON has no NaN.
    assert json.loads(json.dumps(dictionary, allow_nan=False)) == dictionary


def test_trajectories_go_from_the_measured_state_over_the_segments_to_the_arrival(plan):
    assert plan.time_s.tolist() == [0.0, 40.0, 50.0, 75.0, 135.0, 165.0, 170.0, 260.0]
    assert [values.shape for values in (
        plan.battery_temperature_c, plan.soc, plan.hvch_battery_power_w)] == [(8,), (8,), (7,)]
    assert (plan.battery_temperature_c[0], plan.soc[0]) == (-3.0, 0.83)
    assert (plan.arrival_time_s, plan.arrival_temperature_c, plan.arrival_soc) == (
        260.0, plan.battery_temperature_c[-1], plan.soc[-1])


def test_dictionary_is_the_plan(plan):
    dictionary = plan.as_dictionary()
    assert {key: dictionary[key] for key in (
        'status', 'method', 'explanation', 'target_temperature_c', 'heating_start_s',
        'arrival_time_s', 'arrival_temperature_c', 'arrival_soc', 'shortfall_k',
        'undeliverable_power_w', 'undeliverable_at_s', 'planning_time_s')} == {
            'status': 'WAITING', 'method': 'paper', 'explanation': plan.explanation,
            'target_temperature_c': -0.5, 'heating_start_s': plan.heating_start_s,
            'arrival_time_s': 260.0, 'arrival_temperature_c': plan.arrival_temperature_c,
            'arrival_soc': plan.arrival_soc, 'shortfall_k': plan.shortfall_k,
            'undeliverable_power_w': 0.0, 'undeliverable_at_s': None,
            'planning_time_s': plan.planning_time_s}
    for name in ('time_s', 'battery_temperature_c', 'soc', 'hvch_battery_power_w'):
        assert dictionary[name] == list(getattr(plan, name)), name
    assert set(dictionary['energy_wh']) == {
        'joule', 'drivetrain_heat', 'hvch_heat', 'hvch_electric', 'leakage', 'battery_total'}


def test_heater_energy_is_the_heater_power_over_time(plan):
    electric_wh = np.diff(plan.time_s) @ plan.hvch_battery_power_w / 3600.0
    assert plan.energy_wh.hvch_electric == pytest.approx(electric_wh, rel=1e-12)
    assert 0.0 < plan.planning_time_s < 10.0


def test_energies_are_the_same_whether_a_heater_heats_by_command_or_without():
    commanded, uncommanded = (made_plan(40.0, method='optimal_switch', **how) for how in (
        {}, {'heats_throughout': True}))
    assert (commanded.heating_start_s, uncommanded.heating_start_s) == (0.0, None)
    assert asdict(uncommanded.energy_wh) == pytest.approx(asdict(commanded.energy_wh), rel=1e-12)
    assert uncommanded.energy_wh.hvch_electric == pytest.approx(LEFT_W * 260.0 / 3600.0)


def test_a_heater_that_cannot_be_switched_off_takes_power_for_heat_that_comes_too_late():
    # The middle of the last step, 90 s, lies 45 s before arrival.
    energy_wh = made_plan(40.0, heats_throughout=True, heat_lag_s=47.0).energy_wh
    in_time = made_plan(40.0, heat_lag_s=47.0).energy_wh
    assert energy_wh.hvch_electric == pytest.approx(LEFT_W * 260.0 / 3600.0)
    assert energy_wh.hvch_heat == pytest.approx(in_time.hvch_heat)
    assert energy_wh.battery_total > in_time.battery_total + LEFT_W * 90.0 / 3600.0


def test_heating_that_never_starts_is_null():
    assert '"heating_start_s": null' in json.dumps(made_plan(target_c=-5.0).as_dictionary())
