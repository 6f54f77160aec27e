# SPDX-License-Identifier: Apache-2.0
"""
Entry points of the nodes' executables.

While a node is loaded nothing becomes garbage, but Python looks for it again and again: some 5 % of the
processor time of a start. What was loaded stays, so that later collections need not look at it either.

The planner joins the ROS graph before it is loaded: what takes longest until its first command is that
the processes find each other, and that goes on beside.

Ctrl-C before a node is there ends its process at once, without a traceback: nothing is commanded yet.
"""

from __future__ import annotations

import gc
from importlib import import_module
import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def planner() -> None:
    """Run the planner."""
    _end_on_interrupt()
    from bev_preheat.nodes.process import join_graph
    herald = join_graph('planner')
    _load_main('planner_node')(herald)


def nlp_checker() -> None:
    """Run the checker."""
    _load_main('nlp_checker_node')()


def charger_adviser() -> None:
    """Run the adviser."""
    _load_main('charger_adviser_node')()


def vehicle_simulator() -> None:
    """Run the simulated vehicle."""
    _load_main('vehicle_simulator_node')()


def _end_on_interrupt() -> None:
    # `process.run_node` has a handler of its own.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _load_main(module: str) -> Callable[..., None]:
    _end_on_interrupt()
    gc.disable()
    try:
        return import_module(f'bev_preheat.nodes.{module}').main
    finally:
        gc.freeze()
        gc.enable()
