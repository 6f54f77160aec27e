# SPDX-License-Identifier: Apache-2.0
"""The hot end of a charging session: active cooling, derating, polarization, and the answer "too warm"."""

from dataclasses import replace
import math

from hypothesis import given, settings, strategies
import numpy as np
from plain_car import drive, own_session, plain_car, same_session, stored_wh
import pytest
from refusals import problems_of
import yaml

from bev_preheat.charging.equations import make_cooling
from bev_preheat.charging.session import charge
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.charging.verdict import derating_in, too_warm
from bev_preheat.charging.worth_search import find_worth
from bev_preheat.numerics import FLOATS
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.charging import derated
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Cooling
from bev_preheat.vehicle.loading import vehicle_file, vehicle_of_text

CHILLER = Cooling(30.0, 1600.0, 4800.0, 2.5)
RADIATOR = replace(CHILLER, radiator_conductance_w_per_k=170.0)
LEVEL = Table((0.0, 1.0), (-20.0, 0.0, 25.0), ((-20e3, -60e3, -110e3), (-15e3, -40e3, -70e3)))


def hot_car(cooling=CHILLER, factor=1.0, resistance_ohm=0.11, leakage_w_per_k=9.0, limit=LEVEL, **changes):
    car = plain_car(resistance_ohm, leakage_w_per_k, limit, **changes)
    return replace(car, charging=replace(car.charging, cooling=cooling, polarization_factor=factor))


def a_stop(charger_w=105e3, departure_soc=0.85, ambient_c=24.0):
    return ChargingStop(charger_w, departure_soc, ambient_c, 700.0, 350.0)


# --- active cooling ---


def test_the_cooling_by_hand():
    powers = make_cooling(CHILLER, 24.0, FLOATS)
    assert powers(29.0, 50e3) == (0.0, 0.0)
    # A kelvin above the set point: two fifths of the band.
    assert powers(31.0, 50e3) == pytest.approx((640.0, 1920.0))
    assert powers(45.0, 50e3) == pytest.approx((1600.0, 4800.0))
    # The charger leaves 500 W.
    assert powers(45.0, 500.0) == pytest.approx((500.0, 1500.0))
    assert powers(45.0, -10.0) == (0.0, 0.0)
    through_air = make_cooling(RADIATOR, 24.0, FLOATS)
    assert through_air(33.0, 50e3) == pytest.approx((510.0, 1530.0))
    assert make_cooling(RADIATOR, 41.0, FLOATS)(40.0, 50e3) == (0.0, 0.0)
    assert make_cooling(None, 24.0, FLOATS)(60.0, 50e3) == (0.0, 0.0)


def test_a_heat_source_cools_at_the_charger_as_on_the_road():
    car = load_vehicle('heat_pump_car')
    powers = make_cooling(car.charging.cooling, 45.0, FLOATS)
    # Set point 35 degC, half of the band; 1.6 W of cold for each watt at 20 degC, 2.2 at 45.
    assert powers(36.0, 50e3) == pytest.approx((1500.0, 1500.0 * (1.6 + 0.6 * 16.0 / 25.0)))
    assert powers(34.0, 50e3) == (0.0, 0.0)
    stop = replace(a_stop(), ambient_c=38.0)
    cooled = charge(car, stop, BatteryState(44.0, 0.2))
    hot = charge(replace(car, charging=replace(car.charging, cooling=None)), stop, BatteryState(44.0, 0.2))
    assert cooled.cooling_power_w.max() == pytest.approx(3000.0)
    assert cooled.battery_temperature_c[-1] < hot.battery_temperature_c[-1] - 2.0


def test_a_chiller_with_steps_takes_no_more_than_the_highest():
    contents = yaml.safe_load(vehicle_file('heat_pump_car').read_text())
    contents['heat_sources']['chiller']['power_steps_w'] = [1000, 2000]
    cooling = vehicle_of_text(yaml.safe_dump(contents), 'the file').charging.cooling
    # Half of the band, and beyond it: 2.2 W of cold for each watt at 45 degC.
    assert make_cooling(cooling, 45.0, FLOATS)(36.0, 50e3)[0] == pytest.approx(1000.0)
    assert make_cooling(cooling, 45.0, FLOATS)(45.0, 50e3) == pytest.approx((2000.0, 4400.0))
    assert (cooling.electrical_power_w, cooling.cooling_power_w) == pytest.approx((2000.0, 2000.0 * 3.2))


@pytest.mark.parametrize('cooling, problem', [
    ({'heat_source': 'motor'}, ".heat_source: 'motor' is not allowed; it must be a source of heat_sources that "
                               'cools a standing car: chiller'),
    ({'heat_source': 'chiller', 'electrical_power_w': 2000},
     ': heat_source states the powers; set_point_c and proportional_band_k are allowed beside it'),
    ({'cooling_power_w': 4000}, ': needs electrical_power_w with either cooling_power_w, the heat flow '
                                'out of the battery, or coefficient_of_performance, its ratio to '
                                'electrical_power_w; or heat_source without these')],
    ids=['heats', 'twice', 'no power'])
def test_cooling_without_a_source_of_cold_is_refused(cooling, problem):
    contents = yaml.safe_load(vehicle_file('heat_pump_car').read_text())
    contents['charging']['cooling'] = {'set_point_c': 35, **cooling}
    assert problems_of(vehicle_of_text, yaml.safe_dump(contents), 'the file') == [
        f'the file: charging.cooling{problem}']


@pytest.mark.parametrize('cooling', [CHILLER, RADIATOR], ids=['chiller', 'radiator'])
@pytest.mark.parametrize('charger_w, start_c', [(105e3, 29.0), (60e3, 44.0)])
def test_a_cooled_session_is_that_of_an_own_fine_integration(cooling, charger_w, start_c):
    session = same_session(hot_car(cooling, 1.6), a_stop(charger_w), BatteryState(start_c, 0.1), 1e-4)
    assert session.energy_wh.cooling_electric > 10.0


@settings(max_examples=25, deadline=None)
@given(strategies.floats(26.0, 50.0), strategies.floats(200.0, 20e3), strategies.floats(0.5, 12.0),
       strategies.floats(0.5, 8.0), strategies.floats(2e3, 250e3), strategies.floats(-10.0, 45.0),
       strategies.floats(1.0, 4.0), strategies.booleans(), strategies.floats(1.0, 300.0))
def test_the_energies_of_a_cooled_session_balance(
        set_point_c, electrical_w, ratio, band_k, charger_w, ambient_c, factor, is_radiator, conductance):
    cooling = Cooling(set_point_c, electrical_w, ratio * electrical_w, band_k,
                      conductance if is_radiator else math.inf)
    car = hot_car(cooling, factor, heats=True, limit_c=25.0)
    session = charge(car, a_stop(charger_w, 0.6, ambient_c), BatteryState(33.0, 0.3))
    energy, course_c = session.energy_wh, session.battery_temperature_c
    # joule closes the heat balance by definition, so that of the energies is independent of it.
    assert energy.terminal - energy.joule == pytest.approx(
        stored_wh(car, session.soc, course_c), abs=2e-4 * energy.terminal + 1e-3)
    assert energy.bought == pytest.approx(
        energy.terminal + energy.hvch_electric + energy.cooling_electric + energy.cabin + energy.auxiliary)
    assert energy.cooling_heat == pytest.approx(ratio * energy.cooling_electric, rel=1e-9, abs=1e-9)
    assert min(energy.joule, energy.cooling_heat) >= -1e-9
    durations_s = np.diff(session.time_s)
    drawn_w = session.charging_power_w + session.hvch_battery_power_w + session.cooling_power_w
    assert (drawn_w <= charger_w - 1050.0 + 1e-6).all()
    assert float(durations_s @ session.cooling_power_w) / 3600.0 == pytest.approx(energy.cooling_electric)
    warmest_c = max(33.0, ambient_c)
    if is_radiator and ambient_c >= course_c.max():
        assert energy.cooling_heat == 0.0
    assert course_c.min() >= min(ambient_c, 25.0) - 0.5 and course_c.max() >= warmest_c - 40.0


def test_a_cooling_that_takes_all_the_power_for_ever_is_the_problem():
    """In air that is warmer than the cooling can bring the battery below, nothing is left for it."""
    weak = hot_car(replace(CHILLER, cooling_power_w=160.0, electrical_power_w=1600.0), leakage_w_per_k=20.0)
    never = charge(weak, a_stop(2200.0, 0.12, 48.0), BatteryState(45.0, 0.1))
    assert never.problem is not None and 'the cooling takes all the power' in never.problem


# --- derating ---


@given(strategies.floats(25.0, 50.0), strategies.floats(1.0, 20.0), strategies.floats(0.0, 1.0),
       strategies.floats(0.0, 12.0), strategies.floats(28.0, 59.0))
def test_more_derating_never_charges_faster(begins_c, width_k, middle, earlier_k, start_c):
    """Of a battery without resistance, whose temperature does not depend on its power."""
    def times_s(start_of_fall_c, middle_share):
        points = ((start_of_fall_c, start_of_fall_c + 0.5 * width_k, start_of_fall_c + width_k),
                  (1.0, middle_share, 0.0))
        car = plain_car(1e-9, 40.0, derated(LEVEL, *points))
        return charge(car, a_stop(ambient_c=5.0), BatteryState(start_c, 0.1)).charging_time_s

    mild, harder = times_s(begins_c, middle), times_s(begins_c - earlier_k, 0.7 * middle)
    assert harder >= mild * (1.0 - 1e-6)
    assert mild >= charge(plain_car(1e-9, 40.0, LEVEL), a_stop(ambient_c=5.0),
                          BatteryState(start_c, 0.1)).charging_time_s * (1.0 - 1e-6)


@pytest.mark.parametrize('name', ['reference', 'small_car', 'large_suv', 'mid_size_lfp', 'mid_size_suv'])
def test_no_battery_charges_beyond_its_highest_temperature(name):
    """From 60 degC in air of 40 degC the reference car charged with 150 kW up to 71.7 degC."""
    vehicle = load_vehicle(name)
    vehicle = replace(vehicle, charging=replace(vehicle.charging, maximum_inlet_power_w=math.inf))
    highest_c = vehicle.battery.temperature_range_c[1]
    session = charge(vehicle, ChargingStop(300e3, 0.5, 40.0, 0.0, 300.0), BatteryState(highest_c, 0.1))
    assert session.battery_temperature_c.max() <= highest_c + (5.0 if name == 'mid_size_lfp' else 1e-6)
    full_kw = -vehicle.charging.power_limit.function(FLOATS)(0.1, 30.0)
    assert session.charging_power_w.max() < 0.75 * full_kw
    assert derating_in(vehicle, ChargingStop(300e3, 0.5, 40.0, 0.0, 300.0), session) is not None


# --- too warm ---

FALLING, PRICES = derated(LEVEL, (38.0, 48.0), (1.0, 0.1)), Prices(0.4, 40.0)


def test_too_warm_is_an_answer_with_minutes_and_why():
    car, stop = hot_car(None, limit=FALLING, leakage_w_per_k=0.0), a_stop()
    session = charge(car, stop, BatteryState(43.0, 0.1))
    found = too_warm(car, stop, session)
    times_s = {at_c: own_session(car, stop, BatteryState(at_c, 0.1), 2.0).time_s
               for at_c in (43.0, found.fastest_c)}
    assert found.slower_s == pytest.approx(times_s[43.0] - times_s[found.fastest_c], rel=0.01)
    assert found.fastest_c < 38.0 and found.derating.above_c == 38.0
    hours, (minutes, seconds) = round(found.slower_s) // 3600, divmod(round(found.slower_s) % 3600, 60)
    assert found.sentence == (
        f'Too warm: arriving at 43 degC charges {hours}:{minutes:02d}:{seconds:02d} h slower than at '
        f'{found.fastest_c:.0f} degC, because the power is derated above 38 degC, from 10 % on.')


def test_cold_and_cooled_batteries_are_not_too_warm():
    for car, start_c, charger_w in ((hot_car(None, limit=FALLING), 5.0, 40e3),
                                    (hot_car(limit=FALLING), 33.0, 40e3),
                                    # The charger is weaker than the derated map.
                                    (hot_car(None, limit=FALLING), 40.0, 6e3)):
        stop = a_stop(charger_w=charger_w)
        assert too_warm(car, stop, charge(car, stop, BatteryState(start_c, 0.1))) is None


def test_the_worth_of_heating_says_where_it_gets_too_warm():
    car = hot_car(None, limit=derated(LEVEL, (28.0, 40.0), (1.0, 0.05)), resistance_ohm=0.15)
    worth = find_worth(car, drive(40, -2.0, 0.0), BatteryState(4.0, 0.5), Goal(25.0), 150e3, 0.8, PRICES)
    assert worth.best.target_c < 28.0
    assert 'because the power is derated above 28 degC' in worth.verdict
    hottest = max(worth.targets, key=lambda item: item.arrival_temperature_c)
    assert f'Arriving at {hottest.arrival_temperature_c:.0f} degC would ' in worth.verdict


def test_a_battery_that_arrives_too_warm_without_heating_is_told_so():
    car = hot_car(None, limit=FALLING, leakage_w_per_k=2.0)
    worth = find_worth(car, drive(40, 35.0, 0.0), BatteryState(44.0, 0.5), Goal(25.0), 150e3, 0.8, PRICES)
    assert worth.best is worth.without_heating
    assert worth.verdict.startswith('Not worth it') and 'Too warm: arriving at 4' in worth.verdict
