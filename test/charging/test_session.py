# SPDX-License-Identifier: Apache-2.0
"""The charging session: closed forms, balances, an independent integration, endless sessions."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from plain_car import (
    CAPACITY_AH,
    HEAT_CAPACITY_J_PER_K,
    HEATER_EFFICIENCY,
    HEATER_W,
    plain_car,
    same_session,
    stored_wh,
    VOLTAGE_V,
)
import pytest
from refusals import problems_of

from bev_preheat.charging.session import charge, HELD_STEPS, LONGEST_SESSION_S
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.planning.situation import BatteryState
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import HeatPath

REFERENCE, SMALL = load_vehicle('reference'), load_vehicle('small_car')
# -10 degC outside, 1.2 kW for the cabin, 300 W of auxiliaries.
STOP = ChargingStop(60e3, 0.8, -10.0, 1200.0, 300.0)
LATE = replace(REFERENCE, heat_path=HeatPath(45.0, 25e3, 250.0))

SUPPLY_W = 60e3 - 1500.0


def test_heating_warms_in_closed_form_up_to_the_limit_and_holds_there():
    leakage = 100.0
    session = charge(plain_car(leakage_w_per_k=leakage, heats=True),
                     replace(STOP, charger_power_w=20e3), BatteryState(2.0, 0.25))
    heater_w = HEATER_W - 1200.0
    settled_c = -10.0 + HEATER_EFFICIENCY * heater_w / leakage
    reached_s = HEAT_CAPACITY_J_PER_K / leakage * math.log((settled_c - 2.0) / (settled_c - 22.0))
    on = session.time_s <= reached_s
    assert session.battery_temperature_c[on] == pytest.approx(
        settled_c - (settled_c - 2.0) * np.exp(
            -leakage * session.time_s[on] / HEAT_CAPACITY_J_PER_K), abs=1e-6)
    assert session.battery_temperature_c[~on] == pytest.approx(
        np.full((~on).sum(), 22.0), abs=1e-5)
    # From there on the leakage at 32 K is replaced.
    holding_w = leakage * 32.0 / HEATER_EFFICIENCY
    assert session.hvch_battery_power_w[-1] == pytest.approx(holding_w, rel=1e-4)
    # The battery gets the power that the heater leaves: 18.5 kW less 4.8 kW, then less 3.76 kW.
    stored = VOLTAGE_V * CAPACITY_AH * 0.55 - (18500.0 - heater_w) * reached_s / 3600.0
    assert session.charging_time_s == pytest.approx(
        reached_s + 3600.0 * stored / (18500.0 - holding_w), rel=1e-5)


def test_the_inlet_limits_what_the_charger_could_give():
    weaker, limited = (charge(plain_car(inlet_w=inlet_w), replace(STOP, charger_power_w=charger_w),
                              BatteryState(5.0, 0.25))
                       for inlet_w, charger_w in ((math.inf, 40e3), (40e3, 400e3)))
    assert limited.charging_time_s == weaker.charging_time_s
    assert limited.bought_energy_wh == pytest.approx(40e3 * limited.charging_time_s / 3600.0)


def test_constant_power_through_a_resistance():
    ohm = 0.2
    session = charge(plain_car(resistance_ohm=ohm), STOP, BatteryState(5.0, 0.25))
    current_a = (math.sqrt(VOLTAGE_V**2 + 4.0 * ohm * SUPPLY_W) - VOLTAGE_V) / (2.0 * ohm)
    seconds = 3600.0 * CAPACITY_AH * 0.55 / current_a
    assert session.charging_time_s == pytest.approx(seconds, rel=1e-9)
    assert session.battery_temperature_c[-1] == pytest.approx(
        5.0 + ohm * current_a**2 * seconds / HEAT_CAPACITY_J_PER_K, rel=1e-9)
    assert session.energy_wh.joule == pytest.approx(ohm * current_a**2 * seconds / 3600.0, rel=1e-9)


@pytest.mark.parametrize('vehicle, charger_w, state', [
    (REFERENCE, 150e3, BatteryState(-5.0, 0.2)), (REFERENCE, 50e3, BatteryState(12.0, 0.33)),
    (SMALL, 100e3, BatteryState(1.0, 0.15)), (LATE, 22e3, BatteryState(15.0, 0.3, 1000.0, 2.0))],
    ids=['150 kW, cold', '50 kW, held at the limit', 'no heating', 'late heat'])
def test_a_session_is_that_of_an_own_fine_integration(vehicle, charger_w, state):
    same_session(vehicle, ChargingStop(charger_w, 0.62, -9.0, 1700.0, 450.0), state, 2e-4)


@given(name=st.sampled_from(['reference', 'small', 'late heat']), charger_w=st.floats(3e3, 400e3),
       temperature_c=st.floats(-25.0, 45.0), soc=st.floats(0.05, 0.9), more=st.floats(0.0, 0.5),
       ambient_c=st.floats(-30.0, 40.0), cabin_w=st.floats(0.0, 4e3))
def test_energy_is_kept_and_no_limit_is_broken(
        name, charger_w, temperature_c, soc, more, ambient_c, cabin_w):
    vehicle = {'reference': REFERENCE, 'small': SMALL, 'late heat': replace(
        REFERENCE, heat_path=HeatPath(40.0, 20e3, 700.0))}[name]
    stop = ChargingStop(charger_w, min(0.98, soc + more), ambient_c, cabin_w, 350.0)
    session = charge(vehicle, stop, BatteryState(temperature_c, soc), step_s=60.0)
    energy, hours = session.energy_wh, session.time_s[-1] / 3600.0
    # The heat balance closes the energies; it does not check that the rest of the terminals' energy is charge, nor
    # the charger's limit.
    assert energy.stored == pytest.approx(stored_wh(
        vehicle, session.soc, session.battery_temperature_c), rel=1e-4, abs=0.5)
    assert energy.joule >= -1e-6
    assert energy.bought == pytest.approx(
        energy.terminal + energy.hvch_electric + hours * (cabin_w + 350.0), rel=1e-12)
    # A heater with lag may briefly take the battery's share.
    assert energy.bought <= hours * max(charger_w, cabin_w + 350.0) + 100.0 * (name == 'late heat') + 1e-6
    assert session.charging_power_w.min(initial=0.0) >= 0.0
    most_w = max(0.0, vehicle.hvch.maximum_power_w - cabin_w)
    assert session.hvch_battery_power_w.max(initial=0.0) <= most_w + 1e-6
    assert (np.diff(session.time_s) > 0.0).all() and (np.diff(session.soc) >= 0.0).all()
    # A step that holds the temperature is longer.
    assert session.time_s[-1] <= LONGEST_SESSION_S + HELD_STEPS * 60.0
    assert (session.soc[-1] == pytest.approx(stop.departure_soc, abs=1e-9)) == (not session.problem)


@pytest.mark.parametrize('vehicle, stop, temperature_c, problem', [
    (SMALL, replace(STOP, ambient_c=-25.0), -22.0,
     'at 30.0 % and -22.0 degC the battery takes less than 50 W'),
    (REFERENCE, replace(STOP, charger_power_w=1400.0), 10.0,
     'cabin and auxiliaries take all of the 1.4 kW that charger and inlet provide'),
    # 500 W of 2 kW are left for the heater: 435 W of heat against 34.9 W/K.
    (REFERENCE, replace(STOP, charger_power_w=2000.0), -10.0,
     'at 30.0 % and -10.0 degC the heater takes all the power that is left, and the battery gets no '
     'warmer than 2.5 degC'),
    (plain_car(limit=Table((0.0,), (0.0, 20.0), ((0.0, -9e4),)), leakage_w_per_k=900.0, heats=True),
     STOP, -10.0, 'at 30.0 % and -10.0 degC the battery takes less than 50 W, and the battery gets no '
     'warmer than -5.5 degC')], ids=['too cold', 'eaten by the cabin', 'eaten by the heater', 'leaks'])
def test_a_session_that_cannot_begin_says_why(vehicle, stop, temperature_c, problem):
    session = charge(vehicle, stop, BatteryState(temperature_c, 0.3))
    assert session.problem == problem
    assert (session.charging_time_s, session.bought_energy_wh) == (math.inf, math.inf)
    assert len(session.time_s) == 1


def test_a_session_of_more_than_a_day_ends():
    session = charge(plain_car(), replace(STOP, charger_power_w=1700.0), BatteryState(5.0, 0.25), 300.0)
    # 200 W * 24 h of 42 kWh
    assert session.problem == f'the battery has only {25.0 + 480.0 / 42.0:.1f} % after 24 h'


NAN = math.nan


@pytest.mark.parametrize('changes, state, problem', [
    ({'charger_power_w': NAN}, (5.0, 0.2), 'charger power: nan is not allowed; it must be 1000 ... '
     '2000000 W'),
    ({'charger_power_w': 150.0}, (5.0, 0.2), 'charger power: 150 is not allowed; it must be 1000 ... '
     '2000000 W'),
    ({'departure_soc': 1.1}, (5.0, 0.2), 'departure state of charge: 1.1 is not allowed; it must be '
     "0.05 ... 1 (the vehicle's soc_range)"),
    ({'departure_soc': 0.3}, (5.0, 0.41239), 'departure state of charge: 0.3 is below the 0.412 that '
     'the battery arrives with; it must be at least that'),
    ({'ambient_c': -41.0}, (5.0, 0.2), 'ambient temperature: -41 is not allowed; it must be -40 ... 60 '
     'degC'),
    ({'cabin_heating_power_w': -1.0}, (5.0, 0.2), 'cabin heating power: -1 is not allowed; it must be '
     '0 ... 50000 W'),
    ({'auxiliary_power_w': NAN}, (5.0, 0.2), 'auxiliary power: nan is not allowed; it must be 0 ... '
     '50000 W'),
    ({}, (NAN, 0.2), 'battery temperature: nan is not allowed; it must be -40 ... 60 degC, the range of '
     "the vehicle's battery"),
    ({}, (5.0, NAN), 'state of charge: nan is not allowed; it must be 0 ... 1')])
def test_refused_in_words(changes, state, problem):
    assert problems_of(charge, REFERENCE, replace(STOP, **changes), BatteryState(*state)) == [problem]
