# SPDX-License-Identifier: Apache-2.0
"""Routes from spreadsheets: km/h, kW, semicolons, decimal commas; refusals."""

from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.route.csv_file import load_route
from bev_preheat.route.segments import make_route, Route
from bev_preheat.vehicle.description import Defaults

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0, target_battery_temperature_c=21.0)
HEADER = 'duration_s;speed_kmh;propulsion_power_kw;ambient_temperature_c'
# Column, field of Route, unit of the field in units of the column.
OTHER_UNITS = (
    ('duration_min', 'duration_s', 1.0 / 60.0),
    ('speed_kmh', 'speed_mps', 3.6),
    ('propulsion_power_kw', 'propulsion_power_w', 1e-3),
    ('propulsion_power_rms_kw', 'propulsion_power_rms_w', 1e-3),
    ('ambient_temperature_c', 'ambient_temperature_c', 1.0),
    ('cabin_heating_power_kw', 'cabin_heating_power_w', 1e-3),
    ('auxiliary_power_kw', 'auxiliary_power_w', 1e-3))
SEGMENT = st.tuples(
    st.floats(1e-2, 400.0), st.floats(0.1, 99.9), st.floats(-1.9e6, 1.9e6), st.floats(0.0, 1e4),
    st.floats(-60.0, 60.0), st.floats(0.0, 4.9e4), st.floats(0.0, 4.9e4))


def file_of(folder, text, name='trip.csv'):
    path = Path(folder) / name
    path.write_bytes(text.encode('utf-8'))
    return path


def problem_with(tmp_path, text):
    path = file_of(tmp_path, text)
    with pytest.raises(InvalidInput) as caught:
        load_route(path, DEFAULTS)
    problem, = caught.value.problems
    return problem.removeprefix(str(path))


@st.composite
def routes(draw):
    rows = draw(st.lists(SEGMENT, min_size=1, max_size=12))
    duration, speed, mean, more, ambient, cabin, auxiliary = np.array(rows).T
    return make_route({
        'duration_s': duration, 'speed_mps': speed, 'propulsion_power_w': mean,
        'propulsion_power_rms_w': np.abs(mean) + more, 'ambient_temperature_c': ambient,
        'cabin_heating_power_w': cabin, 'auxiliary_power_w': auxiliary}, None)


def assert_same(one, other):
    for field in fields(Route):
        np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name),
                                   rtol=1e-12, atol=1e-300, err_msg=field.name)


@given(route=routes(), separator=st.sampled_from([';', '\t']), comma=st.booleans(),
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
    assert_same(again, route)


@given(route=routes(), length=st.sampled_from([('length_km', 1e-3), ('length_m', 1.0)]),
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
    """Byte order mark, CRLF, quoted comment, lines filled with separators, blank rows, `sep=;`."""
    route = load_route(file_of(tmp_path, '\ufeffsep=;\r\n"# nach Hause; im Winter";;;\r\n'
                               f'{HEADER};;\r\n;;;;;\r\n30;36;-5,25;-7;;\r\n'
                               '12,5;90;17;"-6,5";;\r\n;;;;;\r\n'), DEFAULTS)
    assert route.duration_s.tolist() == [30.0, 12.5]
    assert route.speed_mps.tolist() == [10.0, 25.0]
    assert route.propulsion_power_w.tolist() == [-5250.0, 17000.0]
    assert route.ambient_temperature_c.tolist() == [-7.0, -6.5]
    assert route.cabin_heating_power_w.tolist() == [1111.0, 1111.0]


@pytest.mark.parametrize('row, problem', [
    ('30;36;1.234,5;-7', "propulsion_power_kw: '1.234,5' has a thousands separator; write 1234,5"),
    ('30;36;1,234.5;-7', "propulsion_power_kw: '1,234.5' has a thousands separator; write 1234.5"),
    ("30;36;1'234.5;-7", 'propulsion_power_kw: "1\'234.5" has a thousands separator; write 1234.5'),
    ('30;36;1 234;-7', "propulsion_power_kw: '1 234' has a thousands separator; write 1234"),
    ('30;36;-1\u202f234,5;-7', "propulsion_power_kw: '-1\\u202f234,5' has a thousands separator; "
     'write -1234,5'),
    ('30;36;1.234.567;-7', "propulsion_power_kw: '1.234.567' has a thousands separator; write "
     '1234567'),
    ('30;36;1,234,567;-7', "propulsion_power_kw: '1,234,567' has a thousands separator; write "
     '1234567'),
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
])
def test_a_cell_that_is_unclear_or_impossible_is_named(tmp_path, row, problem):
    assert problem_with(tmp_path, f'{HEADER}\n{row}\n') == f', line 2: {problem}'


@pytest.mark.parametrize('row, problem', [
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
def test_commas_separate_or_are_decimal(tmp_path, row, problem):
    header = HEADER.replace(';', ',')
    assert problem_with(tmp_path, f'{header}\n{row}\n') == f', line 2: {problem}'


def test_values_made_of_others_are_named_after_them(tmp_path):
    assert problem_with(
        tmp_path, 'length_km,speed_kmh,propulsion_power_kw,ambient_temperature_c\n'
        '1,50,10,-7\n0,50,0,-7\n') == (
        ', line 3: duration_s by length_km: 0 is not allowed; it must be 0.001 ... 86400')
    assert problem_with(
        tmp_path, 'length_km,duration_min,propulsion_power_kw,ambient_temperature_c\n'
        '100,2,10,-7\n') == (
        ', line 2: length and duration give 833.333 m/s; at most 100 m/s are allowed; check their units')
    assert problem_with(
        tmp_path, 'duration_s,speed_mps,propulsion_power_kw,propulsion_power_rms_kw,'
        'ambient_temperature_c\n30,10,5,4,-7\n') == (
        ', line 2: propulsion_power_rms_kw: 4000 is below the magnitude of the mean, 5000')
