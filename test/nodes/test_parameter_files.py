# SPDX-License-Identifier: Apache-2.0
"""
Parameters of the nodes through files: what `ros2 param dump` writes, loaded again.

No package index has ros2cli, so the dump is made as it makes it (jazzy: ros2param/verb/dump.py): every
parameter that the node lists, as YAML with a level for each dot. The file is read as by
`ros2 param load`, with rclpy's own reader.
"""

import pytest
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python
import yaml

NODES = {'planner': ('-p', 'arrival_soc_margin:=0.0625'), 'nlp_checker': (), 'charger_adviser': (),
         'route_publisher': (), 'heater_controller': (), 'vehicle_simulator': ('-p', 'start_time:=1700000000.0'),
         'bus_gateway': ('-p', 'signals:=example_car')}


class Services:
    """The parameter services of a node."""

    def __init__(self, bench, name):
        self._bench, self._name = bench, name

    def values(self):
        names = self._call(ListParameters, 'list').result.names
        values = self._call(GetParameters, 'get', names=names).values
        return dict(zip(names, map(parameter_value_to_python, values)))

    def read_only(self, names):
        descriptors = self._call(DescribeParameters, 'describe', names=names).descriptors
        return {descriptor.name for descriptor in descriptors if descriptor.read_only}

    def load(self, path):
        """Set all that is in a file; return (names, names of those that were refused)."""
        parameters = list(parameter_dict_from_yaml_file(str(path), target_nodes=[f'/{self._name}']).values())
        results = self._call(SetParameters, 'set', parameters=parameters).results
        return ({parameter.name for parameter in parameters},
                {parameter.name for parameter, result in zip(parameters, results)
                 if not result.successful})

    def _call(self, service, verb, **fields):
        return self._bench.call(
            service, f'{self._name}/{verb}_parameters', service.Request(**fields))


def dump(path, node_name, values):
    """Write a file as `ros2 param dump` does."""
    tree = {}
    for name, value in sorted(values.items()):
        branch, (*above, last) = tree, name.split('.')
        for part in above:
            branch = branch.setdefault(part, {})
        branch[last] = value
    path.write_text(yaml.dump({f'/{node_name}': {'ros__parameters': tree}},
                              default_flow_style=False))


@pytest.mark.parametrize('name, arguments', NODES.items(), ids=NODES)
def test_what_was_dumped_can_be_loaded_and_started_with(rehearsal, tmp_path, name, arguments):
    process, path = rehearsal.start(name, *arguments), tmp_path / 'dumped.yaml'
    services = Services(rehearsal, name)
    values = services.values()
    dump(path, name, values)
    names, refused = services.load(path)
    # A fixed parameter cannot be set, not even to the same value.
    assert refused <= services.read_only(sorted(names))
    # NaN would differ from itself.
    assert (names, services.values()) == (set(values), values)
    process.end()
    started = rehearsal.start(name, '--params-file', path)
    assert services.values() == values
    assert started.exit_status is None
