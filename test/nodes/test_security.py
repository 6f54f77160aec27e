# SPDX-License-Identifier: Apache-2.0
"""
The SROS 2 policies allow exactly the endpoints of the nodes.

The nodes run without DDS security, which is missing from ROS 2's wheels; the graph shows their endpoints.
"""

from pathlib import Path
from xml.etree import ElementTree

from ament_index_python.packages import get_package_prefix
from node_bench import poll_until
import pytest

from bev_preheat_msgs.msg import HvchCommand

FOLDER = Path(__file__).resolve().parents[2] / 'config' / 'sros2'
SIGNALS = FOLDER.parent / 'signals'
EXECUTABLES = ('planner', 'nlp_checker', 'charger_adviser', 'route_publisher', 'heater_controller',
               'vehicle_simulator', pytest.param('dashboard', marks=pytest.mark.needs('tornado')))
# A gateway has the endpoints of its bus, so it is tested with several signal maps.
GATEWAY = 'bus_gateway'
OPTIONS = {'planner': ('-p', 'lifecycle:=true'),
           'vehicle_simulator': ('-p', 'heater_status:=true'),
           'dashboard': ('-p', 'port:=0', '-p', 'controls:=true')}
# Only these may command the heater, in a car and in a simulated one.
COMMANDERS = {'planner'}


def policy(executable):
    """Return {(kind, 'publish' ...): names} of a policy file."""
    root = ElementTree.parse(FOLDER / f'{executable}.policy.xml').getroot()
    (enclave,) = root.iter('enclave')
    assert enclave.get('path') == f'/bev_preheat/{executable}'
    (profile,) = enclave.iter('profile')
    assert (profile.get('ns'), profile.get('node')) == ('/', executable)
    allowed = {}
    for group in profile:
        ((right, verdict),) = group.attrib.items()
        assert verdict == 'ALLOW'
        allowed[group.tag, right] = {name.text for name in group}
    return allowed


def without_root(name, executable):
    """Return a name as the policies have it: relative unless it is the same in every namespace."""
    if name.startswith(f'/{executable}/'):
        return f'~/{name.removeprefix(f"/{executable}/")}'
    return name if name in ('/rosout', '/parameter_events', '/diagnostics', '/clock') else name.lstrip('/')


def used(node, executable):
    """Return the endpoints of a running node in the graph, in the same form."""
    def names(found):
        return {without_root(name, executable) for name, _ in found}
    topics_out = names(node.get_publisher_names_and_types_by_node(executable, '/'))
    topics_in = names(node.get_subscriber_names_and_types_by_node(executable, '/'))
    services = names(node.get_service_names_and_types_by_node(executable, '/'))
    clients = names(node.get_client_names_and_types_by_node(executable, '/'))
    actions, called = ({name.partition('/_action/')[0] for name in found if '/_action/' in name}
                       for found in (services, clients))

    def plain(found):
        return {name for name in found if '/_action/' not in name}
    found = {('topics', 'publish'): plain(topics_out), ('topics', 'subscribe'): plain(topics_in),
             ('services', 'reply'): plain(services), ('services', 'request'): plain(clients),
             ('actions', 'execute'): actions, ('actions', 'call'): called}
    return {key: value for key, value in found.items() if value}


@pytest.mark.parametrize('executable', EXECUTABLES)
def test_a_policy_allows_what_the_node_uses_and_nothing_else(bench, executable, gated_car):
    # The planner listens to hvch_command while another node publishes it.
    bench.publisher(HvchCommand, 'hvch_command', 10)
    options = OPTIONS.get(executable, ())
    if executable == 'heater_controller':
        options = ('-p', f'vehicle:={gated_car}', '-p', 'lifecycle:=true')
    if executable == 'dashboard':
        # It has endpoints for the planners that it finds.
        bench.start('planner')
    bench.start(executable, *options)
    uses(bench, executable, policy(executable))


def uses(bench, executable, expected):
    """Wait until a node has the expected endpoints."""
    def agrees():
        # A node that the graph does not show yet raises.
        names = [name for name, _ in bench.node.get_node_names_and_namespaces()]
        return executable in names and used(bench.node, executable) == expected
    try:
        poll_until(agrees, 'the endpoints of the policy')
    except AssertionError:
        assert used(bench.node, executable) == expected
        raise


def test_policy_of_the_gateway_allows_what_can_and_vss_use_together(bench, tmp_path):
    can_map = tmp_path / 'can.yaml'
    can_map.write_text((SIGNALS / 'example_car.yaml').read_text().replace(
        'dbc: example_car.dbc', f'dbc: {SIGNALS / "example_car.dbc"}').replace(
        # Any signal with a unit of speed will do.
        '  soc:', '  speed_mps: {channels: BMS_Status.BMS_SoC, unit: m/s}\n  soc:'))
    allowed = policy(GATEWAY)
    action = allowed.pop(('actions', 'call'))
    # There is neither a bus nor a broker; the endpoints do not wait for them.
    gateway = bench.start(GATEWAY, '-p', f'signals:={can_map}')
    uses(bench, GATEWAY, allowed)
    gateway.end()
    bench.start(GATEWAY, '-p', 'signals:=vss', '-r', '__node:=bus_gateway_vss')
    # VSS has no frame for the heater.
    uses(bench, 'bus_gateway_vss', {
        **allowed, ('actions', 'call'): action,
        ('topics', 'publish'): allowed['topics', 'publish'] - {'hvch_status'}})


def test_each_executable_has_a_policy_and_only_the_planner_may_command_the_heater():
    everything = {path.name for path in (Path(get_package_prefix('bev_preheat')) / 'lib' / 'bev_preheat').iterdir()
                  if path.name not in ('preheat', '__pycache__')}
    assert {path.name.partition('.')[0] for path in FOLDER.glob('*.policy.xml')} == everything
    commanders = {executable for executable in everything
                  if 'hvch_command' in policy(executable).get(('topics', 'publish'), ())}
    assert commanders == COMMANDERS


@pytest.fixture
def gated_car(tmp_path):
    """Return a vehicle file with gates on the battery and on the speed."""
    from bev_preheat.files.configuration import find_configuration
    path = tmp_path / 'gated.yaml'
    path.write_text(find_configuration('vehicles', 'reference', '.yaml').read_text() + (
        '\nheating_gates: {minimum_soc: 0.15, only_while_standing: true}\n'))
    return path
