# SPDX-License-Identifier: Apache-2.0
"""Tables in text files: layout, encoding, units, numbers and times, the same for logs and routes."""

import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.files.table import read_table
from bev_preheat.files.units import conversion, QUANTITIES, SPELLINGS, STEPS

# Definitions: 1 mile is 1609.344 m, 1 ft 0.3048 m, a nautical mile 1852 m, 1 hp 550 ft lbf/s.
KNOWN = [('degF', 'degC', 14.0, -10.0), ('K', 'degC', 263.15, -10.0), ('degC', 'degF', -40.0, -40.0),
         ('mph', 'm/s', 100.0, 44.704), ('km/h', 'mph', 1.609344, 1.0), ('kn', 'km/h', 1.0, 1.852),
         ('mi', 'km', 1.0, 1.609344), ('ft', 'm', 1.0, 0.3048), ('%', '1', 50.0, 0.5),
         ('kW', 'W', 1.5, 1500.0), ('hp', 'W', 1.0, 0.3048 * 550.0 * 0.45359237 * 9.80665),
         ('min', 's', 2.0, 120.0), ('h', 'min', 2.0, 120.0),
         ('rad', 'deg', 3.141592653589793, 180.0), ('mA', 'A', 20.0, 0.02), ('MJ', 'kWh', 3.6, 1.0)]


@pytest.mark.parametrize('unit, wanted, value, expected', KNOWN)
def test_units_convert_by_their_definitions(unit, wanted, value, expected):
    there, back = conversion(unit, wanted), conversion(wanted, unit)
    assert there.factor * value + there.offset == pytest.approx(expected, rel=1e-12)
    assert back.factor * expected + back.offset == pytest.approx(value, rel=1e-12)


def test_each_spelling_means_one_unit_and_quantities_do_not_mix():
    spellings = [spelling for units in QUANTITIES.values() for unit, _, _, text in units
                 for spelling in {unit.lower(), *text.split()}]
    assert len(spellings) == len(set(spellings)) and len(SPELLINGS) == len(STEPS) * len(spellings)
    for unit, wanted, words in (('V', 'degC', 'cannot be converted'), ('furlong', 'm', 'is unknown')):
        with pytest.raises(InvalidInput, match=words):
            conversion(unit, wanted)


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'utf-16', 'cp1252'])
@pytest.mark.parametrize('text', [
    'Fahrt;von Köln\nZeit, s;Höhe, m\n0,5;1,25\n1,5;2,5\n', 'Zeit,Höhe\n[s],[m]\n0.5,1.25\n1.5,2.5\n',
    '"sep=|"\nZeit [s]|Höhe [m]\n0.5|1.25\n1.5|2.5\n', '# Fahrt\nZeit_s\tHöhe_m\n0,5\t1,25\n\n1,5\t2,5\n'])
def test_separators_marks_titles_and_encodings_are_found(tmp_path, text, encoding):
    path = tmp_path / 'table.txt'
    path.write_bytes(text.encode(encoding))
    table = read_table(path)
    assert table.units == ('second', 'meter') and [name[:4] for name in table.header] == ['Zeit', 'Höhe']
    assert [table.numbers(name).tolist() for name in table.header] == [[0.5, 1.5], [1.25, 2.5]]
