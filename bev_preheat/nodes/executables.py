# SPDX-License-Identifier: Apache-2.0
"""
Entry points of the nodes' executables.

While a node is loaded nothing becomes garbage, but Python looks for it again and again: some 5 % of the
processor time of a start. What was loaded stays, so that later collections need not look at it either.
"""

from __future__ import annotations

import gc
from importlib import import_module


def planner() -> None:
    """Run the planner."""
    _run('planner_node')


def nlp_checker() -> None:
    """Run the checker."""
    _run('nlp_checker_node')


def charger_adviser() -> None:
    """Run the adviser."""
    _run('charger_adviser_node')


def vehicle_simulator() -> None:
    """Run the simulated vehicle."""
    _run('vehicle_simulator_node')


def _run(module: str) -> None:
    gc.disable()
    try:
        main = import_module(f'bev_preheat.nodes.{module}').main
    finally:
        gc.freeze()
        gc.enable()
    main()
