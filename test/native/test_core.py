# SPDX-License-Identifier: Apache-2.0
"""The native core compared with the Python equations, at random points, and its refusals."""
from dataclasses import replace
from math import inf, isfinite, nan

import drawn_situations
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import FLOATS, SATURATING_FLOATS
from bev_preheat.planning.engine import run_forward, trip_in_core
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle import core_library as library_module
from bev_preheat.vehicle.core_calls import INTEGRATORS, place, rows_of, vehicle_in_core
from bev_preheat.vehicle.core_library import call, core, core_in_words, Declined, use_core, without_core
from bev_preheat.vehicle.core_structs import NativeTrip, NativeVehicle, NotDescribed
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage, Table
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.model import (
    make_euler,
    make_midpoint,
    make_rates,
    make_runge_kutta_4,
    TRIP_COLUMNS,
    TripColumns,
)
from bev_preheat.vehicle.variants import ScaledCurve

FORMULAS, TABLES = (drawn_situations.car(name) for name in drawn_situations.CARS)
LOGARITHM = replace(FORMULAS, battery=replace(
    FORMULAS.battery, open_circuit_voltage=PolynomialVoltage((340.0, 61.0, -7.0), 9.0)))
CURVES = [
    PolynomialVoltage((331.0, 88.0, -21.0, 13.0)), PolynomialVoltage((352.0, 40.0), 11.0),
    InverseTemperatureResistance(3.7, 41.0), Table((0.5,), (0.0,), ((7.5,),)),
    Table((0.1, 0.4, 0.9), (20.0,), ((1.0,), (4.5,), (3.25,))),
    Table((0.5,), (-20.0, -3.0, 11.0, 30.0), ((9.0, 4.0, 2.5, 2.0),)),
    Table((0.0, 0.3, 1.0), (-15.0, 2.0, 25.0), ((3.0, 2.0, 1.5), (2.5, 1.25, 1.0), (4.0, 1.75, 0.5))),
    ScaledCurve(ScaledCurve(InverseTemperatureResistance(3.7, 41.0), 1.07), 0.93)]
SOC = st.one_of(st.floats(-0.2, 1.2), st.sampled_from([0.0, 0.1, 0.3, 0.4, 0.5, 0.9, 1.0]))
TEMPERATURE_C = st.one_of(st.floats(-30.0, 60.0), st.sampled_from([-20.0, -15.0, -3.0, 2.0, 11.0, 25.0]))
# Duration, terminal power, its variance, heat, leakage.
INPUTS = st.tuples(st.one_of(st.floats(1.0, 300.0), st.floats(-300.0, -1.0)), st.floats(-9e4, 4e5),
                   st.floats(0.0, 1e9), st.floats(-4e3, 8e3), st.floats(0.0, 150.0))


def test_it_can_be_switched_off_and_on():
    use_core(False)
    try:
        assert (core(), core_in_words()) == (None, 'not used: switched off')
    finally:
        use_core(True)
    with without_core():
        use_core(True)
        assert core() is None
    assert core() is not None


@pytest.mark.parametrize('content, words', [
    (None, 'not used: package bev_preheat_core is not built'), (b'no library', 'cannot be loaded')])
def test_where_it_is_not_there_the_reason_is_said(tmp_path, monkeypatch, content, words):
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path / "other"}:{tmp_path}')
    if content is not None:
        (tmp_path / 'lib').mkdir()
        (tmp_path / 'lib' / library_module.FILE).write_bytes(content)
    library, problem = library_module.loaded_core.__wrapped__()
    assert library is None
    assert words in f'not used: {problem}'


def test_a_library_of_another_version_is_not_used(monkeypatch):
    path = core_in_words().removeprefix('used: ')
    monkeypatch.setattr(library_module, 'INTERFACE', 0)
    assert library_module.load_core(path) == (None, f'{path} is of another version')


def one_step(inputs):
    """Return the native trip of one step: duration, terminal power, its variance, heat, leakage."""
    given = dict(zip(
        ('duration_s', 'idle_power_w', 'power_variance_w2', 'idle_heat_w', 'leakage_w_per_k'), inputs))
    return NativeTrip(TripColumns.of_columns(*(
        np.array([0.0, given['duration_s']] if name == 'time_s' else [given.get(name, 0.0)])
        for name in TRIP_COLUMNS)))


def run_in_core(vehicle, make_integrator, soc, temperature_c, inputs):
    """Return charge and temperature after a step in the core; None if it declines."""
    states, native, trip = np.array([[soc, nan], [temperature_c, nan]]), NativeVehicle(vehicle), one_step(inputs)
    try:
        call('bev_run', native.address, INTEGRATORS[make_integrator], trip.address, 0, None, None,
             *rows_of(states))
    except Declined:
        return None
    return tuple(states[:, 1].tolist())


def run_in_python(step_of, soc, temperature_c, inputs):
    """Return charge and temperature after a step in Python, saturating if need be; None if they are no numbers."""
    for arithmetic in (FLOATS, SATURATING_FLOATS):
        try:
            ends = step_of(arithmetic)(soc, temperature_c, *inputs)[:2]
        except (ValueError, ArithmeticError):
            continue
        return ends if all(map(isfinite, ends)) else None
    return None


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('make_integrator', INTEGRATORS)
@pytest.mark.parametrize('vehicle', [FORMULAS, LOGARITHM, TABLES, *(
    replace(FORMULAS, battery=replace(FORMULAS.battery, resistance=curve)) for curve in CURVES)])
@given(soc=SOC, temperature_c=TEMPERATURE_C, inputs=INPUTS)
def test_steps_are_the_same(vehicle, make_integrator, soc, temperature_c, inputs):
    assert run_in_core(vehicle, make_integrator, soc, temperature_c, inputs) == run_in_python(
        lambda arithmetic: make_integrator(make_rates(vehicle, arithmetic)), soc, temperature_c, inputs)


def test_a_curve_of_another_kind_leaves_the_vehicle_to_python():
    class Flat:
        def function(self, arithmetic):
            return lambda soc, temperature_c: 0.11

    vehicle = replace(FORMULAS, battery=replace(FORMULAS.battery, resistance=Flat()))
    with pytest.raises(NotDescribed, match='Flat'):
        NativeVehicle(vehicle)
    with pytest.raises(Declined):
        vehicle_in_core(vehicle)
    _, route, state, *_ = drawn_situations.draw(3, 9)
    # U = 400 V, R = 0.11 ohm as a table that is the same everywhere.
    same = replace(vehicle, battery=replace(vehicle.battery, resistance=Table((0.5,), (0.0,), ((0.11,),))))
    ends = [run_forward(make_trip(each, route), make_runge_kutta_4, state.soc, 10.0)[1][-1]
            for each in (vehicle, same)]
    assert ends[0] == ends[1]


def test_more_factors_than_the_core_has_are_left_to_python():
    curve = FORMULAS.battery.resistance
    for factor in (1.1, 0.9, 1.2, 0.8, 1.05):
        curve = ScaledCurve(curve, factor)
    with pytest.raises(Declined):
        vehicle_in_core(replace(FORMULAS, battery=replace(FORMULAS.battery, resistance=curve)))


def trip_of_situation():
    vehicle, route, *_ = drawn_situations.draw(5, 12)
    return make_trip(replace(vehicle, heat_path=HeatPath()), route)


def status_of_run(trip, vehicle, integrator=2, first=0):
    states = np.full((2, len(trip.route) + 1), 0.5)
    return core().bev_run(vehicle, integrator, trip_in_core(trip).address, first, None, None, *map(place, states))


@pytest.mark.parametrize('field, value', [
    ('capacity_ah', 0.0), ('capacity_ah', nan), ('heat_capacity_j_per_k', -1.0), ('highest_c', nan),
    ('hottest_c', inf), ('heater_efficiency', 0.0), ('heat_share', nan), ('heater_lag_s', -1.0),
    ('coolant_heat_capacity_j_per_k', 5e3), ('coolant_conductance_w_per_k', nan)])
def test_an_impossible_number_of_the_vehicle_is_refused(field, value):
    native = NativeVehicle(FORMULAS)
    assert core().bev_check_vehicle(native.address) == 0
    setattr(native.struct, field, value)
    assert core().bev_check_vehicle(native.address) == -2
    # Nor is it run with.
    assert status_of_run(trip_of_situation(), native.address) == -2


def test_a_call_that_makes_no_sense_is_refused():
    trip = trip_of_situation()
    vehicle = vehicle_in_core(trip.vehicle).address
    assert status_of_run(trip, vehicle) == 0
    for arguments in (None, 2, 0), (vehicle, 2, -1), (vehicle, 2, len(trip.route) + 1), (vehicle, 3, 0):
        assert status_of_run(trip, *arguments) == -1, arguments


@pytest.mark.parametrize('make_integrator', [make_euler, make_midpoint, make_runge_kutta_4])
def test_arrays_of_any_layout_are_taken(make_integrator):
    trip = trip_of_situation()
    steps = len(trip.route)
    heater_w = np.linspace(0.0, 4e3, steps)
    strided = np.zeros((steps, 3))
    strided[:, 1] = heater_w
    frozen = heater_w.copy()
    frozen.flags.writeable = False
    whole = np.arange(steps)
    ends = [run_forward(trip, make_integrator, 0.8, -4.0, each)[1].tolist()
            for each in (heater_w, strided[:, 1], frozen)]
    assert ends[0] == ends[1] == ends[2]
    assert (run_forward(trip, make_integrator, 0.8, -4.0, whole)[1].tolist()
            == run_forward(trip, make_integrator, 0.8, -4.0, whole.astype(float))[1].tolist())


def test_an_axis_that_does_not_rise_is_refused():
    table = Table((0.1, 0.4, 0.4), (0.0,), ((1.0,), (2.0,), (3.0,)))
    native = NativeVehicle(replace(FORMULAS, battery=replace(FORMULAS.battery, resistance=table)))
    assert core().bev_check_vehicle(native.address) == -2


@pytest.mark.parametrize('column', ['duration_s', 'idle_power_w', 'idle_heat_w', 'leakage_w_per_k'])
def test_an_input_that_is_no_number_is_refused(column):
    trip = trip_of_situation()
    trip.columns.column(column)[0] = nan
    assert status_of_run(trip, vehicle_in_core(trip.vehicle).address) == -3
