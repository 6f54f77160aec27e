# SPDX-License-Identifier: Apache-2.0
"""
Entry points of the nodes' executables.

Ctrl-C while a node is loading ends its process at once, without a traceback: nothing is commanded yet.
"""

from __future__ import annotations

from importlib import import_module
import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def planner() -> None:
    """Run the planner."""
    _end_on_interrupt()
    from bev_preheat.nodes.process import join_graph
    loading_node = join_graph('planner')
    _load_main('planner_node')(loading_node)


def nlp_checker() -> None:
    """Run the checker."""
    _load_main('nlp_checker_node')()


def charger_adviser() -> None:
    """Run the adviser."""
    _load_main('charger_adviser_node')()


def route_publisher() -> None:
    """Run the publisher of a route file."""
    _load_main('route_publisher_node')()


def heater_controller() -> None:
    """Run the reference of a heater controller."""
    _load_main('heater_controller_node')()


def bus_gateway() -> None:
    """Run the gateway to CAN or VSS."""
    _load_main('bus_gateway_node')()


def vehicle_simulator() -> None:
    """Run the simulated vehicle."""
    _load_main('vehicle_simulator_node')()


def dashboard() -> None:
    """Run the web page."""
    _load_main('dashboard_node', 'dashboard')()


def _end_on_interrupt() -> None:
    # `process.run_node` installs its own handler later.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _load_main(module: str, room: str = 'nodes') -> Callable[..., None]:
    _end_on_interrupt()
    main: Callable[..., None] = import_module(f'bev_preheat.{room}.{module}').main
    return main
