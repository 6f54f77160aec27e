# SPDX-License-Identifier: Apache-2.0
"""The environment of the installed executables in a test: recorders, senders, background actions."""

from contextlib import contextmanager
import threading

from spinning import take_down
from waiting import poll_until, TIME_LIMIT_S

from bev_preheat.nodes.installed_drive import NodeProcess

ANSWER_TIME_S = 5.0


@contextmanager
def repeating(action, period_s):
    """Call `action()` every `period_s` in a thread inside the block; raise its exception."""
    enough, failures = threading.Event(), []

    def repeat():
        try:
            while not enough.wait(period_s):
                action()
        except Exception as error:
            failures.append(error)

    thread = threading.Thread(target=repeat)
    thread.start()
    try:
        yield
    finally:
        enough.set()
        thread.join()
    if failures:
        raise failures[0]


class Record:
    """The messages of a topic; a subclass says how a wait passes, and calls `receive`."""

    patience_s = TIME_LIMIT_S

    def __init__(self, topic):
        self._topic, self._received, self.latest = topic, [], None

    def receive(self, message):
        self._received.append(message)
        self.latest = message

    def _comes(self, condition, timeout_s):
        """Return whether condition() holds, at once or within a time."""
        raise NotImplementedError

    @property
    def messages(self):
        """Return the messages so far, oldest first."""
        return list(self._received)

    def comes_to(self, condition, timeout_s):
        """Return whether condition(the latest message) holds, at once or within `timeout_s`."""
        return self._comes(lambda: self.latest is not None and condition(self.latest), timeout_s)

    def clear(self):
        """Forget all messages, so that wait_for() sees only later ones."""
        self._received = []

    def wait_for(self, condition=lambda message: True, what='', timeout_s=None):
        """
        Return the first message, received already or to come, for which condition(message).

        Each message is checked once: there may be thousands.
        """
        received, looked_at, found, timeout_s = self._received, 0, [], timeout_s or self.patience_s

        def is_there():
            nonlocal received, looked_at
            if received is not self._received:
                received, looked_at = self._received, 0
            while looked_at < len(received) and not found:
                looked_at += 1
                if condition(received[looked_at - 1]):
                    found.append(received[looked_at - 1])
            return found

        assert self._comes(is_there, timeout_s), (
            f'{self._topic}: {what or "the message waited for"}: not among {len(self._received)} messages within '
            f'{timeout_s:g} s; the last: {self.latest}')
        return found[0]

    def wait_for_count(self, count):
        assert self._comes(lambda: len(self._received) >= count, self.patience_s), (
            f'{self._topic}: {len(self._received)} of {count} messages within {self.patience_s:g} s')
        return self.messages[:count]


class Recorder(Record):
    """Keeps every message of a topic, which comes in another thread."""

    def __init__(self, node, message_type, topic, qos):
        super().__init__(topic)
        self._node, self._changed = node, threading.Condition()
        self._subscription = node.create_subscription(message_type, topic, self.receive, qos)

    def receive(self, message):
        with self._changed:
            super().receive(message)
            self._changed.notify_all()

    def _comes(self, condition, timeout_s):
        with self._changed:
            return self._changed.wait_for(condition, timeout_s)

    def destroy(self):
        """Unsubscribe; recorded messages stay."""
        take_down(self._node, lambda: self._node.destroy_subscription(self._subscription))

    def wait_for_publisher(self):
        poll_until(self._subscription.get_publisher_count, f'{self._topic}: a publisher')


class Sender:
    """A publisher that can wait for its subscriptions."""

    def __init__(self, node, message_type, topic, qos):
        self._node, self._topic = node, topic
        self._publisher = node.create_publisher(message_type, topic, qos)

    def destroy(self):
        """Stop advertising; latched messages disappear too."""
        take_down(self._node, lambda: self._node.destroy_publisher(self._publisher))

    def publish(self, message):
        self._publisher.publish(message)

    def wait_for_subscription(self, count=1):
        """Wait until at least `count` subscriptions are matched."""
        # During discovery the count of matches may include a subscription twice.
        poll_until(lambda: min(self._publisher.get_subscription_count(), len(self.subscriptions())) >= count,
                   f'{self._topic}: {count} subscriptions')

    def subscriptions(self):
        """Return the identifiers of the topic's subscriptions in the graph."""
        return {bytes(endpoint.endpoint_gid) for endpoint
                in self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)}


class PatientProcess(NodeProcess):
    """A NodeProcess whose end has the same time limit as any other wait."""

    def wait(self, timeout=TIME_LIMIT_S):
        """Return the exit status; raises subprocess.TimeoutExpired if the process keeps running."""
        return super().wait(timeout)


class Bench:
    """A test's node and its executables: all fixtures in one object, with the interface of a Rehearsal."""

    def __init__(self, node, start_executable):
        """`start_executable(name, *ros_arguments)` returns a NodeProcess."""
        self.node = node
        self.start = start_executable
        self._clients = {}

    @property
    def now_ns(self):
        """Return the time [ns]."""
        return self.node.get_clock().now().nanoseconds

    def repeating(self, action, period_s):
        """Call `action()` every `period_s` inside the block."""
        return repeating(action, period_s)

    def wait_until(self, condition, what):
        """Return the first truthy condition()."""
        return poll_until(condition, what)

    def record(self, message_type, topic, qos=10):
        return Recorder(self.node, message_type, topic, qos)

    def publisher(self, message_type, topic, qos=1):
        return Sender(self.node, message_type, topic, qos)

    def call(self, service_type, name, request):
        """Wait for a service and return its response."""
        # Kept, because discovering a new client takes longer than any answer.
        if (service_type, name) not in self._clients:
            self._clients[service_type, name] = self.node.create_client(service_type, name)
        client = self._clients[service_type, name]
        assert client.wait_for_service(TIME_LIMIT_S), f'{name}: no such service'
        futures = []

        def answered():
            return next((future for future in futures if future.done()), None)

        def asked_and_answered():
            # The answer of a server that has not yet discovered the client is lost.
            futures.append(client.call_async(request))
            try:
                return poll_until(answered, name, ANSWER_TIME_S)
            except AssertionError:
                return None

        return poll_until(asked_and_answered, f'{name}: a response').result()
