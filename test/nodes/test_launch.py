# SPDX-License-Identifier: Apache-2.0
"""The launch file and its parameters, without launch: no package index has it."""

from pathlib import Path
import re
from xml.etree import ElementTree

from ament_index_python.packages import get_package_prefix, get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rehearsal import program_of
import yaml

from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand

SHARE = Path(get_package_share_directory('bev_preheat'))
PARAMETERS_FILE = SHARE / 'config' / 'parameters.yaml'


@pytest.fixture(scope='module')
def launch():
    return ElementTree.parse(SHARE / 'launch' / 'preheat.launch.xml').getroot()


def substituted(text, values):
    """Substitute as launch does: $(var NAME), $(not VALUE) and $(find-pkg-share PACKAGE)."""
    text = re.sub(r'\$\(find-pkg-share (\w+)\)', lambda found: get_package_share_directory(found[1]),
                  text)
    text = re.sub(r'\$\(var (\w+)\)', lambda found: substituted(values[found[1]], values), text)
    text = re.sub(r'\$\(not (\w+)\)', lambda found: str(found[1] != 'true').lower(), text)
    # Of expressions, the file has the comparison with an empty text alone.
    return re.sub(r"\$\(eval '\\'([^']*)\\' != \\'\\''\)", lambda found: str(found[1] != '').lower(), text)


def values_of(launch, **given):
    defaults = {argument.get('name'): argument.get('default') for argument in launch.findall('arg')}
    assert given.keys() <= defaults.keys()
    return {**defaults, **given}


def nodes_of(parent, values, before=()):
    """Yield each node with the ROS arguments of the groups around it, which come before its own."""
    arguments = list(before)
    for child in parent:
        if child.tag == 'group':
            yield from nodes_of(child, values, arguments)
        elif child.tag == 'node':
            yield child, arguments
        elif child.tag == 'set_parameters_from_file':
            arguments += ['--params-file', substituted(child.get('filename'), values)]
        elif child.tag == 'set_parameter' and substituted(child.get('if', 'true'), values) == 'true':
            arguments += ['-p', f'{child.get("name")}:={substituted(child.get("value"), values)}']


def started_by(launch, **given):
    """Return [(executable, ROS arguments)] of the nodes that `ros2 launch` starts with these arguments."""
    values, started = values_of(launch, **given), []
    for node, of_group in nodes_of(launch, values):
        if substituted(node.get('if', 'true'), values) != 'true':
            continue
        namespace = substituted(launch.find('.//push-ros-namespace').get('namespace'), values)
        arguments = ['-r', f'__node:={node.get("name")}', '-r', f'__ns:={namespace}']
        arguments += of_group
        for parameter in node.findall('param'):
            if parameter.get('from'):
                arguments += ['--params-file', substituted(parameter.get('from'), values)]
            else:
                value = substituted(parameter.get('value'), values)
                arguments += ['-p', f'{parameter.get("name")}:={value}']
        started.append((node.get('exec'), arguments))
    return started


def test_it_starts_executables_of_this_package_with_parameters_that_they_have(launch):
    for node in launch.iter('node'):
        assert node.get('pkg') == 'bev_preheat'
        executable = node.get('exec')
        assert (Path(get_package_prefix('bev_preheat')) / 'lib' / 'bev_preheat' / executable).is_file()
        known = {parameter.name for parameter in program_of(executable).parameters} | {'use_sim_time'}
        assert {parameter.get('name') for parameter in node.findall('param')} - {None} <= known
    assert all(argument.get('description') for argument in launch.findall('arg'))
    assert {parameter.get('name') for parameter in launch.iter('set_parameter')} <= {
        parameter.name for parameter in program_of('planner').parameters}


@pytest.mark.parametrize('given, executables', [
    ({}, ['planner']), ({'heater': 'true'}, ['planner', 'heater_controller']),
    ({'checker': 'true'}, ['planner', 'nlp_checker']), ({'dashboard': 'true'}, ['planner', 'dashboard']),
    ({'checker': 'true', 'simulator': 'true'}, ['planner', 'nlp_checker', 'vehicle_simulator'])])
def test_the_planner_comes_alone_unless_more_is_wanted(launch, given, executables):
    assert [name for name, _ in started_by(launch, **given)] == executables


def test_arguments_that_are_not_given_leave_the_values_of_the_parameter_file(launch):
    (_, arguments), = started_by(launch)
    names = {argument.partition(':=')[0] for argument in arguments}
    assert not names & {'state_file', 'flight_recorder', 'locked'}
    (_, arguments), = started_by(launch, state_file='/data/state', flight_recorder='/data/flights', locked='true')
    # Later ones count.
    after_the_file = set(arguments[arguments.index('--params-file') + 2:])
    assert {'state_file:=/data/state', 'flight_recorder:=/data/flights', 'locked:=true'} <= after_the_file


def test_example_with_a_lifecycle_manager_names_the_managed_nodes(launch):
    example = ElementTree.parse(SHARE / 'launch' / 'managed.launch.xml').getroot()
    given = {argument.get('name'): argument.get('value') for argument in example.find('include').findall('arg')}
    manager = {parameter.get('name'): parameter.get('value')
               for parameter in example.find('.//node').findall('param')}
    started = started_by(launch, **{**given, 'namespace': '/'})
    managed = [name for name, arguments in started if 'lifecycle:=true' in arguments]
    assert sorted(manager['node_names'].split(',')) == sorted(managed) == ['heater_controller', 'planner']
    assert (manager['autostart'], float(manager['bond_timeout'])) == ('true', 0.0)


def test_nodes_of_the_car_are_restarted_on_request(launch):
    respawned = {node.get('exec') for node in launch.iter('node') if node.get('respawn') == '$(var respawn)'}
    assert respawned == {'planner', 'heater_controller', 'bus_gateway'}
    assert values_of(launch)['respawn'] == 'false'


@pytest.mark.parametrize('heater', ['true', 'false'])
def test_one_node_writes_the_command_to_can(launch, heater):
    started = dict(started_by(launch, bus='true', signals='my_car.yaml', heater=heater))
    assert ('heater_controller' in started) is (heater == 'true')
    assert {'signals:=my_car.yaml', f'execute_commands:={"false" if heater == "true" else "true"}'} <= set(
        started['bus_gateway'])
    assert heater == 'false' or 'signals:=my_car.yaml' in started['heater_controller']


@pytest.mark.parametrize('name', ['planner', 'nlp_checker', 'dashboard'])
def test_the_parameter_file_has_every_parameter_with_its_default(name):
    contents = yaml.safe_load(PARAMETERS_FILE.read_text(encoding='utf-8'))
    values = contents[f'/**/{name}']['ros__parameters']
    # The vehicle is the launch file's argument, which would override the file's.
    # A token has a file that others cannot read.
    assert values == {parameter.name: parameter.default for parameter in program_of(name).parameters
                      if parameter.name not in ('vehicle', 'token')}
    for parameter in program_of(name).parameters:
        # An integer for a double would be refused.
        value = values.get(parameter.name, 'reference')
        assert value.__class__ is parameter.default.__class__


def test_what_it_starts_drives_in_a_namespace(launch, rehearsal, tmp_path):
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text(PARAMETERS_FILE.read_text(encoding='utf-8').replace(
        'command_lease: 2.5', 'command_lease: 2.25'), encoding='utf-8')
    commands = rehearsal.record(HvchCommand, '/lorry/hvch_command', 10)
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 50)
    for name, arguments in started_by(
            launch, namespace='/lorry', simulator='true', speed_up='50.0', vehicle='small_car',
            parameters=str(parameters)):
        rehearsal.start(name, *arguments)
    waiting = commands.wait_for(lambda message: message.reason == Status.WAITING, 'a plan')
    lease_s = (waiting.valid_until.sec - waiting.header.stamp.sec
               + 1e-9 * (waiting.valid_until.nanosec - waiting.header.stamp.nanosec))
    assert lease_s == pytest.approx(2.25)
    assert diagnostics.wait_for(lambda message: any(
        status.hardware_id == 'small_car' for status in message.status), 'the vehicle')
