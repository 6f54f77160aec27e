# SPDX-License-Identifier: Apache-2.0
"""
The engine: the ten operations on which planning is built: runs, their limits and energies, and plans.

Each exists twice: in the native core (`core_engine`), and in readable Python, which defines the result. The core
answers if it is used and accepts the vehicle and the numbers; otherwise Python answers, or raises the appropriate
exception. No other module of planning knows that there are two.
"""

from __future__ import annotations

from functools import wraps
from typing import ParamSpec, TYPE_CHECKING, TypeVar

from bev_preheat.native.library import Declined
from bev_preheat.planning import core_engine, dynamics, heat_run, limited_drive, recursion, switch_plan
from bev_preheat.planning import model_inputs as python_inputs

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec('P')
R = TypeVar('R')


def _operation(in_core: Callable[P, R], in_python: Callable[P, R]) -> Callable[P, R]:
    """Return the operation of two engines that is the core's if it answers."""
    @wraps(in_python)
    def operation(*arguments: P.args, **named: P.kwargs) -> R:
        try:
            return in_core(*arguments, **named)
        except Declined:
            return in_python(*arguments, **named)
    return operation


# The model's inputs along a route.
model_inputs = _operation(core_engine.model_inputs, python_inputs.model_inputs)
# Runs without regard to limits, and within them.
run_forward = _operation(core_engine.run_forward, dynamics.run_forward)
run_heated = _operation(core_engine.run_heated, heat_run.run_heated)
drive_within_limits = _operation(core_engine.drive_within_limits, limited_drive.drive_within_limits)
# Limits of a run, and its energies.
limits_of_steps_w = _operation(core_engine.limits_of_steps_w, dynamics.limits_of_steps_w)
keep_accounts = _operation(core_engine.keep_accounts, dynamics.keep_accounts)
# Plans.
plan_switch = _operation(core_engine.plan_switch, switch_plan.plan_switch)
plan_by_paper = _operation(core_engine.plan_by_paper, switch_plan.plan_by_paper)
find_values = _operation(core_engine.find_values, recursion.find_values)
follow_values = _operation(core_engine.follow_values, recursion.follow_values)
