# SPDX-License-Identifier: Apache-2.0
"""The analyzers' file covers the entries of all executables of a car, each by one analyzer."""

from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
ANALYZERS = {name: node for name, node in yaml.safe_load(
    (ROOT / 'config/analyzers.yaml').read_text(encoding='utf-8'))['/**']['ros__parameters'].items()
    if isinstance(node, dict)}


# The simulator is no part of a car, and the dashboard has no entries of its own.
EXECUTABLES = sorted({path.name.partition('.')[0] for path in (ROOT / 'config/sros2').iterdir()}
                     - {'vehicle_simulator', 'dashboard'})


def test_executables_are_found():
    assert {'planner', 'heater_controller', 'bus_gateway'} <= set(EXECUTABLES)


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
