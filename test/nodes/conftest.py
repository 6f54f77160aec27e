# SPDX-License-Identifier: Apache-2.0
"""
Fixtures for tests of the installed executables over real DDS.

    def test_something(bench):
        commands = bench.record(HvchCommand, 'hvch_command', 10)     # subscribe first,
        bench.start('planner', '-p', 'vehicle:=reference')           # then start the node,
        states = bench.publisher(BatteryState, 'battery_state', 1)
        states.wait_for_subscription()                               # wait for the match,
        states.publish(BatteryState(...))
        commands.wait_for(lambda m: m.battery_heating_power == 0.0)  # and for the answer.

Each test has its own ROS domain. Tests wait for a condition with a time limit; the limit
is generous because only a failing test uses it up.
"""

from collections import Counter
from contextlib import contextmanager
import gc
from importlib import import_module
import signal
import sys
from types import SimpleNamespace

from node_bench import Bench, PatientProcess
import pytest
from rclpy.context import Context
from rehearsal import Rehearsal
from spinning import spun_node

from bev_preheat.nodes.installed_drive import reserved_domain_id
from bev_preheat.vehicle import vehicle_contents

# Files of 8 s and more, processor time or waiting, the longest first: no long file may begin last.
LONGEST = [f'{name}.py' for name in (
    'test_demo', 'test_whole_car', 'test_nlp_checker', 'test_scenarios', 'test_installed_drive',
    'test_dashboard_page', 'test_optimum', 'test_dashboard', 'test_target_choice', 'test_planner_over_dds',
    'test_bus_gateway', 'test_wheel', 'test_managed', 'test_tutorials', 'test_planner_node',
    'test_prepare_action', 'test_planning_commands', 'test_worker', 'test_exported_planner')]


def pytest_collection_modifyitems(items):
    """Run the longest files first, then those over DDS, which mostly wait, then those marked costly."""
    waiting = Counter(item.path for item in items if 'dds' in item.fixturenames)
    costly = Counter(item.path for item in items if item.get_closest_marker('costly') is not None)

    def rank(item):
        name = item.path.name
        return (LONGEST.index(name) if name in LONGEST else len(LONGEST), -waiting[item.path], -costly[item.path])
    items.sort(key=rank)


@pytest.fixture(scope='session')
def silent_context(ros):
    """Give the ROS context of all rehearsals."""
    context = Context()
    context.init(args=[])
    yield context
    context.try_shutdown()


@pytest.fixture
def rehearsal(silent_context):
    """Return a Rehearsal: nodes in this process, without DDS."""
    with Rehearsal(silent_context).held() as rehearsal:
        yield rehearsal


@pytest.fixture(scope='module')
def module_rehearsal(silent_context):
    """Return a Rehearsal that the tests of a module share."""
    with Rehearsal(silent_context).held() as rehearsal:
        yield rehearsal


@contextmanager
def in_domain(number, folder):
    """Let the processes that start inherit a ROS domain."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(number))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        monkeypatch.setenv('ROS_LOG_DIR', str(folder / 'ros_log'))
        yield


@contextmanager
def executables(folder):
    """
    Give `start(name, *ros_arguments)`, which starts an installed executable: a NodeProcess.

    They are ended after the block; their output is shown if the test fails.
    """
    processes = []

    def start(name, *ros_arguments):
        processes.append(PatientProcess(name, ros_arguments, folder / f'{name}_{len(processes)}.log'))
        return processes[-1]

    try:
        yield start
    finally:
        for process in processes:
            process.end()
            # pytest shows captured output of failed tests only.
            print(f'--- {process.log_file.name}, exit status {process.exit_status}\n{process.output()}')


@pytest.fixture(scope='module')
def module_bench(dds, tmp_path_factory):
    """Bench that the tests of a module share, in a ROS domain of its own."""
    folder = tmp_path_factory.mktemp('module_bench')
    with (reserved_domain_id() as number, executables(folder) as start,
          spun_node('tester', number) as node):
        def start_in_domain(*arguments):
            with in_domain(number, folder):
                return start(*arguments)

        yield Bench(node, start_in_domain)


@pytest.fixture
def bench(node, start_executable):
    """Bench of this test alone, in a ROS domain of its own."""
    return Bench(node, start_executable)


@pytest.fixture
def domain_id(dds, tmp_path):
    """ROS domain of this test, set in the environment that processes inherit."""
    with reserved_domain_id() as number, in_domain(number, tmp_path):
        yield number


@pytest.fixture
def node(domain_id):
    """Return the test's own node, spun by an executor in a thread."""
    with spun_node('tester', domain_id) as node:
        yield node


@pytest.fixture
def start_executable(domain_id, tmp_path):
    """Return the function that starts an installed executable in this test's domain."""
    with executables(tmp_path) as start:
        yield start


@contextmanager
def signals_kept():
    """Restore the signal handlers that a node's process replaces."""
    numbers = signal.SIGINT, signal.SIGTERM
    handlers = [signal.getsignal(number) for number in numbers]
    wakeup = signal.set_wakeup_fd(-1)
    try:
        yield
    finally:
        signal.set_wakeup_fd(wakeup)
        for number, handler in zip(numbers, handlers):
            signal.signal(number, handler)


@pytest.fixture
def call_main(ros, monkeypatch, capfd):
    """
    `call_main(name, *arguments)` runs an executable's main function in this process.

    Only for arguments that make it exit at once; returns its exit status and its output. A process
    would need most of a second of processor time to start. But a node that could not start ends with its
    process; here it would be visible, in a domain that other tests use meanwhile, until Python collects it.
    Other nodes are found only in a test that also has `domain_id`, as through `bench`.
    """
    # The middleware prints a line of its own if another process holds its shared memory.
    monkeypatch.setenv('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')

    def call_main(name, *arguments):
        monkeypatch.setattr(sys, 'argv', [f'/opt/lib/bev_preheat/{name}', *arguments])
        capfd.readouterr()
        with signals_kept(), pytest.raises(SystemExit) as end:
            getattr(import_module('bev_preheat.nodes'), name)()
        gc.collect()
        stdout, stderr = capfd.readouterr()
        return SimpleNamespace(returncode=end.value.code, stdout=stdout, stderr=stderr)
    return call_main


@pytest.fixture
def refusal(call_main):
    """`refusal(name, *arguments)` runs a main function that must refuse its arguments; returns its one line."""
    def refusal(name, *arguments):
        done = call_main(name, *arguments)
        line, = done.stderr.splitlines()
        assert (done.returncode, done.stdout) == (2, '') and line.startswith(f'{name}: error: ')
        return line
    return refusal


@pytest.fixture
def car_with_gates(tmp_path):
    """`car_with_gates(gates)` returns a vehicle file: the reference with `heating_gates` as YAML."""
    def car_with_gates(gates):
        path = tmp_path / 'gated.yaml'
        path.write_text(f'{vehicle_contents("reference").decode()}\nheating_gates: {{{gates}}}\n')
        return path
    return car_with_gates
