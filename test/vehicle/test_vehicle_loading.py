# SPDX-License-Identifier: Apache-2.0
"""Vehicle files: the vehicle from a good one, and the messages about bad ones."""

from dataclasses import replace

from mistakes import changed, GONE
import pytest
from refusals import problems_in, problems_of
import yaml

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.numerics import FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.charging import charging_of
from bev_preheat.vehicle.description import Ageing, Charging

GOOD = {
    'name': 'test car',
    'battery': {
        'capacity_ah': 111,
        'heat_capacity_j_per_k': 222000,
        'open_circuit_voltage': {'formula': {'polynomial_v': [300, 60, -20, 15]}},
        'resistance': {'formula': {'k_ohm_k': 5.5, 'reference_temperature_c': 48}},
        'power_limits': {
            'discharge': {'soc': [0.0, 0.4, 1.0], 'values': [1000, 50000, 90000]},
            'charge': {'temperature_c': [-20, 10], 'values': [-2000, -70000]}},
        'leakage': {'gamma_0_w_per_k': 31, 'gamma_v_w_per_k_per_mps': 0.7},
        'soc_range': [0.04, 0.97],
        'temperature_range_c': [-33, 57]},
    'drivetrain': {'efficiency': 0.91, 'heat_recovery_efficiency': 0.72,
                   'maximum_power_w': 123000},
    'hvch': {'maximum_power_w': 6500, 'efficiency': 0.86},
    'defaults': {'cabin_heating_power_w': 1234, 'auxiliary_power_w': 432,
                 'target_battery_temperature_c': 22},
}

VOLTAGE = 'battery.open_circuit_voltage'
RESISTANCE = 'battery.resistance'
DISCHARGE = 'battery.power_limits.discharge'
CHARGE = 'battery.power_limits.charge'
NO_COLD = ('has no temperature_c, so a cold battery would charge like a warm one and preheating would gain '
           'nothing; add the axis, or let preheat vehicle new --charging-curve combine the curve with the cold')
EVERYWHERE = 'over the whole soc_range and temperature_range_c'
AGEING = {'model': 'schimpe_2018', 'battery_price': 8000, 'age_years': 2.5, 'full_cycles': 150}
THERMAL = {'shell_share': 0.25, 'conductance_w_per_k': 300, 'sensor': 'shell'}


def written(folder, contents):
    """Return the path of a vehicle file with these contents (a dictionary, or the text itself)."""
    path = folder / 'car.yaml'
    text = contents if isinstance(contents, str) else yaml.safe_dump(contents)
    path.write_text(text, encoding='utf-8')
    return path


def problems_with(path):
    """Return the problems that load_vehicle finds in a file, without the leading file name."""
    return problems_in(f'{path}: ', load_vehicle, path)


def test_every_number_of_the_file_finds_its_place(tmp_path):
    vehicle = load_vehicle(written(tmp_path, GOOD))
    battery = vehicle.battery
    assert (
        vehicle.name, battery.capacity_ah, battery.capacity_as, battery.heat_capacity_j_per_k,
        battery.leakage.gamma_0_w_per_k, battery.leakage.gamma_v_w_per_k_per_mps,
        battery.soc_range, battery.temperature_range_c,
        vehicle.drivetrain.efficiency, vehicle.drivetrain.heat_recovery_efficiency,
        vehicle.drivetrain.maximum_power_w, vehicle.hvch.maximum_power_w, vehicle.hvch.efficiency,
        vehicle.defaults.cabin_heating_power_w, vehicle.defaults.auxiliary_power_w,
        vehicle.defaults.target_battery_temperature_c,
    ) == ('test car', 111.0, 399600.0, 222000.0, 31.0, 0.7, (0.04, 0.97), (-33.0, 57.0),
          0.91, 0.72, 123000.0, 6500.0, 0.86, 1234.0, 432.0, 22.0)


def test_what_the_car_does_at_a_charger_is_optional(tmp_path):
    assert load_vehicle(written(tmp_path, GOOD)).charging is None
    node = {'battery_heating': True, 'heating_limit_c': 18, 'maximum_inlet_power_w': 88000}
    vehicle = load_vehicle(written(tmp_path, changed(GOOD, 'charging', node)))
    assert replace(vehicle.charging, power_limit=None) == Charging(
        None, True, 18.0, 88e3, assumed_fall_c=vehicle.battery.temperature_range_c[1] - 5.0)
    assert vehicle.charging.heated_below_c == 18.0
    empty = load_vehicle(written(tmp_path, changed(GOOD, 'charging', {})))
    assert replace(empty.charging, power_limit=None, assumed_fall_c=None) == Charging(None)
    with pytest.raises(InvalidInput):
        charging_of(empty)
    aged = load_vehicle(written(tmp_path, changed(GOOD, 'charging', {**node, 'ageing': AGEING})))
    assert aged.charging.ageing == Ageing('schimpe_2018', 8000.0, 2.5, 150.0, 0.8)
    assert aged.charging.ageing.price == pytest.approx(40000.0)


def test_a_charge_limit_without_temperature_is_no_map_for_sessions(tmp_path):
    contents = changed(GOOD, 'battery.power_limits.charge', {'soc': [0, 1], 'values': [-70000, -2000]})
    contents.pop('charging', None)
    assert load_vehicle(written(tmp_path, contents)).charging is None
    contents['charging'] = {'battery_heating': False}
    assert problems_with(written(tmp_path, contents)) == [
        f'battery.power_limits.charge (there is no charging.power_limit): {NO_COLD}']


def test_a_shell_includes_the_coolant(tmp_path):
    contents = changed(GOOD, 'thermal', THERMAL)
    car = load_vehicle(written(tmp_path, contents))
    # A quarter of 222 kJ/K.
    assert (car.battery.heat_capacity_j_per_k, car.heat_path.coolant_heat_capacity_j_per_k) == (166.5e3, 55.5e3)
    contents['heat_path'] = {'coolant_heat_capacity_j_per_k': 15000, 'coolant_conductance_w_per_k': 400}
    assert problems_with(written(tmp_path, contents)) == [
        'heat_path.coolant_heat_capacity_j_per_k: 15000 J/K are not allowed beside thermal, whose shell includes '
        'the coolant; leave out both values of the coolant']


def test_reference_is_the_car_of_the_papers_table_1():
    car = load_vehicle('reference')
    most_w = car.battery.discharge_power_limit.function(FLOATS)(1.0, 40.0)
    least_w = car.battery.charge_power_limit.function(FLOATS)(0.0, 40.0)
    assert (car.battery.capacity_ah, car.drivetrain.maximum_power_w, most_w, least_w,
            car.defaults.auxiliary_power_w, car.defaults.cabin_heating_power_w,
            car.drivetrain.efficiency, car.drivetrain.heat_recovery_efficiency,
            car.hvch.efficiency) == (200.0, 350e3, 350e3, -150e3, 500.0, 1978.0, 0.9, 0.8, 0.87)


@pytest.mark.costly
@pytest.mark.parametrize('key, value, problem', [
    # Unknown and missing keys.
    ('hvch.eficiency', 0.9, "hvch: unknown key 'eficiency'; did you mean 'efficiency'? "
     'known keys: maximum_power_w, efficiency'),
    ('batery', {}, "the file: unknown key 'batery'; did you mean 'battery'? "
     'known keys: name, battery, drivetrain, hvch, heat_sources, heating_gates, heat_path, thermal, charging, '
     'defaults, road_load, uncertainty, assumed'),
    ('assumed', ['battery.resistanc'], "assumed[0]: 'battery.resistanc' is not a key of this file; did "
     "you mean 'battery.resistance'?"),
    ('assumed', ['hvch', 'hvch'], "assumed: contains 'hvch' twice"),
    # A key of the schema that this file does not have.
    ('assumed', ['road_load'], "assumed[0]: 'road_load' is not a key of this file; such as "
     'battery.resistance'),
    ('battery.cells_in_series', 96.5, 'battery.cells_in_series: 96.5 is not an integer'),
    ('drivetrain', GONE, 'the file: missing drivetrain'),
    ('battery.leakage', {}, 'battery.leakage: missing gamma_0_w_per_k, gamma_v_w_per_k_per_mps'),
    ('defaults.auxiliary_power_w', GONE, 'defaults: missing auxiliary_power_w'),
    # Wrong types.
    ('battery.capacity_ah', '111 Ah', "battery.capacity_ah: '111 Ah' is not a number"),
    ('name', 7, 'name: 7 is not a string; put it in quotes'),
    ('hvch', [6500, 0.9], 'hvch: [6500, 0.9] is not an object'),
    # Regeneration.
    ('drivetrain.maximum_regeneration_power_w', 123001, 'drivetrain.maximum_regeneration_power_w: '
     '123001 is above drivetrain.maximum_power_w, 123000'),
    # The heat path.
    *(('heat_path', {f'coolant_{name}': value}, f'heat_path: coolant_heat_capacity_j_per_k {capacity} beside '
       f'coolant_conductance_w_per_k {conductance} is not allowed; both must be above 0, or both 0')
      for name, value, capacity, conductance in (
          ('heat_capacity_j_per_k', 15000, 15000, 0), ('conductance_w_per_k', 400, 0, 400))),
    ('heat_path', {'coolant_heat_capacity_j_per_k': 15000, 'coolant_conductance_w_per_k': 0.5},
     'heat_path.coolant_conductance_w_per_k: 0.5 W/K take 30000 s for the heat of 15000 J/K; it '
     'must be at most 3600 s'),
    # In kilowatts.
    ('heating_gates', {'power_steps_w': [2, 5000]},
     'heating_gates.power_steps_w[0]: 2 is not allowed; it must be at least 50 and at most 50000'),
    # Two masses.
    # 0.25 * 0.75 * 222000 / 3600
    ('thermal', {**THERMAL, 'conductance_w_per_k': 11}, 'thermal.conductance_w_per_k: 11 W/K is not allowed; it '
     'must be at least 11.6 W/K, for a time constant between shell and core of at most 3600 s'),
    ('thermal', {**THERMAL, 'sensor': 'plate'}, "thermal.sensor: 'plate' is not one of shell, core, mean"),
    # The charger.
    ('charging', {'battery_heating': True}, 'charging: battery_heating needs heating_limit_c'
     ', the battery temperature up to which the car heats'),
    ('charging', {'battery_heating': True, 'heating_limit_c': 58}, 'charging.heating_limit_c: 58 is '
     'outside battery.temperature_range_c -33 ... 57'),
    ('charging', {'power_limit': {'temperature_c': [-20, 10], 'values': [2000, 70000]}},
     f'charging.power_limit: 2000 W at soc 0.04 and -33 degC; it must be -2000000 ... 0 W {EVERYWHERE}'),
    ('charging', {'power_limit': {'soc': [0, 1], 'values': [-70000, -2000]}},
     f'charging.power_limit: {NO_COLD}'),
    # Values that are not numbers.
    (f'{DISCHARGE}.values', [1000, float('nan'), 90000],
     f'{DISCHARGE}.values[1]: nan is not a finite number'),
    # Out of range.
    ('hvch.efficiency', 1.2,
     'hvch.efficiency: 1.2 is not allowed; it must be above 0 and at most 1'),
    ('battery.soc_range', [4, 97], None),
    ('battery.temperature_range_c', [-33, 0, 57],
     'battery.temperature_range_c: has 3 values; it must have at most 2'),
    # Axes.
    ('battery.soc_range', [0.97, 0.04], 'battery.soc_range: [0.97, 0.04] must rise'),
    ('battery.temperature_range_c', [22, 22], 'battery.temperature_range_c: [22, 22] must rise'),
    (f'{DISCHARGE}.soc', [0.0, 0.4, 0.4],
     f'{DISCHARGE}.soc: [0.0, 0.4, 0.4] must rise from point to point'),
    (f'{CHARGE}.temperature_c', [10, -20],
     f'{CHARGE}.temperature_c: [10.0, -20.0] must rise from point to point'),
    # Shapes of tables.
    (f'{DISCHARGE}.values', [1000, 50000],
     f'{DISCHARGE}.values: must have 3 values, one for each point of its axes'),
    (CHARGE, {'soc': [0.1, 0.9], 'temperature_c': [-20, 0, 10],
              'values': [[-1, -2, -3], [-4, -5]]},
     f'{CHARGE}.values: must have 2 x 3 values, one for each point of its axes'),
    (CHARGE, {'soc': [0.1, 0.9], 'temperature_c': [-20, 0], 'values': [-1, -2]},
     f'{CHARGE}.values: must have 2 x 2 values, one for each point of its axes'),
    (CHARGE, {'values': [-1, -2]},
     f'{CHARGE}: must have at least 2 of: soc, temperature_c, values'),
    # A formula or a table.
    (f'{VOLTAGE}.table', {'soc': [0.0, 1.0], 'values': [300, 400]},
     f'{VOLTAGE}: must have only 1 of: formula, table'),
    (RESISTANCE, {}, f'{RESISTANCE}: must have at least 1 of: formula, table'),
    # Impossible values: 0 V at soc 0.04; 5.5/(-33 + 33) ohm; limits of the wrong sign.
    (f'{VOLTAGE}.formula.polynomial_v', [-4, 100], f'{VOLTAGE}: 0 V at soc 0.04 and -33 degC; it '
     f'must be 10 ... 2000 V {EVERYWHERE}'),
    ('name', 'x' * 10_000, 'name: has 10000 characters; it must have at most 100'),
    (f'{RESISTANCE}.formula.reference_temperature_c', 33, f'{RESISTANCE}: inf ohm at soc 0.04 and '
     f'-33 degC; it must be 1e-06 ... 100 ohm {EVERYWHERE}'),
    (f'{DISCHARGE}.values', [-1000, -1000, 90000], f'{DISCHARGE}: -1000 W at soc 0.04 and -33 '
     f'degC; it must be 0 ... 2000000 W {EVERYWHERE}'),
    (f'{CHARGE}.values', [2000, 70000], f'{CHARGE}: 2000 W at soc 0.04 and -33 degC; it must be '
     f'-2000000 ... 0 W {EVERYWHERE}'),
    # Between the points of any even grid, at a single point of the table.
    (RESISTANCE, {'table': {'soc': [0.0, 0.5, 0.501, 0.502, 1.0],
                            'values': [0.2, 0.2, -0.1, 0.2, 0.2]}},
     f'{RESISTANCE}: -0.1 ohm at soc 0.501 and -33 degC; it must be 1e-06 ... 100 ohm '
     f'{EVERYWHERE}'),
    (VOLTAGE, {'table': {'soc': [0.0, 0.5, 0.501, 0.502, 1.0],
                         'values': [300, 350, 345, 350, 400]}},
     f'{VOLTAGE}: falls from 350 V at soc 0.5 to 345 V at soc 0.501; it must not fall with soc'),
    # The voltage falls from the start: 400 - 50 soc, a fortieth of the range further on.
    (f'{VOLTAGE}.formula.polynomial_v', [400, -50], f'{VOLTAGE}: falls from 398 V at soc 0.04 to '
     '396.837 V at soc 0.06325; it must not fall with soc'),
    # 22.2 kJ/K / (1000 W/K + 40 m/s * 50 W/K per m/s) = 7.4 s
    ('battery', {**GOOD['battery'], 'heat_capacity_j_per_k': 22200, 'leakage': {
        'gamma_0_w_per_k': 1000, 'gamma_v_w_per_k_per_mps': 50}},
     'battery.heat_capacity_j_per_k: 22200 J/K with a leakage of 3000 W/K at 40 m/s is a battery '
     'that cools within 7.4 s; it must be at least 20 s'),
    # The default target.
    ('defaults.target_battery_temperature_c', 58, 'defaults.target_battery_temperature_c: 58 is '
     'outside battery.temperature_range_c -33 ... 57'),
    ('defaults.target_battery_temperature_c', -34, 'defaults.target_battery_temperature_c: -34 is '
     'outside battery.temperature_range_c -33 ... 57'),
])
def test_refused_in_words(tmp_path, key, value, problem):
    expected = [problem] if problem else [
        f'battery.soc_range[{i}]: {number} is not allowed; it must be at least 0 and at most 1'
        for i, number in enumerate(value)]
    assert problems_with(written(tmp_path, changed(GOOD, key, value))) == expected


@pytest.mark.parametrize('text', [
    'name: &itself [*itself]', 'battery: &itself {capacity_ah: *itself}'], ids=['list', 'mapping'])
def test_values_that_contain_themselves_are_nested_too_deeply(tmp_path, text):
    assert problems_with(written(tmp_path, text)) == ['cannot be read: its values are nested too deeply']


def test_file_that_may_not_be_read(tmp_path, monkeypatch):
    path = written(tmp_path, GOOD)

    def refuse(*arguments, **kwargs):
        raise PermissionError(13, 'Permission denied')

    # Root may read a file without permission.
    monkeypatch.setattr('builtins.open', refuse)
    assert problems_with(path) == ['cannot be read: Permission denied']


KNOWN = ', '.join(sorted(path.stem for path in configuration_folder('vehicles').iterdir()))


@pytest.mark.parametrize('name, problem', [
    ('no/such/car', 'no/such/car: no such file'), ('car.yaml', 'car.yaml: no such file'),
    ('referense', f"vehicle 'referense' is unknown; did you mean 'reference'?; known: {KNOWN}; or give a file "),
    ('zeppelin', f"vehicle 'zeppelin' is unknown; known: {KNOWN}; or give a file ")])
def test_a_vehicle_that_is_not_there_is_named(tmp_path, monkeypatch, name, problem):
    monkeypatch.chdir(tmp_path)
    (found,) = problems_of(load_vehicle, name)
    assert found.startswith(problem)
