# SPDX-License-Identifier: Apache-2.0
"""Charging curves: files, shapes of classes, and the map that a curve and the cold give."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from refusals import problems_of

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import FLOATS
from bev_preheat.vehicle.charging_curve import (
    charging_map,
    ChargingCurve,
    ChargingLimit,
    class_curve,
    curves_at,
    FIT_RANGE,
    read_charging_curve,
)
from bev_preheat.vehicle.chemistry import CHEMISTRIES, load_chemistry

HEADER = 'state_of_charge_percent,power_kw\n'
NMC = load_chemistry('nmc')


@pytest.fixture
def curve_of(tmp_path):
    def read(text):
        file = tmp_path / 'curve.csv'
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_charging_curve(file)
    return read


NO_HEADER = ('the first line must be state_of_charge_percent,power_kw or, for a limit, '
             'battery_temperature_c,max_power_kw')
LIMIT = 'battery_temperature_c,max_power_kw\n'


def test_a_limit_over_the_temperature_is_told_by_its_first_line(curve_of):
    limit = curve_of(f'# as read from a car\n{LIMIT}-1000,20\n0,60\n15,75\n25,233\n')
    assert limit == ChargingLimit((-1000.0, 0.0, 15.0, 25.0), (20.0, 60.0, 75.0, 233.0))
    # Halfway from 75 to 233 kW.
    assert (limit.warm_c(1000.0), limit.warm_c(154.0), limit.warm_c(10.0)) == (25.0, pytest.approx(20.0), -1000.0)


@pytest.mark.parametrize('column', [';', '\t'])
def test_a_spreadsheet_with_decimal_commas_is_read(curve_of, column):
    text = 'battery_temperature_c;max_power_kw\n-7,5;20\n25;120,25\n'
    assert curve_of(text.replace(';', column)) == ChargingLimit((-7.5, 25.0), (20.0, 120.25))


@pytest.mark.parametrize('soc, temperature_c, expected_kw', [
    # The limit, between 0 and 15 degC with 1 kW more for each kelvin.
    (0.35, -40.0, 60.0), (0.5, 0.0, 60.0), (0.35, 7.5, 67.5), (0.35, 15.0, 75.0),
    # The car's maximum, and the curve.
    (0.35, 25.0, 120.0), (0.0, 60.0, 120.0), (1.0, 0.0, 20.0), (1.0, 60.0, 20.0)])
def test_with_a_limit_the_map_is_the_least_of_curve_limit_and_maximum(soc, temperature_c, expected_kw):
    curve = ChargingCurve((0.0, 0.5, 1.0), (160.0, 160.0, 20.0), 30.0)
    limit = ChargingLimit((-1000.0, 0.0, 15.0, 25.0), (60.0, 60.0, 75.0, 233.0))
    power_w = charging_map([curve], NMC, 120.0, limit).function(FLOATS)(soc, temperature_c)
    assert -power_w == pytest.approx(1e3 * expected_kw)


@pytest.mark.parametrize('text, problem', [
    ('', NO_HEADER),
    ('soc,kW\n10,100\n80,50\n', NO_HEADER),
    (HEADER, 'it covers nothing; it must cover at least 10 ... 80 %'),
    (HEADER + '0.1,100\n0.8,50\n', 'the last state of charge is 0.8 %; states of charge are in percent'),
    (HEADER + '20,100\n80,50\n', 'it covers 20 ... 80 %; it must cover at least 10 ... 80 %'),
    (HEADER + '10,100\n', 'it covers 10 ... 10 %; it must cover at least 10 ... 80 %'),
    (HEADER + '10,100\n80,50,3\n', "line 3: '80,50,3' is not two numbers"),
    (HEADER + '10,nan\n80,50\n', 'nan kW at 10 % is not allowed; it must be 0 ... 2000 kW'),
    (HEADER + '10,inf\n80,50\n', 'inf kW at 10 % is not allowed; it must be 0 ... 2000 kW'),
    (HEADER + 'nan,100\n80,50\n', 'nan % is not allowed; it must be 0 ... 100 %'),
    (HEADER + '10,100000\n80,50\n', '100000 kW at 10 % is not allowed; it must be 0 ... 2000 kW'),
    (HEADER + '80,50\n10,100\n', '10 % must be above the 80 % before it'),
    (HEADER + '10,100\n50,0\n80,50\n', 'the power must be above 0 kW up to 80 %'),
    (b'\xff\xfe\x00', 'cannot be read: is not UTF-8 text'),
    (f'{LIMIT}0,60\n', '1 points; 2 ... 1000 are allowed'),
    (f'{LIMIT}0,60\n0,70\n', '0 degC must be above the 0 degC before it'),
    (f'{LIMIT}0,60\nnan,70\n', 'nan degC is not allowed; it must be -9999 ... 9999 degC'),
    (f'{LIMIT}273,60\n298,70\n', 'it covers 273 ... 298 degC; batteries have -60 ... 100 degC'),
    (f'{LIMIT}0,60000\n9,70\n', '60000 kW at 0 degC is not allowed; it must be 0 ... 2000 kW'),
    (f'{LIMIT}0,0\n9,0\n', 'the power must be above 0 kW at some temperature')])
def test_a_file_that_is_no_curve_and_no_limit_is_refused_in_words(curve_of, text, problem):
    (refusal,) = problems_of(curve_of, text)
    assert refusal.startswith('--charging-curve: ') and refusal.endswith(f'curve.csv: {problem}')


@pytest.mark.parametrize('temperatures_c, problem', [
    ([25.0], '1 temperatures for 2 --charging-curve files'), ([-40.1, 25.0], r'-40.1 degC .* -40 ... 45 degC'),
    ([0.0, 45.1], r'45.1 degC .* -40 ... 45 degC'), ([float('nan'), 25.0], r'nan degC .* -40 ... 45 degC'),
    ([25.0, 25.0], 'each curve needs a temperature of its own'),
    ([9.9, -10.0], '9.9 degC is not allowed for the warmest curve; it must be 10 ... 45 degC')])
def test_each_curve_has_a_temperature_and_one_is_of_a_warm_battery(curve_of, temperatures_c, problem):
    with pytest.raises(InvalidInput, match=f'--charging-curve-temperature-c: {problem}'):
        curves_at([curve_of(HEADER + '10,100\n80,50\n')] * 2, temperatures_c)


def test_between_the_temperatures_of_curves_the_map_is_linear_and_beyond_it_follows_the_chemistry():
    cold, warm = ((0.0, 0.5, 1.0), (40.0, 20.0, 4.0), 0.0), ((0.0, 0.4, 1.0), (110.0, 100.0, 10.0), 25.0)
    curves = curves_at([ChargingCurve(*warm), ChargingCurve(*cold)], [25.0, 0.0])
    assert [curve.temperature_c for curve in curves] == [0.0, 25.0]
    power_w = charging_map(curves, NMC, 120.0).function(FLOATS)
    # At 50 %: 20 kW at 0 degC, 85 kW at 25 degC; NMC takes 0.11 at -10 degC, 0.28 at 0 degC, half at 50 degC.
    for at_c, expected_kw in ((0.0, 20.0), (10.0, 46.0), (25.0, 85.0), (45.0, 85.0), (50.0, 42.5),
                              (-10.0, 20.0 * 0.11 / 0.28)):
        assert -power_w(0.5, at_c) / 1e3 == pytest.approx(expected_kw, abs=0.001), at_c
    limit = ChargingLimit((-1000.0, 10.0, 15.0, 25.0), (60.0, 30.0, 75.0, 233.0))
    limited_w = charging_map(curves, NMC, 120.0, limit).function(FLOATS)
    assert [-limited_w(0.5, at_c) / 1e3 for at_c in (0.0, 10.0, 25.0, 60.0)] == pytest.approx(
        [20.0, 30.0, 85.0, 85.0], abs=0.001)


@pytest.mark.parametrize('temperature_c, at_c, expected_kw', [
    # NMC: 0.53 at 10 degC, 0.28 at 0 degC, 1 from 25 degC.
    (30.0, 25.0, 80.0), (30.0, 10.0, 0.53 * 80.0), (30.0, 0.0, 0.28 * 80.0), (30.0, -20.0, 0.03 * 80.0),
    # A curve of a battery at 10 degC: a warm one takes more, but no more than the car's maximum.
    (10.0, 10.0, 80.0), (10.0, 0.0, 80.0 * 0.28 / 0.53), (10.0, 25.0, 120.0)])
def test_the_map_is_the_curve_times_the_share_of_the_cold(temperature_c, at_c, expected_kw):
    # Half way the curve has 80 kW.
    table = charging_map([ChargingCurve((0.0, 0.5, 1.0), (100.0, 80.0, 10.0), temperature_c)], NMC, 120.0)
    assert -table.function(FLOATS)(0.5, at_c) / 1e3 == pytest.approx(expected_kw, abs=0.001)


@given(chemistry=st.sampled_from(CHEMISTRIES), voltage_v=st.sampled_from([350.0, 700.0]),
       energy_kwh=st.floats(20.0, 700.0), rate=st.floats(0.2, 5.0), fit=st.floats(*FIT_RANGE),
       fuller=st.floats(1.0, 3.0))
def test_class_curves_hold_the_maximum_once_and_get_fuller_with_the_fit(
        chemistry, voltage_v, energy_kwh, rate, fit, fuller):
    figures = load_chemistry(chemistry)
    most_kw = rate * energy_kwh
    curve, more = (class_curve(figures, voltage_v, energy_kwh, most_kw, value) for value in (fit, fit * fuller))
    assert max(curve.power_kw) == pytest.approx(most_kw, rel=1e-12)
    assert min(curve.power_kw) > 0.0 and (np.diff(curve.soc) > 0.0).all()
    soc = np.linspace(0.0, 1.0, 201)
    # Points are joined by lines, so a power of a shape lies up to 1 % below its own line.
    assert (np.interp(soc, more.soc, more.power_kw)
            >= np.interp(soc, curve.soc, curve.power_kw) - 0.01 * most_kw).all()
