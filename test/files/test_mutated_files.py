# SPDX-License-Identifier: Apache-2.0
"""Corrupted files of every kind: each is read, or refused in a bounded message without a traceback."""

import json
from pathlib import Path
from random import Random
import re

from hypothesis import given, settings
from hypothesis import strategies as st
from mistakes import mutated
import pytest
from refusals import problems_of

from bev_preheat.charging.chargers import load_chargers
from bev_preheat.control.itinerary import load_itinerary
from bev_preheat.control.settings import settings_of
from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.state_file import load_state
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.csv_file import load_route
from bev_preheat.route.legs import load_legs
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
ROUTE = load_route('winter_commute', VEHICLE.defaults)
LONG_ROUTE = load_route('motorway_3h', VEHICLE.defaults)
CAR = 'a' * 64
STATE = json.dumps({'bev_preheat_state_file': 3, 'cars': {CAR: {
    'log_factors': {'heat_capacity': 0.07, 'leakage': -0.2, 'resistance': 0.1, 'heater_efficiency': -0.03},
    'covariance': [[3e-4 if row == column else 0.0 for column in range(4)] for row in range(4)],
    'log_lags': {'heat': 0.6, 'sensor': -0.9}, 'lag_variances': {'heat': 0.04, 'sensor': 0.2},
    'last_seen': {'temperature_c': 11.5, 'soc': 0.5, 'stamp_ns': 1_700_000_000_000_000_000}}},
    'driver': {'switched_off_ns': 5, 'cancelled_trip': {
        'route_id': 'home', 'route_stamp_ns': 6, 'cancelled_ns': 7}, 'ended_trip': {
            'route_id': 'home', 'route_stamp_ns': 6, 'ended_ns': 8, 'is_observed': True}}}, indent=1)


def plan(vehicle=VEHICLE, route=ROUTE):
    """Plan like `preheat plan`, because a file that is read must also be fit for planning."""
    plan_preheating(vehicle, route, BatteryState(5.0, 0.8), Goal(20.0))


def read_scenario(path):
    settings_of(load_scenario(path).planner)


def read_state(path):
    """Read a state file; damage counts as a refusal."""
    damage = load_state(path, CAR).damage
    if damage:
        raise InvalidInput(damage)


# Kind of file: shipped examples, and the function that reads them.
KINDS = {
    'vehicle': ('vehicles/*.yaml', lambda path: plan(load_vehicle(path))),
    'route': ('routes/*.csv', lambda path: plan(route=load_route(path, VEHICLE.defaults))),
    'legs': ('routes/legs/*.yaml', lambda path: load_legs(path, VEHICLE)),
    'scenario': ('scenarios/*.yaml', read_scenario),
    'itinerary': ('itineraries/*.yaml', lambda path: load_itinerary(path, VEHICLE)),
    'chargers': ('chargers/*.yaml', lambda path: load_chargers(path, LONG_ROUTE, 0.5)),
    'state file': (None, read_state)}
# The limit of the message excludes the file name, which the test chooses.
LONGEST = 2200


@pytest.mark.parametrize('kind', KINDS)
@given(seed=st.integers(0, 2**32))
@settings(max_examples=2 * settings.default.max_examples)
def test_a_file_with_mistakes_is_read_or_refused_in_few_words(kind, seed, tmp_path_factory):
    pattern, read = KINDS[kind]
    originals = [path.read_bytes() for path in sorted(configuration_folder('').glob(pattern))] if pattern else [
        STATE.encode()]
    path = tmp_path_factory.mktemp('mistakes') / f'mistaken{Path(pattern or ".json").suffix}'
    random = Random(seed)
    path.write_bytes(mutated(random.choice(originals), random))
    try:
        read(path)
    except InvalidInput as error:
        assert 0 < len(str(error)) < LONGEST


@pytest.mark.parametrize('kind, name, key, value, problem', [
    ('legs', 'routes/legs/alpine_pass.yaml', 'seed', '6.0', 'seed: 6.0 is not an integer'),
    ('legs', 'routes/legs/alpine_pass.yaml', 'seed', '-0.0', 'seed: -0.0 is not an integer'),
    ('vehicle', 'vehicles/reference.yaml', 'capacity_ah', '1' * 400,
     'battery.capacity_ah: an integer of 1326 bits is too large'),
    ('vehicle', 'vehicles/reference.yaml', 'capacity_ah', '0x' + 'f' * 5000,
     'battery.capacity_ah: an integer of 20000 bits is too large'),
    ('vehicle', 'vehicles/reference.yaml', 'name', '!!int ""', 'is not YAML: a value does not fit its tag (!!…)')])
def test_a_number_that_the_reader_cannot_take_is_named(kind, name, key, value, problem, tmp_path):
    text = re.sub(rf'(?m)^(\s*{key}): .*$', lambda found: f'{found[1]}: {value}',
                  (configuration_folder('') / name).read_text(), count=1)
    path = tmp_path / 'mistaken.yaml'
    path.write_text(text)
    assert problems_of(KINDS[kind][1], path) == [f'{path}: {problem}']


def test_of_one_mistake_in_each_row_the_first_few_are_named(tmp_path):
    path = tmp_path / 'route.csv'
    path.write_text('duration_s,speed_mps,propulsion_power_w,ambient_temperature_c\n' + '30,10,1e4,-7x\n' * 500)
    assert problems_of(load_route, path, VEHICLE.defaults) == [
        *(f"{path}, line {line}: ambient_temperature_c: '-7x' is not a number" for line in (2, 3, 4)),
        '497 more problems']
