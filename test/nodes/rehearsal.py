# SPDX-License-Identifier: Apache-2.0
"""
Nodes in this process, without DDS and in a time that only the test moves, for tests of their decisions.

A `Rehearsal` has the interface of `node_bench.Bench`: it starts the nodes of the executables with their ROS
arguments, records topics, publishes and calls services. Messages are serialized as on their way through DDS. A
wait moves the time from one timer to the next: no test depends on the computer, and a minute takes milliseconds.

Not rehearsed are actions, lifecycle services, and everything that DDS decides: discovery, deadlines, quality of
service but for latching. These are tested over DDS.
"""

from collections import deque
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
import inspect
import sys
import time
from types import SimpleNamespace

from node_bench import Record
import pytest
from rclpy.clock import Clock, ClockType, ROSClock
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time

from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.core_library import use_core

START_NS = 1_700_000_000 * NS_PER_S
# A wait fails after this time of the rehearsal; events at one instant are a loop after this number.
TIME_LIMIT_S, EVENTS_LIMIT = 600.0, 200_000
CLASSES = {
    'planner': ('nodes.planner_node', 'PlannerNode'),
    'nlp_checker': ('nodes.nlp_checker_node', 'NlpCheckerNode'),
    'charger_adviser': ('nodes.charger_adviser_node', 'ChargerAdviserNode'),
    'heater_controller': ('nodes.heater_controller_node', 'HeaterControllerNode'),
    'route_publisher': ('nodes.route_publisher_node', 'RoutePublisherNode'),
    'vehicle_simulator': ('nodes.vehicle_simulator_node', 'VehicleSimulatorNode'),
    'bus_gateway': ('nodes.bus_gateway_node', 'BusGatewayNode'),
    'dashboard': ('monitoring.dashboard_node', 'DashboardNode')}


def class_of(name):
    module, class_name = CLASSES[name]
    return getattr(import_module(f'bev_preheat.{module}'), class_name)


def program_of(name):
    return import_module(f'bev_preheat.{CLASSES[name][0]}').PROGRAM


class HandTimer:
    """A timer that fires when its time is set beyond its period, as rcl's do: once for all missed periods."""

    def __init__(self, period_ns, callback, now_ns, is_simulated=False):
        """`now_ns()` returns the time of its clock [ns]; simulated: that of /clock."""
        self.timer_period_ns, self.callback, self.is_simulated = period_ns, callback, is_simulated
        self._now_ns = now_ns
        self.reset()

    def reset(self):
        """Begin a period, also after cancel()."""
        self._is_canceled, self._last_ns = False, self._now_ns()
        self.due_ns = self._last_ns + self.timer_period_ns

    def cancel(self):
        self._is_canceled = True

    def is_canceled(self):
        return self._is_canceled

    def fires(self):
        """Fire if it is due; return whether it did."""
        now_ns = self._now_ns()
        if now_ns < self._last_ns:
            # The clock was set back.
            self.reset()
        if self._is_canceled or now_ns < self.due_ns:
            return False
        self._last_ns = now_ns
        self.due_ns += self.timer_period_ns * (1 + max(0, now_ns - self.due_ns) // self.timer_period_ns)
        self.callback()
        return True


class Logger:
    """Keeps the lines of a node's log."""

    def __init__(self):
        self.lines = []

    def get_child(self, name):
        return self

    def __getattr__(self, severity):
        if severity not in ('debug', 'info', 'warning', 'warn', 'error', 'fatal'):
            raise AttributeError(severity)
        return lambda text, **options: self.lines.append(f'[{severity.upper()}] {text}')


@dataclass
class Topic:
    """The publishers and subscriptions of a topic."""

    publishers: list = field(default_factory=list)
    subscriptions: list = field(default_factory=list)


class Endpoint:
    """A publisher or a subscription."""

    def __init__(self, rehearsal, owner, message_type, topic, qos):
        self.topic_name, self.msg_type = topic, message_type
        self.qos_profile = QoSProfile(depth=qos) if isinstance(qos, int) else qos
        self._rehearsal, self.owner = rehearsal, owner
        rehearsal.endpoints += 1
        self.gid = rehearsal.endpoints.to_bytes(16, 'big')

    @property
    def is_latched(self):
        return self.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL

    def info(self):
        package = self.msg_type.__module__.partition('.')[0]
        return SimpleNamespace(
            node_name=self.owner.get_name(), node_namespace=self.owner.get_namespace(),
            topic_type=f'{package}/msg/{self.msg_type.__name__}', topic_type_hash='',
            endpoint_gid=list(self.gid), qos_profile=self.qos_profile)


class Publisher(Endpoint):
    """Delivers messages to all subscriptions of its topic."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._count, self.latest = 0, None

    def publish(self, message):
        self._count += 1
        sent_ns = time.time_ns()
        self.latest = bytes(serialize_message(message)), {
            'source_timestamp': sent_ns, 'received_timestamp': sent_ns,
            'publication_sequence_number': self._count, 'reception_sequence_number': None}
        self._rehearsal.deliver(self)

    def get_subscription_count(self):
        return len(self._rehearsal.topic(self.topic_name).subscriptions)

    def wait_for_all_acked(self, timeout):
        """Return True: messages arrive at once."""
        return True

    def wait_for_subscription(self, count=1):
        self._rehearsal.wait_until(lambda: self.get_subscription_count() >= count,
                                   f'{self.topic_name}: {count} subscriptions')

    def destroy(self):
        self._rehearsal.topic(self.topic_name).publishers.remove(self)


class Subscription(Endpoint):
    """Calls a function with each message, and with its information if it takes two arguments."""

    def __init__(self, rehearsal, owner, message_type, topic, qos, callback, raw=False):
        super().__init__(rehearsal, owner, message_type, topic, qos)
        self.raw, self._callback = raw, callback
        try:
            inspect.signature(callback).bind(None)
            self._has_info = False
        except TypeError:
            self._has_info = True

    def take(self, data, info):
        content = data if self.raw else deserialize_message(data, self.msg_type)
        self._callback(*((content, info) if self._has_info else (content,)))

    def destroy(self):
        self._rehearsal.topic(self.topic_name).subscriptions.remove(self)


class Recorder(Record):
    """Keeps every message of a topic; a wait moves the time."""

    patience_s = TIME_LIMIT_S

    def __init__(self, rehearsal, message_type, topic, qos):
        super().__init__(topic)
        self._rehearsal = rehearsal
        self._subscription = rehearsal.subscribe(message_type, topic, qos, self.receive)

    def _comes(self, condition, timeout_s):
        return self._rehearsal.comes_to(condition, timeout_s)

    def destroy(self):
        """Unsubscribe; recorded messages stay."""
        self._subscription.destroy()


class SilentNode(Node):
    """Takes the place of rclpy's Node below a node's own class; a subclass sets its context and arguments."""

    silent_context = None
    arguments = ()

    def __init__(self, name):
        """Take the arguments as a command line has them."""
        super().__init__(name, context=self.silent_context, cli_args=['--ros-args', *self.arguments],
                         use_global_arguments=False)


class RehearsedNode(Node):
    """Takes the place of rclpy's Node below a node's own class; a subclass sets its rehearsal and arguments."""

    rehearsal = None
    arguments = ()

    def __init__(self, name):
        self.log = Logger()
        super().__init__(name, context=self.rehearsal.context, cli_args=['--ros-args', *self.arguments],
                         use_global_arguments=False, enable_rosout=False)

    def get_logger(self):
        return self.log

    def get_clock(self):
        return super().get_clock() if self._follows_clock() else self.rehearsal.clock

    def _follows_clock(self):
        return self.has_parameter('use_sim_time') and self.get_parameter('use_sim_time').value

    def create_publisher(self, msg_type, topic, qos_profile, **options):
        return self.rehearsal.add_publisher(self, msg_type, self.resolve_topic_name(topic), qos_profile)

    def create_subscription(self, msg_type, topic, callback, qos_profile, *, raw=False, **options):
        return self.rehearsal.add_subscription(
            self, msg_type, self.resolve_topic_name(topic), qos_profile, callback, raw)

    def create_service(self, srv_type, srv_name, callback, **options):
        return self.rehearsal.add_service(self.resolve_service_name(srv_name), srv_type, callback)

    def create_timer(self, timer_period_sec, callback, callback_group=None, clock=None, autostart=True):
        if self._follows_clock() and (clock is None or clock.clock_type != ClockType.STEADY_TIME):
            return self.rehearsal.add_timer(
                timer_period_sec, callback, self, lambda: self.get_clock().now().nanoseconds)
        return self.rehearsal.add_timer(timer_period_sec, callback, self)

    def destroy_subscription(self, subscription):
        subscription.destroy()
        return True

    def count_publishers(self, topic_name):
        return self.rehearsal.count_publishers(self.resolve_topic_name(topic_name))

    def get_publishers_info_by_topic(self, topic_name, no_mangle=False):
        return [each.info() for each in self.rehearsal.topic(self.resolve_topic_name(topic_name)).publishers]

    def get_subscriptions_info_by_topic(self, topic_name, no_mangle=False):
        return [each.info() for each in self.rehearsal.topic(self.resolve_topic_name(topic_name)).subscriptions]


class RehearsedProcess:
    """In place of a NodeProcess: the node and its end."""

    def __init__(self, rehearsal, node):
        self._rehearsal, self.node, self._exit_status = rehearsal, node, None

    @property
    def exit_status(self):
        """None while it runs, then that of the process; a node whose future `finished` is done ends."""
        if self._exit_status is None and hasattr(self.node, 'finished') and self.node.finished.done():
            self.end(self.node.exit_status)
        return self._exit_status

    def output(self):
        return '\n'.join(self.node.log.lines)

    def wait(self):
        """Let time pass until it has ended by itself; return the exit status."""
        self._rehearsal.wait_until(lambda: self.exit_status is not None, 'its end')
        return self.exit_status

    def end(self, exit_status=0):
        if self._exit_status is None:
            if hasattr(self.node, 'last_words'):
                self.node.last_words()
            self._take_down(exit_status)

    def kill(self):
        """End it as SIGKILL does: without a word."""
        if self._exit_status is None:
            self._take_down(-9)

    def _take_down(self, exit_status):
        self._exit_status = exit_status
        self._rehearsal.remove(self.node)


class Rehearsal:
    """The graph; see the module."""

    def __init__(self, context):
        """Begin at START_NS, without nodes."""
        self.context, self.now_ns, self.endpoints = context, START_NS, 0
        # Real time that passes with each second: for nodes that wait for a process, such as a solver.
        self.real_s_per_s = 0.0
        # With a real handle, for the parts of a node that are not rehearsed.
        self.clock = SimpleNamespace(
            handle=ROSClock().handle, now=lambda: Time(nanoseconds=self.now_ns, clock_type=ClockType.ROS_TIME))
        self._topics, self._services, self._timers, self._processes = {}, {}, [], []
        self._tester = SimpleNamespace(get_name=lambda: 'tester', get_namespace=lambda: '/')
        self._under_way, self._is_acting, self._patches = deque(), False, None

    # For tests

    def start(self, name, *ros_arguments):
        """Start the node of an executable; return a RehearsedProcess. Raises the node's own errors."""
        rehearsed = type('Rehearsed', (class_of(name), RehearsedNode), {
            'rehearsal': self, 'arguments': tuple(map(str, ros_arguments))})
        self.hold_time()
        with self._acting():
            self._processes.append(RehearsedProcess(self, rehearsed()))
        return self._processes[-1]

    def record(self, message_type, topic, qos=10):
        return Recorder(self, message_type, topic, qos)

    def subscribe(self, message_type, topic, qos, callback):
        """Subscribe as the node /tester."""
        with self._acting():
            return self.add_subscription(self._tester, message_type, _absolute(topic), qos, callback)

    def publisher(self, message_type, topic, qos=1):
        """Advertise as the node /tester."""
        return self.add_publisher(self._tester, message_type, _absolute(topic), qos)

    def call(self, service_type, name, request):
        with self._acting():
            return self._services[_absolute(name)](request, service_type.Response())

    @contextmanager
    def repeating(self, action, period_s):
        """Call `action()` every `period_s` of the rehearsal's time inside the block."""
        timer = self.add_timer(period_s, action)
        try:
            yield
        finally:
            timer.cancel()

    def advance(self, seconds):
        end_ns = self.now_ns + round(seconds * NS_PER_S)
        while self._go_on(end_ns):
            pass

    def fire_all(self):
        with self._acting():
            for timer, _ in list(self._timers):
                if not timer.is_canceled():
                    timer.callback()

    def comes_to(self, condition, timeout_s=TIME_LIMIT_S):
        """Return whether condition() holds, at once or as time passes."""
        end_ns = self.now_ns + round(timeout_s * NS_PER_S)
        for _ in range(EVENTS_LIMIT):
            if condition():
                return True
            if not self._go_on(end_ns):
                return condition()
        raise AssertionError(f'{EVENTS_LIMIT} events')

    def wait_until(self, condition, what):
        """Return the first truthy condition() as time passes."""
        found = []

        def holds():
            found.append(condition())
            return found[-1]

        assert self.comes_to(holds), f'{what}: not within {TIME_LIMIT_S:g} s'
        return found[-1]

    @contextmanager
    def held(self):
        """Give itself; in the end kill all nodes, and reset the settings that they made in this process."""
        try:
            with pytest.MonkeyPatch.context() as self._patches:
                yield self
        finally:
            for process in self._processes:
                process.kill()
                # pytest shows captured output of failed tests only.
                print(process.output())
            use_core(True)

    # For nodes

    def topic(self, name):
        return self._topics.setdefault(name, Topic())

    def count_publishers(self, name):
        return len(self.topic(name).publishers)

    def add_publisher(self, owner, message_type, name, qos):
        self.topic(name).publishers.append(Publisher(self, owner, message_type, name, qos))
        return self.topic(name).publishers[-1]

    def add_subscription(self, owner, message_type, name, qos, callback, raw=False):
        """Subscribe, and receive the latched messages."""
        added = Subscription(self, owner, message_type, name, qos, callback, raw)
        self.topic(name).subscriptions.append(added)
        for publisher in self.topic(name).publishers:
            if added.is_latched and publisher.is_latched and publisher.latest is not None:
                self._under_way.append((added, *publisher.latest))
        return added

    def add_service(self, name, service_type, callback):
        self._services[name] = callback
        return SimpleNamespace(srv_name=name, srv_type=service_type)

    def add_timer(self, period_s, callback, owner=None, simulated_ns=None):
        """Start a timer, by the time that `simulated_ns()` returns if it is given."""
        self._timers.append((HandTimer(
            round(period_s * NS_PER_S), callback, simulated_ns or (lambda: self.now_ns),
            simulated_ns is not None), owner))
        return self._timers[-1][0]

    def deliver(self, publisher):
        """Deliver the publisher's latest message, after those that are under way."""
        with self._acting():
            self._under_way += [(subscription, *publisher.latest) for subscription
                                in self.topic(publisher.topic_name).subscriptions
                                if subscription.msg_type is publisher.msg_type]

    def remove(self, node):
        self._timers = [each for each in self._timers if each[1] is not node]
        prefix = f'{node.get_fully_qualified_name()}/'
        self._services = {name: callback for name, callback in self._services.items()
                          if not name.startswith(prefix)}
        for topic in self._topics.values():
            for endpoints in (topic.publishers, topic.subscriptions):
                endpoints[:] = [each for each in endpoints if each.owner is not node]
        node.destroy_node()

    @contextmanager
    def _acting(self):
        """Let the block act, and then deliver all messages; within another action, deliver them after that."""
        if self._is_acting:
            yield
            return
        self._is_acting = True
        try:
            yield
            while self._under_way:
                subscription, data, info = self._under_way.popleft()
                subscription.take(data, info)
                if subscription.topic_name == '/clock':
                    for timer, _ in list(self._timers):
                        if timer.is_simulated:
                            timer.fires()
        finally:
            self._is_acting = False

    def hold_time(self):
        """Give the modules of the nodes the rehearsal's steady time instead of the computer's."""
        by_hand = _Time(self)
        for name, module in list(sys.modules.items()):
            if name.startswith('bev_preheat.nodes.'):
                for attribute, value in list(vars(module).items()):
                    if value is time:
                        self._patches.setattr(module, attribute, by_hand)
                    elif value is Clock:
                        self._patches.setattr(module, attribute, by_hand.clock)

    def _go_on(self, end_ns):
        """Fire a timer that is due, or go to the instant of the next; return False at `end_ns`."""
        with self._acting():
            if any(timer.fires() for timer, _ in list(self._timers)):
                return True
        due_ns = min((timer.due_ns for timer, _ in self._timers
                      if not timer.is_simulated and not timer.is_canceled()), default=end_ns)
        if self.now_ns >= end_ns:
            return False
        if self.real_s_per_s:
            time.sleep(self.real_s_per_s * (min(due_ns, end_ns) - self.now_ns) / NS_PER_S)
        self.now_ns = min(due_ns, end_ns)
        return True


class _Time:
    """The module `time`, with the steady time of a rehearsal."""

    def __init__(self, rehearsal):
        self._rehearsal = rehearsal

    def __getattr__(self, name):
        return getattr(time, name)

    def monotonic_ns(self):
        return self._rehearsal.now_ns

    def monotonic(self):
        return self._rehearsal.now_ns / NS_PER_S

    def clock(self, *, clock_type):
        if clock_type != ClockType.STEADY_TIME:
            return Clock(clock_type=clock_type)
        return SimpleNamespace(clock_type=clock_type, now=lambda: Time(
            nanoseconds=self._rehearsal.now_ns, clock_type=clock_type))


def _absolute(name):
    return name if name.startswith('/') else f'/{name}'
