# SPDX-License-Identifier: Apache-2.0
"""The identified file: its uncertainty, from 90 % intervals and back, and the intervals beside its values."""

from dataclasses import replace
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from bev_preheat.identification.result import Estimated, ResistanceCurve
from bev_preheat.identification.uncertainty import uncertainty_of
from bev_preheat.identification.vehicle_file import identified_text, notes_of
from bev_preheat.vehicle import load_vehicle, vehicle_contents
from bev_preheat.vehicle.description import HeatPath, Uncertainty
from bev_preheat.vehicle.loading import vehicle_of_text

# 95 % quantile of the normal distribution.
Q = 1.6448536


def estimated(name, estimate, low, high):
    return Estimated(name, name, '', estimate, estimate, low, high, low, high, True, 0.0, '', '')


def around(name, estimate, deviation):
    """Return an Estimated with the interval of a lognormal distribution."""
    return estimated(name, estimate, estimate * math.exp(-Q * deviation), estimate * math.exp(Q * deviation))


def estimates(**changes):
    """Return Estimated of a car whose leakage is 4 W/K at stand and rises by 0.1 W/K per m/s."""
    usual = {'heat_capacity': around('heat_capacity', 2e5, 0.04), 'leakage': around('leakage', 4.0, 0.1),
             'leakage_with_speed': estimated('leakage_with_speed', 0.1, 0.1 - Q * 0.02, 0.1 + Q * 0.02),
             'drivetrain_heat': estimated('drivetrain_heat', 0.03, 0.0, 0.04),
             'heater_efficiency': around('heater_efficiency', 0.8, 0.02)}
    return tuple({**usual, **changes}.values())


def resistance(deviation):
    """Return a ResistanceCurve with a deviation over temperature [deg C]."""
    at_c = np.arange(-20.0, 41.0)
    ohm = 3.0 / (at_c + 30.0)
    spread = np.exp(Q * deviation(at_c))
    return ResistanceCurve(at_c, ohm, ohm, ohm / spread, ohm * spread)


def test_deviations_are_those_of_the_lognormal_intervals():
    found = uncertainty_of(Uncertainty(), estimates(), resistance(lambda at_c: np.full_like(at_c, 0.03)), 10.0)
    # 4 W/K +- 10 % and 10 m/s times 0.1 +- 0.02 W/K per m/s: 5 W/K +- 0.447.
    assert {name: own for name, own in vars(found).items() if own} == pytest.approx({
        'heat_capacity': 0.04, 'leakage': math.hypot(0.4, 0.2) / 5.0, 'resistance': 0.03,
        'heater_efficiency': 0.02}, rel=2e-3)


def test_values_that_the_logs_do_not_tell_keep_the_uncertainty_of_the_start_file():
    untold = {item.name: replace(item, is_identified=False) for item in estimates()}
    assert uncertainty_of(Uncertainty(), untold.values(), None, 10.0) == Uncertainty()
    start = Uncertainty(0.05, 0.11, 0.07, 0.02)
    assert uncertainty_of(start, untold.values(), None, 10.0) == start
    told = uncertainty_of(start, {**untold, 'leakage': around('leakage', 4.0, 0.3)}.values(), None, 0.0)
    assert told == replace(start, leakage=0.3)


@pytest.mark.parametrize('deviation, written', [(1e-6, 0.005), (9.0, 1.0)])
def test_whatever_the_logs_tell_the_file_can_be_loaded(deviation, written):
    told = estimates(heat_capacity=around('heat_capacity', 2e5, deviation),
                     heater_efficiency=estimated('heater_efficiency', 0.5, 0.0, 1.0))
    found = uncertainty_of(Uncertainty(), told, resistance(lambda at_c: deviation + 0.0 * at_c), 30.0)
    assert (found.heat_capacity, found.resistance, found.heater_efficiency) == (written, written, 1.0)


@pytest.mark.parametrize('uncertainty', [
    Uncertainty(), Uncertainty(0.041, 0.0894, 0.0756, 0.005), Uncertainty(resistance=1.0)])
def test_the_file_has_the_uncertainty_and_nothing_else_of_it(uncertainty):
    start = yaml.safe_load(vehicle_contents('small_car'))
    car = replace(load_vehicle('small_car'), uncertainty=uncertainty)
    for before in ({}, {'uncertainty': {'leakage': 0.5}}):
        text = identified_text({**start, **before}, car, {'uncertainty': 'as identified'}, frozenset(), 'head')
        assert vehicle_of_text(text, 'mine').uncertainty == uncertainty
        assert ('# as identified' in text) is (uncertainty != Uncertainty())


COOLANT_CAR = replace(load_vehicle('reference'), heat_path=HeatPath(0.0, 20e3, 400.0, 12.0))


@pytest.mark.parametrize('name, key, estimate, value', [
    ('heat_capacity', 'battery.heat_capacity_j_per_k', COOLANT_CAR.battery.heat_capacity_j_per_k + 20e3,
     COOLANT_CAR.battery.heat_capacity_j_per_k),
    ('drivetrain_heat', 'drivetrain.heat_recovery_efficiency', COOLANT_CAR.drivetrain.heat_share,
     COOLANT_CAR.drivetrain.heat_recovery_efficiency),
    ('heat_lag', 'heat_path.coolant_conductance_w_per_k', 50.0, 400.0),
    ('sensor_lag', 'heat_path.sensor_lag_s', 12.0, 12.0),
    ('heater_efficiency', 'hvch.efficiency', COOLANT_CAR.hvch.efficiency, COOLANT_CAR.hvch.efficiency)])
def test_the_interval_contains_the_value_beside_it(name, key, estimate, value):
    """An interval of 1 % about the estimate is an interval of about 1 % about the value of the file."""
    item = replace(estimated(name, estimate, 0.99 * estimate, 1.01 * estimate), key=key)
    result = SimpleNamespace(
        estimates=(item,), vehicle=COOLANT_CAR, electrical=SimpleNamespace(used=()),
        coverage=SimpleNamespace(resistance_from_c=None, resistance_to_c=None, soc=(0.2, 0.9)))
    low, high = map(float, re.search(r'interval (\S+) ... (\S+)', notes_of(result)[key]).groups())
    assert low < value < high
    assert high - low == pytest.approx(0.02 * value, rel=0.1)
