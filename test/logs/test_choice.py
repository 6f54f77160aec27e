# SPDX-License-Identifier: Apache-2.0
"""Channels of a log that become a signal: by quantity and kind, never a counter or current as a temperature."""

import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.choice import candidates
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.signal_map import load_signal_map

COMMON = load_signal_map('common').sources


def chosen(signal, **units):
    groups = candidates(COMMON[signal], {name.replace('__', '.'): unit for name, unit in units.items()}).groups
    return groups[0] if groups else ()


@pytest.mark.parametrize('signal, units, expected', [
    ('battery_temperature_c', {'Bat__BatTemp': 'degC', 'Bat__BatTempAlive': '', 'Bat__BatTempCrc': ''},
     ('Bat.BatTemp',)),
    ('battery_temperature_c', {'Bat__BatTemp': '', 'Bat__BatTempRollingCounter': '', 'Bat__BatTempQBit': ''},
     ('Bat.BatTemp',)),
    ('battery_temperature_c', {'Bat__BatTempX': '', 'Bat__BatTempMin': 'degC', 'Bat__BatTempMax': 'degC'},
     ('Bat.BatTempMin', 'Bat.BatTempMax')),
    ('battery_temperature_c', {'BatTempQ': '', 'BatTempCS': '', 'BatTempMaxPos': ''}, ()),
    ('battery_temperature_c', {'PackTemps__Fan': '', 'PackTemps__PackTemp': ''}, ('PackTemps.PackTemp',)),
    ('battery_temperature_c', {'Bus__BattCurrent12': 'ampere', 'Bus__BattTemp': 'degC'}, ('Bus.BattTemp',)),
    ('battery_temperature_c', {'Batt_T1': '', 'Batt_T2': '', 'Batt_T10': ''}, ('Batt_T1', 'Batt_T2', 'Batt_T10')),
    ('battery_temperature_c', {'BattTempMin': 'degC', 'BattTempMax': 'degC'}, ('BattTempMin', 'BattTempMax')),
    ('battery_temperature_c', {'car1_battery_temp': '', 'car2_battery_temp': ''}, ('car1_battery_temp',)),
    # A name that ends like a unit has none.
    ('battery_temperature_c', {'battery_temp_min': 'minute', 'battery_temp_max': ''},
     ('battery_temp_min', 'battery_temp_max')),
    ('battery_temperature_c', {'Battery temp (min)': 'minute', 'Battery temp (max)': ''},
     ('Battery temp (min)', 'Battery temp (max)')),
    ('battery_temperature_c', {'battery temp %': 'percent', 'battery temp': ''}, ('battery temp',)),
    ('soc', {'A__BatSOC_cold': 'percent', 'A__BatSOC': 'percent'}, ('A.BatSOC',)),
    ('battery_temperature_c', {'Battery fan temp': '', 'Battery charger temp': '', 'BMS PCB temp': ''}, ()),
    ('battery_temperature_c', {'Battery temp delta': '', 'Cell temp 1': '', 'Cell temp 2': ''},
     ('Cell temp 1', 'Cell temp 2')),
    ('speed_mps', {'Average speed': '', 'Max speed': '', 'Blower speed': ''}, ()),
    ('soc', {'12V SOC': '', 'Min SOC': '', 'Display SOC': ''}, ('Display SOC',)),
    ('current_a', {'battery charge current': 'ampere', 'battery discharge current': 'ampere'}, ()),
    ('current_a', {'Battery Charge/Discharge Current': 'ampere'}, ('Battery Charge/Discharge Current',)),
    ('current_a', {'HV battery current (negative = charging)': ''}, ('HV battery current (negative = charging)',)),
    ('power_w', {'Batterie Ladeleistung': '', 'Battery regen power': '', 'Battery peak power': '',
                 'Battery power': ''}, ('Battery power',)),
    ('battery_temperature_c', {'Pack temp goal': 'degC', 'Battery temp desired': 'degC'}, ()),
    ('speed_mps', {'Cruise control speed': '', 'v_Veh': ''}, ('v_Veh',)),
    # As apps name the standard's PID 0x5B.
    ('soc', {'Hybrid battery pack remaining life': 'percent'}, ('Hybrid battery pack remaining life',)),
    ('soc', {'Hybrid/EV battery pack remaining charge (%)': 'percent', 'Remaining range (%)': 'percent'},
     ('Hybrid/EV battery pack remaining charge (%)',)),
    ('soc', {'Battery Temp [%]': 'percent'}, ()), ('soc', {'Battery [%]': 'percent'}, ('Battery [%]',)),
    ('soc', {'Pack_SOC__Mean292': 'percent'}, ('Pack_SOC.Mean292',)),
    ('voltage_v', {'B__BattVoltLink': 'volt', 'B__BattVolt': 'volt'}, ('B.BattVolt',)),
    ('voltage_v', {'BMS__BMS_U_Batt': 'volt', 'U_batt_max': 'volt'}, ('BMS.BMS_U_Batt',)),
    ('current_a', {'I_batt': '', 'I_batt_max': '', 'HV_I_limit': ''}, ('I_batt',)),
    ('current_a', {'HVBat_I': 'ampere'}, ('HVBat_I',)), ('ambient_c', {'AmbT': 'kelvin'}, ('AmbT',)),
    ('battery_temperature_c', {'HVBat_T_Mean': 'kelvin'}, ('HVBat_T_Mean',)),
    ('power_w', {'HVCH_S__HVCH_Power': 'watt'}, ()),
    ('heater_w', {'HVCH_S__HVCH_PowerRequest': 'watt', 'HVCH_S__HVCH_Power': 'watt'}, ('HVCH_S.HVCH_Power',)),
    # A heater's channel in watts is its power, wherever the log states the unit.
    ('battery_heater_w', {'Battery heater (kW)': 'kilowatt', 'Battery heater': ''}, ('Battery heater (kW)',)),
    ('heater_w', {'HTR_S__HTR_Power': 'watt', 'HTR_S__HTR_Current': 'ampere'}, ('HTR_S.HTR_Power',)),
    ('heater_w', {'car__PTC': 'watt', 'car__PTC temp': 'degC'}, ('car.PTC',)),
    ('battery_heater_w', {'batt_heater_w': 'watt'}, ('batt_heater_w',)),
    ('cabin_heater_w', {'Cabin heater': 'kilowatt'}, ('Cabin heater',)),
    ('battery_heater_w', {'Batterieheizung [W]': 'watt'}, ('Batterieheizung [W]',)),
    ('battery_temperature_c', {'bmsUnknownTempA': ''}, ()),
    ('ambient_c', {'t_env_c': 'degC'}, ('t_env_c',)), ('ambient_c', {'T_amb_C': 'degC'}, ('T_amb_C',)),
    ('ambient_c', {'VCU__VCU_AmbTemp': 'degC'}, ('VCU.VCU_AmbTemp',)),
    ('ambient_c', {'outTemp': ''}, ('outTemp',)),
    ('ambient_c', {'Coolant_Out_Temp': '', 'Outlet temp': '', 'Lambda temp': ''}, ()),
    ('speed_mps', {'CCVS1__WheelBasedVehicleSpeed': '', 'WheelSpeedVeh': ''}, ('CCVS1.WheelBasedVehicleSpeed',)),
    ('speed_mps', {'ESP__VehSpd': ''}, ('ESP.VehSpd',)),
    ('ambient_c', {'OAT[DegC]': 'degC'}, ('OAT[DegC]',)), ('odometer_m', {'s_km': 'kilometer'}, ('s_km',)),
])
def test_only_alike_readings_of_the_quantity_make_up_a_signal(signal, units, expected):
    assert chosen(signal, **units) == expected


def write(path, header, rows):
    path.write_text('\n'.join([header, *(','.join(map(str, row)) for row in rows)]) + '\n')
    return path


def test_a_column_with_the_unit_of_another_quantity_is_named_and_not_used(tmp_path):
    path = write(tmp_path / 'a.csv', 'time_s,Battery temp [V],SOC [%],Speed [km/h]',
                 [(at, 3.6 + 0.001 * at, 80, 50) for at in range(30)])
    recording = read_recording(path)
    assert 'battery_temperature_c' not in recording.signals
    assert recording.unused == ('Battery temp [V]',)
    assert any('Battery temp [V]: has the unit volt' in remark for remark in recording.remarks)


def test_a_channel_that_jumps_as_no_temperature_gives_way_to_the_next(tmp_path):
    # A count of 16 without a name that tells it, before the temperature in alphabet and length.
    path = write(tmp_path / 'a.csv', 'time_s,batt temp x,battery pack temp [degC]',
                 [(at, at % 16, 7 + 0.01 * at) for at in range(200)])
    recording = read_recording(path)
    np.testing.assert_allclose(recording.signals['battery_temperature_c'].value, 7 + 0.01 * np.arange(200))
    path = write(tmp_path / 'a.csv', 'time_s,batt temp x,speed_kmh', [(at, at % 16, 50) for at in range(200)])
    recording = read_recording(path)
    assert 'battery_temperature_c' not in recording.signals
    assert any('batt temp x: jumps as no temperature does' in remark for remark in recording.remarks)


def test_sensors_that_are_far_apart_are_not_averaged(tmp_path):
    path = write(tmp_path / 'a.csv', 'time_s,batt temp 1,batt temp 2', [(at, 5, 60) for at in range(30)])
    recording = read_recording(path)
    assert set(recording.signals['battery_temperature_c'].value) == {5.0}
    assert any('are not alike; the first counts' in remark for remark in recording.remarks)


@pytest.mark.parametrize('code_c', [0, -40])
def test_sensors_that_a_car_lacks_and_that_read_a_code_are_not_averaged(tmp_path, code_c):
    path = write(tmp_path / 'a.csv', 'time_s,Module 1 batt temp,Module 2 batt temp,Module 3 batt temp',
                 [(at, code_c, 6, 8 + at / 30) for at in range(30)])
    (tmp_path / 'own.yaml').write_text("signals: {battery_temperature_c: {channels: '/^M/', combine: mean}}\n")
    recording = read_recording(path, tmp_path / 'own.yaml')
    np.testing.assert_allclose(recording.signals['battery_temperature_c'].value, 7 + np.arange(30) / 60)
    told = f'Module 1 batt temp: stays at {code_c}, unlike the others'
    assert any(told in remark for remark in recording.remarks)
    # Nor one alone, before others in alphabet and length; near 0 a sensor may stay there.
    path = write(tmp_path / 'a.csv', 'time_s,batt temp,Module 2 batt temp', [(at, 0, 6) for at in range(30)])
    assert set(read_recording(path).signals['battery_temperature_c'].value) == {6.0}
    path = write(tmp_path / 'a.csv', 'time_s,batt temp 1,batt temp 2', [(at, 0, 1) for at in range(30)])
    assert set(read_recording(path).signals['battery_temperature_c'].value) == {0.5}


@pytest.mark.parametrize('nothing', [0, -1, 85])
def test_what_a_logger_writes_before_the_first_reading_is_none(tmp_path, nothing):
    rows = [(at, nothing if at < 4 else 17, 0 if at < 6 else 0.75, -5) for at in range(90)]
    recording = read_recording(write(tmp_path / 'a.csv', 'time_s,battery_temperature_c,soc,ambient_c', rows))
    assert {name: (series.time_s[0], *set(series.value)) for name, series in recording.signals.items()} == {
        'battery_temperature_c': (4, 17), 'soc': (6, 0.75), 'ambient_c': (0, -5)}
    assert any(f'battery_temperature_c: {nothing} stands before the first reading; it is dropped' in each
               for each in recording.remarks)
    # A single wild reading shows nothing about those before it.
    rows = [(at, 60 if at == 4 else 17) for at in range(90)]
    path = write(tmp_path / 'a.csv', 'time_s,battery_temperature_c', rows)
    assert read_recording(path).signals['battery_temperature_c'].value.tolist() == [17.0] * 89


def test_channels_that_are_not_used_are_listed_those_like_a_signal_first(tmp_path):
    recording = read_recording(write(tmp_path / 'a.csv', 'time_s,foo,battery temp,battery temp limit',
                                     [(at, 1, 2, 3) for at in range(9)]))
    assert recording.sources == {'battery_temperature_c': ('battery temp',)}
    assert recording.unused == ('battery temp limit', 'foo')
    assert any('battery temp: has no unit; its readings are taken as degC' in each for each in recording.remarks)


@pytest.mark.parametrize('header', ['time_s,VehId,speed_kmh', 'time_s,vin,speed_kmh', 'time_s,car_name,speed_kmh'])
def test_two_cars_in_one_log_are_refused(tmp_path, header):
    path = write(tmp_path / 'a.csv', header, [(at, f'7{at % 2}', 50 + at) for at in range(40)])
    with pytest.raises(InvalidInput, match="is '70' and '71'; a log must be of one car: split it"):
        read_recording(path)


@pytest.mark.parametrize('column, values, count, is_second, is_wild, kept', [
    # A single wild state of charge is dropped.
    ('soc', (0.5, 0.8), 40, lambda at: at % 2, lambda at: at == 9, 39),
    ('odometer_m', (1e7, 3e7), 40, lambda at: at % 2, lambda at: at == 9, 40),
    # In blocks; wrong for each tenth reading.
    ('soc', (0.5, 0.8), 400, lambda at: at // 50 % 2, lambda at: at % 10 > 0, 400)])
def test_two_cars_without_a_name_are_told_by_what_alternates(
        tmp_path, column, values, count, is_second, is_wild, kept):
    def written(is_high):
        return write(tmp_path / 'a.csv', f'time_s,{column}', [(at, values[is_high(at)]) for at in range(count)])

    with pytest.raises(InvalidInput, match=f'{column} jumps to and fro between .*; a log must be of one car'):
        read_recording(written(is_second))
    # Wild readings are not another car.
    assert len(read_recording(written(is_wild)).signals[column].value) == kept


@pytest.mark.parametrize('name, usual, lone, step', [
    ('battery_temp_c', 15.0, 0.0, 4.0), ('soc_percent', 80.0, 0.0, 4.0), ('soc_percent', 80.0, 100.0, 4.0)])
def test_a_single_reading_far_from_its_neighbours_is_dropped_and_a_lasting_step_is_not(
        tmp_path, name, usual, lone, step):
    values = [usual + 0.01 * at for at in range(100)]
    expected = [value for at, value in enumerate(values) if at not in (20, 40, 41)]
    for at in (20, 40, 41):
        values[at] = lone
    # A step that stays, and readings too far apart to be compared.
    rows = [*enumerate(values), *((100 + at, usual + step) for at in range(9)),
            *((1000 + 100 * at, lone if at == 4 else usual) for at in range(9))]
    recording = read_recording(write(tmp_path / 'a.csv', f'time_s,speed_kmh,{name}', [
        (at, 50, value) for at, value in rows]))
    [signal] = [each for each in recording.signals if each != 'speed_mps']
    found = recording.signals[signal].value * (100.0 if signal == 'soc' else 1.0)
    np.testing.assert_allclose(found, [*expected, *[usual + step] * 9, *([usual] * 4), lone, *([usual] * 4)])
    assert [remark for remark in recording.remarks if ': the reading after 20 s, ' in remark
            and remark.endswith('it is dropped (and 2 more samples)')]


@pytest.mark.parametrize('begin, end', [(0, 200), (400, 460), (500, 600)])
def test_zeros_for_minutes_are_no_state_of_charge(tmp_path, begin, end):
    rows = [(at, 50, 0 if begin <= at < end else 80 - at / 100) for at in range(600)]
    recording = read_recording(write(tmp_path / 'a.csv', 'time_s,speed_kmh,soc_percent', rows))
    assert len(recording.signals['soc'].value) == 600 - end + begin and recording.signals['soc'].value.min() > 0.7
    assert any(f'0 from {begin} s on is far from the readings before and after it; it is dropped (and '
               f'{end - begin - 1} more samples)' in each for each in recording.remarks)
    # Nor is a battery that is driven empty and charged far from its readings.
    rows = [(60 * at, 50, max(5 - at / 4, 0) if at < 40 else (at - 40) / 2) for at in range(200)]
    recording = read_recording(write(tmp_path / 'a.csv', 'time_s,speed_kmh,soc_percent', rows))
    assert len(recording.signals['soc'].value) == 200


def test_positions_of_a_receiver_without_a_fix_are_dropped(tmp_path):
    # On the equator or the meridian of Greenwich a single 0 is a position.
    places = [(0, 0), (0, 0), *((5.5 - 0.5 * at, -3.0 + 0.5 * at) for at in range(12))]
    recording = read_recording(write(tmp_path / 'a.csv', 'time_s,speed_kmh,latitude,longitude', [
        (at, 50, *place) for at, place in enumerate(places)]))
    assert [recording.signals[f'{name}_deg'].value.tolist() for name in ('latitude', 'longitude')] == [
        [place[axis] for place in places[2:]] for axis in (0, 1)]
    assert [remark for remark in recording.remarks if remark.endswith('0, 0 means no position; it is dropped '
                                                                      '(and 1 more sample)')]
