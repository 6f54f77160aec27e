# SPDX-License-Identifier: Apache-2.0
"""Logs of JSON objects: an object a line or one array, whole or nested, by field or one reading an object."""

import json

import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.json_lines import flat, JsonRows
from bev_preheat.logs.reading import read_recording

TIMES_S = [1_700_000_000.0 + second for second in range(0, 120, 2)]
TEMPERATURES_C = [3.0 + 0.01 * at for at in range(60)]
OBJECTS = [{'timestamp': time_s, 'battery_temperature_c': temperature_c, 'note': {'of': ['car', at]}}
           for at, (time_s, temperature_c) in enumerate(zip(TIMES_S, TEMPERATURES_C))]


def read(tmp_path, text):
    path = tmp_path / 'log.json'
    path.write_text(text)
    return path, read_recording(path)


@pytest.mark.parametrize('text', [
    '\n'.join(map(json.dumps, OBJECTS)), '[\n' + ',\n'.join(map(json.dumps, OBJECTS)) + '\n]',
    json.dumps(OBJECTS), json.dumps(OBJECTS, indent=1), json.dumps({'status': 'ok', 'data': OBJECTS}, indent=2),
    json.dumps({'data': {'drive': {'id': 7, 'details': OBJECTS}, 'car': {'id': 1}}}),
    json.dumps({'drives': [{'start_date': TIMES_S[0], 'details': OBJECTS[:30]},
                           {'start_date': TIMES_S[30], 'details': OBJECTS[30:]}]}),
    '\n'.join(json.dumps({'batch': OBJECTS[first:first + 20]}) for first in (0, 20, 40)),
    json.dumps({'data': {'timestamp': TIMES_S, 'battery_temperature_c': TEMPERATURES_C}}),
    ''.join(map(json.dumps, OBJECTS)), '\n'.join(json.dumps(each, indent=2) for each in OBJECTS),
    json.dumps({'features': [{'geometry': {}, 'properties': each} for each in OBJECTS]}),
    json.dumps({'data': {name: [{'value': value, 'timestamp': time_s} for time_s, value in zip(TIMES_S, values)]
                         for name, values in (('battery_temperature_c', TEMPERATURES_C), ('x', TIMES_S))}}),
    json.dumps({'timestamp': dict(enumerate(TIMES_S)), 'battery_temperature_c': dict(enumerate(TEMPERATURES_C))}),
    json.dumps({'columns': ['time', 'battery_temperature_c'], 'index': [0, 1],
                'data': list(zip(TIMES_S, TEMPERATURES_C))}),
    json.dumps([['time', 'battery_temperature_c'], *zip(TIMES_S, TEMPERATURES_C)]),
    json.dumps({'results': [{'series': [
        {'name': name, 'columns': ['time', 'mean'], 'values': list(zip(TIMES_S, values))} for name, values in (
            ('battery_temperature_c', TEMPERATURES_C), ('speed_kmh', [50.0] * len(TIMES_S)))]}]}),
    '\n'.join(json.dumps({'createdAt': time_s, 'data': [
        {'key': 'battery_temperature_c', 'value': {'doubleValue': temperature_c}},
        {'key': 'Gear', 'value': {'stringValue': 'D'}}]})
        for time_s, temperature_c in zip(TIMES_S, TEMPERATURES_C))],
    ids=['an object a line', 'array, an object a line', 'array in one line', 'array', 'answer of a server',
         'array under keys', 'several drives', 'an array a line', 'an array a channel',
         'objects in a row', 'objects of several lines', 'a nested time', 'a list of readings a channel',
         'a column a channel', 'names and rows', 'a row of names',
         'a table a channel', 'names and values'])
def test_each_form_has_the_same_readings(tmp_path, text):
    _, recording = read(tmp_path, text)
    assert recording.format.startswith('JSON')
    temperature = recording.signals['battery_temperature_c']
    np.testing.assert_allclose(temperature.value, TEMPERATURES_C)
    np.testing.assert_allclose(temperature.time_s + recording.start_s, TIMES_S)


def test_a_history_of_home_assistant_names_entity_and_unit_once(tmp_path):
    text = json.dumps([[
        {'state': f'{1.8 * value + 32.0:.3f}', 'last_changed': time_s} | ({
            'entity_id': f'sensor.{name}', 'attributes': {'unit_of_measurement': '°F'}} if at == 0 else {})
        for at, (time_s, value) in enumerate(zip(TIMES_S, TEMPERATURES_C))]
        for name in ('car_battery_temperature', 'outside_temperature')])
    _, recording = read(tmp_path, text)
    for signal in ('battery_temperature_c', 'ambient_c'):
        np.testing.assert_allclose(recording.signals[signal].value, TEMPERATURES_C, atol=1e-3)


def test_a_first_state_without_a_unit_leaves_that_of_the_others(tmp_path):
    _, recording = read(tmp_path, json.dumps([[{
        'entity_id': 'sensor.car_battery_temperature', 'last_changed': time_s,
        'state': f'{1.8 * value + 32.0:.3f}' if at else 'unavailable',
        'attributes': {'unit_of_measurement': '°F'} if at else {}}
        for at, (time_s, value) in enumerate(zip(TIMES_S, TEMPERATURES_C))]]))
    np.testing.assert_allclose(recording.signals['battery_temperature_c'].value, TEMPERATURES_C[1:], atol=1e-3)


def test_an_array_with_bytes_of_no_text_is_read(tmp_path):
    path = tmp_path / 'log.json'
    path.write_bytes(json.dumps(OBJECTS).replace('car', '__').encode().replace(b'__', b'\x90\xff'))
    assert len(read_recording(path).signals['battery_temperature_c'].value) == len(OBJECTS)


def test_lines_that_are_no_object_or_have_no_time_are_dropped_with_one_remark_a_cause(tmp_path):
    lines = list(map(json.dumps, OBJECTS))
    lines[10:12] = ['{"timestamp": 17', '"text"']
    lines[20] = json.dumps({**OBJECTS[20], 'timestamp': 'noon'})
    path, recording = read(tmp_path, '\n'.join(lines))
    assert len(recording.signals['battery_temperature_c'].value) == len(OBJECTS) - 3
    remarks = ' '.join(recording.remarks)
    dropped = "'{\"timestamp\": 17' is not a JSON object; the line is dropped (and 1 more line)"
    assert f'{path}, line 11: {dropped}' in remarks
    assert f"{path}, line 21: 'noon' is not a time; the line is dropped" in remarks


def test_nested_values_have_dotted_names_and_what_is_no_reading_is_empty():
    assert flat({'a': {'b': 1, 'c': [True, None, 'x']}, 'far': 10**400, 'nan': float('nan'), 'd': {}}) == {
        'a.b': '1.0', 'a.c.0': 'True', 'a.c.2': 'x', 'far': '', 'nan': ''}
    assert flat({'speed': {'value': 50, 'unit': 'mph', 'at': '7:30'}, 'soc': {'value': 0.8, 'unit': None}}) == {
        'speed': '50 mph', 'speed.at': '7:30', 'soc': '0.8'}


@pytest.mark.parametrize('text, problem', [
    ('[\n1,\n2\n]', 'has no JSON object with fields'), ('[1, 2', 'is not JSON: '),
    (json.dumps({f'field {at}': at for at in range(5001)}), 'more than 5000 fields; this is no log'),
    (json.dumps({'time': 0, 'points': [{'battery_temperature_c': at} for at in range(99)]}),
     'is one object whose lists have no time .*; write an object'),
    (json.dumps({'cars': {'a': OBJECTS, 'b': OBJECTS}}),
     'has several lists of .*; a log must be one drive of one car')],
    ids=['no objects', 'no JSON', 'thousands of fields', 'no times', 'two cars'])
def test_a_file_that_is_no_log_is_named(tmp_path, text, problem):
    path = tmp_path / 'log.json'
    path.write_text(text)
    with pytest.raises(InvalidInput, match=f'{path}.*{problem}'):
        JsonRows(path, 'utf-8')
