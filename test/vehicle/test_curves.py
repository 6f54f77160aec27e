# SPDX-License-Identifier: Apache-2.0
"""Formulas and tables of the vehicle: values by hand, and floats compared with arrays."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import ARRAYS, FLOATS
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage, Table

OVER_SOC = Table(soc=(0.1, 0.35, 0.9), temperature_c=(0.0,), values=((7.0,), (3.0,), (11.0,)))
OVER_TEMPERATURE = Table(soc=(0.0,), temperature_c=(-20.0, -4.0, 30.0), values=((5.0, 2.0, -3.0),))
OVER_BOTH = Table(soc=(0.0, 0.25, 1.0), temperature_c=(-10.0, 5.0, 15.0, 40.0),
                  values=((1.0, 2.0, 4.0, 8.0), (3.0, 5.0, 9.0, 17.0), (6.0, 7.0, 13.0, 29.0)))
TABLES = pytest.mark.parametrize('table', [
    pytest.param(OVER_SOC, id='soc'), pytest.param(OVER_TEMPERATURE, id='temperature'),
    pytest.param(OVER_BOTH, id='both')])

# Wider than every axis above, so that the constant ends are covered, too.
SOCS = st.floats(-0.5, 1.5)
TEMPERATURES_C = st.floats(-80.0, 80.0)


POLYNOMIAL = PolynomialVoltage((300.0, 40.0, -10.0, 24.0))
LOGARITHM = PolynomialVoltage((300.0, 40.0), log_soc_v=6.0)
RESISTANCE = InverseTemperatureResistance(4.5, 50.0)


@pytest.mark.parametrize('curve, point, expected', [
    (POLYNOMIAL, (0.5, 17.0), 300.0 + 40.0 / 2 - 10.0 / 4 + 24.0 / 8),
    # ln(1/e) = -1
    (LOGARITHM, (1.0 / math.e, 0.0), 300.0 + 40.0 / math.e - 6.0),
    (RESISTANCE, (0.3, -20.0), 4.5 / (-20.0 + 50.0)), (RESISTANCE, (0.3, 25.0), 4.5 / (25.0 + 50.0))])
def test_formula_by_hand(curve, point, expected):
    assert curve.function(FLOATS)(*point) == pytest.approx(expected, rel=1e-15)


@given(soc=st.floats(0.0, 1.0), temperature_c=st.floats(-40.0, 80.0))
@pytest.mark.parametrize('curve', [POLYNOMIAL, LOGARITHM, RESISTANCE], ids=['power', 'logarithm', 'resistance'])
def test_formula_of_arrays_is_that_of_floats(curve, soc, temperature_c):
    array = curve.function(ARRAYS)(np.array([soc]), np.array([temperature_c]))
    assert array == pytest.approx([curve.function(FLOATS)(soc, temperature_c)], rel=1e-12)


@pytest.mark.parametrize('table, point, expected', [
    # soc a third of the way from 0.25 to 1, temperature a tenth from 5 to 15:
    # 2/3 (5 + 0.1*4) + 1/3 (7 + 0.1*6)
    (OVER_BOTH, (0.5, 6.0), (2 * 5.4 + 7.6) / 3),
    (OVER_SOC, (0.05, 0.0), 7.0), (OVER_SOC, (0.95, 0.0), 11.0),
    (OVER_TEMPERATURE, (0.5, -21.0), 5.0), (OVER_TEMPERATURE, (0.5, 31.0), -3.0),
    (OVER_BOTH, (-0.1, -11.0), 1.0), (OVER_BOTH, (-0.1, 41.0), 8.0),
    (OVER_BOTH, (1.1, -11.0), 6.0), (OVER_BOTH, (1.1, 41.0), 29.0),
    # Beyond one axis only, the other still counts: 2 + 0.3 (4 - 2), 1 + 0.4 (3 - 1).
    (OVER_BOTH, (-9.0, 8.0), 2.6), (OVER_BOTH, (0.1, -99.0), 1.8)])
@pytest.mark.parametrize('arithmetic', [pytest.param(FLOATS, id='floats'), pytest.param(ARRAYS, id='arrays')])
def test_table_is_bilinear_between_its_points_and_level_beyond_them(table, point, expected, arithmetic):
    assert table.function(arithmetic)(*point) == pytest.approx(expected, rel=1e-14)


@TABLES
@given(points=st.lists(st.tuples(SOCS, TEMPERATURES_C), min_size=1, max_size=10))
def test_table_of_arrays_is_that_of_floats(table, points):
    socs, temperatures_c = np.array(points).T
    lookup = table.function(FLOATS)
    # The values change sign, so the scale is that of the largest magnitude.
    assert table.function(ARRAYS)(socs, temperatures_c) == pytest.approx(
        [lookup(*point) for point in points], rel=0.0, abs=1e-12 * 29.0)


@given(st.lists(st.floats(-100.0, 100.0), min_size=4, max_size=4), SOCS, TEMPERATURES_C)
def test_table_never_leaves_the_range_of_its_values(corners, soc, temperature_c):
    table = Table((0.2, 0.7), (-15.0, 20.0), (tuple(corners[:2]), tuple(corners[2:])))
    # Four roundings of the largest possible value at a corner.
    slack = 1e-13 * 100.0
    value = table.function(FLOATS)(soc, temperature_c)
    assert min(corners) - slack <= value <= max(corners) + slack
