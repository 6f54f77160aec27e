# SPDX-License-Identifier: Apache-2.0
"""Set-up errors around the installed nodes are described in the log and in the diagnostics."""

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Temperature
from spinning import take_down

from bev_preheat.nodes.convert import time_message
from bev_preheat.nodes.setup_watch import clock_hint
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
DAY_NS = 86400 * 10**9
WALL_NS = 1_795_000_000 * 10**9


def setup_entry(diagnostics, name, text, level=DiagnosticStatus.WARN):
    """Return the message of the setup entry that has the text and the level, once it comes."""
    def entries(array):
        return [status for status in array.status if status.name == f'{name}: setup'
                and status.level == level and text in status.message]

    return entries(diagnostics.wait_for(lambda array: entries(array), f'{name}: {text}'))[0].message


class Shared:
    """A node that tests share, with the test's own publishers and subscriptions around it."""

    def __init__(self, bench, name):
        self.name = name
        self.process = bench.start(name)
        self.diagnostics = bench.record(DiagnosticArray, '/diagnostics')
        self._bench = bench
        self._made = []
        self._before = 0

    def publish(self, message_type, topic, qos=1):
        """Advertise until the test is over; returns the rclpy publisher."""
        node = self._bench.node
        publisher = node.create_publisher(message_type, topic, qos)
        self._made.append(lambda: node.destroy_publisher(publisher))
        return publisher

    def subscribe(self, message_type, topic, qos):
        """Subscribe until the test is over."""
        node = self._bench.node
        subscription = node.create_subscription(message_type, topic, lambda message: None, qos)
        self._made.append(lambda: node.destroy_subscription(subscription))

    def entry(self, text, level=DiagnosticStatus.WARN):
        """Return the next message of the setup entry with this text and level."""
        self.diagnostics.clear()
        return setup_entry(self.diagnostics, self.name, text, level)

    def log(self):
        """Return the log since the start of the test."""
        return self.process.output()[self._before:]

    def take_down(self):
        """Remove the test's own nodes; the planner must then report a correct set-up."""
        while self._made:
            take_down(self._bench.node, self._made.pop())
        self.entry('fit', DiagnosticStatus.OK)
        assert self.process.exit_status is None
        self._before = len(self.process.output())


@pytest.fixture(scope='module')
def running(module_bench):
    """`running(name)` is the Shared of an executable; the previous one is ended, because each takes time."""
    latest = []

    def running(name):
        if not latest or latest[-1].name != name:
            if latest:
                latest[-1].process.end()
            latest.append(Shared(module_bench, name))
        return latest[-1]
    return running


@pytest.fixture
def shared(running, name):
    """Give the node of the name that the test has as parameter."""
    shared = running(name)
    yield shared
    shared.take_down()


@pytest.mark.parametrize('name', ['planner'])
def test_all_is_well_with_what_fits(shared, name):
    shared.subscribe(HvchCommand, 'hvch_command', BEST_EFFORT)
    # Matches one subscription.
    shared.publish(RoutePlan, 'route_plan', BEST_EFFORT)
    shared.publish(BatteryState, 'battery_state', LATCHED)
    # The second check certainly sees them.
    for _ in range(2):
        shared.entry('parameters, clock and topics fit', DiagnosticStatus.OK)
    assert 'WARN' not in shared.log()


# Those of one executable follow each other. Of one topic one node can have one type only.
MISFITS = {
    'planner': ('planner', [
        (lambda shared: shared.publish(Temperature, 'battery_state'),
         '/tester publishes /battery_state as sensor_msgs/msg/Temperature; the type must be '
         'sensor_msgs/msg/BatteryState'),
        (lambda shared: shared.publish(Temperature, 'route_plan'),
         '/tester publishes /route_plan as sensor_msgs/msg/Temperature; the type must be '
         'bev_preheat_msgs/msg/RoutePlan'),
        (lambda shared: shared.subscribe(HvchCommand, 'hvch_command', LATCHED),
         '/tester subscribes to /hvch_command with an incompatible quality of service: '
         'volatile publisher and transient local subscription')]),
    'type of a subscription': ('planner', [
        (lambda shared: shared.subscribe(Temperature, 'hvch_command', 1),
         '/tester subscribes to /hvch_command as sensor_msgs/msg/Temperature')]),
    'type of hvch_command': ('vehicle_simulator', [
        (lambda shared: shared.publish(Temperature, 'hvch_command'),
         '/tester publishes /hvch_command as sensor_msgs/msg/Temperature')]),
    'best-effort commands': ('vehicle_simulator', [
        (lambda shared: shared.publish(HvchCommand, 'hvch_command', BEST_EFFORT),
         '/tester publishes /hvch_command with an incompatible quality of service: '
         'best effort publisher and reliable subscription')]),
    'checker': ('nlp_checker', [
        (lambda shared: shared.publish(Temperature, 'route_plan'),
         '/tester publishes /route_plan as sensor_msgs/msg/Temperature'),
        (lambda shared: shared.publish(PreheatPlan, 'preheat_plan'),
         '/tester publishes /preheat_plan with an incompatible quality of service: ')]),
}


@pytest.mark.parametrize('name, misfits', [
    pytest.param(*misfits, id=kind, marks=pytest.mark.deep if kind == 'checker' else [])
    for kind, misfits in MISFITS.items()])
def test_who_does_not_fit_is_named_once_in_the_log_and_forgotten_when_gone(shared, name, misfits):
    texts = [text for _, text in misfits]
    for make, _ in misfits:
        make(shared)
    for text in texts:
        setup_entry(shared.diagnostics, name, text)
    # Two checks later they are still there, and not logged again.
    message = shared.entry(texts[0])
    assert all(text in message for text in texts)
    assert [shared.log().count(text) for text in texts] == [1] * len(texts)


def stamped(instant_ns):
    message = BatteryState(temperature=-7.0, percentage=0.8)
    message.header.stamp = time_message(instant_ns)
    return message


def refusals(diagnostics):
    return [status.message for array in diagnostics.messages for status in array.status
            if 'battery_state refused' in status.message]


@pytest.mark.parametrize('name', [
    'nlp_checker', pytest.param('planner', marks=pytest.mark.deep)])
def test_simulated_stamps_against_the_wall_clock_are_told(shared, name, wait_until):
    states = shared.publish(BatteryState, 'battery_state')
    shared.diagnostics.clear()

    def are_refused():
        states.publish(stamped(1000 * 10**9))
        return refusals(shared.diagnostics)

    text = ("days before this node's time, which is the system's: if the sender is simulated or "
            'replayed, set use_sim_time:=true here')
    assert text in wait_until(are_refused, 'a refusal')[0]
    assert text in shared.log()


# Unknown parameters

def test_a_misspelt_parameter_on_the_command_line_is_told_with_the_nearest(bench):
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    planner = bench.start('planner', '-p', 'vehicel:=small_car')
    text = "parameter 'vehicel' is unknown and ignored; did you mean 'vehicle'?"
    assert setup_entry(diagnostics, 'planner', text) == text
    assert planner.output().count(text) == 1


@pytest.mark.parametrize('name, misspelt, nearest', [
    pytest.param('nlp_checker', 'time_limits', 'time_limit', marks=pytest.mark.deep),
    ('vehicle_simulator', 'initial_socc', 'initial_soc')])
def test_a_misspelt_parameter_in_a_file_is_told(bench, tmp_path, name, misspelt, nearest):
    path = tmp_path / 'parameters.yaml'
    path.write_text(f'{name}:\n  ros__parameters:\n    {misspelt}: 0.5\n    use_sim_time: false\n'
                    'another_node:\n  ros__parameters:\n    colour: red\n')
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    bench.start(name, '--params-file', str(path))
    text = f'parameter {misspelt!r} is unknown and ignored; did you mean {nearest!r}?'
    assert setup_entry(diagnostics, name, text) == text


def test_parameters_that_ros_knows_are_not_unknown(bench):
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    planner = bench.start(
        'planner', '-p', 'use_sim_time:=false', '-p', 'start_type_description_service:=false',
        '-p', 'qos_overrides./route_plan.subscription.depth:=2', '-p', 'vehicle:=small_car',
        '-p', 'another_node:colour:=red')
    setup_entry(diagnostics, 'planner', 'fit', DiagnosticStatus.OK)
    assert 'unknown' not in planner.output()


def test_a_file_for_another_node_is_told(bench, tmp_path):
    path = tmp_path / 'parameters.yaml'
    path.write_text('planer:\n  ros__parameters:\n    vehicle: small_car\n')
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    bench.start('planner', '--params-file', str(path))
    setup_entry(diagnostics, 'planner', 'the parameter file holds nothing for /planner')


# Clocks

@pytest.mark.parametrize('name', [
    'planner', pytest.param('nlp_checker', marks=pytest.mark.deep)])
def test_with_simulated_time_no_clock_and_wall_stamps_are_told(bench, wait_until, name):
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    process = bench.start(name, '-p', 'use_sim_time:=true')
    text = 'use_sim_time is set and no /clock has arrived: time stands at 0'
    assert setup_entry(diagnostics, name, text) == text
    assert text in process.output()
    clocks = bench.publisher(Clock, '/clock')
    diagnostics.clear()

    def is_well():
        # Its timers need a clock that runs.
        clocks.publish(Clock(clock=time_message(1000 * 10**9 + time.monotonic_ns())))
        return any((status.name, status.level) == (f'{name}: setup', DiagnosticStatus.OK)
                   for array in diagnostics.messages for status in array.status)

    wait_until(is_well, 'an entry without a problem')
    states = bench.publisher(BatteryState, 'battery_state')
    hint = ("days after this node's time, which is /clock (use_sim_time is set): set "
            'use_sim_time:=true at the sender too, or use_sim_time:=false here')

    def are_refused():
        clocks.publish(Clock(clock=time_message(1000 * 10**9 + time.monotonic_ns())))
        states.publish(stamped(time.time_ns()))
        # The log repeats a refusal every 5 s, and the first may precede the clock.
        return (any(hint in refusal for refusal in refusals(diagnostics))
                and hint in process.output())

    wait_until(are_refused, 'a refusal with the hint')


@pytest.mark.parametrize('now_ns, stamp_ns, is_far', [
    (WALL_NS, WALL_NS - DAY_NS // 2, False), (WALL_NS, WALL_NS - 2 * DAY_NS, True),
    (WALL_NS, WALL_NS + 2 * DAY_NS, True), (0, WALL_NS, False), (WALL_NS, 0, False)])
def test_only_clocks_that_are_days_apart_are_different_clocks(now_ns, stamp_ns, is_far):
    for uses_sim_time in (False, True):
        assert bool(clock_hint(uses_sim_time, now_ns, stamp_ns)) == is_far
