# SPDX-License-Identifier: Apache-2.0
"""
The SROS 2 policies allow exactly the endpoints of the nodes.

The nodes run without DDS security, which is missing from ROS 2's wheels, and mostly in this process; the graph
shows their endpoints.
"""

from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

from ament_index_python.packages import get_package_prefix
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rehearsal import class_of, SilentNode
from waiting import poll_until

from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand

FOLDER = Path(__file__).resolve().parents[2] / 'config' / 'sros2'
SIGNALS = FOLDER.parent / 'signals'
EXECUTABLES = ('planner', 'nlp_checker', 'charger_adviser', 'route_publisher', 'heater_controller',
               'vehicle_simulator')
# A gateway has the endpoints of its bus, so it is tested with several signal maps.
GATEWAY = 'bus_gateway'
OPTIONS = {'planner': ('-p', 'lifecycle:=true'),
           'vehicle_simulator': ('-p', 'heater_status:=true', '-p', 'vehicle:=heat_pump_car'),
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


@pytest.fixture(scope='module')
def silent_context(ros):
    """Give a context without the nodes of other tests, whose late end would take a namesake's endpoints away."""
    context = Context()
    context.init(args=[])
    yield context
    context.try_shutdown()


@contextmanager
def spun(context, executable, *arguments):
    """Give the node of an executable in this process, and a function that lets it work until a condition holds."""
    node_class = type('Silent', (class_of(executable), SilentNode), {
        'silent_context': context, 'arguments': arguments})
    node, executor = node_class(), SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def wait_until(condition, what):
        return poll_until(lambda: condition() or executor.spin_once(0.05), what)

    try:
        yield node, wait_until
    finally:
        executor.shutdown()
        node.destroy_node()


@pytest.mark.parametrize('executable', EXECUTABLES)
def test_a_policy_allows_what_the_node_uses_and_nothing_else(silent_context, executable, car_with_gates):
    options = OPTIONS.get(executable, ())
    if executable == 'heater_controller':
        gated_car = car_with_gates('minimum_soc: 0.15, only_while_standing: true')
        options = ('-p', f'vehicle:={gated_car}', '-p', 'lifecycle:=true')
    with spun(silent_context, executable, *options) as (node, wait_until):
        # The planner listens to commands while another node publishes them.
        tester = rclpy.create_node('tester', context=silent_context)
        tester.create_publisher(HvchCommand, 'hvch_command', 10)
        tester.create_publisher(HeatSourceCommand, 'heat_source_command', 10)
        allowed = policy(executable)
        if executable == 'heater_controller':
            # It executes the command of the HVCH or of another source.
            allowed = {key: {name for name in names if not name.startswith('heat_source_')}
                       for key, names in allowed.items()}
        uses(node, executable, allowed, wait_until)
        tester.destroy_node()


@pytest.mark.needs('tornado')
def test_the_policy_of_the_dashboard_allows_what_it_uses_and_nothing_else(bench):
    # It has endpoints for the planners that it finds.
    bench.start('planner')
    bench.start('dashboard', *OPTIONS['dashboard'])
    uses(bench.node, 'dashboard', policy('dashboard'), poll_until)


def uses(node, executable, expected, wait_until):
    """Wait until a node has the expected endpoints."""
    def agrees():
        # A node that the graph does not show yet raises.
        names = [name for name, _ in node.get_node_names_and_namespaces()]
        return executable in names and used(node, executable) == expected
    try:
        wait_until(agrees, 'the endpoints of the policy')
    except AssertionError:
        assert used(node, executable) == expected
        raise


def test_policy_of_the_gateway_allows_what_can_and_vss_use_together(silent_context, tmp_path):
    can_map, dbc = tmp_path / 'can.yaml', (SIGNALS / 'example_car.dbc').read_text()
    pump = 'BO_ 754 Pump_Command: 2 GATEWAY\n SG_ Pump_Power : 0|16@1+ (1,0) [0|7000] "W" HVCH\n\n'
    (tmp_path / 'example_car.dbc').write_text(dbc.replace('BO_ 753 HVCH_Status', f'{pump}BO_ 753 HVCH_Status'))
    # Any signal with a unit of speed will do.
    can_map.write_text((SIGNALS / 'example_car.yaml').read_text().replace(
        '  soc:', '  speed_mps: {channels: BMS_Status.BMS_SoC, unit: m/s}\n  soc:')
        + '  heat_sources:\n    pump: {command: {message: Pump_Command, power: Pump_Power}}\n')
    allowed = policy(GATEWAY)
    action = allowed.pop(('actions', 'call'))
    # There is neither a bus nor a broker; the endpoints do not wait for them.
    with spun(silent_context, GATEWAY, '-p', f'signals:={can_map}') as (node, wait_until):
        uses(node, GATEWAY, allowed, wait_until)
    vss = '-p', 'signals:=vss', '-r', '__node:=bus_gateway_vss'
    with spun(silent_context, GATEWAY, *vss) as (node, wait_until):
        # VSS has no frame for the heater.
        uses(node, 'bus_gateway_vss', {
            **allowed, ('actions', 'call'): action,
            ('topics', 'publish'): allowed['topics', 'publish'] - {'hvch_status', 'heat_source_status'},
            ('topics', 'subscribe'): allowed['topics', 'subscribe'] - {'heat_source_command'}}, wait_until)


def test_each_executable_has_a_policy_and_only_the_planner_may_command_the_heater():
    everything = {path.name for path in (Path(get_package_prefix('bev_preheat')) / 'lib' / 'bev_preheat').iterdir()
                  if path.name not in ('preheat', '__pycache__')}
    assert {path.name.partition('.')[0] for path in FOLDER.glob('*.policy.xml')} == everything
    commanders = {executable for executable in everything
                  if 'hvch_command' in policy(executable).get(('topics', 'publish'), ())}
    assert commanders == COMMANDERS
