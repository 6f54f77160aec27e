# SPDX-License-Identifier: Apache-2.0
"""The shipped layouts show topics that the flight recorder writes; the analyzers cover all entries of a car."""

import json
from pathlib import Path
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

from bev_preheat.nodes.flight_recording import TYPES

CONFIG = Path(__file__).parents[2] / 'config'
LAYOUTS = CONFIG / 'layouts'
NUMBERS = {'float', 'double', 'uint8', 'int32', 'boolean'}


def foxglove_panels():
    return json.loads((LAYOUTS / 'foxglove.json').read_text())


def foxglove_paths(kind):
    return [path['value'] if isinstance(path, dict) else path
            for name, panel in foxglove_panels()['configById'].items() if name.startswith(kind)
            for path in panel.get('paths', [panel.get('topicPath')])]


def plotjuggler_paths():
    root = ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()
    assert root.tag == 'root'
    return [curve.get('name').replace('/', '.').replace('.', '/', 1) for curve in root.iter('curve')]


def type_of(path):
    """Return the type of the field at /topic.field; fails if there is none."""
    topic, _, field = path.partition('.')
    assert topic.startswith('/'), path
    return TYPES[topic[1:]].get_fields_and_field_types()[field]


@pytest.mark.parametrize('path, types', [
    *((path, NUMBERS) for path in (
        *foxglove_paths('Plot'), *foxglove_paths('StateTransitions'), *plotjuggler_paths())),
    *((path, {'string'}) for path in foxglove_paths('RawMessages'))])
def test_what_is_shown_is_a_number_or_a_text_that_the_recorder_writes(path, types):
    assert type_of(path) in types


def test_every_panel_has_a_place_and_every_place_a_panel():
    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node['first']) + leaves(node['second'])

    panels = foxglove_panels()
    assert sorted(leaves(panels['layout'])) == sorted(panels['configById'])


# Analyzers

ANALYZERS = {name: node for name, node in yaml.safe_load(
    (CONFIG / 'analyzers.yaml').read_text(encoding='utf-8'))['/**']['ros__parameters'].items()
    if isinstance(node, dict)}


# The simulator is no part of a car, and the dashboard has no entries of its own.
EXECUTABLES = sorted({path.name.partition('.')[0] for path in (CONFIG / 'sros2').iterdir()}
                     - {'vehicle_simulator', 'dashboard'})


@pytest.mark.parametrize('executable', EXECUTABLES)
@pytest.mark.parametrize('namespace', ['', 'car_7/'])
def test_each_node_has_one_analyzer(executable, namespace):
    entry = f'{namespace}{executable}: setup'
    assert sum(any(part in entry for part in analyzer['contains']) for analyzer in ANALYZERS.values()) == 1


def test_analyzers_are_complete_and_wait_longer_than_an_entry_is_repeated():
    for analyzer in ANALYZERS.values():
        assert analyzer['type'] == 'diagnostic_aggregator/GenericAnalyzer'
        assert analyzer['path']
        # Every node publishes its entries once a second.
        assert analyzer['timeout'] > 2.0
