# SPDX-License-Identifier: Apache-2.0
"""
Fixtures for tests of the installed executables over real DDS.

    def test_something(start_executable, record, publisher):
        commands = record(HvchCommand, 'hvch_command', 10)           # subscribe first,
        start_executable('planner', '-p', 'vehicle:=reference')      # then start the node,
        states = publisher(BatteryState, 'battery_state', 1)
        states.wait_for_subscription()                               # wait for the match,
        states.publish(BatteryState(...))
        commands.wait_for(lambda m: m.battery_heating_power == 0.0)  # and for the answer.

Each test has its own ROS domain. What a test waits for is a condition with a time limit; the limit
is generous because it is only ever used up where the test fails.
"""

import os
import threading
import time

import pytest

from bev_preheat.demonstration.processes import NodeProcess, reserved_domain_id
from bev_preheat.nodes.listening import spun_node

TIME_LIMIT_S = 20.0
POLL_S = 0.005
ANSWER_TIME_S = 5.0


def poll_until(condition, what, timeout_s=TIME_LIMIT_S):
    """Return the first truthy `condition()`; AssertionError naming `what` at the limit."""
    deadline_s = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < deadline_s, f'{what}: not within {timeout_s:g} s'
        time.sleep(POLL_S)
    return value


class Recorder:
    """Keeps every message of a topic, with the instant (time.monotonic) of its arrival."""

    def __init__(self, node, message_type, topic, qos):
        """Subscribe."""
        self._topic = topic
        self._changed = threading.Condition()
        self._received = []
        self._subscription = node.create_subscription(message_type, topic, self._receive, qos)

    def _receive(self, message):
        with self._changed:
            self._received.append((time.monotonic(), message))
            self._changed.notify_all()

    @property
    def messages(self):
        """Return the messages so far, oldest first."""
        return [message for _, message in self.timed]

    @property
    def timed(self):
        """Return (instant of arrival [s, time.monotonic], message) so far, oldest first."""
        with self._changed:
            return list(self._received)

    def clear(self):
        """Forget what has come, so that wait_for() sees only what comes from now on."""
        with self._changed:
            self._received.clear()

    def wait_for(self, condition=lambda message: True, what='', timeout_s=TIME_LIMIT_S):
        """Return the first message, received already or to come, for which condition(message)."""
        def found():
            return next((item for item in self._received if condition(item[1])), None)

        with self._changed:
            self._changed.wait_for(found, timeout_s)
            item = found()
            assert item is not None, (
                f'{self._topic}: {what or "the message waited for"}: not among '
                f'{len(self._received)} messages within {timeout_s:g} s; the last: '
                f'{self._received[-1][1] if self._received else None}')
            return item[1]

    def wait_for_count(self, count, timeout_s=TIME_LIMIT_S):
        """Return the first `count` messages once there are so many."""
        with self._changed:
            enough = self._changed.wait_for(lambda: len(self._received) >= count, timeout_s)
            assert enough, (f'{self._topic}: {len(self._received)} of {count} messages within '
                            f'{timeout_s:g} s')
            return [message for _, message in self._received[:count]]

    def wait_for_publisher(self, timeout_s=TIME_LIMIT_S):
        """Wait until somebody publishes the topic."""
        poll_until(lambda: self._subscription.get_publisher_count(),
                   f'{self._topic}: a publisher', timeout_s)


class Sender:
    """A publisher that can wait for its subscriptions."""

    def __init__(self, node, message_type, topic, qos):
        """Advertise."""
        self._topic = topic
        self._publisher = node.create_publisher(message_type, topic, qos)

    def publish(self, message):
        """Publish."""
        self._publisher.publish(message)

    def wait_for_subscription(self, count=1, timeout_s=TIME_LIMIT_S):
        """Wait until at least `count` subscriptions are matched."""
        poll_until(lambda: self._publisher.get_subscription_count() >= count,
                   f'{self._topic}: {count} subscriptions', timeout_s)


@pytest.fixture
def wait_until():
    """`wait_until(condition, what)` waits for a truthy `condition()` and returns it."""
    return poll_until


class Bench:
    """A test's node, and the executables that run beside it: what the fixtures give, in one."""

    def __init__(self, node, start_executable):
        """`start_executable(name, *ros_arguments)` returns a NodeProcess."""
        self.node = node
        self.start = start_executable

    def record(self, message_type, topic, qos=10):
        """Subscribe; returns a Recorder."""
        return Recorder(self.node, message_type, topic, qos)

    def publisher(self, message_type, topic, qos=1):
        """Advertise; returns a Sender."""
        return Sender(self.node, message_type, topic, qos)

    def call(self, service_type, name, request, timeout_s=TIME_LIMIT_S):
        """Return the response of a service, waiting for it to be there."""
        client = self.node.create_client(service_type, name)
        try:
            assert client.wait_for_service(timeout_s), f'{name}: no such service'
            deadline_s = time.monotonic() + timeout_s
            while True:
                future = client.call_async(request)
                try:
                    poll_until(future.done, f'{name}: a response', ANSWER_TIME_S)
                    return future.result()
                except AssertionError:
                    # A server that has not found the client yet answers into the void.
                    if time.monotonic() > deadline_s:
                        raise
        finally:
            self.node.destroy_client(client)


@pytest.fixture(scope='module')
def module_bench(tmp_path_factory):
    """Bench that the tests of a module share, in a ROS domain of its own."""
    folder = tmp_path_factory.mktemp('module_bench')
    processes = []
    with reserved_domain_id() as domain_id:
        def start_executable(name, *ros_arguments):
            with pytest.MonkeyPatch.context() as monkeypatch:
                monkeypatch.setenv('ROS_DOMAIN_ID', str(domain_id))
                monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
                monkeypatch.setenv('ROS_LOG_DIR', str(folder / 'ros_log'))
                processes.append(NodeProcess(
                    name, ros_arguments, folder / f'{name}_{len(processes)}.log'))
            return processes[-1]

        try:
            with spun_node('tester', domain_id) as node:
                yield Bench(node, start_executable)
        finally:
            for process in processes:
                process.end()
                print(f'--- {process.log_file.name}, exit status {process.exit_status}\n'
                      f'{process.output()}')


@pytest.fixture
def bench(node, start_executable):
    """Bench of this test alone, in a ROS domain of its own."""
    return Bench(node, start_executable)


@pytest.fixture
def domain_id(monkeypatch, tmp_path):
    """ROS domain of this test, set in the environment that processes inherit."""
    with reserved_domain_id() as number:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(number))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
        yield number


@pytest.fixture
def node(domain_id):
    """Return the test's own node, spun by an executor in a thread."""
    with spun_node('tester', domain_id) as node:
        yield node


@pytest.fixture
def record(node):
    """`record(message_type, topic, qos)` subscribes and returns a Recorder."""
    def record(message_type, topic, qos):
        return Recorder(node, message_type, topic, qos)
    return record


@pytest.fixture
def publisher(node):
    """`publisher(message_type, topic, qos)` advertises and returns a Sender."""
    def publisher(message_type, topic, qos):
        return Sender(node, message_type, topic, qos)
    return publisher


@pytest.fixture
def start_executable(domain_id, tmp_path):
    """
    `start_executable(name, *ros_arguments)` starts an installed executable: a NodeProcess.

    It is ended after the test; its output is shown where the test fails.
    """
    processes = []

    def start_executable(name, *ros_arguments):
        log_file = tmp_path / f'{name}_{len(processes)}.log'
        processes.append(NodeProcess(name, ros_arguments, log_file))
        return processes[-1]

    yield start_executable
    for process in processes:
        process.end()
        # pytest shows captured output of failed tests only.
        print(f'--- {os.path.basename(process.log_file)}, exit status {process.exit_status}\n'
              f'{process.output()}')
