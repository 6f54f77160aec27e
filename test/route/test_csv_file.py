# SPDX-License-Identifier: Apache-2.0
"""Route files: lossless round trips, and a message for each error."""

from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.route.csv_file import load_route, save_route
from bev_preheat.route.segments import LIMITS, make_route, Route
from bev_preheat.vehicle.description import Defaults

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0, target_battery_temperature_c=21.0)
HEADER = ('duration_s,speed_mps,propulsion_power_w,propulsion_power_rms_w,ambient_temperature_c,'
          'cabin_heating_power_w,auxiliary_power_w')
ALL = f'{HEADER},propulsion_power_magnitude_w'
SEGMENT = st.tuples(
    st.floats(1e-3, 400.0), st.floats(0.0, 100.0), st.floats(-2e6, 1.9e6), st.floats(0.0, 1e4),
    st.floats(-60.0, 60.0), st.floats(0.0, 5e4), st.floats(0.0, 5e4))


def file_of(tmp_path, text, name='trip.csv'):
    path = tmp_path / name
    path.write_text(text, encoding='utf-8')
    return path


def problems_with(tmp_path, text):
    """Return the problems of loading a file, without the leading path."""
    path = file_of(tmp_path, text)
    with pytest.raises(InvalidInput) as caught:
        load_route(path, DEFAULTS)
    for problem in caught.value.problems:
        assert problem.startswith(str(path))
    return [problem.removeprefix(str(path)) for problem in caught.value.problems]


@settings(deadline=None)
@given(st.lists(SEGMENT, min_size=1, max_size=20))
def test_what_is_saved_is_loaded_bit_for_bit(rows):
    duration, speed, mean, more, ambient, cabin, auxiliary = np.array(rows).T
    route = make_route({
        'duration_s': duration, 'speed_mps': speed, 'propulsion_power_w': mean,
        'propulsion_power_rms_w': np.minimum(np.abs(mean) + more, 2e6),
        'ambient_temperature_c': ambient, 'cabin_heating_power_w': cabin,
        'auxiliary_power_w': auxiliary}, DEFAULTS)
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


def test_columns_are_found_by_name_and_optional_ones_may_be_missing(tmp_path):
    route = load_route(file_of(tmp_path, """
        # a comment, then a header in another order
        ambient_temperature_c, duration_s, propulsion_power_w, speed_mps
        -7.5, 30, -2e3, 11   # behind the numbers too

        -8.5, 20, 3000, 22
        """), DEFAULTS)
    assert route.ambient_temperature_c.tolist() == [-7.5, -8.5]
    assert route.duration_s.tolist() == [30.0, 20.0]
    assert route.propulsion_power_w.tolist() == [-2e3, 3e3]
    assert route.propulsion_power_rms_w.tolist() == [2e3, 3e3]
    assert route.speed_mps.tolist() == [11.0, 22.0]
    assert route.cabin_heating_power_w.tolist() == [1111.0, 1111.0]
    assert route.auxiliary_power_w.tolist() == [222.0, 222.0]


def test_a_value_beyond_its_limits_is_named_with_its_line(tmp_path):
    assert problems_with(tmp_path, f'# km/h\n{HEADER}\n30,10,5e3,6e3,-7,1500,500\n\n'
                         '30,130,5e3,6e3,-7,1500,500\n') == [
        ', line 5: speed_mps: 130 is not allowed; it must be 0 ... 100']


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
])
def test_a_header_that_does_not_make_a_route_is_explained(tmp_path, header, problem):
    row = ','.join('9' * len(header.split(',')))
    assert problems_with(tmp_path, f'# trip\n{header}\n{row}\n') == [f', line 2: {problem}']


def test_the_reference_names_every_column():
    reference = (Path(__file__).parents[2] / 'docs' / 'reference' / 'files.md').read_text()
    table = reference.partition('## Route CSV')[2].partition('\n## ')[0]
    assert [name for name in LIMITS if f'\n| `{name}` |' not in table] == []


def test_rows_of_another_length_are_refused(tmp_path):
    assert problems_with(tmp_path, f'{HEADER}\n30,10,5e3,6e3,-7,1500,500\n30,10,5e3,6e3,-7,1500,500\n'
                         '30,10,5e3,6e3,-7,1500\n') == [', line 4: has 6 values; the header names 7 columns']


def test_cells_that_are_no_numbers_are_refused(tmp_path):
    assert problems_with(tmp_path, f'{HEADER}\n30,ten,5e3,6e3,-7,1500,500\n30,nan,5e3,6e3,-7,1500,500\n'
                         '30,,5e3,6e3,-7,1500,500\n') == [
        f', line {line}: speed_mps: {text!r} is not a number' for line, text in ((2, 'ten'), (3, 'nan'), (4, ''))]
