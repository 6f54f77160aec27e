# SPDX-License-Identifier: Apache-2.0
"""A node within a program that is not a node itself, to follow other nodes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bev_preheat.errors import InvalidInput

# Longest wait for a message [s], because Python handles signals between two waits. It is constant, because an
# executor whose timeout changes prefers the first subscriptions.
WAIT_S = 0.05


class Listener:
    """A node whose callbacks run only in `listen`, in the caller's thread: their data need no lock."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self.node, self._executor = node, executor

    def listen(self, duration_s: float) -> None:
        """Run callbacks for `duration_s` [s of real time]; a callback's exception passes through."""
        end_s = monotonic() + duration_s
        while monotonic() < end_s:
            self._executor.spin_once(timeout_sec=WAIT_S)


@contextmanager
def listening(name: str, domain_id: int | None = None, namespace: str = '') -> Iterator[Listener]:
    """Give the Listener of a new node in a domain, None: the environment's; InvalidInput on a bad namespace."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    try:
        try:
            node = rclpy.create_node(name, context=context, namespace=namespace, enable_rosout=False)
        except InvalidNamespaceException as error:
            raise InvalidInput(f'--namespace: {namespace!r}: {error}') from error
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        try:
            yield Listener(node, executor)
        finally:
            executor.shutdown()
            node.destroy_node()
    finally:
        context.try_shutdown()
