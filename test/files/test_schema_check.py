# SPDX-License-Identifier: Apache-2.0
"""The check without jsonschema: accepts every shipped file, and none that jsonschema refuses."""

from jsonschema import Draft7Validator
from mistakes import changed, GONE, places
import pytest
import yaml

from bev_preheat.charging import chargers
from bev_preheat.control import itinerary
from bev_preheat.files.checked_yaml import load_schema, surely_obeys
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.route import legs
from bev_preheat.simulation import scenario
from bev_preheat.vehicle import loading

SCHEMAS = {'vehicles': loading.SCHEMA, 'scenarios': scenario.SCHEMA, 'chargers': chargers.SCHEMA,
           'itineraries': itinerary.SCHEMA, 'routes/legs': legs.SCHEMA}
ODD_VALUES = (-1e9, 1e9, 0, 0.5, True, None, '', 'x' * 101, [], [1.0, [2.0], 'x'], {}, {'key': 1}, GONE)


def shipped():
    config = configuration_folder('vehicles').parent
    for folder, schema in SCHEMAS.items():
        for path in sorted((config / folder).glob('*.yaml')):
            yield folder, load_schema(schema), yaml.safe_load(path.read_text(encoding='utf-8'))


def test_every_shipped_file_surely_obeys():
    files = list(shipped())
    assert {folder for folder, _, _ in files} == set(SCHEMAS)
    for folder, schema, contents in files:
        assert surely_obeys(schema, contents), contents['name' if 'name' in contents else folder]


@pytest.mark.parametrize('every', [3, pytest.param(1, marks=pytest.mark.deep)])
@pytest.mark.parametrize('folder', SCHEMAS)
def test_what_is_sure_obeys(folder, every):
    _, schema, contents = next(file for file in shipped() if file[0] == folder)
    validator = Draft7Validator(schema)
    verdicts = []
    for place in list(places(contents))[::every]:
        if any(isinstance(key, int) and key > 0 for key in place):
            continue
        for value in ODD_VALUES:
            other = changed(contents, place, value)
            verdicts.append(surely_obeys(schema, other))
            assert not verdicts[-1] or validator.is_valid(other), (place, other)
    assert {True, False} == set(verdicts)


@pytest.mark.parametrize('schema, value', [
    ({'type': 'integer'}, 2.0), ({'oneOf': [{'type': 'number'}]}, 1), ({'enum': [1]}, 1),
    ({'uniqueItems': True}, [1, 2]), (True, 1)])
def test_what_is_not_sure_is_left_to_jsonschema(schema, value):
    assert Draft7Validator(schema).is_valid(value)
    assert not surely_obeys(schema, value)
