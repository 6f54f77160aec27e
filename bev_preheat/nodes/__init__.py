# SPDX-License-Identifier: Apache-2.0
"""
The ROS 2 nodes: topics, parameters, services; wiring only. Here are the entry points of their executables.

Ctrl-C while a node is loading ends its process at once, without a traceback: nothing is commanded yet.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
import signal


def planner() -> None:
    """Run the planner."""
    _end_on_interrupt()
    from bev_preheat.nodes.process import join_graph
    loading_node = join_graph('planner')
    import_module('bev_preheat.nodes.planner_node').main(loading_node)


def _end_on_interrupt() -> None:
    # `process.run_node` installs its own handler later.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _run(module: str) -> None:
    _end_on_interrupt()
    import_module(f'bev_preheat.{module}').main()


nlp_checker = partial(_run, 'nodes.nlp_checker_node')
charger_adviser = partial(_run, 'nodes.charger_adviser_node')
route_publisher = partial(_run, 'nodes.route_publisher_node')
heater_controller = partial(_run, 'nodes.heater_controller_node')
bus_gateway = partial(_run, 'nodes.bus_gateway_node')
vehicle_simulator = partial(_run, 'nodes.vehicle_simulator_node')
dashboard = partial(_run, 'monitoring.dashboard_node')
