# SPDX-License-Identifier: Apache-2.0
"""A node beside other work: for programs that listen to nodes, and are none themselves."""

from contextlib import contextmanager
import threading

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor


@contextmanager
def spun_node(name, domain_id=None, namespace=''):
    """
    Give a node that a thread spins while the block lasts; signals remain the caller's business.

    `domain_id` None: that of the environment. Raises rclpy.exceptions.InvalidNamespaceException.
    """
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    try:
        node = rclpy.create_node(name, context=context, namespace=namespace, enable_rosout=False)
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


def _spin(executor):
    try:
        executor.spin()
    except ExternalShutdownException:
        pass
