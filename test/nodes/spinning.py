# SPDX-License-Identifier: Apache-2.0
"""A node spun in a thread, so that a test can wait for messages."""

from contextlib import contextmanager
import threading

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from waiting import TIME_LIMIT_S


@contextmanager
def spun_node(name, domain_id=None, uses_sim_time=False):
    """Give a node whose callbacks run in their own thread inside the block."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    try:
        node = rclpy.create_node(name, context=context, enable_rosout=False, parameter_overrides=[
            Parameter('use_sim_time', value=uses_sim_time)])
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        thread = threading.Thread(target=_spin, args=(executor,), daemon=True)
        thread.start()
        try:
            yield node
        finally:
            executor.shutdown()
            thread.join()
            node.destroy_node()
    finally:
        context.try_shutdown()


def take_down(node, action):
    """
    Call `action()`, which destroys parts of a spun node, between two waits of the thread that spins.

    A part destroyed while that thread prepares to wait for it would end the thread (InvalidHandle).
    """
    done = threading.Event()
    task = node.executor.create_task(action)
    task.add_done_callback(lambda _: done.set())
    assert done.wait(TIME_LIMIT_S), 'the node is not spun any more'
    task.result()


def _spin(executor):
    try:
        executor.spin()
    except ExternalShutdownException:
        pass
