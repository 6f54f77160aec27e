# SPDX-License-Identifier: Apache-2.0
"""
The ROS 2 nodes: topics, parameters, services; wiring only. Here are the entry points of their executables.

Ctrl-C while a node is loading ends its process at once, without a traceback: nothing is commanded yet.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.node import Node


def planner() -> None:
    """Run the planner."""
    _end_on_interrupt()
    from bev_preheat.nodes.process import join_graph
    _run('nodes.planner_node', 'PlannerNode', join_graph('planner'))


def _end_on_interrupt() -> None:
    # `process.run_node` installs its own handler later.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _run(module: str, node: str, loading_node: Node | None = None) -> None:
    """Run a module's node until a signal ends it, or the node itself."""
    _end_on_interrupt()
    loaded = import_module(f'bev_preheat.{module}')
    from bev_preheat.nodes.process import run_node
    sys.exit(run_node(getattr(loaded, node), loaded.PROGRAM, loading_node))


nlp_checker = partial(_run, 'nodes.nlp_checker_node', 'NlpCheckerNode')
charger_adviser = partial(_run, 'nodes.charger_adviser_node', 'ChargerAdviserNode')
route_publisher = partial(_run, 'nodes.route_publisher_node', 'RoutePublisherNode')
heater_controller = partial(_run, 'nodes.heater_controller_node', 'HeaterControllerNode')
bus_gateway = partial(_run, 'nodes.bus_gateway_node', 'BusGatewayNode')
vehicle_simulator = partial(_run, 'nodes.vehicle_simulator_node', 'VehicleSimulatorNode')
dashboard = partial(_run, 'monitoring.dashboard_node', 'DashboardNode')
