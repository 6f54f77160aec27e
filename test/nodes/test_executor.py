# SPDX-License-Identifier: Apache-2.0
"""The executor of the nodes: which callbacks it runs, their order, and exceptions that it passes on."""

import threading
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.serialization import deserialize_message
from std_msgs.msg import Int32
from std_srvs.srv import SetBool

from bev_preheat.nodes.executor import PromptExecutor

# Never used up where a test passes.
TIME_LIMIT_S = 60.0


@pytest.fixture
def spun(domain_id):
    """Give (node, executor); the node talks to itself."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node('alone', context=context)
    executor = PromptExecutor(context=context)
    executor.add_node(node)
    # What takes too long ends the test, and does not hang it.
    node.create_timer(TIME_LIMIT_S, lambda: pytest.fail('not done in time'))
    yield node, executor
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def numbers(spun):
    """Give a publisher of the topic `numbers`, with somebody who hears it."""
    node, _ = spun
    publisher = node.create_publisher(Int32, 'numbers', 10)
    node.create_subscription(Int32, 'numbers', lambda message: None, 10)
    end_s = time.monotonic() + TIME_LIMIT_S
    while not publisher.get_subscription_count():
        assert time.monotonic() < end_s
        time.sleep(0.01)
    return publisher


def subscribe(node, publisher, callback, **options):
    """Subscribe to `numbers` and wait for the match."""
    count = publisher.get_subscription_count()
    subscription = node.create_subscription(Int32, 'numbers', callback, 10, **options)
    end_s = time.monotonic() + TIME_LIMIT_S
    while publisher.get_subscription_count() <= count:
        assert time.monotonic() < end_s
        time.sleep(0.01)
    return subscription


def test_messages_come_in_order_with_what_a_callback_asks_for(spun, numbers):
    node, executor = spun
    plain, informed, raw = [], [], []
    subscribe(node, numbers, lambda message: plain.append(message.data))
    subscribe(node, numbers, lambda message, info: informed.append(
        (message.data, info['source_timestamp'] > 0)))
    subscribe(node, numbers, lambda data: raw.append(deserialize_message(data, Int32).data), raw=True)
    for number in range(5):
        numbers.publish(Int32(data=number))
    executor.run(lambda: len(plain) == len(informed) == len(raw) == 5)
    assert plain == raw == [0, 1, 2, 3, 4]
    assert informed == [(number, True) for number in range(5)]


def test_messages_without_a_pause_keep_no_timer_and_no_service_waiting(spun, numbers):
    node, executor = spun
    heard, ticks, answers = [], [], []

    def hear(message):
        heard.append(message.data)
        numbers.publish(message)

    def tick():
        ticks.append(len(heard))
        if len(ticks) == 5:
            client.call_async(SetBool.Request(data=True)).add_done_callback(answers.append)

    subscribe(node, numbers, hear)
    client = node.create_client(SetBool, 'switch')
    node.create_service(SetBool, 'switch', lambda request, response: response)
    assert client.wait_for_service(TIME_LIMIT_S)
    node.create_timer(0.01, tick)
    numbers.publish(Int32())
    executor.run(lambda: len(ticks) >= 20 and bool(answers))
    assert len(heard) > 20


def test_what_is_created_later_is_served_and_what_is_destroyed_is_not(spun, numbers):
    node, executor = spun
    first, second = [], []

    def hear_first(message):
        first.append(message.data)
        # With two more messages in its queue.
        count = numbers.get_subscription_count()
        node.destroy_subscription(subscription)
        # At once: the middleware keeps its buffers as long as it exists.
        assert numbers.get_subscription_count() == count - 1
        node.create_timer(0.01, tick)

    def tick():
        if not second:
            subscribe(node, numbers, lambda message: second.append(message.data))
            second.append(None)
            numbers.publish(Int32(data=4))

    subscription = subscribe(node, numbers, hear_first)
    for number in (1, 2, 3):
        numbers.publish(Int32(data=number))
    executor.run(lambda: 4 in second)
    assert first == [1]
    assert second == [None, 4]


def test_a_message_that_resets_a_timer_does_so_though_it_has_run_out(spun, numbers):
    node, executor = spun
    heard, ticks = [], []

    def hear(message):
        heard.append(message.data)
        timer.reset()

    subscribe(node, numbers, hear)
    timer = node.create_timer(0.3, lambda: ticks.append(len(heard)))
    numbers.publish(Int32())
    # Both are ready before the executor checks either.
    time.sleep(0.5)
    executor.run(lambda: bool(heard))
    assert not ticks
    executor.run(lambda: bool(ticks))
    assert ticks == [1]


def test_tasks_that_tasks_make_are_run_though_nothing_else_happens(spun):
    node, executor = spun
    run = []

    def first():
        run.append(1)
        executor.create_task(second).add_done_callback(lambda _: run.append(3))

    def second():
        run.append(2)

    timer = node.create_timer(0.05, lambda: (timer.cancel(), executor.create_task(first)))
    executor.run(lambda: len(run) == 3)
    assert run == [1, 2, 3]


@pytest.mark.parametrize('what', ['message', 'timer', 'service', 'task'])
def test_what_a_callback_raises_is_passed_on(spun, numbers, what):
    node, executor = spun

    def fail(*arguments):
        raise LookupError(what)

    if what == 'message':
        subscribe(node, numbers, fail)
        numbers.publish(Int32())
    elif what == 'timer':
        node.create_timer(0.01, fail)
    elif what == 'service':
        client = node.create_client(SetBool, 'switch')
        node.create_service(SetBool, 'switch', fail)
        assert client.wait_for_service(TIME_LIMIT_S)
        client.call_async(SetBool.Request())
    else:
        executor.create_task(fail)
    with pytest.raises(LookupError, match=what):
        executor.run(lambda: False)


def test_a_context_that_is_shut_down_ends_it(spun):
    node, executor = spun
    threading.Timer(0.2, node.context.try_shutdown).start()
    with pytest.raises(ExternalShutdownException):
        executor.run(lambda: False)


def test_a_callback_that_shuts_the_context_down_ends_it(spun):
    node, executor = spun
    node.create_timer(0.01, node.context.try_shutdown)
    executor.run(lambda: False)
    assert not node.context.ok()
