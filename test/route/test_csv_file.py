# SPDX-License-Identifier: Apache-2.0
"""Route files, also of spreadsheets (km/h, kW, semicolons, decimal commas): round trips, a message for errors."""

from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from refusals import problems_in

from bev_preheat.route import route_for
from bev_preheat.route.csv_file import load_route, save_route
from bev_preheat.route.segments import LIMITS, make_route, Route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Defaults

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0, target_battery_temperature_c=21.0)
HEADER = ('duration_s,speed_mps,propulsion_power_w,propulsion_power_rms_w,ambient_temperature_c,'
          'cabin_heating_power_w,auxiliary_power_w')
ALL = f'{HEADER},propulsion_power_magnitude_w'
SPREADSHEET = 'duration_s;speed_kmh;propulsion_power_kw;ambient_temperature_c'
# Column, field of Route, unit of the field in units of the column.
OTHER_UNITS = (
    ('duration_min', 'duration_s', 1.0 / 60.0),
    ('speed_kmh', 'speed_mps', 3.6),
    ('propulsion_power_kw', 'propulsion_power_w', 1e-3),
    ('propulsion_power_rms_kw', 'propulsion_power_rms_w', 1e-3),
    ('ambient_temperature_c', 'ambient_temperature_c', 1.0),
    ('cabin_heating_power_kw', 'cabin_heating_power_w', 1e-3),
    ('auxiliary_power_kw', 'auxiliary_power_w', 1e-3))


def routes(duration_s, speed_mps, power_w, heater_w):
    """Return a strategy for Routes with values within these ranges; the rms is up to 10 kW above the mean."""
    def route(rows):
        duration, speed, mean, more, ambient, cabin, auxiliary = np.array(rows).T
        return make_route({
            'duration_s': duration, 'speed_mps': speed, 'propulsion_power_w': mean,
            'propulsion_power_rms_w': np.minimum(np.abs(mean) + more, 2e6), 'ambient_temperature_c': ambient,
            'cabin_heating_power_w': cabin, 'auxiliary_power_w': auxiliary}, None)

    return st.lists(st.tuples(*(st.floats(*ends) for ends in (
        duration_s, speed_mps, power_w, (0.0, 1e4), (-60.0, 60.0), heater_w, heater_w))),
        min_size=1, max_size=20).map(route)


# Values at the limits may be beyond them in other units.
ALL_ROUTES = routes((1e-3, 400.0), (0.0, 100.0), (-2e6, 1.9e6), (0.0, 5e4))
INNER_ROUTES = routes((1e-2, 400.0), (0.1, 99.9), (-1.9e6, 1.9e6), (0.0, 4.9e4))


def file_of(folder, text):
    path = Path(folder) / 'trip.csv'
    path.write_bytes(text.encode('utf-8'))
    return path


def problems_with(tmp_path, text):
    """Return the problems of loading a file, without the leading path."""
    path = file_of(tmp_path, text)
    return problems_in(path, load_route, path, DEFAULTS)


@given(ALL_ROUTES)
def test_what_is_saved_is_loaded_bit_for_bit(route):
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'trip.csv'
        save_route(path, route, ['made from numbers'])
        again = load_route(path, None)
    for field in fields(Route):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(route, field.name))


def test_the_file_has_the_columns_of_the_contract(tmp_path):
    route = make_route({
        'duration_s': [30.0, 12.5], 'speed_mps': [10.0], 'propulsion_power_w': [-5e3, 0.125],
        'propulsion_power_rms_w': [6e3], 'ambient_temperature_c': [-7.0],
        'propulsion_power_magnitude_w': [5.5e3]}, DEFAULTS)
    save_route(tmp_path / 'trip.csv', route, ['first', 'second'])
    assert (tmp_path / 'trip.csv').read_text(encoding='utf-8') == (
        f'# first\n# second\n{ALL}\n'
        '30,10,-5000,6000,-7,1111,222,5500\n12.5,10,0.125,6000,-7,1111,222,5500\n')


@pytest.mark.parametrize('header, problem', [
    ('duration_s,speed_kmh,propulsion_power_w', 'missing columns: ambient_temperature_c'),
    ('duration_min,ambient_temperature_c', 'missing columns: speed_kmh or length_km, propulsion_power_kw'),
    ('propulsion_power_kw,ambient_temperature_c', 'missing columns: duration_s and speed_kmh'),
    # Metres, kilometres or miles?
    ('duration_s,speed', "column 'speed' has no unit: rename it to speed_mps or speed_kmh"),
    ('Propulsion power,speed_mps', "column 'Propulsion power' has no unit: rename it to propulsion_power_w "
     'or propulsion_power_kw'),
    (f'{HEADER},battery_power_kw', "column 'battery_power_kw' is unknown; did you mean 'auxiliary_power_kw'?"),
    ('duration_s,speed_v,propulsion_power_w', "column 'speed_v' has the unit volt, which is not one of speed"),
    (f'{HEADER},odometer_km', "column 'odometer_km': if it holds values per segment, rename it to length_m; "
     'values cumulated from the start of the trip are not accepted'),
    (f'{HEADER},time_s', "column 'time_s': if it holds values per segment, rename it to duration_s; values "
     'cumulated from the start of the trip are not accepted'),
    (HEADER.replace('cabin_heating_power_w', 'cabin_heatng_power_w'),
     "column 'cabin_heatng_power_w' is unknown; did you mean 'cabin_heating_power_w'?"),
    (f'{HEADER},speed_mps', "columns 'speed_mps' and 'speed_mps' hold the same quantity; keep only one"),
    (f'{HEADER},v [km/h]', "columns 'speed_mps' and 'v [km/h]' hold the same quantity; keep only one"),
    (f'{HEADER},energy_wh', "columns 'propulsion_power_w' and 'energy_wh' both give the drive; keep only one"),
])
def test_a_header_that_does_not_make_a_route_is_explained(tmp_path, header, problem):
    row = ','.join('9' * len(header.split(',')))
    assert problems_with(tmp_path, f'# trip\n{header}\n{row}\n') == [f', line 2: {problem}']


def test_charging_times_are_stops_as_in_a_list_of_segments(tmp_path):
    header = 'duration_s,speed_mps,propulsion_power_w,ambient_temperature_c'
    rows = [f'{seconds},10,5e3,-7' for seconds in (60, 70, 80)]
    text = '\n'.join([f'{header},charging_time_min', f'{rows[0]},0', f'{rows[1]},15', f'{rows[2]},20'])
    car = load_vehicle('reference')
    # The last segment ends at the destination.
    assert [(stop.after_segment, stop.duration_s) for stop in route_for(file_of(tmp_path, text), car).stops] == [
        (1, 900.0)]
    above = '# charging stop: after segment 1, 900 s\n'
    assert 'above its header and in a column; keep only one' in problems_with(tmp_path, above + text)[0]
    assert problems_with(tmp_path, above.replace('900 s', '15 min') + '\n'.join([header, *rows])) == [
        ", line 1: 'charging stop: after segment 1, 15 min' is not allowed; it must be such as 'charging stop: "
        "after segment 3, 1200 s'"]
    assert problems_with(tmp_path, text.replace('15', '0.01')) == [
        ', line 3: charging_time_min: 0.6 s is not allowed; it must be 0 s, no stop, or 1 ... 86400 s']


def test_the_reference_names_every_column():
    reference = (Path(__file__).parents[2] / 'docs' / 'reference' / 'files.md').read_text()
    table = reference.partition('## Route CSV')[2].partition('\n## ')[0]
    assert [name for name in LIMITS if f'\n| `{name}` |' not in table] == []


@pytest.mark.parametrize('text, problems', [
    (f'# km/h\n{HEADER}\n30, 10, 5e3, 6e3, -7, 1500, 500\n\n30,130,5e3,6e3,-7,1500,500\n',
     [', line 5: speed_mps: 130 is not allowed; it must be 0 ... 100']),
    (f'{HEADER}\n30,10,5e3,6e3,-7,1500,500\n30,10,5e3,6e3,-7,1500\n',
     [', line 3: has 6 values; the header names 7 columns']),
    (f'{HEADER}\n30,ten,5e3,6e3,-7,1500,500\n30,nan,5e3,6e3,-7,1500,500\n30,,5e3,6e3,-7,1500,500\n',
     [", line 2: speed_mps: 'ten' is not a number", ", line 3: speed_mps: 'nan' is not a number",
      ", line 4: speed_mps: '' is not a number"]),
    # Values made of others are named after them.
    ('length_km,speed_kmh,propulsion_power_kw,ambient_temperature_c\n1,50,10,-7\n0,50,0,-7\n',
     [', line 3: duration_s by length_km: 0 is not allowed; it must be 0.001 ... 86400']),
    ('length_km,duration_min,propulsion_power_kw,ambient_temperature_c\n100,2,10,-7\n',
     [', line 2: length and duration give 833.333 m/s; at most 100 m/s are allowed; check their units']),
    ('duration_s,speed_mps,propulsion_power_kw,propulsion_power_rms_kw,ambient_temperature_c\n30,10,5,4,-7\n',
     [', line 2: propulsion_power_rms_kw: 4000 is below the magnitude of the mean, 5000'])])
def test_rows_that_make_no_route_are_named_by_their_lines(tmp_path, text, problems):
    assert problems_with(tmp_path, text) == problems


# Spreadsheets


@given(route=INNER_ROUTES, separator=st.sampled_from([';', '\t']), comma=st.booleans(),
       end=st.sampled_from(['\n', '\r\n']), mark=st.sampled_from(['', '\ufeff']),
       exponents=st.booleans(), order=st.permutations(OTHER_UNITS))
def test_a_route_survives_other_units_separators_and_commas(route, separator, comma, end, mark, exponents, order):
    def written(value):
        # With three digits after the mark, a number may look like thousands.
        text = f'{value:.16e}' if exponents else np.format_float_positional(value, min_digits=4)
        return text.replace('.', ',') if comma else text

    lines = [separator.join(column for column, _, _ in order)]
    lines += [separator.join(written(getattr(route, field)[at] * factor)
                             for _, field, factor in order) for at in range(len(route))]
    with TemporaryDirectory() as folder:
        again = load_route(file_of(folder, mark + end.join(lines) + end), None)
    for field in fields(Route):
        np.testing.assert_allclose(getattr(again, field.name), getattr(route, field.name),
                                   rtol=1e-12, atol=1e-300, err_msg=field.name)


@given(route=INNER_ROUTES, length=st.sampled_from([('length_km', 1e-3), ('length_m', 1.0)]),
       given_too=st.sampled_from(['duration_s', 'speed_mps']))
def test_the_length_of_segments_stands_for_duration_or_speed(route, length, given_too):
    name, factor = length
    length_m = np.maximum(route.duration_s * route.speed_mps, 1e-300)
    rows = [f'{name},{given_too},propulsion_power_w,ambient_temperature_c'] + [
        f'{a!r},{b!r},{c!r},{d!r}' for a, b, c, d in zip(
            (length_m * factor).tolist(), getattr(route, given_too).tolist(),
            route.propulsion_power_w.tolist(), route.ambient_temperature_c.tolist())]
    with TemporaryDirectory() as folder:
        again = load_route(file_of(folder, '\n'.join(rows)), DEFAULTS)
    np.testing.assert_allclose(again.duration_s, route.duration_s, rtol=1e-12)
    np.testing.assert_allclose(again.speed_mps, route.speed_mps, rtol=1e-12)


def test_a_german_spreadsheet(tmp_path):
    """Byte order mark, CRLF, comments, one quoted, lines filled with separators, blank rows, `sep=;`."""
    route = load_route(file_of(tmp_path, '\ufeffsep=;\r\n"# nach Hause; im Winter";;;\r\n'
                               f'{SPREADSHEET};;\r\n;;;;;\r\n30;36;-5,25;-7  # auch hier;;\r\n'
                               '12,5;90;17;"-6,5";;\r\n;;;;;\r\n'), DEFAULTS)
    assert route.duration_s.tolist() == [30.0, 12.5]
    assert route.speed_mps.tolist() == [10.0, 25.0]
    assert route.propulsion_power_w.tolist() == [-5250.0, 17000.0]
    assert route.ambient_temperature_c.tolist() == [-7.0, -6.5]
    # Columns that the file does not have.
    assert route.propulsion_power_rms_w.tolist() == [5250.0, 17000.0]
    assert route.cabin_heating_power_w.tolist() == [1111.0, 1111.0]
    assert route.auxiliary_power_w.tolist() == [222.0, 222.0]


@pytest.mark.parametrize('row, problem', [
    ('30;36;1.234,5;-7', "propulsion_power_kw: '1.234,5' has a thousands separator; write 1234,5"),
    ('30;36;1.234;-7,5', "propulsion_power_kw: '1.234' has a thousands separator; write 1234"),
    ('30;36;1,234.5;-7', "propulsion_power_kw: '1,234.5' has a thousands separator; write 1234.5"),
    ("30;36;1'234.5;-7", 'propulsion_power_kw: "1\'234.5" has a thousands separator; write 1234.5'),
    ('30;36;1 234;-7', "propulsion_power_kw: '1 234' has a thousands separator; write 1234"),
    ('30;36;-1\u202f234,5;-7', "propulsion_power_kw: '-1\\u202f234,5' has a thousands separator; "
     'write -1234,5'),
    ('30;36;1.234.567;-7', "propulsion_power_kw: '1.234.567' has a thousands separator; write 1234567"),
    ('30;36;1.234;-7', "propulsion_power_kw: '1.234' can be read as 1234 or as 1.234; write no "
     'thousands separator, or a number of digits other than three behind the decimal mark'),
    ('30;36;1,500;-7', "propulsion_power_kw: '1,500' can be read as 1500 or as 1.5; write no "
     'thousands separator, or a number of digits other than three behind the decimal mark'),
    ('30;36.5;5,5;-7', "propulsion_power_kw: '5,5' has a comma; with decimal commas in all numbers, separate the "
     'columns by semicolons'),
    ('30;1_0;5;-7', "speed_kmh: '1_0' is not a number"),
    ('30;\u0663;5;-7', "speed_kmh: '\u0663' is not a number"),
    ('30;36 km/h;5;-7', "speed_kmh: '36 km/h' is not a number"),
    ('30;361;5;-7', 'speed_kmh: 361 is not allowed; it must be 0 ... 360'),
    ('30;36;2001;-7', 'propulsion_power_kw: 2001 is not allowed; it must be -2000 ... 2000'),
    # A decimal comma makes one column too many.
    ('30,36,5,5,-7', 'has 5 values; the header names 4 columns; with decimal commas, separate the '
     'columns by semicolons'),
    ('30,36,"1,500",-7', "propulsion_power_kw: '1,500' has a comma; with decimal commas in all numbers, separate "
     'the columns by semicolons'),
    ('30,36,"1,500.5",-7', "propulsion_power_kw: '1,500.5' has a thousands separator; write "
     '1500.5'),
    ('30,36,5', "ambient_temperature_c: '' is not a number"),
    ('30,36,"5,-7', "propulsion_power_kw: '5,-7' has a comma; with decimal commas in all numbers, separate the "
     'columns by semicolons'),
])
def test_a_cell_that_is_unclear_or_impossible_is_named(tmp_path, row, problem):
    # Behind the 30 stands the separator.
    header = SPREADSHEET.replace(';', row[2])
    assert problems_with(tmp_path, f'{header}\n{row}\n') == [f', line 2: {problem}']
