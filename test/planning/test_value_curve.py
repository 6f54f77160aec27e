# SPDX-License-Identifier: Apache-2.0
"""The value curve: against curves in closed form, and properties of every curve."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.planning.strides import StrideMap
from bev_preheat.planning.value_curve import (
    cheaper_branch,
    CURVE_TOLERANCE_J,
    heating_pays,
    INDIFFERENCE_J,
    MOST_POINTS,
    ValueCurve,
    WIDEST_GAP_K,
)

TARGET_C = 25.0
PRICE_J_PER_K = 3e6
# Energy for a heater that warms by a kelvin in each stride.
HEATER_J_PER_K = 5e5
GRID_C = np.linspace(-40.0, 60.0, 64)


def stride(warmer_k: float, energy_j: float) -> StrideMap:
    """Every battery ends warmer by the same amount, and takes the same energy."""
    return StrideMap(GRID_C, GRID_C + warmer_k, np.full(len(GRID_C), energy_j), -np.inf)


def at_the_target() -> ValueCurve:
    points_c = np.unique(np.append(GRID_C, TARGET_C))
    return ValueCurve(points_c, PRICE_J_PER_K * np.maximum(TARGET_C - points_c, 0.0))


def test_without_leakage_the_threshold_falls_by_what_a_stride_can_heat():
    curve = at_the_target()
    for strides_left in range(1, 11):
        heated, unheated = (curve.before(step, 1.0) for step in (
            stride(1.0, HEATER_J_PER_K), stride(0.0, 0.0)))
        curve, bands = cheaper_branch(heated, unheated, heating_pays(curve, heated, unheated, 60.0))
        assert len(bands) == 1
        # Heating later costs the same, so only the heat that could not be made up for is needed now.
        _, low_c, high_c = bands[0]
        assert low_c == pytest.approx(TARGET_C - strides_left, abs=1e-9)
        assert high_c == pytest.approx(TARGET_C - strides_left + 1.0, abs=1e-9)
        curve = curve.within(-20.0, 50.0)
        # Heat that is still possible costs the heater's energy; the rest, the penalty.
        for missing_k in (0.0, 0.5 * strides_left, strides_left, strides_left + 3.0):
            heated_k = min(missing_k, strides_left)
            assert curve.at(TARGET_C - missing_k) == pytest.approx(
                HEATER_J_PER_K * heated_k + PRICE_J_PER_K * (missing_k - heated_k),
                abs=CURVE_TOLERANCE_J * strides_left)


def test_a_kelvin_is_worth_what_the_heater_takes_for_it():
    after = at_the_target()
    heated, unheated = after.before(stride(3.0, 3.0 * HEATER_J_PER_K), 1.0), after.before(stride(0.0, 0.0), 1.0)
    curve, _ = cheaper_branch(heated, unheated, heating_pays(after, heated, unheated, 60.0))
    assert curve.worth_j_per_k(TARGET_C - 1.5) == pytest.approx(HEATER_J_PER_K)
    assert curve.worth_j_per_k(TARGET_C - 5.0) == pytest.approx(PRICE_J_PER_K)
    assert curve.worth_j_per_k(TARGET_C + 5.0) == 0.0


def test_charge_that_is_worth_less_makes_a_stride_cheaper():
    after = at_the_target()
    dear, cheap = (after.before(stride(0.0, 1e6), worth) for worth in (1.0, 0.25))
    assert dear.energy_j - cheap.energy_j == pytest.approx(0.75e6)


def test_heating_that_costs_more_than_it_brings_never_pays():
    after = at_the_target()
    heated, unheated = after.before(stride(1.0, 2.0 * PRICE_J_PER_K), 1.0), after.before(stride(0.0, 0.0), 1.0)
    curve, bands = cheaper_branch(heated, unheated, heating_pays(after, heated, unheated, 60.0))
    assert (curve, bands) == (unheated, [])


def test_beyond_the_grid_nothing_is_heated():
    after = at_the_target()
    heated, unheated = after.before(stride(1.0, HEATER_J_PER_K), 1.0), after.before(stride(0.0, 0.0), 1.0)
    assert heating_pays(after, heated, unheated, 60.0).any()
    assert not heating_pays(after, heated, unheated, TARGET_C - 30.0)[
        heated.temperature_c[1:] >= TARGET_C - 30.0].any()


@st.composite
def curves(draw: st.DrawFn, points: int = 90) -> ValueCurve:
    gaps_k = draw(st.lists(st.floats(1e-3, 5.0), min_size=3, max_size=points))
    energy_j = draw(st.lists(st.floats(-1e7, 1e7), min_size=len(gaps_k), max_size=len(gaps_k)))
    return ValueCurve(np.cumsum(gaps_k) - 30.0, np.array(energy_j))


@given(curves())
def test_a_thinned_curve_is_the_curve(curve):
    coldest_c, warmest_c = curve.temperature_c[0], curve.temperature_c[-1]
    kept = curve.within(coldest_c, warmest_c)
    everywhere_c = np.linspace(coldest_c, warmest_c, 500)
    difference_j = np.abs(
        np.interp(everywhere_c, kept.temperature_c, kept.energy_j)
        - np.interp(everywhere_c, curve.temperature_c, curve.energy_j))
    assert difference_j.max() <= CURVE_TOLERANCE_J * (1.0 + 1e-9) + 1e-6
    # A gap that is halved once is still too wide if it was wider than twice that.
    widest_k = np.diff(curve.temperature_c).max()
    assert np.diff(kept.temperature_c).max() <= max(WIDEST_GAP_K, 0.5 * widest_k) + 1e-9


@given(curves(), st.floats(-35.0, 0.0), st.floats(0.0, 100.0))
def test_a_part_of_a_curve_is_as_the_whole_there(curve, coldest_c, width_k):
    kept = curve.within(coldest_c, coldest_c + width_k)
    inside_c = np.linspace(max(coldest_c, curve.temperature_c[0]),
                           min(coldest_c + width_k, curve.temperature_c[-1]), 50)
    for temperature_c in inside_c[(inside_c >= coldest_c) & (inside_c <= coldest_c + width_k)
                                  & (inside_c >= curve.temperature_c[0])
                                  & (inside_c <= curve.temperature_c[-1])]:
        assert kept.at(temperature_c) == pytest.approx(
            curve.at(temperature_c), abs=CURVE_TOLERANCE_J + 1e-6)


def test_many_points_on_a_line_become_few():
    points_c = np.linspace(0.0, 20.0, 4 * MOST_POINTS)
    kept = ValueCurve(points_c, -1e5 * points_c).within(0.0, 20.0)
    assert len(kept.temperature_c) <= 2 * MOST_POINTS + 1
    assert kept.at(7.3) == pytest.approx(-7.3e5)


@given(st.lists(st.floats(0.0, 4e6), min_size=8, max_size=40), st.floats(0.1, 4.0), st.floats(0.0, 3e6))
def test_the_cheaper_branch_costs_no_more_than_either(fall_j, warmer_k, energy_j):
    """Any falling curve: also if heating pays in a band only."""
    after = ValueCurve(np.arange(float(len(fall_j))), 1e7 - np.cumsum(fall_j))
    heated, unheated = after.before(stride(warmer_k, energy_j), 1.0), after.before(stride(0.0, 0.0), 1.0)
    curve, bands = cheaper_branch(heated, unheated, heating_pays(after, heated, unheated, 60.0))
    # A single band down to the coldest battery is decided piece by piece, by slopes.
    if len(bands) < 2 and not (bands and np.isfinite(bands[0][0])):
        return
    for temperature_c in curve.temperature_c:
        if heated.temperature_c[0] <= temperature_c <= heated.temperature_c[-1]:
            assert curve.at(temperature_c) <= heated.at(temperature_c) + INDIFFERENCE_J
    for floor_c, low_c, high_c in bands:
        assert floor_c < low_c < high_c
