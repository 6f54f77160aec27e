# SPDX-License-Identifier: Apache-2.0
"""Key figures of a vehicle file, by hand, and warnings about unusual ones."""

from mistakes import changed
import pytest
import yaml

from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.plausibility import meaning_of

# 360 V at all states of charge: every figure below can be checked by hand.
PLAIN = {
    'name': 'plain',
    'battery': {
        'capacity_ah': 150, 'heat_capacity_j_per_k': 400000, 'cells_in_series': 100,
        'open_circuit_voltage': {'formula': {'polynomial_v': [360]}},
        'resistance': {'table': {'temperature_c': [-20, 0, 25], 'values': [0.21, 0.12, 0.06]}},
        'power_limits': {
            'discharge': {'temperature_c': [-20, 25], 'values': [40000, 130000]},
            'charge': {'temperature_c': [-10, 0, 10, 25],
                       'values': [-12000, -30000, -55000, -110000]}},
        'leakage': {'gamma_0_w_per_k': 30, 'gamma_v_w_per_k_per_mps': 0.9},
        'soc_range': [0.1, 0.9], 'temperature_range_c': [-35, 50]},
    'drivetrain': {'efficiency': 0.9, 'heat_recovery_efficiency': 0.5, 'maximum_power_w': 120000},
    'hvch': {'maximum_power_w': 6000, 'efficiency': 0.8},
    'defaults': {'cabin_heating_power_w': 2000, 'auxiliary_power_w': 400,
                 'target_battery_temperature_c': 25},
}


@pytest.fixture
def plain(tmp_path):
    """Load the plain car with some keys changed."""
    def load(changes=()):
        contents = PLAIN
        for place, value in dict(changes).items():
            contents = changed(contents, place, value)
        file = tmp_path / 'car.yaml'
        file.write_text(yaml.safe_dump(contents))
        return load_vehicle(file)
    return load


def test_figures_by_hand(plain):
    meaning = meaning_of(plain())
    # 360 V * 150 Ah * 0.8
    assert (meaning.energy_kwh, meaning.nominal_voltage_v) == pytest.approx((43.2, 360.0))
    fast_w_per_k = 30.0 + 0.9 * 100.0 / 3.6
    assert meaning.resistance_ohm == {-20.0: 0.21, 0.0: 0.12, 25.0: 0.06}
    # 0.06 ohm * 150 A of 360 V
    assert meaning.one_hour_drop == pytest.approx(0.025)
    assert meaning.heat_capacity_kj_per_k_kwh == pytest.approx(400.0 / 43.2)
    assert meaning.time_constant_h == pytest.approx(400e3 / 30.0 / 3600.0)
    assert meaning.time_constant_at_100_kmh_h == pytest.approx(400e3 / fast_w_per_k / 3600.0)
    assert meaning.most_charging_power_kw == 110.0
    assert meaning.charging_power_kw[0.0] == {0.2: 30.0, 0.5: 30.0, 0.8: 30.0}
    # A ninth of the way from 20 to 25 degC is a fifth of 45 K from -20 degC.
    assert meaning.discharging_power_kw[-10.0] == pytest.approx(40.0 + 90.0 * 10.0 / 45.0)


@pytest.mark.parametrize('changes, warning', [
    ({'battery.capacity_ah': 15}, 'energy: 4.32 kWh; the usual range is 5 ... 1000 (capacity_ah times the '
     'open-circuit voltage)'),
    ({'battery.heat_capacity_j_per_k': 40000}, 'heat capacity: 0.926 kJ/K for each kWh; the usual range is '
     '3 ... 13 (about 1 kJ/(kg K) times the mass of the pack)'),
    ({'battery.cells_in_series': 300}, 'open-circuit voltage: 1.20 V a cell at soc 0.1 with 300 '
     'cells in series; the usual range is 2.5 ... 4.3 V'),
    ({'battery.resistance': {'table': {'temperature_c': [-20, 25], 'values': [0.05, 0.06]}}},
     'resistance: rises from 0.05 ohm at -20 degC to 0.0502 ohm at -19 degC; battery resistance '
     'falls with temperature'),
    ({'battery.resistance': {'table': {'temperature_c': [-20, 25], 'values': [12.0, 6.0]}}},
     'voltage drop at the one-hour current: 250 % at 25 degC; the usual range is 0.5 ... 10 (resistance in '
     'ohm, of the whole pack)'),
    ({'battery.resistance': {'table': {'temperature_c': [-20, 25], 'values': [0.061, 0.06]}}},
     'resistance at -20 degC: 1.02 times that at 25 degC; the usual range is 1.3 ... 15 (cold batteries have '
     'several times that value)'),
    ({'battery.leakage': {'gamma_0_w_per_k': 30, 'gamma_v_w_per_k_per_mps': 9.0}},
     'leakage: 280 W/K at 100 km/h is more than 8 times the 30 W/K at rest; is '
     'gamma_v_w_per_k_per_mps per km/h?'),
    ({'battery.leakage': {'gamma_0_w_per_k': 0.1, 'gamma_v_w_per_k_per_mps': 0.0}},
     'thermal time constant at rest: 1.11e+03 h; the usual range is 0.5 ... 40 (heat capacity over leakage)'),
    ({'hvch.maximum_power_w': 60.0}, 'heating: -0.37 K in 10 min at full heater power; the usual range is '
     '1 ... 40 (heater power in W over heat capacity)'),
    ({'battery.power_limits.charge': {'temperature_c': [-10, 25], 'values': [-300e3, -600e3]}},
     'charge limit: 13.9 kW for each kWh (at most 600 kW); the usual range is 0.15 ... 6 (power in W, '
     'negative)'),
    ({'battery.power_limits.charge': {'temperature_c': [-10, 25], 'values': [-90e3, -110e3]}},
     'charge limit: 90 kW at -10 degC and soc 0.2, but 110 kW at 25 degC; cold batteries usually '
     'accept less than 50 %; otherwise preheating gains little'),
    ({'drivetrain.maximum_power_w': 200000}, 'discharge limit: 130 kW at 25 degC and soc 0.8 for a '
     'drivetrain of 200 kW; a warm battery usually delivers the full drivetrain power')])
def test_what_is_unusual_is_said_with_its_figure(plain, changes, warning):
    assert warning in meaning_of(plain(changes)).warnings


def test_a_formula_is_not_asked_outside_of_the_range_of_its_file(plain):
    """At -20 degC this formula would be negative."""
    vehicle = plain({'battery.temperature_range_c': [-5, 50], 'battery.resistance': {
        'formula': {'k_ohm_k': 2.5, 'reference_temperature_c': 15}}})
    assert meaning_of(vehicle).resistance_ohm == pytest.approx({0.0: 2.5 / 15, 25.0: 2.5 / 40})


def test_the_path_of_the_heat_is_said_in_words(plain):
    assert meaning_of(plain()).heat_path == ('The heat of the heater arrives at once, and the sensor shows it.')
    # 0.8 * 6 kW / 400 W/K = 12 K; (40 s + 20 kJ/K / 400 W/K) * 6 kW = 150 Wh.
    path = {'heater_lag_s': 40, 'coolant_heat_capacity_j_per_k': 20000,
            'coolant_conductance_w_per_k': 400, 'sensor_lag_s': 25}
    assert meaning_of(plain({'heat_path': path})).heat_path == (
        'The heater follows its command with a time constant of 40 s; the coolant passes its heat '
        'on with a time constant of 50 s and gets 12 K warmer than the battery at full heater power; 150 Wh are '
        'still under way when the heater is switched off at full power; heat that arrives after the '
        'drive is lost; the sensor follows the battery with a time constant of 25 s.')
    assert meaning_of(plain({'heat_path': {'sensor_lag_s': 25}})).heat_path == (
        'The heat of the heater arrives at once; the sensor follows the battery with a time '
        'constant of 25 s.')


@pytest.mark.parametrize('charging, words', [
    (None, 'The file does not say whether the car heats its battery while it charges '
     '(charging.battery_heating); only charging sessions need it.'),
    ({'maximum_inlet_power_w': 100000}, 'The file does not say whether the car heats its battery while '
     'it charges (charging.battery_heating); only charging sessions need it.'),
    ({'battery_heating': False, 'maximum_inlet_power_w': 100000}, 'While it charges the car does not '
     "heat its battery; its inlet takes at most 100 kW; the charging power is limited by the battery's "
     'charge limit. The power of a hot battery is not stated: it is assumed to fall to 0 over the last 5 K up to '
     '50 degC (charging.hot_derating states it). Its battery is not cooled there.'),
    ({'battery_heating': True, 'heating_limit_c': 18.5,
      'power_limit': {'temperature_c': [0, 20], 'values': [-10e3, -90e3]}}, 'While it charges the car '
     'can heat its battery up to 18.5 degC with the heater power left by the cabin, 4.0 kW; its inlet is not '
     'limited; the charging power is limited by a map of its own. The power of a hot battery is not stated: it is '
     'assumed to fall to 0 over the last 5 K up to 50 degC (charging.hot_derating states it). Its battery is not '
     'cooled there.'),
    ({'battery_heating': False, 'polarization_factor': 1.7, 'hot_derating': {
        'temperature_c': [38, 49], 'share': [1, 0]}, 'cooling': {
            'set_point_c': 33, 'electrical_power_w': 1500, 'coefficient_of_performance': 3,
            'radiator_conductance_w_per_k': 210}}, (
                'While it charges the car does not heat its battery; its inlet is not limited; the charging power '
                "is limited by the battery's charge limit. The power of a hot battery falls from 38 degC on. In a "
                'session its resistance is 1.7 times that of battery.resistance. Above 33 degC it cools its '
                'battery with up to 4.5 kW, at most 210 W for each kelvin above the air, for 1.5 kW from the '
                'charger.'))])
def test_what_the_car_does_at_a_charger_in_words(plain, charging, words):
    assert meaning_of(plain({} if charging is None else {'charging': charging})).charging == words
